"""State of a training on disk: what it takes to go on bit for bit."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import torch
from pydantic import BaseModel, ConfigDict, Field
from torch import nn

from gensim2.errors import InputError
from gensim2.files import write_atomic, write_json
from gensim2.foreign.tree import read_regular, why
from gensim2.record_files import read_record

STATE_JSON = "state.json"
MAX_BYTES = 32 * 2**30
_REMEDY = "delete the folder and train again"


class _Record(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)

    schema_version: Literal[1]
    identity: str
    step: int
    cpu_s: float
    file: str = Field(pattern=r"^state-[0-9a-f]{16}\.safetensors$")
    sha256: str
    losses: list[float] = []
    loss: float | None = None
    settings: dict[str, Any] = {}


@dataclass(frozen=True)
class Identity:
    """Settings and data that determine the result of a training.

    Attributes:
        parts: plain data by name: ``"policy"`` and ``"training"`` by setting, the others as they are.
    """

    parts: Mapping[str, Any]

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the parts, in hexadecimal digits."""
        return _digest(self.parts)

    @property
    def settings(self) -> dict[str, Any]:
        """The settings of policy and training, the digest of the data, and those of what else there is."""
        others = {
            name: _digest(part) for name, part in self.parts.items() if name not in ("policy", "training", "data")
        }
        data = self.parts["data"]
        return {
            **self.parts["policy"],
            **self.parts["training"],
            "data": data["digest"],
            "folders": _digest(data),
            **others,
        }

    def differs_in(self, settings: Mapping[str, Any]) -> list[str]:
        """Names of the settings that are others here; none where ``settings`` is empty.

        Args:
            settings: of another training; those of earlier versions lack what is no setting: it is not compared then.
        """
        mine = json.loads(json.dumps(self.settings))
        names = {*mine, *settings} if "action" in settings else set(settings)
        nowhere = object()
        return sorted(name for name in names if mine.get(name, nowhere) != settings.get(name, nowhere))


def _digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()


@dataclass
class TrainState:
    """Weights, their averages, the optimizer's moments, and where the training is.

    Nothing else has a state: what is drawn in a step follows from the seed and the number of the step.

    Attributes:
        network: that is trained.
        average: exponential moving average of its weights; buffers as they are.
        optimizer: AdamW over the network's parameters.
        step: steps that were taken.
        cpu_s: CPU seconds that they took.
        losses: of the steps since the last point of the curves.
        loss: mean of the last point of the curves; None: there is none, or an earlier version wrote the state.
    """

    network: nn.Module
    average: nn.Module
    optimizer: torch.optim.AdamW
    step: int = 0
    cpu_s: float = 0.0
    losses: list[float] = field(default_factory=list)
    loss: float | None = None

    def save(self, folder: Path, identity: Identity) -> None:
        """Write the state, whole or not at all.

        Args:
            folder: that of the state.
            identity: everything that the training follows from.

        Raises:
            WriteError: the folder cannot be written to.
        """
        from safetensors.torch import save

        tensors = {f"network.{name}": value for name, value in self.network.state_dict().items()}
        tensors |= {f"average.{name}": value for name, value in self.average.state_dict().items()}
        for name, parameter in self.network.named_parameters():
            for key, value in self.optimizer.state.get(parameter, {}).items():
                tensors[f"optimizer.{key}.{name}"] = value
        content = save({name: value.detach().cpu().contiguous().clone() for name, value in tensors.items()})
        digest = hashlib.sha256(content).hexdigest()
        file = f"state-{digest[:16]}.safetensors"
        write_atomic(folder / file, content)
        record = _Record(
            schema_version=1,
            identity=identity.digest,
            step=self.step,
            cpu_s=self.cpu_s,
            file=file,
            sha256=digest,
            losses=self.losses,
            loss=self.loss,
            settings=identity.settings,
        )
        write_json(folder / STATE_JSON, record.model_dump())
        for old in folder.glob("state-*.safetensors"):
            if old.name != file:
                old.unlink()

    def load(self, folder: Path, identity: Identity) -> None:
        """Go on where a state was written.

        Raises:
            InputError: it is damaged, or of another training or version of gensim2.
        """
        from safetensors import SafetensorError
        from safetensors.torch import load

        record = read_record(folder / STATE_JSON, _Record, _REMEDY)
        if record.identity != identity.digest:
            others = identity.differs_in(record.settings)
            message = "is of a training with other settings or data"
            message += f": {', '.join(others)}" if others else ""
            raise InputError(
                message, file=folder / STATE_JSON, remedy="choose another --out, or give the same settings"
            )
        path = folder / record.file
        try:
            content = read_regular(path, MAX_BYTES)
        except OSError as error:
            raise InputError(why(error), file=path, remedy=_REMEDY) from error
        if hashlib.sha256(content).hexdigest() != record.sha256:
            raise InputError("is damaged: its digest is another", file=path, remedy=_REMEDY)
        parts: dict[str, dict[str, torch.Tensor]] = {"network": {}, "average": {}, "optimizer": {}}
        try:
            for name, value in load(content).items():
                part, _, rest = name.partition(".")
                parts[part][rest] = value
            self.network.load_state_dict(parts["network"])
            self.average.load_state_dict(parts["average"])
        except (SafetensorError, KeyError, RuntimeError) as error:
            raise InputError("is of another version of gensim2", file=path, remedy=_REMEDY) from error
        for name, parameter in self.network.named_parameters():
            moments = {
                key: parts["optimizer"][f"{key}.{name}"]
                for key in ("step", "exp_avg", "exp_avg_sq")
                if f"{key}.{name}" in parts["optimizer"]
            }
            if moments:
                # The fused optimizer wants the number of the step where the parameter is, too.
                self.optimizer.state[parameter] = {key: value.to(parameter.device) for key, value in moments.items()}
        self.step, self.cpu_s = record.step, record.cpu_s
        self.losses, self.loss = record.losses, record.loss
