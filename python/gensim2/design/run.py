"""Run the pipeline of ``gensim2 run-pipeline``; a resumed run repeats no finished work."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Unpack

from gensim2.core import seeding
from gensim2.core.errors import InputError
from gensim2.core.processes import Execution
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.data.records import PipelineResult
from gensim2.data.runfolder import RunFolder, default_run_dir
from gensim2.design import Designer, OfflineDesigner
from gensim2.design.base import Known
from gensim2.design.designing import Chosen
from gensim2.design.execution import VERIFY_EPISODES, Extent, PipelineRun, Wanted
from gensim2.design.proposals import redesigned
from gensim2.design.remembering import BY_HAND, known_before
from gensim2.design.report import reported
from gensim2.design.search import LONG_BUDGET, Budget
from gensim2.objects import open_library
from gensim2.rollout.config import RolloutOptions, RunArguments
from gensim2.rollout.identity import digest, listing
from gensim2.rollout.inputs import (
    check_counts,
    chosen_word,
    has_instances,
    instances_word,
    read_task_input,
    require_true_scene,
    scene_options,
)
from gensim2.rollout.runner import EpisodeRunner
from gensim2.scenes.physics import Engines
from gensim2.tasks.library import PAPER, load_strategies, load_task, load_task_file, origin_of, task_names
from gensim2.tasks.spec import DESIGNED, Provenance

DESIGNERS: dict[str, type[Designer]] = {"offline": OfflineDesigner}


def run_pipeline(
    *,
    num_tasks: int = 2,
    single: int | None = None,
    long: int | None = None,
    verify: int = VERIFY_EPISODES,
    from_empty: bool = False,
    episodes: int = 5,
    seed: int = 0,
    out: Path | None = None,
    target_task: str | Path | None = None,
    stored_tasks: Sequence[str] = (),
    resume: bool = False,
    designer: str | Designer = "offline",
    videos: int = 1,
    engines: Engines = "one",
    budget: Budget | None = None,
    progress: Progress = NULL_PROGRESS,
    **scene: Unpack[RunArguments],
) -> PipelineResult:
    """Design new tasks, verify them in simulation and collect demonstrations of the successful tasks.

    Example:
        ```python
        result = gensim2.run_pipeline(num_tasks=1, episodes=2, assets="builtin")
        [task.name for task in result.tasks if task.kept]
        ```

    Args:
        num_tasks: number of tasks to keep. If the library does not support as many tasks, the run keeps fewer tasks and
            adds a note. Ignored if ``single`` or ``long`` is given.
        single, long: number of single-step tasks and number of long tasks to keep. If both numbers are 0, the run
            designs no task and runs only ``stored_tasks``.
        verify: number of fresh episodes that decide whether a task is kept.
        from_empty: hide the stored tasks from the designer. By default the designer knows all stored tasks and proposes
            none of them again. With this option the designer may propose a task of the paper's suite again, but such a
            task serves only as a step of longer tasks and does not count towards the number of tasks.
        episodes: number of demonstrations to keep for each task.
        seed: seed of all random choices.
        out: run folder; default ``runs/<date>-<time>``.
        target_task: task to design again without its stored strategies. The value is the name of a library task, or the
            path of a folder with a task.yaml.
        stored_tasks: names of library tasks that the run also verifies and demonstrates, with their stored strategies.
        resume: continue the run in ``out``.
        designer: ``"offline"``, or a :class:`~gensim2.design.base.Designer`.
        videos: number of videos for each task. The videos show demonstrations, or failed episodes if the task is not
            kept. If the number is 0, the report also contains no picture of the best candidate's plan.
        engines: ``"both"`` repeats each verification in the other physics engine and keeps a task only if enough
            episodes succeed in both engines. Demonstrations must succeed in both engines, too.
        budget: limits of episodes and rounds in the search for each task; None: the default limits.
        progress: listener for stages and steps.
        scene: ``assets``, ``instances``, ``physics``, ``robot``, ``randomization``, ``open_loop``; see
            :class:`~gensim2.rollout.config.RunArguments`. Demonstrations use ``instances``; search and verification use
            separate instances. Tasks are proposed only on classes that have matching instances.

    Returns:
        The run folder, every designed task with its verification, and the rejected proposals.

    Raises:
        InputError: an argument cannot be used.
        NotRunError: some jobs could not be run; the rest of the current task is finished. Call again with ``resume``.
    """
    wanted = Wanted(num_tasks) if single is None and long is None else _by_kind(single or 0, long or 0)
    check_counts(verify=verify)
    if single is None and long is None:
        check_counts(num_tasks=num_tasks)
    elif wanted.total == 0 and target_task is None and not stored_tasks:
        remedy = "set single or long to at least 1, or name a stored task"
        raise InputError("no task is requested", field="single, long", remedy=remedy)
    if episodes < 0:
        raise InputError(f"must be at least 0, not {episodes}", field="episodes")
    execution = Execution.of(scene)
    by = _designer(designer)
    own = load_task_file(target_task) if isinstance(target_task, Path) else None
    target = None
    if own is not None:
        origin = origin_of(own) or BY_HAND
        target = redesigned(own, DESIGNED).model_copy(update={"provenance": Provenance(origin=origin)})
    elif target_task is not None:
        target = redesigned(load_task(str(target_task)))
    seeding.check_seed(seed)
    require_true_scene(**scene)
    options, rollout = scene_options(**scene), RolloutOptions(open_loop=scene.get("open_loop", False), engines=engines)
    options.second_engine(engines)  # raises an error now if the second engine cannot be used
    library, instances = open_library(options.assets), instances_word(**scene)
    if target is not None:
        # raises an error now if ``instances`` matches no object of a class in the target
        chosen_word(target, library, instances, seed)
    elif not any(has_instances(library, name, instances) for name in library.classes()):
        wrong = f"no class in the library {library.location} has instances that match {instances!r}"
        raise InputError(wrong, field="instances")
    stored = [read_task_input(name, seed=seed, **scene) for name in dict.fromkeys(stored_tasks)]
    known = [] if from_empty else [Known(load_task(name), load_strategies(name)) for name in known_before(out)]
    familiar = [load_task(name) for name in task_names(PAPER)] if from_empty else []
    with (
        RunFolder(
            Path(out) if out is not None else default_run_dir(),
            {
                "command": "run-pipeline" if own is None else "design",
                "num_tasks": num_tasks,
                "episodes": episodes,
                "seed": seed,
                **options.to_record(),
                **rollout.to_record(),
                "instances": instances,
                "designer": by.name,
                "wish": by.wish if isinstance(by, Chosen) else None,
                "verify": verify,
                "from_empty": from_empty,
                "single": single,
                "long": long,
                "target_task": None if target is None else target.name,
                "stored_tasks": [given.spec.name for given in stored],
                "videos": videos,
                **execution.to_record(),
            },
            {
                "budget": digest([asdict(each) for each in ((budget,) if budget else (Budget(), LONG_BUDGET))]),
                "known tasks": digest([each.task.model_dump(mode="json") for each in known]),
                **({"task": digest(target.model_dump(mode="json"))} if own is not None and target is not None else {}),
                "stored strategies": digest([given.strategies for given in stored]),
                "objects": listing(library, library.classes()),
            },
            resume,
        ) as folder,
        reported(folder.path),
        EpisodeRunner(options, execution, progress, rollout=rollout, log=folder.errors_log) as evaluator,
    ):
        extent = Extent(verify, episodes, instances, videos)
        pipeline = PipelineRun(library, by, folder, evaluator, seed, extent, known, familiar, budget, progress)
        result = pipeline.run(wanted if target is None else Wanted(1), target, stored)
        folder.finish(result.to_dict())
    return result


def _by_kind(single: int, long: int) -> Wanted:
    if min(single, long) < 0:
        raise InputError("the number of tasks must be at least 0", field="single" if single < 0 else "long")
    return Wanted(single + long, single, long)


def _designer(given: str | Designer) -> Designer:
    if not isinstance(given, str):
        return given
    if given not in DESIGNERS:
        raise InputError(f"unknown designer {given!r}", field="designer", remedy=f"one of {', '.join(DESIGNERS)}")
    return DESIGNERS[given]()
