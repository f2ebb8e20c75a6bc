"""Store planned scenes on disk: shards of arrays, written atomically, and a record of the settings."""

from __future__ import annotations

import json
import math
import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field, TypeAdapter

from gensim2.core.errors import InputError
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.core.record_files import Record, parse_record, read_record
from gensim2.core.resumable import ResumableFolder, RunSettings
from gensim2.core.seeding import scene_seeds
from gensim2.perception import ObservationSpec
from gensim2.planning.strategies import CENTERED
from gensim2.policy.array_file import Expected, read_arrays, require_shapes, write_arrays
from gensim2.policy.keypose.goals import TaskGoal
from gensim2.policy.keypose.program import KEYPOSES
from gensim2.policy.keypose.teaching import PATIENCE
from gensim2.rollout.counted_objects import hashes
from gensim2.rollout.inputs import TaskInput
from gensim2.scenes.config import SceneConfig, SceneRecord
from gensim2.scenes.physics import Engines
from gensim2.tasks.criteria import ArticulatedClosed, ArticulatedOpen
from gensim2.tasks.spec import Step
from gensim2.tasks.strategies import Strategies

if TYPE_CHECKING:
    from gensim2.core.processes import Executor

SHARD = 50
"""Number of scenes in a shard."""
RECORD = "data.json"
PURPOSE = "keypose/train"
"""Name from which the seeds of training scenes are derived; benchmarks and evaluations have other names."""


class PlannedRecord(RunSettings):
    """Content of ``data.json``.

    Attributes:
        task: name of the task.
        language: instruction of the task.
        robot: name of the robot profile.
        steps, ways: names of the task steps, and for each step the names of its strategies.
        scene: settings of the scenes.
        observation: observation spec.
        seed: seed of the run.
        identity: digest of task, strategies and objects.
        verified: whether plans were executed in simulation, and scenes with failed plans were left out.
        engines: ``"both"`` if plans were executed in both physics engines, ``"one"`` otherwise.
        to_end: indices of the steps that open or close a joint completely.
        goal: objects and success criteria of the task; None in the records of earlier versions.
    """

    FREE: ClassVar[frozenset[str]] = frozenset({"goal"})

    schema_version: Literal[1] = 1
    task: str
    language: str
    robot: str
    steps: tuple[str, ...]
    ways: tuple[tuple[str, ...], ...]
    scene: SceneRecord
    observation: dict[str, Any]
    seed: int
    identity: str
    verified: bool = False
    engines: Engines = "one"
    to_end: tuple[int, ...] = ()
    goal: TaskGoal | None = None


class _About(Record):
    scenes: int = Field(ge=0)
    failed: dict[str, int]
    cpu_s: float = Field(ge=0)


_SHAPES: dict[str, Expected] = {
    "points": (np.int16, (None, None, 3)),
    "joints": (np.float32, (None, None)),
    "fingers": (np.float32, (None, 2)),
    "positions": (np.float32, (None, KEYPOSES, 3)),
    "rotations": (np.float32, (None, KEYPOSES, 3, 3)),
    "gripper": (np.float32, (None, KEYPOSES + 1)),
    "seconds": (np.float32, (None, KEYPOSES)),
    "force": (np.float32, (None,)),
    "step": (np.int16, (None,)),
    "way": (np.int16, (None,)),
    "seed": (np.int64, (None,)),
}
"""Data type and shape of a shard's arrays (:func:`~gensim2.policy.keypose.examples.example`); each has one row for each
example."""


@dataclass(frozen=True)
class Planned:
    """Planned scenes that are stored in one folder.

    Attributes:
        record: settings of the scenes.
        arrays: training data of all examples. Each array has a name from
            :func:`~gensim2.policy.keypose.examples.example` and one row for each example.
        scenes: number of scenes that were generated.
        failed: number of scenes that were left out, for each reason. A scene is left out if planning fails, or if its
            plans fail in simulation.
        cpu_s: CPU time that the scenes took, s.
    """

    record: PlannedRecord
    arrays: Mapping[str, npt.NDArray[Any]]
    scenes: int
    failed: Mapping[str, int]
    cpu_s: float

    @property
    def refuted(self) -> int:
        """Return the number of scenes whose plans failed in simulation."""
        return sum(count for why, count in self.failed.items() if why.startswith("refuted"))

    @property
    def demonstrations(self) -> int:
        """Return the number of planned steps, each of which is one demonstration."""
        return int((self.arrays["way"] >= 0).sum())


