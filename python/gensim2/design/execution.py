"""Run the pipeline, which proposes tasks, searches for strategies, verifies tasks and collects demonstrations."""

from __future__ import annotations

import shutil
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from gensim2.core.errors import GenSim2Error, InputError
from gensim2.core.files import remove
from gensim2.core.plural import plural
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.core.seeding import scene_seeds
from gensim2.data.demonstrations import collect, film_attempt
from gensim2.data.records import DesignEffort, PipelineResult, SecondEngine, TaskOutcome, Verification
from gensim2.data.runfolder import RunFolder, TaskFolder
from gensim2.design import Designer
from gensim2.design.base import Brief, Declined, Known
from gensim2.design.briefing import Classes, robot_summary
from gensim2.design.checking import check_criteria, remedy_for
from gensim2.design.designs import read_design, write_design
from gensim2.design.proposals import goal_of
from gensim2.design.report import PLAN_PICTURE, write_report
from gensim2.design.search import Budget, Search, budget_for
from gensim2.design.unseen import Apart, kept_apart
from gensim2.objects import Library
from gensim2.rollout import worker
from gensim2.rollout.checker_result import CheckerResult
from gensim2.rollout.config import EpisodeConfig
from gensim2.rollout.episode_log import EpisodeLog
from gensim2.rollout.identity import digest
from gensim2.rollout.inputs import TaskInput, chosen_word
from gensim2.rollout.record import Episode
from gensim2.rollout.runner import EpisodeRunner
from gensim2.rollout.solving import draw_plan, plan_steps, step_to_draw
from gensim2.rollout.tally import Tally
from gensim2.scenes.physics import Engine
from gensim2.tasks.library import strategies_of
from gensim2.tasks.likeness import first_alike
from gensim2.tasks.spec import Made, Provenance, TaskSpec
from gensim2.tasks.strategies import StepStrategies, Strategies, with_strategies

#: Minimum success rate of a task that is kept, for tasks with a single step and for tasks with several steps.
KEEP_THRESHOLD, KEEP_LONG = 0.8, 0.6

#: Default number of verification episodes.
VERIFY_EPISODES = 20

#: Number of episodes after which the verification checks again whether the threshold can still be reached.
STRIDE = 10

#: Name of the file that stores the episodes of a verification until the verification is finished.
UNDER_WAY = "verification.jsonl"
UNDER_WAY_SECOND = "verification_second.jsonl"


def repeated(
    jobs: Sequence[tuple[EpisodeConfig, Strategies, int]],
    engine: Engine,
    name: str,
    evaluator: EpisodeRunner,
    log: EpisodeLog | None = None,
) -> SecondEngine:
    """Run the episodes of a verification again in another physics engine.

    Args:
        jobs: configuration, strategies and seed of each episode.
        engine: the other engine.
        name: name of the task, for messages.
        evaluator: worker pool that runs the episodes.
        log: log of finished episodes, which are not run again; None: run all.

    Raises:
        NotRunError: some episodes could not be run; all others are finished.
    """
    there = [
        (replace(one, scene=replace(one.scene, engine=engine)), strategies, seed) for one, strategies, seed in jobs
    ]
    return SecondEngine(engine, tuple(evaluator.episodes(f"{name}: verification in {engine}", there, log=log)))


