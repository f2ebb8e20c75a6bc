"""Save and load the state of a training run, so that a resumed run gives the same result."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, Self

import torch
from pydantic import ConfigDict, Field
from torch import nn

from gensim2.core.errors import InputError
from gensim2.core.files import remove, write_atomic, write_json
from gensim2.core.foreign.tensors import Shape, read_shapes, read_tensors, require_shapes
from gensim2.core.record_files import read_record
from gensim2.core.resumable import RunSettings, differing

STATE_JSON = "state.json"
MAX_BYTES = 32 * 2**30
_REMEDY = "delete the folder and train again"


class _Record(RunSettings):
    model_config = ConfigDict(extra="forbid", strict=True)

    schema_version: Literal[1]
    identity: str
    step: int = Field(ge=0)
    cpu_s: float = Field(ge=0)
    file: str = Field(pattern=r"^state-[0-9a-f]{16}\.safetensors$")
    sha256: str
    losses: list[float] = Field(default_factory=list)
    loss: float | None = None
    settings: dict[str, Any] = Field(default_factory=dict)

    def differences(self, now: Self) -> Iterator[tuple[str, str]]:
        """Yield the settings that differ from ``now``. Settings that earlier versions did not record are left out."""
        if self.identity == now.identity:
            return
        theirs = json.loads(json.dumps(now.settings))
        if "action" not in self.settings:
            theirs = {name: theirs.get(name) for name in self.settings}
        yield from differing("settings", self.settings, theirs)
        yield from differing("identity", self.identity, now.identity)


@dataclass(frozen=True)
class Identity:
    """Settings and data that determine the result of a training run.

    Attributes:
        parts: plain data by name. All settings of ``"policy"`` and ``"training"`` are stored, and the SHA-256 of other
            parts.
    """

    parts: Mapping[str, Any]

    @cached_property
    def digest(self) -> str:
        """SHA-256 of all parts, in hexadecimal digits."""
        return _digest(self.parts)

    @property
    def settings(self) -> dict[str, Any]:
        """Return the settings of policy and training, and the SHA-256 of every other part."""
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


def _digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()


@dataclass
class TrainState:
    """Weights, averaged weights, optimizer moments, and progress of a training run.

    This is the complete state, because the random numbers of a step depend only on seed and step number.

    Attributes:
        average: network with the exponential moving average of the weights, and copies of ``network``'s buffers.
        optimizer: AdamW over the network's parameters.
        step: number of steps taken.
        cpu_s: CPU time of these steps, s.
        losses: losses since the last logged point of the loss curve.
        loss: mean loss at the last logged point; None if there is no point, or in states of earlier versions.
    """

    network: nn.Module
    average: nn.Module
    optimizer: torch.optim.AdamW
    step: int = 0
    cpu_s: float = 0.0
    losses: list[float] = field(default_factory=list)
    loss: float | None = None

    def save(self, folder: Path, identity: Identity) -> None:
        """Write the state atomically.

        Args:
            identity: settings and data that determine the result of the run.

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
        write_json(folder / STATE_JSON, self._record(identity, file, digest).model_dump())
        for old in folder.glob("state-*.safetensors"):
            if old.name != file:
                remove(old)

    def load(self, folder: Path, identity: Identity) -> None:
        """Load a state to resume from.

        Raises:
            InputError: the state is damaged, or belongs to another training run or to another version of gensim2.
        """
        record = read_record(folder / STATE_JSON, _Record, _REMEDY)
        record.require_same(self._record(identity, record.file, record.sha256), folder / STATE_JSON)
        if record.step > (steps := identity.parts["training"]["steps"]):
            message = f"is {record.step} of a training of {steps} steps"
            raise InputError(message, file=folder / STATE_JSON, field="step", remedy=_REMEDY)
        path = folder / record.file
        try:
            require_shapes(path, found := read_shapes(path, MAX_BYTES, _REMEDY), self._shapes(found), _REMEDY)
        except InputError as error:
            message = f"is of another version of gensim2, or is damaged: {error.message}"
            raise InputError(message, file=path, remedy=_REMEDY) from error
        parts: dict[str, dict[str, torch.Tensor]] = {"network": {}, "average": {}, "optimizer": {}}
        for name, value in read_tensors(path, MAX_BYTES, record.sha256, _REMEDY).items():
            part, _, rest = name.partition(".")
            parts[part][rest] = value
        self.network.load_state_dict(parts["network"])
        self.average.load_state_dict(parts["average"])
        for name, parameter in self.network.named_parameters():
            moments = {
                key: parts["optimizer"][f"{key}.{name}"]
                for key in ("step", "exp_avg", "exp_avg_sq")
                if f"{key}.{name}" in parts["optimizer"]
            }
            if moments:
                # The fused optimizer needs the step number on the parameter's device, too.
                self.optimizer.state[parameter] = {key: value.to(parameter.device) for key, value in moments.items()}
        self.step, self.cpu_s = record.step, record.cpu_s
        self.losses, self.loss = record.losses, record.loss

    def _record(self, identity: Identity, file: str, digest: str) -> _Record:
        return _Record(
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

    def _shapes(self, found: Mapping[str, Shape]) -> dict[str, Shape]:
        """Return the shapes in a saved state: weights, averages, and Adam moments of parameters once updated."""
        modules = {"network": self.network, "average": self.average}
        shapes = {
            f"{part}.{name}": Shape.of(value)
            for part, module in modules.items()
            for name, value in module.state_dict().items()
        }
        for name, parameter in self.network.named_parameters():
            if f"optimizer.step.{name}" in found:
                shapes |= {f"optimizer.{key}.{name}": Shape.of(parameter) for key in ("exp_avg", "exp_avg_sq")}
                shapes[f"optimizer.step.{name}"] = Shape("F32", ())
        return shapes
