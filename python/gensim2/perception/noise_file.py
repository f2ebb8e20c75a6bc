"""Depth noise by name, or from the file that ``gensim2 robot fit-noise`` writes."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict

from gensim2.core.errors import InputError
from gensim2.core.record_files import read_record
from gensim2.perception.noise import PRESETS, DepthNoise

REMEDY = "make it anew with gensim2 robot fit-noise"


class NoiseFile(BaseModel):
    """Fitted parameters on the disk."""

    model_config = ConfigDict(extra="forbid")

    schema_version: Literal[1] = 1
    noise: dict[str, float | bool]
    told: dict[str, int]


def read_noise(name: str | Path) -> DepthNoise:
    """Noise by name (``white``, ``d435``, ``deployed``), or from a file that ``gensim2 robot fit-noise`` wrote.

    Raises:
        InputError: there is none, or a parameter cannot be so.
    """
    if str(name) in PRESETS:
        return PRESETS[str(name)]
    found = read_record(Path(name), NoiseFile, REMEDY)
    try:
        return DepthNoise(**found.noise)  # type: ignore[arg-type]
    except TypeError as error:
        raise InputError(str(error), file=name, field="noise", remedy=REMEDY) from error
    except InputError as error:
        raise InputError(error.message, file=name, field=error.field, remedy=REMEDY) from error