def verify(
    task: TaskSpec,
    strategies: Strategies,
    files: TaskFolder,
    run: RunFolder,
    evaluator: EpisodeRunner,
    library: Library,
    apart: Apart,
    *,
    episodes: int,
    seed: int,
    second: Engine | None = None,
    progress: Progress = NULL_PROGRESS,
) -> Verification:
    """Run fresh episodes of a task and write ``verification.json``; a second call reads the file.

    The verification ends early if the success rate can no longer reach the threshold.

    Args:
        strategies: strategies of its steps, by name.
        files: the task's folder.
        run: the run's folder.
        evaluator: worker pool that runs the episodes.
        apart: division of the instances into search and test instances; the episodes use the test instances.
        seed: seed of the scenes.
        second: engine that repeats the verification if the task passes it in the first engine; None for one engine.

    Raises:
        NotRunError: some episodes could not be run; all others are finished.
        InputError: files of an earlier run cannot be used.
    """
    seeds = scene_seeds(seed, task.name, "verify", episodes)
    log_path = files.path / UNDER_WAY
    verification = files.verification()
    if verification is not None:
        had = [episode.seed for episode in verification.episodes]
        if had != seeds[: len(had)] or (verification.kept and len(had) != len(seeds)):
            wrong = "the file contains episodes of another run"
            raise InputError(wrong, file=files.verification_path, field="episodes", remedy="delete the file and resume")
    else:
        log = EpisodeLog(log_path, seeds)
        threshold = KEEP_THRESHOLD if task.is_single_step else KEEP_LONG
        progress.start(f"{task.name}: verify", len(seeds))
        progress.advance(len(log.done))
        configs = [evaluator.config(task, drawn) for drawn in apart.verification(len(seeds), seed)]
        for first in range(0, len(seeds), STRIDE):
            upto = min(first + STRIDE, len(seeds))
            jobs = [(configs[i], strategies, seeds[i]) for i in range(upto)]
            found = evaluator.episodes(f"{task.name}: verification", jobs, log=log)
            failed = sum(not episode.held for episode in found)
            if len(seeds) - failed < threshold * len(seeds):
                break
        verification = Verification(tuple(found), threshold, apart.kind)
        if second is not None and verification.kept:
            there = EpisodeLog(files.path / UNDER_WAY_SECOND, seeds)
            progress.start(f"{task.name}: verify in {second}", len(seeds))
            progress.advance(len(there.done))
            jobs = [(config, strategies, scene_seed) for config, scene_seed in zip(configs, seeds, strict=True)]
            verification = replace(verification, second=repeated(jobs, second, task.name, evaluator, there))
        files.write_verification(verification)
    remove(log_path)
    remove(files.path / UNDER_WAY_SECOND)
    run.add_episodes(library, verification.episodes, files.verification_path)
    run.save()
    return verification


#: Maximum number of proposals that are searched for each requested task.
PROPOSALS_PER_TASK = 3

#: A run ends if this many proposals in a row are of kinds that already have enough tasks.
MAX_UNWANTED = 300

#: Minimum CPU time (s) between two versions of the report. Writing it takes longer the more tasks there are.
REPORT_EVERY = 60.0


@dataclass(frozen=True)
class Wanted:
    """Number of tasks that a run should design and keep.

    Attributes:
        total: number of tasks of any kind.
        single: maximum number of single-step tasks; None means no limit.
        long: maximum number of tasks with several steps; None means no limit.
    """

    total: int
    single: int | None = None
    long: int | None = None

    def wants(self, task: TaskSpec, kept: Sequence[TaskSpec]) -> bool:
        """Return whether the run should keep another task of the same type as ``task``: single-step or long."""
        most = self.single if task.is_single_step else self.long
        return most is None or sum(each.is_single_step == task.is_single_step for each in kept) < most


@dataclass(frozen=True)
class Extent:
    """Amount of work on each task.

    Attributes:
        verify: number of verification episodes.
        demos: number of demonstrations to collect.
        instances: instances that demonstrations use, as in ``--instances``.
        videos: number of videos for each task. If this number is 0, no picture of the planned motion is drawn, either.
    """

    verify: int
    demos: int
    instances: str
    videos: int


#: Folder with the episodes of an unfinished search; a resumed search reads the episodes instead of running them.
SEARCHED = "search"


