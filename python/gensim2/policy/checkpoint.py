"""Save and load checkpoints: a folder with ``config.json`` and a safetensors file, without executable content.

``config.json`` is written last and has the name and the SHA-256 of the weights file. Therefore a reader sees either the
old or the new checkpoint.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from gensim2.core.errors import InputError
from gensim2.core.files import write_json
from gensim2.core.foreign.tensors import Shape, only_shapes, read_shapes, read_tensors, require_shapes
from gensim2.core.record_files import Record, read_record
from gensim2.core.weights import Digest, FileName, remove_other_weights, write_weights
from gensim2.data.record import TaskName
from gensim2.perception import ObservationSpec
from gensim2.policy.config import CLIP, PRETRAINED, SENTENCE, PolicyConfig, TrainConfig
from gensim2.robots import robot_key

if TYPE_CHECKING:
    import torch

    from gensim2.policy.network import PolicyNetwork

CONFIG_JSON = "config.json"
KIND: Literal["gensim2-policy"] = "gensim2-policy"
VERSION = 1
MAX_WEIGHTS = 8 * 2**30  # maximum size of the weights, bytes

BUILTIN = "builtin"
"""Name of the checkpoint that comes with the package: a keypose policy for the single-step tasks."""

_REMEDY = f"give the folder of a policy that `gensim2 learn` or `train` made, or {BUILTIN!r}"
_NETWORK, _TABLE = "network.", "sentences"


def checkpoint_folder(place: Path | str) -> Path:
    """Return a checkpoint's folder; ``"builtin"`` stands for the checkpoint that comes with the package.

    To use a folder that is named ``builtin``, give ``./builtin`` or ``Path("builtin")``.
    """
    return Path(__file__).parent / BUILTIN if place == BUILTIN else Path(place)


class CheckpointError(InputError):
    """A checkpoint is damaged, has another version, or does not fit the robot, the task or the command."""


class DataRecord(Record):
    """Description of a policy's training data.

    Attributes:
        digest: hash of all episodes and their observations.
        episodes, frames: number of episodes and number of their frames. A planned scene counts as one frame.
        noisy: number of episodes recorded with noise on the arm's commands.
        relabels: number of additional frames from rollouts of the policy, with actions of the planner (DAgger).
    """

    model_config = ConfigDict(frozen=True)

    digest: str
    tasks: tuple[TaskName, ...] = Field(strict=False)
    episodes: int
    frames: int
    folders: tuple[str, ...] = Field(strict=False)
    noisy: int = 0
    relabels: int = 0


class ActionSpec(Record):
    """Format of a policy's output.

    Attributes:
        kind: ``joint-relative`` for chunks of actions (:mod:`gensim2.policy.heads.actions`), or ``keypose``.
        arm: m, number of the arm's joints.
        control_hz: rate of the actions, Hz.
    """

    model_config = ConfigDict(frozen=True)

    kind: Literal["joint-relative", "keypose"]
    arm: int = Field(ge=1, le=64)
    control_hz: int = Field(ge=1, le=10_000)


class _Weights(Record):
    file: FileName
    sha256: Digest


class _CheckpointRecord(Record):
    schema_version: int
    kind: Literal["gensim2-policy"]
    policy: dict[str, Any]
    training: dict[str, Any]
    step: int
    robot: str
    action: ActionSpec
    observation: dict[str, Any]
    sentences: list[str]
    data: DataRecord
    versions: dict[str, str]
    weights: _Weights


class _Version(BaseModel):
    """Fields that ``config.json`` has in every version of the format."""

    model_config = ConfigDict(extra="allow", strict=True)

    schema_version: int
    kind: Literal["gensim2-policy"]


@dataclass(frozen=True, eq=False)
class PolicyCheckpoint:
    """A trained policy with everything needed to run it.

    Attributes:
        network: the network with its weights; :meth:`load` returns it on the CPU in evaluation mode.
        robot: name of the robot profile.
        action: format of the output.
        observation: observations that the policy needs.
        sentences: the S different instructions in the training data.
        table: (S, ...) encoded ``sentences``, with one row for each; see :func:`gensim2.policy.text.prepare`.
        data: description of the training data.
        training: training settings.
        step: number of gradient steps taken.
        versions: versions of the packages used for training.
    """

    network: PolicyNetwork
    robot: str
    action: ActionSpec
    observation: ObservationSpec
    sentences: tuple[str, ...]
    table: torch.Tensor
    data: DataRecord
    training: TrainConfig
    step: int
    versions: dict[str, str] = field(default_factory=dict)

    @property
    def config(self) -> PolicyConfig:
        return self.network.config

    def save(self, folder: Path) -> None:
        """Write the checkpoint atomically.

        Raises:
            WriteError: the folder cannot be written to.
        """
        tensors = {_NETWORK + name: value.detach().cpu() for name, value in self.network.state_dict().items()}
        tensors[_TABLE] = self.table.cpu()
        name, digest = write_weights(folder, {name: value.contiguous().clone() for name, value in tensors.items()})
        record = _CheckpointRecord(
            schema_version=VERSION,
            kind=KIND,
            policy=self.config.to_dict(),
            training=self.training.to_dict(),
            step=self.step,
            robot=self.robot,
            action=self.action,
            observation=self.observation.to_dict(),
            sentences=list(self.sentences),
            data=self.data,
            versions=self.versions,
            weights=_Weights(file=name, sha256=digest),
        )
        write_json(folder / CONFIG_JSON, record.model_dump(mode="json"))
        remove_other_weights(folder, name)

    @staticmethod
    def load(folder: Path | str) -> PolicyCheckpoint:
        """Read a checkpoint.

        Args:
            folder: folder of the checkpoint, or ``"builtin"`` for the checkpoint that comes with the package.

        Raises:
            CheckpointError: the checkpoint is damaged, or another version of gensim2 wrote it.
            InputError: the folder has no checkpoint, or ``config.json`` has an invalid field.
        """
        folder = checkpoint_folder(folder)
        file = folder / CONFIG_JSON
        version = read_record(file, _Version, _REMEDY).schema_version
        if version != VERSION:
            message = f"is {version}, but this version of gensim2 reads files with schema version {VERSION}"
            raise CheckpointError(
                message, file=file, field="schema_version", remedy="use the version of gensim2 that wrote the file"
            )
        record = read_record(file, _CheckpointRecord, _REMEDY)
        config = PolicyConfig.of(record.policy, file=str(file))
        try:
            observation = ObservationSpec.of(record.observation)
        except (InputError, TypeError) as error:
            message = f"is no observation spec: {error}"
            raise CheckpointError(message, file=file, field="observation", remedy=_REMEDY) from error
        _check_agreement(record, config, observation, file)
        try:
            network, table = _read_weights(folder / record.weights.file, config, record)
        except CheckpointError:
            raise
        except InputError as error:
            raise CheckpointError(error.message, file=error.file, field=error.field, remedy=error.remedy) from error
        return PolicyCheckpoint(
            network,
            record.robot,
            record.action,
            observation,
            tuple(record.sentences),
            table,
            record.data,
            TrainConfig.of(record.training, file=str(file)),
            record.step,
            record.versions,
        )

    def require_robot(self, robot: str, folder: Path | str) -> None:
        """Check that the policy was trained for a robot.

        Raises:
            CheckpointError: the policy was trained for another robot.
            InputError: the robot that the policy was trained for is not registered in this process.
        """
        if robot != self.robot:
            robot_key(self.robot)
            message = f"is for the robot {self.robot!r}, not for {robot!r}"
            raise CheckpointError(message, file=folder, field="robot", remedy=f"use --robot {self.robot}")

    def require_text_model(self, given: str | None, folder: Path | str) -> None:
        """Check that the checkpoint's text encoder may be loaded. The weights of the encoder must be a default of
        gensim2, or the user must have named them. Otherwise a downloaded checkpoint could start further downloads.

        Args:
            given: folder or Hugging Face name of the text encoder's weights, as given by the user, or None.
            folder: the checkpoint's folder, for the message.

        Raises:
            CheckpointError: the weights of the text encoder are neither a default of gensim2 nor ``given``.
        """
        if self.config.text in PRETRAINED and self.config.text_model not in (CLIP, SENTENCE, given):
            message = f"names the weights {self.config.text_model!r}, which a checkpoint alone does not load"
            remedy = "give them with --text-model if they are your own"
            raise CheckpointError(message, file=folder, field="policy.text_model", remedy=remedy)

    def row_of(self, sentence: str, folder: Path | str) -> torch.Tensor:
        """Return the encoded instruction (1, ...) of a sentence.

        Raises:
            CheckpointError: the policy was not trained on the sentence.
        """
        if sentence in self.sentences:
            index = self.sentences.index(sentence)
            return self.table[index : index + 1]
        if self.config.text == "none":
            return self.table[:1]
        raise unknown_sentence(self, sentence, folder)


def _check_agreement(record: _CheckpointRecord, config: PolicyConfig, observation: ObservationSpec, file: Path) -> None:
    """Check that the sections of ``config.json`` are consistent."""
    of_keyposes = config.head == "keypose"
    contradictions = {
        "action.kind": (record.action.kind == "keypose") is not of_keyposes,
        "policy.points": config.points is not None and config.points != observation.cloud.points,
        "policy.encoder": config.source != observation.cloud.source,
        "sentences": not record.sentences,
    }
    for name, wrong in contradictions.items():
        if wrong:
            message = "contradicts the rest of the checkpoint"
            raise CheckpointError(message, file=file, field=name, remedy=_REMEDY)


def _read_weights(path: Path, config: PolicyConfig, record: _CheckpointRecord) -> tuple[PolicyNetwork, torch.Tensor]:
    """Return the network with its weights, in evaluation mode, and the table of encoded instructions."""
    from gensim2.policy.network import PolicyNetwork
    from gensim2.policy.text import check_table, table_shape

    found = read_shapes(path, MAX_WEIGHTS, _REMEDY)
    of_table = table_shape(config, len(record.sentences), found.get(_TABLE))
    require_shapes(path, {_TABLE: found[_TABLE]} if _TABLE in found else {}, {_TABLE: of_table}, _REMEDY)
    with only_shapes(list(found.values()), path, _REMEDY):
        network = PolicyNetwork(config, record.action.arm, of_table.shape[1:])
    shapes = {_NETWORK + name: Shape.of(value) for name, value in network.state_dict().items()}
    require_shapes(path, found, {_TABLE: of_table, **shapes}, _REMEDY)
    tensors = read_tensors(path, MAX_WEIGHTS, record.weights.sha256, _REMEDY)
    table = tensors.pop(_TABLE)
    check_table(table, config, path)
    network.load_state_dict({name.removeprefix(_NETWORK): value for name, value in tensors.items()})
    return network.eval(), table


def unknown_sentence(
    policy: PolicyCheckpoint, sentence: str, folder: Path | str, reason: str | None = None
) -> CheckpointError:
    """Create the error to raise for an instruction that the policy was not trained on.

    Args:
        sentence: the instruction.
        reason: steps of the instruction, or the reason why the instruction is not understood.
    """
    message = f"was not trained on the sentence {sentence!r}" + (f" ({reason})" if reason else "")
    remedy = f"train on the task; it knows {', '.join(policy.data.tasks)}"
    return CheckpointError(message, file=folder, field="sentences", remedy=remedy)
