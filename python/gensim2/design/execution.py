"""One run of the pipeline, task by task: propose, search, verify, keep, collect."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from gensim2.core.errors import InputError
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.core.seeding import scene_seeds
from gensim2.data.demonstrations import collect
from gensim2.data.records import DesignEffort, PipelineResult, TaskOutcome, Verification
from gensim2.data.runfolder import RunFolder, TaskFolder
from gensim2.design import Designer
from gensim2.design.base import Brief, Declined, Known
from gensim2.design.briefing import Classes, robot_summary
from gensim2.design.designs import read_design, write_design
from gensim2.design.proposals import goal_of
from gensim2.design.report import write_report
from gensim2.design.search import Budget, Search
from gensim2.design.unseen import Apart, kept_apart
from gensim2.objects import Library
from gensim2.rollout.episode_log import EpisodeLog
from gensim2.rollout.inputs import TaskInput, chosen_word
from gensim2.rollout.runner import EpisodeRunner
from gensim2.rollout.tally import Tally
from gensim2.tasks.library import strategies_of
from gensim2.tasks.likeness import first_alike
from gensim2.tasks.spec import Made, Provenance, TaskSpec
from gensim2.tasks.strategies import StepStrategies, Strategies, with_strategies

#: Share of fresh episodes that must hold for a task to be kept: of one step, of several.
KEEP_THRESHOLD, KEEP_LONG = 0.8, 0.6

#: Fresh episodes of a verification by default.
VERIFY_EPISODES = 20

#: Episodes after which it is looked at whether the threshold can still be reached.
STRIDE = 10

#: Episodes of a verification that is under way.
UNDER_WAY = "verification.jsonl"


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
    progress: Progress = NULL_PROGRESS,
) -> Verification:
    """Run fresh episodes and write ``verification.json``; a second call reads it.

    A task that can no longer reach its threshold is not run to the end: what it has then is all of its verification.

    Args:
        apart: which instances the episodes draw from.
        episodes: how many.

    Raises:
        NotRunError: episodes could not be run; all others are finished.
        InputError: what an earlier run left cannot be used.
    """
    seeds = scene_seeds(seed, task.name, "verify", episodes)
    log_path = files.path / UNDER_WAY
    verification = files.verification()
    if verification is not None:
        had = [episode.seed for episode in verification.episodes]
        if had != seeds[: len(had)] or (verification.kept and len(had) != len(seeds)):
            raise InputError(
                "is not of this run", file=files.verification_path, field="episodes", remedy="delete it and resume"
            )
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
        files.write_verification(verification)
    log_path.unlink(missing_ok=True)
    run.add_episodes(library, verification.episodes, files.verification_path)
    run.save()
    return verification


#: Proposals put to the search for each task that was asked for, before the run gives up on reaching that number.
PROPOSALS_PER_TASK = 3

#: Proposals in a row of a kind that no more of are wanted, before the run gives up: each may cost a model's answer.
MAX_UNWANTED = 300

#: Seconds of CPU after which the report is written anew: it takes the longer the more tasks there are.
REPORT_EVERY = 60.0


@dataclass(frozen=True)
class Wanted:
    """Number of tasks that a run is to keep.

    Attributes:
        total: of any kind.
        single, long: of these no more than so many of one step, of several; None: any number.
    """

    total: int
    single: int | None = None
    long: int | None = None

    def wants(self, task: TaskSpec, kept: Sequence[TaskSpec]) -> bool:
        """Whether a task of this kind is still wanted."""
        most = self.single if task.is_single_step else self.long
        return most is None or sum(each.is_single_step == task.is_single_step for each in kept) < most


@dataclass(frozen=True)
class Extent:
    """Extent of the work on each task.

    Attributes:
        verify: fresh episodes of the verification.
        demos: demonstrations to collect; 0: none.
        instances: what demonstrations draw from, as in ``--instances``.
        video: film each kept task where this machine can render.
    """

    verify: int
    demos: int
    instances: str
    video: bool


def classes_of(task: TaskSpec) -> str:
    """Classes of a task's objects, in their order."""
    return ", ".join(dict.fromkeys(thing.asset_class for thing in task.objects.values()))