class _Kept:
    """Runner for the trials of a search.

    The runner plans or simulates trials and stores their results. A resumed search reads the results.

    Args:
        runner: runner that plans scenes and simulates episodes.
        folder: folder with a file of results for each method call. A file is used again only if the arguments are the
            same.
    """

    def __init__(self, runner: EpisodeRunner, folder: Path) -> None:
        self._runner, self._folder, self._calls = runner, folder, 0

    def screen(
        self, config: EpisodeConfig, candidates: Sequence[StepStrategies], seeds: Sequence[int]
    ) -> list[list[worker.Screened]]:
        """Plan each candidate in the scene of each seed, or read the stored results."""
        return self._runner.screen(config, candidates, seeds, self._next(candidates))

    def trials(self, config: EpisodeConfig, jobs: Sequence[tuple[StepStrategies, int]]) -> list[Episode]:
        """Simulate one episode for each job (strategies of each step, seed), or read the stored results."""
        log = EpisodeLog(self._next([ways for ways, _ in jobs]).with_suffix(".jsonl"), [seed for _, seed in jobs])
        return self._runner.trials(config, jobs, log)

    def _next(self, ways: Sequence[StepStrategies]) -> Path:
        self._calls += 1
        return self._folder / f"{self._calls:03d}_{digest([dict(each) for each in ways])[:12]}"


def classes_of(task: TaskSpec) -> str:
    """Return the classes of a task's objects, separated by commas."""
    return ", ".join(dict.fromkeys(thing.asset_class for thing in task.objects.values()))


