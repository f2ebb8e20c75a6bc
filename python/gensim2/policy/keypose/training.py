"""Train a keypose policy on planned scenes and write its checkpoint."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import ConfigDict, Field

from gensim2.core.errors import InputError
from gensim2.core.files import write_json
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.core.record_files import Record, read_record
from gensim2.policy.checkpoint import CheckpointError, PolicyCheckpoint
from gensim2.policy.config import PolicyConfig, TrainConfig
from gensim2.policy.keypose.goals import TaskGoal
from gensim2.policy.keypose.source import PlannedSource
from gensim2.policy.train import TrainResult, train_policy

WAYS_JSON = "keypose.json"
"""Name of the file in a checkpoint's folder that describes the classes and the goals of the tasks."""
_REMEDY = "train the policy again"

POLICY = PolicyConfig(
    head="keypose",
    colour=False,
    tool_frame=False,
    joints=False,
    text="none",
    layers=1,
    width=128,
    hidden=256,
    seen_points=128,
    spread_points=64,
    hears=True,
)
"""Network for a single task; it ignores the instruction and trains within minutes on one core."""
TRAINING = TrainConfig(steps=1200, batch=32, learning_rate=2e-3, ema=0.995, threads=1, save_every=200, log_every=25)


class Way(Record):
    """One class of the keypose head.

    Attributes:
        language: instruction of the task.
        step: index of the task step.
        name: name of the strategy.
        to_end: whether the step moves a joint to an end of its range, so that a push may be extended.
    """

    model_config = ConfigDict(frozen=True)

    language: str
    step: int
    name: str
    to_end: bool = False


class WaysRecord(Record):
    """Content of ``keypose.json``.

    Attributes:
        ways: step and strategy that each output class of the network represents. The last class of the network, "done",
            is not listed.
        goals: goal of each task, by the task's instruction. Policies of earlier versions have no goals.
    """

    schema_version: Literal[1] = 1
    ways: list[Way]
    goals: dict[str, TaskGoal] = Field(default_factory=dict)


def train_keypose(
    source: PlannedSource,
    out: Path,
    *,
    policy: PolicyConfig = POLICY,
    training: TrainConfig = TRAINING,
    start: PolicyCheckpoint | None = None,
    resume: bool = False,
    device: str = "cpu",
    progress: Progress = NULL_PROGRESS,
) -> TrainResult:
    """Train a policy with the keypose head and write its checkpoint.

    Args:
        source: planned scenes.
        out: folder of the checkpoint.
        policy: network settings. ``frame`` must be ``turned``, because the policy learns hand poses in the base frame
            turned by the angle of the arm's first joint. The number of classes ``ways`` is taken from the source. If
            the source has several instructions and ``text`` is ``none``, the encoder ``small`` is used.
        training: training settings.
        start: policy to start from; its classes must be the first classes of the source.
        resume: whether to continue an interrupted training run.
        device: device, as for :func:`~gensim2.policy.devices.read_devices`.
        progress: progress display.

    Raises:
        InputError: ``frame`` is not ``turned``, or :func:`gensim2.policy.train.train_policy` cannot use an argument.
    """
    if policy.frame != "turned":
        message = (
            f"must be turned, but is {policy.frame}: poses are taught in the base's frame turned by the first joint"
        )
        raise InputError(message, field="frame")
    text = "small" if len(source.sentences) > 1 and policy.text == "none" else policy.text
    config = PolicyConfig.of({**policy.to_dict(), "ways": len(source.ways), "text": text})
    ways = [
        Way(language=language, step=step, name=name, to_end=(language, step) in source.ways.to_end)
        for language, step, name in source.ways.tasks
    ]
    trained = train_policy(source, config, training, out, start=start, resume=resume, device=device, progress=progress)
    write_json(out / WAYS_JSON, WaysRecord(ways=ways, goals=source.goals).model_dump(mode="json"))
    return trained


def read_ways(folder: Path, policy: PolicyCheckpoint) -> list[Way]:
    """Return the step and strategy that each output class of a checkpoint's network represents.

    Raises:
        CheckpointError: the number of classes differs from the number of network outputs.
        InputError: the file is missing or damaged.
    """
    ways = _read(folder).ways
    if len(ways) + 1 != policy.config.ways:
        message = f"has {len(ways)} ways and done, the network {policy.config.ways} classes"
        raise CheckpointError(message, file=folder / WAYS_JSON, field="ways", remedy=_REMEDY)
    return ways


def read_goals(folder: Path) -> dict[str, TaskGoal]:
    """Return the goals of the tasks that a checkpoint was trained on, by instruction. Policies of earlier versions have
    no goals.

    Raises:
        InputError: the file is missing or damaged.
    """
    return _read(folder).goals


def _read(folder: Path) -> WaysRecord:
    return read_record(folder / WAYS_JSON, WaysRecord, _REMEDY)