def plan_scenes(
    given: TaskInput,
    spec: ObservationSpec,
    folder: Path,
    executor: Executor,
    *,
    seed: int,
    scenes: int,
    cpu_limit: float | None = None,
    verify: bool = False,
    engines: Engines = "one",
    progress: Progress = NULL_PROGRESS,
) -> Planned:
    """Generate and plan scenes of a task, in addition to the scenes that the folder already has.

    Args:
        folder: folder that contains only the scenes of this task.
        executor: executor that creates the shards; the data do not depend on the kind of executor.
        scenes: maximum number of scenes, rounded up to a multiple of ``SHARD``.
        cpu_limit: CPU time (s) after which no new shard is started.
        verify: whether to simulate the plans and leave out scenes in which they fail; this takes ten times as long as
            planning alone.
        engines: ``"both"`` simulates the plans in both physics engines.

    Raises:
        InputError: the folder contains something else, or scenes with other settings.
        NotRunError: a shard could not be created.
    """
    from gensim2.core.processes import Job, results

    record = record_of(given, spec, seed, verify, engines)
    ResumableFolder(folder, RECORD, record, holds="planned scenes", resume=True, lock=None, alone=False)
    shards = -(-scenes // SHARD)
    seeds = scene_seeds(seed, given.spec.name, PURPOSE, shards * SHARD)
    missing = [number for number in range(shards) if not _shard(folder, number).exists()]
    spent = sum(_cpu_of(_shard(folder, number)) for number in range(shards) if number not in missing)
    done = shards - len(missing)
    progress.start(f"{given.spec.name}: scenes", shards * SHARD)
    progress.advance(done * SHARD)
    jobs = (
        Job(
            number,
            (
                given.scene,
                given.strategies,
                spec,
                seeds[number * SHARD : (number + 1) * SHARD],
                str(folder),
                number,
                verify,
                engines,
            ),
        )
        for number in missing
    )

    def while_there_is_time() -> Any:
        for job in jobs:
            if cpu_limit is not None and spent >= cpu_limit:
                return
            yield job

    for _, cpu_s in results(executor.map_unordered(make_shard, while_there_is_time()), "planned scenes", None):
        spent, done = spent + cpu_s, done + 1
        if cpu_limit is not None:
            # Shards that are running when the limit is reached are finished, so the estimate may be exceeded.
            within = math.ceil(cpu_limit * done / max(spent, 1e-9))
            progress.resize(SHARD * min(shards, max(done, within)))
        progress.advance(SHARD)
    progress.resize(SHARD * done)
    return read_planned(folder)


def make_shard(
    scene: SceneConfig,
    strategies: Strategies,
    spec: ObservationSpec,
    seeds: list[int],
    folder: str,
    number: int,
    verify: bool = False,
    engines: Engines = "one",
) -> float:
    """Create and write one shard in a worker process, and return the CPU time of the shard, s."""
    from gensim2.policy.keypose.examples import draw

    begin = time.process_time()
    examples: list[dict[str, npt.NDArray[Any]]] = []
    failed = Counter[str]()
    for seed in seeds:
        drawn = draw(scene, strategies, spec, seed, verify=verify, engines=engines)
        examples += drawn.examples
        if drawn.failed is not None:
            failed[drawn.failed] += 1
    cpu_s = time.process_time() - begin
    names = list(examples[0]) if examples else []
    arrays: dict[str, Any] = {name: np.stack([each[name] for each in examples]) for name in names}
    about = json.dumps({"scenes": len(seeds), "failed": failed, "cpu_s": cpu_s})
    write_arrays(_shard(Path(folder), number), {"about": np.array(about), **arrays})
    return cpu_s


def record_of(
    given: TaskInput, spec: ObservationSpec, seed: int, verify: bool = False, engines: Engines = "one"
) -> PlannedRecord:
    from gensim2.rollout.identity import digest, listing

    classes = sorted({thing.asset_class for thing in given.spec.objects.values()})
    parts: list[Any] = [given.spec.model_dump(mode="json"), given.strategies, listing(given.library, classes)]
    parts += hashes(given)
    if any(step.tool in given.spec.objects for step in given.spec.steps):
        parts += [CENTERED, PATIENCE]
    return PlannedRecord(
        task=given.spec.name,
        language=given.spec.description,
        robot=given.scene.robot,
        steps=tuple(step.name for step in given.spec.steps),
        ways=tuple(tuple(step.strategies) for step in given.spec.steps),
        scene={**given.scene.options.to_record(), "instances": given.instances},
        observation=spec.to_dict(),
        seed=seed,
        identity=digest(parts),
        verified=verify,
        engines=engines,
        to_end=tuple(number for number, step in enumerate(given.spec.steps) if _is_to_end(step)),
        goal=TaskGoal.of(given.spec),
    )


def _is_to_end(step: Step) -> bool:
    """Return whether every success criterion of a step requires a completely open or completely closed joint."""
    return bool(step.done) and all(isinstance(each, ArticulatedOpen | ArticulatedClosed) for each in step.done)


def read_planned(folder: Path) -> Planned:
    """Read a folder of planned scenes.

    Raises:
        InputError: the folder has no planned scenes, or a file is damaged.
    """
    record = read_record(folder / RECORD, PlannedRecord, "create the data again, in a new folder")
    found, scenes, failed, cpu_s = [], 0, Counter[str](), 0.0
    for path in sorted(folder.glob("shard_*.npz")):
        about, arrays = _read(path)
        scenes, cpu_s = scenes + about.scenes, cpu_s + about.cpu_s
        failed.update(about.failed)
        if arrays:
            found.append(arrays)
    if not found:
        message = f"none of the {scenes} scenes of {record.task} could be planned"
        raise InputError(message, file=folder, remedy="leave the task out")
    sizes = {(each["points"].shape[1], each["joints"].shape[1]) for each in found}
    if len(sizes) > 1:
        raise InputError(
            "the shards have point clouds or joint vectors of different sizes",
            file=folder,
            remedy="create the data again",
        )
    joined = {name: np.concatenate([each[name] for each in found]) for name in found[0]}
    _check_classes(record, joined, folder)
    return Planned(record, joined, scenes, dict(failed), cpu_s)


def _check_classes(record: PlannedRecord, arrays: Mapping[str, npt.NDArray[Any]], folder: Path) -> None:
    """Raise an error if an example belongs to a step or strategy that is not in the record."""
    ways = [len(names) for names in record.ways]
    for step, way in set(zip(arrays["step"].tolist(), arrays["way"].tolist(), strict=True)):
        if way != -1 and not (step in range(len(ways)) and way in range(ways[step])):
            message = f"has an example of strategy {way} of step {step}, and the record has none such"
            raise InputError(message, file=folder / RECORD, field="ways", remedy="create the data again")


def _shard(folder: Path, number: int) -> Path:
    return folder / f"shard_{number:05d}.npz"


def _cpu_of(path: Path) -> float:
    return _read(path)[0].cpu_s


def _read(path: Path) -> tuple[_About, dict[str, npt.NDArray[Any]]]:
    remedy = "remove it and make it again"
    arrays = read_arrays(path)
    told = str(arrays.pop("about", ""))
    about = parse_record(told.encode(errors="surrogateescape"), TypeAdapter(_About), path, remedy, "about")
    require_shapes(arrays, _SHAPES if arrays else {}, path)
    if arrays.keys() - _SHAPES:
        message = f"the file contains an array with the unknown name {min(arrays.keys() - _SHAPES)!r}"
        raise InputError(message, file=path, remedy=remedy)
    return about, arrays
