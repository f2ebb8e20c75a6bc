"""Read and check the inputs of commands before anything starts.

Fast checks of files, fields and names come first, then checks that load an object of each class.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Unpack

from gensim2.core.errors import InputError, brief, near
from gensim2.core.seeding import check_seed, rng
from gensim2.objects import ArticulatedObject, Library, open_library
from gensim2.objects.library.selection import object_of_ids, taken_instances, words_of_objects
from gensim2.planning.config import ObjectNames, check_strategies
from gensim2.planning.strategies import parse_strategy
from gensim2.robots import robot as profile
from gensim2.rollout.config import TRUE_SCENE, RolloutOptions, RunArguments
from gensim2.rollout.controller_spec import planner_spec
from gensim2.scenes.config import SceneConfig, SceneOptions, split_arguments
from gensim2.tasks.library import (
    PAPER,
    load_strategies,
    load_strategies_beside,
    load_task,
    load_task_file,
    strategy_files,
    task_folder,
    task_names,
)
from gensim2.tasks.spec import TaskSpec
from gensim2.tasks.strategies import Strategies, with_strategies


@dataclass(frozen=True)
class TaskInput:
    """A checked task: the task is valid, its objects exist, and its strategies name only existing keypoints.

    Attributes:
        scene: settings of the task's scenes.
        instances: selection of the task's objects: ``"all"``, ``"train"``, ``"test"``, ``"new"`` or an id.
        strategies: strategies by name, as plain data.
        library: library of the task's objects.
        rollout: options of the task's episodes.
    """

    scene: SceneConfig
    instances: str
    strategies: Strategies
    library: Library
    rollout: RolloutOptions

    @property
    def spec(self) -> TaskSpec:
        return self.scene.task


def read_task_input(task: str, *, seed: int = 0, **given: Unpack[RunArguments]) -> TaskInput:
    """Read and check a task.

    Args:
        task: name of a library task, or a folder with task.yaml and strategies/ (or solver.yaml, version 1).
        given: see :class:`~gensim2.rollout.config.RunArguments`.

    Raises:
        InputError: an input is invalid; the message names the file and the field, or the argument.
    """
    seed = check_seed(seed)
    options = scene_options(**given)
    spec, strategies = task_and_strategies(task)
    folder = Path(task) if _is_folder(task) else None
    library = open_library(options.assets)
    for role, thing in spec.objects.items():
        try:
            library.instances(thing.asset_class)
        except InputError as error:
            file = folder / "task.yaml" if folder else None
            raise InputError(error.message, file=file, field=f"objects.{role}.class", remedy=error.remedy) from error
    word = chosen_word(spec, library, instances_word(**given), seed)
    files = {name: str(file) for name, file in strategy_files(folder or task_folder(spec.name), spec).items()}
    check_strategies(
        spec,
        {name: parse_strategy(data, files[name]) for name, data in strategies.items()},
        _object_names(spec, library, word),
        profile(options.robot),
        files,
    )
    rollout = RolloutOptions(
        open_loop=given.get("open_loop", False),
        scene_source=given.get("scene_source", TRUE_SCENE),
        depth_noise=given.get("depth_noise"),
    )
    return TaskInput(options.with_task(spec, word), word, strategies, library, rollout)


def check_scene_source(given: TaskInput) -> str | None:
    """Check that the planner can get its scene.

    An estimated scene needs an estimator; otherwise the scene is the simulator's.

    Returns:
        Hash that identifies the planner with its estimator, if the scene is estimated; None for the true scene.

    Raises:
        InputError: the estimator cannot be read, or it cannot estimate the scene of this task.
        MissingExtraError: PyTorch is not installed.
    """
    if not given.rollout.is_estimated:
        return None
    spec = planner_spec(given.spec, given.strategies, given.rollout, given.scene.robot)
    spec.make()
    return spec.digest


def require_true_scene(**given: Unpack[RunArguments]) -> None:
    """Check that the arguments do not select an estimated scene, for functions that can only plan on the true scene.

    Raises:
        InputError: the arguments select an estimated scene.
    """
    for name, default in (("scene_source", TRUE_SCENE), ("depth_noise", None)):
        if given.get(name, default) != default:
            raise InputError("is an option of benchmark, demo and view only", field=name)


def scene_options(**given: Unpack[RunArguments]) -> SceneOptions:
    """Return the scene options from a run's keyword arguments.

    Raises:
        InputError: an argument is invalid or unknown.
    """
    for name in given:
        if name not in RunArguments.__annotations__:
            raise InputError("is an unknown argument", field=name, remedy=near(name, RunArguments.__annotations__))
    if not isinstance(given.get("assets"), str | Path | None):
        raise InputError("must be None, 'builtin' or a folder", field="assets")
    return SceneOptions.of(**split_arguments(given)[0])


def instances_word(**given: Unpack[RunArguments]) -> str:
    """Return the ``instances`` argument of a run, after checking that the argument is a string and not a mapping.

    Raises:
        InputError: the argument is not a string.
    """
    word = given.get("instances", "all")
    if not isinstance(word, str):
        raise InputError(f"must be a single string, but is {word!r}", field="instances")
    return word


def read_task_inputs(
    tasks: Sequence[str], *, seed: int, origin: str | None = None, **given: Unpack[RunArguments]
) -> tuple[list[TaskInput], dict[str, str]]:
    """Read and check the inputs of tasks. Tasks that the given objects do not permit are skipped.

    Args:
        tasks, origin: as for :func:`of_these_objects`.
        seed: seed of the run.
        given: see :class:`~gensim2.rollout.config.RunArguments`.

    Returns:
        Inputs of the tasks that can be run, and, for each skipped task, its name and the reason.

    Raises:
        InputError: two tasks have the same name, or :func:`of_these_objects` or :func:`read_task_input` raises this
            error.
    """
    assets, word = scene_options(**given).assets, instances_word(**given)
    wanted, skipped = of_these_objects(assets, tasks, word, origin)
    inputs = [read_task_input(task, seed=seed, **given) for task in wanted]
    if len({one.spec.name for one in inputs}) < len(inputs):
        raise InputError("a task is named twice", field="tasks")
    return inputs, skipped


def read_all_task_inputs(tasks: Sequence[str], *, seed: int, **given: Unpack[RunArguments]) -> list[TaskInput]:
    """Read and check tasks; raise an error if the objects of any of the tasks are missing.

    Args:
        tasks, seed, given: as for :func:`read_task_inputs`.

    Raises:
        InputError: as for :func:`read_task_inputs`, or a task cannot be run with these objects.
    """
    inputs, skipped = read_task_inputs(tasks, seed=seed, **given)
    for name, reason in skipped.items():
        raise InputError(reason, field=f"tasks.{name}")
    return inputs


def only_strategies(given: Sequence[TaskInput], names: Sequence[str]) -> list[TaskInput]:
    """Restrict the steps of tasks to the strategies ``names``; a step without any of these strategies is unchanged.

    Raises:
        InputError: no step has one of these strategies.
    """
    known = {name for one in given for step in one.spec.steps for name in step.strategies}
    for name in names:
        if name not in known:
            raise InputError(f"no step has the strategy {name!r}", field="strategy", remedy=near(name, sorted(known)))
    return [_only(one, set(names)) for one in given] if names else list(given)


def _only(given: TaskInput, names: set[str]) -> TaskInput:
    ways: dict[str, Strategies] = {}
    for step in given.spec.steps:
        wanted = [name for name in step.strategies if name in names] or list(step.strategies)
        ways[step.name] = {name: given.strategies[name] for name in wanted}
    strategies = {name: data for own in ways.values() for name, data in own.items()}
    task = with_strategies(given.spec, ways)
    return replace(given, scene=replace(given.scene, task=task), strategies=strategies)


def chosen_word(spec: TaskSpec, library: Library, instances: str, seed: int) -> str:
    """Return the ``--instances`` selection of a task; ``random`` is replaced by an id that the seed determines.

    Raises:
        InputError: a class has no such instance or split.
    """
    if instances == "random":
        drawn = object_of_ids(library.instances, _classes(spec))
        ids = taken(spec, library, "all")[drawn]
        return ids[int(rng(seed, f"choose/{spec.objects[drawn].asset_class}").integers(len(ids)))]
    taken(spec, library, instances)
    return instances


def taken(spec: TaskSpec, library: Library, word: str) -> dict[str, tuple[str, ...]]:
    """Return the ids that an ``--instances`` selection contains, by object.

    Raises:
        InputError: a class has no such instance or split.
    """
    asked = words_of_objects(library.instances, _classes(spec), (word,))
    try:
        return {
            name: taken_instances(
                library.choose, thing.asset_class, asked[name], thing.words(library.source(thing.asset_class))
            )
            for name, thing in spec.objects.items()
        }
    except InputError as error:  # The error must name the argument that the user gave, which is ``instances``.
        raise InputError(error.message, file=error.file, field="instances", remedy=error.remedy) from error


def has_instances(library: Library, asset_class: str, instances: str) -> bool:
    """Return whether a class has instances in an ``--instances`` selection."""
    try:
        return bool(library.choose(asset_class, instances))
    except InputError:
        return False


def _classes(spec: TaskSpec) -> dict[str, str]:
    return {name: thing.asset_class for name, thing in spec.objects.items()}


def of_these_objects(
    assets: str | Path | None, tasks: Sequence[str] = (), instances: str = "all", origin: str | None = None
) -> tuple[tuple[str, ...], dict[str, str]]:
    """Find the tasks that can be run with the given objects.

    Args:
        assets: library of the objects, as in :class:`~gensim2.scenes.config.SceneArguments`.
        tasks: names of library tasks, or folders of tasks. If it is empty, all tasks of ``origin`` are used.
        instances: name of the set of objects, as in :class:`~gensim2.scenes.config.SceneArguments`.
        origin: the paper's suite (default) or the name of a designer; not together with ``tasks``.

    Returns:
        Names of the tasks that can be run, and, for each other task, its name and the reason why it cannot be run.

    Raises:
        InputError: a folder cannot be read, a task is unknown, no task can be run, or both tasks and an origin are
            given.
    """
    if tasks and origin is not None:
        raise InputError("cannot be combined with named tasks", field="origin", remedy="give only one")
    library = open_library(assets)
    skipped: dict[str, InputError] = {}
    named = tuple(tasks) or task_names(origin or PAPER)
    for name in named:
        spec = load_task_file(Path(name)) if _is_folder(name) else load_task(name)
        try:
            if (lacking := what_it_lacks(library, spec)) is not None:
                raise InputError(lacking, field="assets")
            chosen_word(spec, library, instances, 0)
        except InputError as error:
            skipped[name] = error
    if len(skipped) == len(named):
        name, first = next(iter(skipped.items()))
        wrong = f"no task can be run on these objects; for example, {name}: {first.message}"
        raise InputError(wrong, field=first.field, remedy=first.remedy)
    reasons = {name: reason.message for name, reason in skipped.items()}
    return tuple(name for name in named if name not in skipped), reasons


def what_it_lacks(library: Library, spec: TaskSpec) -> str | None:
    """Return a message with the object classes of a task that a library lacks; None if the library has all classes."""
    lacking = [each for each in dict.fromkeys(_classes(spec).values()) if each not in library.classes()]
    return f"{library.location} has no {', '.join(lacking)}" if lacking else None


def task_and_strategies(task: str) -> tuple[TaskSpec, Strategies]:
    """Return the spec and the strategies of a library task, or of a folder with task.yaml and strategies/.

    Raises:
        InputError: the task or folder does not exist, or a file in it cannot be used.
    """
    if not _is_folder(task):
        return load_task(task), load_strategies(task)
    folder = Path(task)
    spec = load_task_file(folder)
    return spec, load_strategies_beside(folder, spec)


def _object_names(spec: TaskSpec, library: Library, word: str) -> dict[str, ObjectNames]:
    """Return, for each object of the task, the names that strategies may refer to."""
    found: dict[str, ObjectNames] = {}
    for name, ids in taken(spec, library, word).items():
        model = library.load(spec.objects[name].asset_class, ids[0])
        joint = model.joint.type if isinstance(model, ArticulatedObject) else None
        found[name] = ObjectNames(tuple(model.keypoints), joint)
    return found


def _is_folder(task: str) -> bool:
    try:
        return bool(task) and Path(task).is_dir()
    except OSError as error:
        raise InputError(f"cannot read: {error.strerror}", file=task) from error


def check_counts(**values: int) -> None:
    """Check that all given counts are at least 1.

    Raises:
        InputError: a count is invalid; the message names the first invalid count.
    """
    for name, value in values.items():
        if value < 1:
            raise InputError(f"must be at least 1, not {brief(value)}", field=name)
