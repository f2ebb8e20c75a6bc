"""Provide the training plans of tasks that a keypose policy already knows, so that the policy does not forget these
tasks when it learns additional ones.

``gensim2 learn`` stores the plans in the policy's folder. The builtin policy is distributed without plans. Its tasks
are planned again, which is possible because they use only generated objects.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from gensim2.core.errors import InputError
from gensim2.core.files import new_folder
from gensim2.core.foreign.tree import ForeignTree
from gensim2.core.plural import plural
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
"""Name of the folder with a policy's training plans; it has a subfolder for each task."""
BESIDE = ".generated"
"""Suffix of a task's second folder of plans, with generated objects."""
REHEARSED = 50
"""Number of scenes planned again for each known task, so that the policy does not forget it; about 4 s of CPU time.
"""
REMEDY = "give a folder that gensim2 learn has made"


def is_packaged(start: Path) -> bool:
    """Return whether a folder is the builtin policy's folder."""
    return start.resolve() == checkpoint_folder(BUILTIN).resolve()


def taught_before(start: Path, known: Sequence[str], *, seed: int, **scene: Unpack[SceneArguments]) -> list[TaskInput]:
    """Return the tasks that a policy was trained on, each with its training objects. A task is left out if its training
    objects are not in the object library that ``scene`` selects.

    Args:
        start: folder of the policy, as written by ``gensim2 learn``.
        known: names of the tasks that the policy knows.

    Raises:
        InputError: the folder has no plans.
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
    """Copy a policy's training plans to the folder of another policy, and return the plans in the order of ``known``.

    Args:
        start: folder of the policy, as written by ``gensim2 learn``.
        folder: folder of the other policy.
        known: names of the tasks that the first policy knows.

    Raises:
        InputError: the folder has no plans.
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
    """Return the tasks of a policy whose training plans are missing and must be made again.

    Only the builtin policy is distributed without plans, so the function returns all tasks of the builtin policy. For
    any other policy it returns an empty list.

    Args:
        start: folder of the policy.
        objects: number of generated objects of each class.
        scene: see :class:`~gensim2.scenes.config.SceneArguments`; objects named in these arguments are ignored.

    Raises:
        InputError: the task library lacks a strategy that the policy was trained with.
    """
    if not is_packaged(start):
        return []
    generated: dict[str, Any] = {**scene, "assets": GENERATED, "instances": "all"}
    found = [pulls_last(read_task_input(name, seed=seed, **generated)) for name in begun.data.tasks]
    ways = read_ways(start, begun)
    taught = [_as_taught(one, [way for way in ways if way.language == one.spec.description], start) for one in found]
    return all_with_objects(taught, objects, seed)


def _as_taught(one: TaskInput, ways: Sequence[Way], start: Path) -> TaskInput:
    """Return the task with only the strategies that the policy was trained with."""
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
    """Plan scenes of the tasks that a policy already knows, so that further training does not degrade the policy on
    these tasks.

    Args:
        known: tasks that the policy knows.
        folder: folder of the new policy.
        executor: executor that runs the shards of scenes.

    Returns:
        The plans by task, and the CPU time of planning, s.
    """
    planned = [
        plan_scenes(one, spec, folder / DATA / one.spec.name, executor, seed=seed, scenes=REHEARSED, progress=progress)
        for one in known
    ]
    count, spent = sum(each.demonstrations for each in planned), sum(each.cpu_s for each in planned)
    progress.message(
        f"{plural(len(known), 'task')} of the policy planned again: {plural(count, 'plan')}, {spent:.0f} s of CPU"
    )
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
    """Return versions of the tasks that use generated objects in place of the objects of the asset folder.

    The policy trains on both versions of a task, so the generated objects are additional training objects.

    Args:
        tasks: names or folders of the tasks.
        given: the same tasks with the objects of the asset folder.
        count: number of generated objects of each class.
        progress: progress listener. It gets a message for each task that cannot use generated objects.
        scene: see :class:`~gensim2.scenes.config.SceneArguments`; objects named in these arguments are ignored.

    Raises:
        InputError: the tasks in ``given`` already use generated objects, or none of the tasks can use generated
            objects.
    """
    if any(one.scene.assets == GENERATED for one in given):
        message = "adds generated objects to a folder's objects, but the tasks already use generated objects"
        remedy = "give a folder with --assets, or set the number of generated objects with --objects"
        raise InputError(message, field="generated", remedy=remedy)
    found = []
    for task, one in zip(tasks, given, strict=True):
        try:
            found.append(generated_input(task, count, seed=seed, **scene))
        except InputError as error:
            progress.message(f"{one.spec.name}: trained without generated objects, {error.message}")
    if not found:
        message = "none of these tasks can use generated objects"
        raise InputError(message, field="generated", remedy="leave it out")
    return found


def generated_input(task: str, count: int, *, seed: int, **scene: Unpack[SceneArguments]) -> TaskInput:
    """Return a task with generated objects.

    Args:
        task: name or folder.
        count: number of objects of each class.
        scene: see :class:`~gensim2.scenes.config.SceneArguments`; objects named there are ignored.

    Raises:
        InputError: generated objects do not suit the task, or all of its objects are rigid.
    """
    generated: dict[str, Any] = {**scene, "assets": GENERATED, "instances": "all"}
    return with_objects(read_task_input(task, seed=seed, **generated), count, seed)


def _plans(start: Path, name: str) -> list[Path]:
    """Return the folders that contain the training plans of a task. The folder with plans for generated objects comes
    last.

    Raises:
        InputError: the policy's folder has no plans for the task, or has a symbolic link that leads out of the folder.
    """
    folder, beside = (ForeignTree(start).inside(f"{DATA}/{name}{end}") for end in ("", BESIDE))
    if not folder.is_dir():
        raise InputError("the folder lacks the plans that the policy was trained on", file=folder, remedy=REMEDY)
    return [folder, *([beside] if beside.is_dir() else [])]
