"""Plans of the tasks that a keypose policy knows already, for one that is to know more.

``learn`` leaves them beside the policy. The package's own policy comes without: its tasks are planned again, on
generated objects, which are all that it was taught on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from gensim2.core.errors import InputError
from gensim2.core.files import new_folder
from gensim2.core.foreign.tree import ForeignTree
from gensim2.core.progress import Progress
from gensim2.core.record_files import read_record
from gensim2.objects.library.catalogue import BUILTIN as GENERATED
from gensim2.perception import ObservationSpec
from gensim2.policy.checkpoint import BUILTIN, PolicyCheckpoint, checkpoint_folder
from gensim2.policy.keypose.data import RECORD, Planned, PlannedRecord, plan_scenes, read_planned
from gensim2.policy.keypose.teaching import pulls_last
from gensim2.policy.keypose.training import WAYS_JSON, Way, read_ways
from gensim2.rollout.counted_objects import all_with_objects, is_counted, with_objects
from gensim2.rollout.inputs import TaskInput, read_task_input, scene_options
from gensim2.scenes.config import SceneArguments
from gensim2.tasks.strategies import with_strategies

if TYPE_CHECKING:
    from gensim2.core.processes import Executor

DATA = "data"
"""Folder of a learned policy that holds the plans which taught it, a folder a task."""
BESIDE = ".generated"
"""End of the name of a second folder of a task, of plans on generated objects beside those of a library."""
REHEARSED = 50
"""Scenes of a task that are planned again, in some four seconds of CPU, so that a policy forgets little of what it
knows."""
REMEDY = "give a folder that gensim2 learn has made"


def is_packaged(start: Path) -> bool:
    """Whether a policy is the package's own."""
    return start.resolve() == checkpoint_folder(BUILTIN).resolve()


def taught_before(start: Path, known: Sequence[str], *, seed: int, **scene: Unpack[SceneArguments]) -> list[TaskInput]:
    """Tasks of a policy with the listed objects of this library that they were taught on; others are left out.

    Args:
        start: folder of the policy, as ``gensim2 learn`` left it.
        known: names of the policy's tasks.
        seed: of the run.
        scene: see :class:`~gensim2.scenes.config.SceneArguments`.

    Raises:
        InputError: the policy has no plans beside it.
    """
    if is_packaged(start):
        return []
    found, here = [], scene_options(**scene).to_record()["assets"]
    for name in known:
        was = read_record(_plans(start, name)[0] / RECORD, PlannedRecord, REMEDY).scene
        if was["assets"] == here and not is_counted(was["instances"]):
            found.append(read_task_input(name, seed=seed, **{**scene, "instances": was["instances"]}))
    return found


def take_along(start: Path, folder: Path, known: Sequence[str]) -> list[Planned]:
    """Copy the plans that taught a policy to another, and return them in the order of its tasks.

    Args:
        start: folder of the policy, as ``gensim2 learn`` left it.
        folder: of the other.
        known: names of the policy's tasks.

    Raises:
        InputError: the policy has no plans beside it.
    """
    found = []
    for there in (each for name in known for each in _plans(start, name)):
        here = folder / DATA / there.name
        if not here.exists():
            here.parent.mkdir(parents=True, exist_ok=True)
            with new_folder(here) as made:
                ForeignTree(there).copy_all(made)
        found.append(read_planned(here))
    return found


def tasks_to_plan_again(
    start: Path, begun: PolicyCheckpoint, objects: int, *, seed: int, **scene: Unpack[SceneArguments]
) -> list[TaskInput]:
    """Tasks of the package's policy with generated objects that no library lists; none for any other policy.

    Args:
        start: folder of the policy.
        begun: the policy.
        objects: number of each class.
        seed: of the run.
        scene: see :class:`~gensim2.scenes.config.SceneArguments`; its objects are not asked for.

    Raises:
        InputError: the library lacks a strategy that taught the policy.
    """
    if not is_packaged(start):
        return []
    generated: dict[str, Any] = {**scene, "assets": GENERATED, "instances": "all"}
    found = [pulls_last(read_task_input(name, seed=seed, **generated)) for name in begun.data.tasks]
    ways = read_ways(start, begun)
    taught = [_as_taught(one, [way for way in ways if way.language == one.spec.description], start) for one in found]
    return all_with_objects(taught, objects, seed)


