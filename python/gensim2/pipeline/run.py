"""``gensim2 run-pipeline``: propose, design, verify, keep, demonstrate; whatever is finished stays finished."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

from gensim2 import seeding
from gensim2.designers import Affordance, Designer, OfflineDesigner
from gensim2.designers.proposals import goal_of
from gensim2.errors import InputError
from gensim2.objects import Library, open_library
from gensim2.objects.types import Instance
from gensim2.pipeline.demonstrations import collect
from gensim2.pipeline.evaluator import PoolEvaluator
from gensim2.pipeline.inputs import check_counts, check_workers
from gensim2.pipeline.records import PipelineResult, TaskOutcome
from gensim2.pipeline.report import reported, write_report
from gensim2.pipeline.runfolder import RunFolder, TaskFolder, default_run_dir, digest, listing
from gensim2.pipeline.search import Budget, Search
from gensim2.pipeline.verification import verify
from gensim2.processes import JOBS_PER_WORKER, TIME_LIMIT
from gensim2.progress import NULL_PROGRESS, Progress
from gensim2.tasks.library import load_task, task_names
from gensim2.tasks.spec import TaskSpec

#: Instances from which an affordance is read.
AFFORDANCE_INSTANCES = 3

#: Proposals put to the search for each task that was asked for, before the run gives up on reaching that number.
PROPOSALS_PER_TASK = 3

DESIGNERS: dict[str, type[Designer]] = {"offline": OfflineDesigner}


def run_pipeline(
    *,
    num_tasks: int = 2,
    episodes: int = 5,
    seed: int = 0,
    assets: str | Path | None = None,
    out: Path | None = None,
    workers: int = 2,
    target_task: str | None = None,
    resume: bool = False,
    designer: str = "offline",
    video: bool = True,
    budget: Budget | None = None,
    time_limit: float = TIME_LIMIT,
    jobs_per_worker: int = JOBS_PER_WORKER,
    progress: Progress = NULL_PROGRESS,
) -> PipelineResult:
    """Design new tasks, verify them in physics and collect demonstrations of those that hold.

    Args:
        num_tasks: how many tasks to keep; fewer if the library affords fewer, and the notes say so.
        episodes: demonstrations to keep of each task.
        seed: of everything that is drawn.
        assets: folder of objects, ``"builtin"``, or None for ``GENSIM2_ASSETS`` or else the built-in library.
        out: run folder; default ``runs/<date>-<time>``.
        workers: simulator processes; the result does not depend on their number.
        target_task: design this task of the task library anew, with that task hidden from the designer.
        resume: go on with the run that ``out`` holds.
        designer: ``"offline"``.
        video: film each kept task where this machine can render.
        budget: of the search.
        time_limit: seconds after which an episode, or the planning on one scene, counts as hung and is tried again.
        jobs_per_worker: jobs after which a simulator process is renewed.
        progress: listener.

    Raises:
        InputError: an argument cannot be used.
        NotRunError: some jobs could not be run; what else there was to do with the task at hand is done, and
            ``resume`` goes on.
    """
    check_counts(num_tasks=num_tasks, episodes=episodes, workers=workers)
    check_workers(time_limit, jobs_per_worker)
    if designer not in DESIGNERS:
        raise InputError(f"unknown designer {designer!r}", field="designer", remedy=f"one of {', '.join(DESIGNERS)}")
    target = load_task(target_task) if target_task is not None else None
    seeding.check_seed(seed)
    library = open_library(assets)
    if target is not None:
        library.instances(target.asset_class)  # a class that is not there is said before anything starts
    budget = budget or Budget()
    with (
        RunFolder(
            Path(out) if out is not None else default_run_dir(),
            {
                "command": "run-pipeline",
                "num_tasks": num_tasks,
                "episodes": episodes,
                "seed": seed,
                "assets": library.location,
                "designer": designer,
                "target_task": target_task,
                "workers": workers,
            },
            {
                "budget": digest(asdict(budget)),
                "known tasks": digest([load_task(name).model_dump(mode="json") for name in task_names()]),
                "objects": listing(library, library.classes()),
            },
            resume,
        ) as folder,
        reported(folder.path),
        PoolEvaluator(
            library.location,
            workers,
            progress,
            time_limit=time_limit,
            jobs_per_worker=jobs_per_worker,
            log=folder.errors_log,
        ) as evaluator,
    ):
        run = _Run(library, DESIGNERS[designer](), folder, seed, episodes, video, budget, progress)
        result = run.execute(evaluator, num_tasks if target is None else 1, target)
        folder.finish(result.to_dict())
    return result


class _Run:
    """One call of ``run_pipeline``: the state that its steps share."""

    def __init__(
        self,
        library: Library,
        designer: Designer,
        folder: RunFolder,
        seed: int,
        episodes: int,
        video: bool,
        budget: Budget,
        progress: Progress,
    ) -> None:
        self.library, self.designer, self.folder = library, designer, folder
        self.seed, self.episodes, self.video = seed, episodes, video
        self.budget, self.progress = budget, progress
        self.notes: list[str] = []
        self._affordances: dict[str, Affordance] = {}

    def execute(self, evaluator: PoolEvaluator, wanted: int, target: TaskSpec | None) -> PipelineResult:
        known = [load_task(name) for name in task_names()]
        if target is not None:
            known = [task for task in known if task.name != target.name]
        outcomes: list[TaskOutcome] = []
        rejected: list[dict[str, str]] = []
        tried = 0
        proposals = iter([target]) if target is not None else self.proposals(known)
        while sum(outcome.kept for outcome in outcomes) < wanted and tried < PROPOSALS_PER_TASK * wanted:
            task = next(proposals, None)
            if task is None:
                break
            tried += 1
            outcome = self._one(task, evaluator)
            if isinstance(outcome, str):
                rejected.append({"name": task.name, "class": task.asset_class, "reason": outcome})
            else:
                outcomes.append(outcome)
            write_report(self.folder.path)
        kept = sum(outcome.kept for outcome in outcomes)
        if kept < wanted:
            self.notes.append(f"{wanted} tasks were asked for; {tried} were tried and {kept} held")
        return PipelineResult(str(self.folder.path), tuple(outcomes), tuple(rejected), tuple(self.notes))

    def proposals(self, known: list[TaskSpec]) -> Iterator[TaskSpec]:
        """Yield the designer's proposals over the library's classes in a seeded order."""
        classes = list(self.library.classes())
        order = seeding.rng(self.seed, "classes").permutation(len(classes))
        affordances = (self.affordance(classes[index]) for index in order)
        return iter(self.designer.propose((a for a in affordances if a is not None), known, self.seed))

    def affordance(self, asset_class: str) -> Affordance | None:
        """Return what a few instances of a class have in common, or None where none can be used."""
        if asset_class not in self._affordances:
            ids = self.library.instances(asset_class)
            order = seeding.rng(self.seed, f"{asset_class}/affordance").permutation(len(ids))
            instances: list[Instance] = []
            self.progress.start(f"{asset_class}: look at objects", min(AFFORDANCE_INSTANCES, len(ids)))
            for index in order:
                try:
                    instances.append(self.library.load(asset_class, ids[index]))
                    self.progress.advance()
                except InputError as error:
                    self.notes.append(f"{asset_class}/{ids[index]} left out: {error}")
                if len(instances) == AFFORDANCE_INSTANCES:
                    break
            if not instances:
                return None
            for instance in instances:
                self.folder.add_instance(instance)
            self._affordances[asset_class] = Affordance.of(instances)
        return self._affordances[asset_class]

    def _one(self, task: TaskSpec, evaluator: PoolEvaluator) -> TaskOutcome | str:
        """Take one proposal as far as it goes; return its outcome, or why it was not designed."""
        folder = self.folder.task(task.name)
        config = self._design(task, folder, evaluator)
        if isinstance(config, str):
            self.folder.reject(task.name)
            return config
        verification = verify(
            task,
            config,
            folder,
            self.folder,
            evaluator,
            self.library,
            episodes=self.episodes,
            seed=self.seed,
            progress=self.progress,
        )
        demos = 0
        if verification.kept:
            collected = collect(
                task,
                config,
                folder,
                self.folder,
                evaluator,
                self.library,
                episodes=self.episodes,
                seed=self.seed,
                video=self.video,
                progress=self.progress,
            )
            demos = collected.demos
            self.notes.extend(collected.notes)
        else:
            self.folder.reject(task.name)
        self.progress.message(
            f"{task.name}: {verification.successes} of {len(verification.attempts)} fresh episodes hold"
            + (f", {demos} demonstrations" if verification.kept else ", not kept")
        )
        return TaskOutcome(
            name=task.name,
            asset_class=task.asset_class,
            goal=goal_of(task),
            kept=verification.kept,
            episodes=len(verification.attempts),
            successes=verification.successes,
            demos=demos,
        )

    def _design(self, task: TaskSpec, folder: TaskFolder, evaluator: PoolEvaluator) -> dict[str, Any] | str:
        affordance = self.affordance(task.asset_class)  # also where it is not needed: its notes are part of the result
        self.folder.save()
        record = folder.design()
        if record is None:
            if affordance is None:
                return f"no instance of {task.asset_class} can be used"
            search = Search(task, affordance, self.designer, evaluator, self.seed, self.budget, self.progress)
            folder.write_design(search.run())
            record = folder.design()
            assert record is not None
        folder.write_task(task)
        if record.config is None:
            return record.notes[-1]
        folder.write_config(record.config)
        return record.config
