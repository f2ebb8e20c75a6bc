"""Check the success criteria of a task before it is searched, verified or added to a library."""

from __future__ import annotations

from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.core.seeding import scene_seeds
from gensim2.data.runfolder import TaskFolder
from gensim2.objects import open_library
from gensim2.objects.types import ArticulatedObject
from gensim2.rollout import worker
from gensim2.rollout.checker_result import CheckerResult, Mutation
from gensim2.rollout.runner import EpisodeRunner
from gensim2.scenes.config import Drawn, SceneOptions
from gensim2.tasks.criteria import JOINT, ArticulatedBetween, ArticulatedOpen
from gensim2.tasks.presets import preset
from gensim2.tasks.spec import TaskSpec

SCENES = 10
"""Number of scenes whose mutated worlds check a task. A scene has 4 to 40 worlds."""

CHANGE_GOAL = "add a criterion about the object that was not moved, or a stricter threshold"
"""Remedy for a task whose success criteria are refused, unless the start of a joint is the cause."""

FAR_OPEN = 0.8
"""Threshold for ``articulated_open`` that no mutated world reaches; for ``articulated_closed`` it is one minus this."""

NEAR_END = 0.1
"""Largest openness of a joint that starts almost closed, as proposed by :func:`remedy_for`."""


def check_criteria(
    task: TaskSpec,
    evaluator: EpisodeRunner,
    instances: Drawn,
    *,
    seed: int,
    scenes: int = SCENES,
    files: TaskFolder | None = None,
    progress: Progress = NULL_PROGRESS,
) -> CheckerResult:
    """Count how often a task's success criteria are wrongly true in mutated worlds.

    A mutated world is a scene that is changed on purpose so that the task is not done (docs/reference/tasks.md).

    Args:
        task: task to check; its strategies are not used.
        evaluator: worker pool that builds the worlds.
        seed: seed of the scenes.
        files: the task's folder, in which ``checker.json`` stores the result; a second call reads the file.

    Raises:
        NotRunError: some scenes could not be built.
        InputError: the file cannot be used, or the task's goal is met at the start of every episode.
    """
    if files is not None and (found := files.checker()) is not None:
        return found
    what = f"{task.name}: check of the success criteria"
    progress.start(what, scenes)
    config = evaluator.config(task, instances)
    jobs = {n: (config, each) for n, each in enumerate(scene_seeds(seed, task.name, "checker", scenes))}
    judged = dict(evaluator.each(worker.judge_scene, jobs, what))
    result = CheckerResult.of([judged[n] for n in range(scenes)])
    if files is not None:
        files.write_checker(result)
    return result


def remedy_for(task: TaskSpec, checker: CheckerResult, scene: SceneOptions) -> str:
    """Return how to change a task whose success criteria were refused.

    If a criterion already holds before a quarter of the joint's range, the remedy is another threshold or another
    start.

    Args:
        task: the refused task.
        checker: result of :func:`check_criteria`.
        scene: settings of the scenes in which the task was checked.
    """
    from gensim2.scenes.randomize import openness_range  # import late, because this module loads SciPy

    unmoved = (Mutation.NOTHING, Mutation.AT_START, Mutation.A_LITTLE)
    wrong = {each.subject for each in checker.of_goal if each.fooled and each.mutation in unmoved}
    for criterion in task.success:
        if not isinstance(criterion, JOINT) or not wrong & {"", criterion.object}:
            continue
        thing, library = task.objects[criterion.object], open_library(scene.assets)
        model = library.load(thing.asset_class, library.instances(thing.asset_class)[0])
        assert isinstance(model, ArticulatedObject)
        low, high = openness_range(thing.randomization, preset(scene.randomization), model.default_openness)
        starts = f"{criterion.object!r} starts at openness {low:.2f} to {high:.2f}"
        if isinstance(criterion, ArticulatedBetween):
            if low < criterion.high and criterion.low < high:
                return f"{starts}; set openness_mean in randomization so that the start lies outside the goal"
            continue
        # Convert the openness: 1 becomes the end of the joint range that the joint must move to, 0 the other end.
        opens = isinstance(criterion, ArticulatedOpen)
        nearest = high if opens else 1.0 - low
        threshold = criterion.threshold if opens else 1.0 - criterion.threshold
        if threshold >= _after_a_quarter(nearest):
            continue
        options = []
        if threshold < FAR_OPEN and nearest < FAR_OPEN:
            word, far = ("raise", FAR_OPEN) if opens else ("lower", 1.0 - FAR_OPEN)
            options.append(f"{word} the threshold of {criterion.type} to {far:.1f}")
        if threshold >= _after_a_quarter(NEAR_END):
            mean = NEAR_END / 2 if opens else 1.0 - NEAR_END / 2
            start = f"openness_mean: {mean:g}, openness_spread: {NEAR_END / 2:g}"
            options.append(f"let the object start {'closed' if opens else 'open'} with randomization: {{{start}}}")
        if options:
            return f"{starts}; {', or '.join(options)}"
    return CHANGE_GOAL


def _after_a_quarter(openness: float) -> float:
    """Return the openness after a quarter of the way to the end, as in the worlds ``Mutation.A_LITTLE``."""
    return openness + (1.0 - openness) / 4
