"""Damaged USD and MJCF files are converted or refused in one line; the script ``models.py`` tries hundreds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco")
pytest.importorskip("pxr")

from models import attempt, bases

COUNT = 12


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return bases(tmp_path_factory.mktemp("good"))


@pytest.mark.parametrize("number", range(4), ids=["usda", "usdc", "usdz", "mjcf"])
def test_damaged_models(number: int, good: list[Path], tmp_path: Path) -> None:
    for count in range(COUNT if number == 3 else COUNT // 3):
        place = tmp_path / str(count)
        place.mkdir()
        attempt(good[number], place, np.random.default_rng([7, number, count]))