def _as_taught(one: TaskInput, ways: Sequence[Way], start: Path) -> TaskInput:
    """The task done by the strategies that taught the policy; the library may have more by now."""
    here = [(number, name) for number, step in enumerate(one.spec.steps) for name in step.strategies]
    was = [(way.step, way.name) for way in ways]
    if not set(was) <= set(here) or len({number for number, _ in was}) < len(one.spec.steps):
        message = f"{one.spec.name} was taught by {_names(was)}, the library has {_names(here)}"
        raise InputError(message, file=start / WAYS_JSON, field="ways", remedy=REMEDY)
    by = {
        step.name: {name: one.strategies[name] for at, name in was if at == number}
        for number, step in enumerate(one.spec.steps)
    }
    return replace(one, scene=replace(one.scene, task=with_strategies(one.spec, by)))


def _names(ways: Sequence[tuple[int, str]]) -> str:
    return ", ".join(name for _, name in ways)


def plan_again(
    known: Sequence[TaskInput],
    spec: ObservationSpec,
    folder: Path,
    executor: Executor,
    *,
    seed: int,
    progress: Progress,
) -> tuple[list[Planned], float]:
    """Plan some scenes of each task that a policy knows, so that it does not forget them.

    Args:
        known: the tasks.
        spec: what is seen.
        folder: of the policy that is to know more.
        executor: runs the shards.
        seed: of the run.
        progress: listener.

    Returns:
        The plans by task, and the CPU seconds that they took.
    """
    planned = [
        plan_scenes(one, spec, folder / DATA / one.spec.name, executor, seed=seed, scenes=REHEARSED, progress=progress)
        for one in known
    ]
    count, spent = sum(each.demonstrations for each in planned), sum(each.cpu_s for each in planned)
    progress.message(f"{len(known)} tasks of the policy planned again: {count} plans, {spent:.0f} s of CPU")
    return planned, spent


def inputs_beside(
    tasks: Sequence[str],
    given: Sequence[TaskInput],
    count: int,
    progress: Progress,
    *,
    seed: int,
    **scene: Unpack[SceneArguments],
) -> list[TaskInput]:
    """Tasks with generated objects that no library lists, beside the objects that they are given with.

    Args:
        tasks: names or folders.
        given: the same with their objects, a folder's.
        count: number of generated ones of each class.
        progress: is told which tasks generated objects do not do for, and why; these are left out.
        seed: of the run.
        scene: see :class:`~gensim2.scenes.config.SceneArguments`; its objects are not asked for.

    Raises:
        InputError: the objects that they are given with are generated ones, or these do for no task.
    """
    if any(one.scene.assets == GENERATED for one in given):
        message = "are beside the objects of a folder"
        raise InputError(message, field="generated", remedy="give a folder with --assets, or --objects")
    found = []
    for task, one in zip(tasks, given, strict=True):
        try:
            found.append(generated_input(task, count, seed=seed, **scene))
        except InputError as error:
            progress.message(f"{one.spec.name}: taught without generated objects, {error.message}")
    if not found:
        message = "none of these tasks can be taught on generated objects"
        raise InputError(message, field="generated", remedy="leave it out")
    return found


def generated_input(task: str, count: int, *, seed: int, **scene: Unpack[SceneArguments]) -> TaskInput:
    """A task with generated objects that no library lists.

    Args:
        task: name or folder.
        count: number of objects of each class.
        seed: of the run.
        scene: see :class:`~gensim2.scenes.config.SceneArguments`; its objects are not asked for.

    Raises:
        InputError: they do not do for it, or all of its objects are rigid.
    """
    generated: dict[str, Any] = {**scene, "assets": GENERATED, "instances": "all"}
    return with_objects(read_task_input(task, seed=seed, **generated), count, seed)


def _plans(start: Path, name: str) -> list[Path]:
    """Folders of plans of a task, that of generated objects beside others last."""
    folder = start / DATA / name
    if not folder.is_dir():
        raise InputError("the plans that taught it are not beside it", file=folder, remedy=REMEDY)
    beside = start / DATA / f"{name}{BESIDE}"
    return [folder, *([beside] if beside.is_dir() else [])]
