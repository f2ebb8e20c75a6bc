"""``gensim2 run-pipeline``: propose, design, verify, keep, demonstrate; whatever is finished stays finished."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from gensim2 import seeding
from gensim2.assets import Library, open_library
from gensim2.assets.types import Instance
from gensim2.designers import Affordance, Designer, OfflineDesigner
from gensim2.designers.proposals import goal_of
from gensim2.errors import InputError
from gensim2.files import write_json
from gensim2.pipeline.demonstrations import collect
from gensim2.pipeline.evaluator import PoolEvaluator
from gensim2.pipeline.records import PipelineResult, TaskOutcome, Verification
from gensim2.pipeline.report import write_report
from gensim2.pipeline.runfolder import RunFolder, TaskFolder, default_run_dir
from gensim2.pipeline.search import Budget, Search, design_seeds
from gensim2.progress import NULL_PROGRESS, Progress
from gensim2.tasks.library import load_task, task_names
from gensim2.tasks.spec import TaskSpec

#: Share of fresh episodes that must hold for a task to be kept.
KEEP_THRESHOLD = 0.7

#: Fresh episodes of a verification, unless more demonstrations than that are asked for.
VERIFY_EPISODES = 20

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
        progress: listener.

    Raises:
        InputError: an argument cannot be used.
    """
    _check(num_tasks=num_tasks, episodes=episodes, workers=workers)
    if designer not in DESIGNERS:
        raise InputError(f"unknown designer {designer!r}", field="designer", remedy=f"one of {', '.join(DESIGNERS)}")
    target = load_task(target_task) if target_task is not None else None
    library = open_library(assets)
    folder = RunFolder(
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
        resume,
    )
    run = _Run(library, DESIGNERS[designer](), folder, seed, episodes, video, budget or Budget(), progress)
    with PoolEvaluator(library.location, workers, progress) as evaluator:
        try:
            result = run.execute(evaluator, num_tasks if target is None else 1, target)
        finally:
            write_report(folder.path)
    folder.finish(result.to_dict())
    write_report(folder.path)
    return result


def _check(**values: int) -> None:
    for name, value in values.items():
        if value < 1:
            raise InputError(f"must be at least 1, not {value}", field=name)


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
                self.folder.add_instance(f"{asset_class}/{instance.id}", instance.content_hash, instance.license)
            self._affordances[asset_class] = Affordance.of(instances)
        return self._affordances[asset_class]

    def _one(self, task: TaskSpec, evaluator: PoolEvaluator) -> TaskOutcome | str:
        """Take one proposal as far as it goes; return its outcome, or why it was not designed."""
        folder = self.folder.task(task.name)
        config = self._design(task, folder, evaluator)
        if isinstance(config, str):
            self.folder.reject(task.name)
            return config
        verification = self._verify(task, config, folder, evaluator)
        demos = 0
        if verification.kept:
            demos = collect(
                task,
                config,
                folder,
                self.folder,
                evaluator,
                episodes=self.episodes,
                seed=self.seed,
                video=self.video,
                progress=self.progress,
            )
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
        record = folder.read("design.json")
        if record is None:
            affordance = self.affordance(task.asset_class)
            if affordance is None:
                return f"no instance of {task.asset_class} can be used"
            design = Search(task, affordance, self.designer, evaluator, self.seed, self.budget, self.progress).run()
            record = design.to_dict()
            folder.write_task(task)
            if design.chosen is not None:
                folder.write_config(design.chosen)
            write_json(folder.path / "design.json", record)
            self.folder.save()
        config = record["config"]
        return config if config is not None else str(record["notes"][-1])

    def _verify(
        self, task: TaskSpec, config: dict[str, Any], folder: TaskFolder, evaluator: PoolEvaluator
    ) -> Verification:
        verification = folder.verification()
        if verification is None:
            count = max(VERIFY_EPISODES, self.episodes)
            self.progress.start(f"{task.name}: verify", count)
            seeds = design_seeds(self.seed, task, "verify", count)
            attempts = evaluator.attempt(task, [(config, seed) for seed in seeds])
            verification = Verification(tuple(attempts), KEEP_THRESHOLD)
            write_json(folder.path / "verification.json", verification.to_dict())
        return verification