class PipelineRun:
    """One call of ``run_pipeline``: the state that its steps share.

    Args:
        library: of the objects.
        designer: proposes and designs.
        folder: of the run.
        evaluator: tries what is designed.
        seed: of everything that is drawn.
        extent: what is done with each task.
        known: tasks that the designer knows.
        familiar: tasks that are no news: what repeats one is a piece of longer ones at best and is not counted.
        budget: of the search; None: the usual one of each task.
        progress: listener.
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
        self._brief = Brief(robot_summary(evaluator.scene.robot), self._classes, self._known, self._familiar)
        self._outcomes: list[TaskOutcome] = []
        self._kept: list[TaskSpec] = []

    def run(self, wanted: Wanted, target: TaskSpec | None, stored: Sequence[TaskInput]) -> PipelineResult:
        """Design until what is wanted is kept, or the one that is the target; then take the stored ones."""
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
                    self.notes.append(f"{unwanted} proposals in a row were of a kind that no more of are wanted")
                    break
                continue
            unwanted = 0
            tried += 1
            begin, cpu_s = time.perf_counter(), self.evaluator.cpu_s
            reason = self._designed(task)
            self.folder.note_effort(task.name, self.evaluator.cpu_s - cpu_s, time.perf_counter() - begin)
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
            self._tested(given.spec, given.strategies, folder)
            write_report(self.folder.path)
        notes = (*self._classes.notes, *self.notes, *self.designer.notes)
        return PipelineResult(str(self.folder.path), tuple(self._outcomes), tuple(rejected), notes)

    def _designed(self, task: TaskSpec) -> str | None:
        """Take one proposal as far as it goes; why it was not designed, or None."""
        from gensim2.scenes.goal import GoalError
        from gensim2.scenes.initial_state import PlacementError

        folder = self.folder.task(task.name)
        begin = self.evaluator.cpu_s
        try:
            found = self._search(task, folder)
            if isinstance(found, str):
                return self._rejected(task, folder, found)
            ways, effort = found
            task = _made(
                with_strategies(task, ways), "all" if kept_apart(self.library, task).search == "all" else "train"
            )
            folder.write_task(task)
            strategies = {name: data for own in ways.values() for name, data in own.items()}
            outcome = self._tested(task, strategies, folder)
        except Declined as declined:
            return self._rejected(task, folder, str(declined))
        except (PlacementError, GoalError) as error:  # the proposal's fault, which ends no run
            return self._rejected(task, folder, error.message)
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
        """Episodes of its verification: of a piece that is not counted no more than usual."""
        verify = min(self.extent.verify, VERIFY_EPISODES) if self._is_familiar(task) else self.extent.verify
        return max(verify, self.extent.demos)

    def _rejected(self, task: TaskSpec, folder: TaskFolder, reason: str) -> str:
        folder.write_task(task)
        self.folder.reject(task.name)
        self.progress.message(f"{task.name}: rejected: {reason}")
        return reason

    def _search(self, task: TaskSpec, folder: TaskFolder) -> tuple[StepStrategies, DesignEffort] | str:
        """The ways that a search found, now or in an earlier call, or why there are none."""
        for thing in task.objects.values():
            _ = self._classes[thing.asset_class]  # also where it is not needed: its notes are part of the result
        self.folder.save()
        record = read_design(folder.path)
        if record is None:
            config = self.evaluator.config(task, kept_apart(self.library, task).search)
            search = Search(config, self._brief, self.designer, self.evaluator, self.seed, self.budget, self.progress)
            write_design(folder.path, search.run())
            record = read_design(folder.path)
            assert record is not None
        effort = DesignEffort(
            candidates=len(record.candidates),
            episodes=sum(s.episodes for c in record.candidates for s in c.stages if s.name == "physics"),
        )
        return record.notes[-1] if record.steps is None else (record.steps, effort)

    def _tested(self, task: TaskSpec, strategies: Strategies, folder: TaskFolder) -> TaskOutcome:
        """Verify, and collect demonstrations of what is kept."""
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
            progress=self.progress,
        )
        if apart.kind == "all" and apart.classes:
            self.notes.append(
                f"{task.name}: there are too few {', '.join(apart.classes.values())} objects to keep some apart; "
                "the verification draws from those that the search saw"
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
                video=self.extent.video,
                progress=self.progress,
            )
            fresh, demos = (*fresh, *collected.episodes), collected.demos
        if not verification.kept:
            self.folder.reject(task.name)
        held = f"{task.name}: {verification.tally.held} of {verification.tally.episodes} fresh episodes hold"
        self.progress.message(held + (f", {demos} demonstrations" if verification.kept else ", not kept"))
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
            )
        )
        return self._outcomes[-1]


def _made(task: TaskSpec, seen: Literal["train", "all"]) -> TaskSpec:
    """The task, and that its strategies were found by a search on objects of that word."""
    origin = "search" if task.provenance is None else task.provenance.origin
    strategies = {name: Made(by="search", seen=seen) for name in strategies_of(task)}
    return task.model_copy(update={"provenance": Provenance(origin=origin, strategies=strategies)})
