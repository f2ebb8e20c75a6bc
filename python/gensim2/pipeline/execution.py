"""One run of the pipeline, task by task: propose, search, verify, keep, collect."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from gensim2 import seeding
from gensim2.designers import Affordance, Designer
from gensim2.designers.base import Strategies
from gensim2.designers.proposals import goal_of
from gensim2.errors import InputError
from gensim2.objects import Instance, Library
from gensim2.pipeline.demonstrations import collect
from gensim2.pipeline.evaluator import PoolEvaluator
from gensim2.pipeline.inputs import TaskInput, chosen_word, has_instances
from gensim2.pipeline.records import PipelineResult, TaskOutcome
from gensim2.pipeline.report import write_report
from gensim2.pipeline.runfolder import RunFolder, TaskFolder
from gensim2.pipeline.search import Budget, Search
from gensim2.pipeline.tally import Tally
from gensim2.pipeline.unseen import kept_apart
from gensim2.pipeline.verification import verify
from gensim2.progress import Progress
from gensim2.tasks.library import load_task, task_names
from gensim2.tasks.spec import TaskSpec

#: Instances from which an affordance is read.
AFFORDANCE_INSTANCES = 3

#: Proposals put to the search for each task that was asked for, before the run gives up on reaching that number.
PROPOSALS_PER_TASK = 3


def acted_on(task: TaskSpec) -> str:
    """Class of the object that the first step acts on."""
    return task.objects[task.steps[0].object].asset_class


class Execution:
    """One call of ``run_pipeline``: the state that its steps share."""

    def __init__(
        self,
        library: Library,
        designer: Designer,
        folder: RunFolder,
        evaluator: PoolEvaluator,
        seed: int,
        episodes: int,
        instances: str,
        video: bool,
        budget: Budget,
        progress: Progress,
    ) -> None:
        self.library, self.designer, self.folder, self.evaluator = library, designer, folder, evaluator
        self.seed, self.episodes, self.instances, self.video = seed, episodes, instances, video
        self.budget, self.progress = budget, progress
        self.notes: list[str] = []
        self._affordances: dict[str, Affordance] = {}
        self._outcomes: list[TaskOutcome] = []

    def run(self, wanted: int, target: TaskSpec | None, stored: Sequence[TaskInput]) -> PipelineResult:
        """Design until ``wanted`` tasks are kept, or the one that is the target; then take the stored ones."""
        known = [load_task(name) for name in task_names()]
        rejected: list[dict[str, str]] = []
        tried = 0
        proposals = iter([target]) if target is not None else self._proposals(known)
        while sum(outcome.kept for outcome in self._outcomes) < wanted and tried < PROPOSALS_PER_TASK * wanted:
            task = next(proposals, None)
            if task is None:
                break
            tried += 1
            if (reason := self._designed(task)) is not None:
                rejected.append({"name": task.name, "class": acted_on(task), "reason": reason})
            write_report(self.folder.path)
        kept = sum(outcome.kept for outcome in self._outcomes)
        if kept < wanted:
            self.notes.append(f"{wanted} tasks were asked for; {tried} were tried and {kept} held")
        for given in stored:
            folder = self.folder.task(given.spec.name)
            folder.write_task(given.spec)
            self._tested(given.spec, given.strategies, folder)
            write_report(self.folder.path)
        return PipelineResult(str(self.folder.path), tuple(self._outcomes), tuple(rejected), tuple(self.notes))

    def _proposals(self, known: list[TaskSpec]) -> Iterator[TaskSpec]:
        """The designer's proposals over the library's classes in a seeded order."""
        classes = [
            name for name in self.library.classes("articulated") if has_instances(self.library, name, self.instances)
        ]
        order = seeding.rng(self.seed, "classes").permutation(len(classes))
        affordances = (self._affordance(classes[index]) for index in order)
        return iter(self.designer.propose((a for a in affordances if a is not None), known, self.seed))

    def _affordance(self, asset_class: str) -> Affordance | None:
        """What a few instances of a class have in common, of those that a search may see; None where none is usable."""
        if asset_class not in self._affordances:
            ids = self.library.choose(asset_class, kept_apart(self.library, asset_class).search)
            order = seeding.rng(self.seed, f"{asset_class}/affordance").permutation(len(ids))
            instances: list[Instance] = []
            self.progress.start(f"{asset_class}: look at objects", min(AFFORDANCE_INSTANCES, len(ids)))
            for index in order:
                try:
                    instances.append(self.library.load_articulated(asset_class, ids[index]))
                    self.progress.advance()
                except InputError as error:
                    self.notes.append(f"{asset_class}/{ids[index]} left out: {error}")
                if len(instances) == AFFORDANCE_INSTANCES:
                    break
            if not instances:
                return None
            for instance in instances:
                self.folder.add_object(instance)
            self._affordances[asset_class] = Affordance.of(instances)
        return self._affordances[asset_class]

    def _designed(self, task: TaskSpec) -> str | None:
        """Take one proposal as far as it goes; why it was not designed, or None."""
        folder = self.folder.task(task.name)
        strategies = self._search(task, folder)
        if isinstance(strategies, str):
            self.folder.reject(task.name)
            return strategies
        self._tested(task, strategies, folder)
        return None

    def _search(self, task: TaskSpec, folder: TaskFolder) -> Strategies | str:
        """The strategies that a search found, now or in an earlier call, or why there are none."""
        affordance = self._affordance(acted_on(task))  # also where it is not needed: its notes are part of the result
        self.folder.save()
        record = folder.design()
        if record is None:
            if affordance is None:
                return f"no instance of {acted_on(task)} can be used"
            setting = self.evaluator.setting(task, kept_apart(self.library, acted_on(task)).search)
            search = Search(setting, affordance, self.designer, self.evaluator, self.seed, self.budget, self.progress)
            folder.write_design(search.run())
            record = folder.design()
            assert record is not None
        folder.write_task(task)
        return record.notes[-1] if record.strategies is None else record.strategies

    def _tested(self, task: TaskSpec, strategies: Strategies, folder: TaskFolder) -> None:
        """Verify, and collect demonstrations of what is kept."""
        folder.write_strategies(strategies)
        begin = self.evaluator.cpu_s
        apart = kept_apart(self.library, acted_on(task))
        verification = verify(
            task,
            strategies,
            folder,
            self.folder,
            self.evaluator,
            self.library,
            apart,
            episodes=self.episodes,
            seed=self.seed,
            progress=self.progress,
        )
        if apart.kind == "all":
            self.notes.append(
                f"{task.name}: there are too few {acted_on(task)} objects to keep some apart; "
                "the verification draws from those that the search saw"
            )
        fresh, demos = verification.episodes, 0
        if verification.kept:
            collected = collect(
                task,
                strategies,
                folder,
                self.folder,
                self.evaluator,
                self.library,
                chosen_word(task, self.library, self.instances, self.seed),
                episodes=self.episodes,
                seed=self.seed,
                video=self.video,
                progress=self.progress,
            )
            fresh, demos = (*fresh, *collected.episodes), collected.demos
            self.notes.extend(collected.notes)
        else:
            self.folder.reject(task.name)
        held = f"{task.name}: {verification.tally.held} of {verification.tally.episodes} fresh episodes hold"
        self.progress.message(held + (f", {demos} demonstrations" if verification.kept else ", not kept"))
        self._outcomes.append(
            TaskOutcome(
                name=task.name,
                asset_class=acted_on(task),
                goal=goal_of(task),
                kept=verification.kept,
                verification=verification.tally,
                fresh=Tally.of(fresh),
                demos=demos,
                cpu_s=self.evaluator.cpu_s - begin,
            )
        )