class PipelineRun:
    """One call of ``run_pipeline``: settings, progress and results.

    Args:
        library: object library.
        designer: designer that proposes tasks and candidates.
        folder: run folder.
        evaluator: worker pool that plans and runs episodes.
        seed: seed of all random choices.
        extent: amount of work on each task.
        known: tasks that the designer knows.
        familiar: tasks that count as solved. Solved tasks may be proposed and used in longer tasks, but do not count as
            requested tasks.
        budget: maximum numbers of candidates and episodes in each search; None selects the default for the task.
        progress: progress listener.
    """

    def __init__(
        self,
        library: Library,
        designer: Designer,
        folder: RunFolder,
        evaluator: EpisodeRunner,
        seed: int,
        extent: Extent,
        known: Sequence[Known],
        familiar: Sequence[TaskSpec],
        budget: Budget | None,
        progress: Progress,
    ) -> None:
        self.library, self.designer, self.folder, self.evaluator = library, designer, folder, evaluator
        self.seed, self.extent, self.budget, self.progress = seed, extent, budget, progress
        self.notes: list[str] = []
        self._known, self._familiar = list(known), tuple(familiar)
        self._classes = Classes(library, extent.instances, seed, folder, progress)
        self._refused: dict[str, str] = {}
        self._brief = Brief(
            robot_summary(evaluator.scene.robot), self._classes, self._known, self._familiar, self._refused
        )
        self._designer_s = 0.0
        self._outcomes: list[TaskOutcome] = []
        self._kept: list[TaskSpec] = []

    def run(self, wanted: Wanted, target: TaskSpec | None, stored: Sequence[TaskInput]) -> PipelineResult:
        """Design tasks until enough are kept, or design only ``target``; then verify the tasks ``stored``."""
        rejected: list[dict[str, str]] = []
        tried, unwanted, reported = 0, 0, 0.0
        self.designer.open(self.folder.path)
        proposals = iter([target] if target is not None else self.designer.propose(self._brief, self.seed))
        while len(self._kept) < wanted.total and tried < PROPOSALS_PER_TASK * wanted.total:
            task = next(proposals, None)
            if task is None:
                break
            if not wanted.wants(task, self._kept):
                unwanted += 1
                if unwanted == MAX_UNWANTED:
                    self.notes.append(
                        f"stopped after {unwanted} consecutive proposals that repeat a kind with enough kept tasks"
                    )
                    break
                continue
            unwanted = 0
            tried += 1
            begin, cpu_s = time.perf_counter() - self._designer_s, self.evaluator.cpu_s
            reason = self._designed(task)
            wall_s = time.perf_counter() - self._designer_s - begin
            self.folder.note_effort(task.name, self.evaluator.cpu_s - cpu_s, wall_s)
            if reason is not None:
                rejected.append({"name": task.name, "class": classes_of(task), "reason": reason})
            if self.evaluator.cpu_s - reported > REPORT_EVERY:
                write_report(self.folder.path)
                reported = self.evaluator.cpu_s
        write_report(self.folder.path)
        if len(self._kept) < wanted.total:
            familiar = sum(outcome.kept for outcome in self._outcomes) - len(self._kept)
            beside = f" beside {familiar} that the paper's suite has, too" if familiar else ""
            said = f"{tried} {'was' if tried == 1 else 'were'} tried and {len(self._kept)} held{beside}"
            asked = "1 task was" if wanted.total == 1 else f"{wanted.total} tasks were"
            self.notes.append(f"{asked} asked for; {said}")
        for given in stored:
            folder = self.folder.task(given.spec.name)
            folder.write_task(given.spec)
            checker = self._checked(given.spec, folder)
            if checker.passes:
                self._tested(given.spec, given.strategies, folder, checker)
            else:
                reason = self._rejected(given.spec, folder, self._why_refused(given.spec, checker))
                rejected.append({"name": given.spec.name, "class": classes_of(given.spec), "reason": reason})
            write_report(self.folder.path)
        notes = (*self._classes.notes, *self.notes, *self.designer.notes)
        return PipelineResult(str(self.folder.path), tuple(self._outcomes), tuple(rejected), notes)

    def _designed(self, task: TaskSpec) -> str | None:
        """Search strategies for a task and verify the task.

        Return the reason if it is rejected before verification, else None.
        """
        from gensim2.scenes.goal import GoalError
        from gensim2.scenes.initial_state import PlacementError

        folder = self.folder.task(task.name)
        begin = self.evaluator.cpu_s
        try:
            checker = self._checked(task, folder)
            if not checker.passes:
                self._refused[task.name] = checker.reason
                return self._rejected(task, folder, self._why_refused(task, checker))
            found = self._search(task, folder)
            if isinstance(found, str):
                return self._rejected(task, folder, found)
            ways, effort = found
            task = _made(
                with_strategies(task, ways), "all" if kept_apart(self.library, task).search == "all" else "train"
            )
            folder.write_task(task)
            strategies = {name: data for own in ways.values() for name, data in own.items()}
            outcome = self._tested(task, strategies, folder, checker)
        except Declined as declined:
            return self._rejected(task, folder, str(declined))
        except (PlacementError, GoalError) as error:  # only this proposal is faulty, so the run continues
            return self._rejected(task, folder, f"{error.message} ({error.remedy})" if error.remedy else error.message)
        effort = replace(effort, cpu_s=self.evaluator.cpu_s - begin - outcome.cpu_s)
        self._outcomes[-1] = replace(outcome, effort=effort)
        if outcome.kept:
            if not self._is_familiar(task):
                self._kept.append(task)
            self._known.append(Known(task, strategies, outcome.verification.held, outcome.verification.episodes))
        return None

    def _is_familiar(self, task: TaskSpec) -> bool:
        return first_alike(task, self._familiar) is not None

    def _to_verify(self, task: TaskSpec) -> int:
        """Return the number of verification episodes.

        The number is the requested one, but limited for tasks that count as solved, and at least the number of
        demonstrations.
        """
        verify = min(self.extent.verify, VERIFY_EPISODES) if self._is_familiar(task) else self.extent.verify
        return max(verify, self.extent.demos)

    def _why_refused(self, task: TaskSpec, checker: CheckerResult) -> str:
        """Return why the success criteria of a task were refused, and how to change the task."""
        return f"{checker.reason} ({remedy_for(task, checker, self.evaluator.scene)})"

    def _rejected(self, task: TaskSpec, folder: TaskFolder, reason: str) -> str:
        folder.write_task(task)
        self.folder.reject(task.name)
        self.progress.message(f"{task.name}: rejected: {reason}")
        return reason

    def _search(self, task: TaskSpec, folder: TaskFolder) -> tuple[StepStrategies, DesignEffort] | str:
        """Return the strategies found by the search, now or in an earlier call, or the reason why it found none."""
        for thing in task.objects.values():
            # Loading the class adds warnings about its objects to ``self._classes.notes``, which the report shows.
            _ = self._classes[thing.asset_class]
        self.folder.save()
        record = read_design(folder.path)
        if record is None:
            config = self.evaluator.config(task, kept_apart(self.library, task).search)
            most = (self.budget or budget_for(task)).max_physics_episodes
            told = f"at most {most} episodes of search, then {self._to_verify(task)} of verification"
            self.progress.message(f"{task.name}: {told}; usually 1 to 5 minutes")
            kept = _Kept(self.evaluator, folder.path / SEARCHED)
            search = Search(config, self._brief, self.designer, kept, self.seed, self.budget, self.progress)
            try:
                write_design(folder.path, search.run())
            finally:
                self._designer_s += search.designer_s
            shutil.rmtree(folder.path / SEARCHED, ignore_errors=True)
            record = read_design(folder.path)
            assert record is not None
        effort = DesignEffort(
            candidates=len(record.candidates),
            episodes=sum(s.episodes for c in record.candidates for s in c.stages if s.name == "physics"),
        )
        if record.steps is None:
            if not record.candidates:
                return record.notes[-1]
            best = record.candidates[0]
            self._show_best(task, folder, best.steps)
            words = next((stage.diagnoses[0].words for stage in best.stages[::-1] if stage.diagnoses), best.cause)
            return record.notes[-1] + (f"; the best candidate, {best.label!r}: {words}" if words else "")
        return record.steps, effort

    def _show_best(self, task: TaskSpec, folder: TaskFolder, ways: StepStrategies) -> None:
        """After a search without success, record videos of the best candidate and draw its planned motion."""
        strategies = {name: data for own in ways.values() for name, data in own.items()}
        config = self.evaluator.config(with_strategies(task, ways), kept_apart(self.library, task).search)
        seeds = scene_seeds(self.seed, task.name, "design", self.extent.videos)
        films = {folder.path / f"failed_{n:06d}.mp4": (config, strategies, seed) for n, seed in enumerate(seeds)}
        self._show(task, folder, films)

    def _show_verified(
        self, task: TaskSpec, strategies: Strategies, folder: TaskFolder, verification: Verification
    ) -> None:
        """Record videos and draw the plan of a verified task: successful episodes if it is kept, else failed ones."""
        drawn = kept_apart(self.library, task).verification(len(verification.episodes), self.seed)
        wanted = [n for n, episode in enumerate(verification.episodes) if episode.held == verification.kept]
        word = "held" if verification.kept else "failed"
        films = {
            folder.path / f"{word}_{n:06d}.mp4": (
                self.evaluator.config(task, drawn[n]),
                strategies,
                verification.episodes[n].seed,
            )
            for n in wanted[: self.extent.videos]
        }
        self._show(task, folder, films)

    def _show(self, task: TaskSpec, folder: TaskFolder, films: Mapping[Path, tuple[Any, ...]]) -> None:
        """Record the videos and draw the plan of the first recorded episode; report errors as messages and continue."""
        picture = folder.path / PLAN_PICTURE
        missing = {path: job for path, job in films.items() if not path.exists()}
        if not films or (not missing and picture.exists()):
            return
        what = f"{task.name}: pictures"
        self.progress.start(what, len(missing) + 1)
        try:
            for _ in self.evaluator.each(draw_scene, {0: (*next(iter(films.values())), picture)}, what):
                pass
            jobs = {n: (*job, path) for n, (path, job) in enumerate(missing.items())}
            for _ in self.evaluator.each(film_attempt, jobs, what):
                pass
        except GenSim2Error as error:
            self.progress.message(f"{task.name}: not all pictures were made: {error}")

    def _checked(self, task: TaskSpec, folder: TaskFolder) -> CheckerResult:
        """Return, and store, how often the criteria are wrongly true where the task is not done."""
        instances = kept_apart(self.library, task).search
        return check_criteria(task, self.evaluator, instances, seed=self.seed, files=folder, progress=self.progress)

    def _tested(
        self, task: TaskSpec, strategies: Strategies, folder: TaskFolder, checker: CheckerResult
    ) -> TaskOutcome:
        folder.write_strategies(strategies)
        begin = self.evaluator.cpu_s
        apart = kept_apart(self.library, task)
        verification = verify(
            task,
            strategies,
            folder,
            self.folder,
            self.evaluator,
            self.library,
            apart,
            episodes=self._to_verify(task),
            seed=self.seed,
            second=self.evaluator.scene.second_engine(self.evaluator.rollout.engines),
            progress=self.progress,
        )
        if verification.second is not None:
            tally, engine = verification.second.tally, verification.second.engine
            self.notes.append(
                f"{task.name}: {tally.held} of {tally.episodes} episodes on the same scenes hold in {engine}"
            )
        if apart.kind == "all" and apart.classes:
            self.notes.append(
                f"{task.name}: there are too few {', '.join(apart.classes.values())} objects for a separate test set; "
                "the verification uses the objects of the search"
            )
        fresh, demos = verification.episodes, 0
        if verification.kept and self.extent.demos:
            collected = collect(
                task,
                strategies,
                folder,
                self.folder,
                self.evaluator,
                self.library,
                chosen_word(task, self.library, self.extent.instances, self.seed),
                episodes=self.extent.demos,
                seed=self.seed,
                videos=self.extent.videos,
                progress=self.progress,
            )
            fresh, demos = (*fresh, *collected.episodes), collected.demos
            if engines := collected.tally.engines:
                rates = ", ".join(f"{count} in {engine}" for engine, count in engines.items())
                tried = f"{plural(len(collected.episodes), 'episode')} for demonstrations"
                self.notes.append(f"{task.name}: of {tried} {rates} hold, {demos} in both")
        if not (verification.kept and self.extent.demos):
            self._show_verified(task, strategies, folder, verification)
        if not verification.kept:
            self.folder.reject(task.name)
        held = f"{task.name}: {verification.tally.held} of {verification.tally.episodes} fresh episodes hold"
        self.progress.message(held + (f", {plural(demos, 'demonstration')}" if verification.kept else ", not kept"))
        self._outcomes.append(
            TaskOutcome(
                name=task.name,
                asset_class=classes_of(task),
                goal=goal_of(task),
                kept=verification.kept,
                verification=verification.tally,
                fresh=Tally.of(fresh),
                demos=demos,
                cpu_s=self.evaluator.cpu_s - begin,
                checker=checker,
            )
        )
        return self._outcomes[-1]


def draw_scene(config: EpisodeConfig, strategies: Strategies, seed: int, picture: Path) -> bool:
    """Plan a task in the scene of one seed and draw it.

    The picture shows the first step without a complete motion, or the last step. Workers call this function.

    Returns:
        Whether a picture was drawn.
    """
    env = worker.simulator(config.scene)
    env.reset(seed)
    steps = plan_steps(config.task, env.profile, strategies, env.scene_state())
    return draw_plan(step_to_draw(steps), config.task, strategies, env.profile, picture) is not None


def _made(task: TaskSpec, seen: Literal["train", "all"]) -> TaskSpec:
    """Return the task with a record of its origin.

    The record states whether the search used ``"train"`` or ``"all"`` objects.
    """
    origin = "search" if task.provenance is None else task.provenance.origin
    strategies = {name: Made(by="search", seen=seen) for name in strategies_of(task)}
    return task.model_copy(update={"provenance": Provenance(origin=origin, strategies=strategies)})
