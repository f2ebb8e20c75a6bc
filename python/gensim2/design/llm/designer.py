"""Design tasks and strategies with a language model, in the stages of the GenSim2 paper.

A search in simulation tests the strategies afterwards.
"""

from __future__ import annotations

import itertools
import queue
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TypeVar

from gensim2.design.base import Brief, Candidate, CandidateResult, Declined
from gensim2.design.llm.catalog import Catalog
from gensim2.design.llm.conversations import Ask, ConversationRecord, Conversations, Dropped
from gensim2.design.llm.model import LanguageModel
from gensim2.design.llm.questions import BudgetSpent
from gensim2.design.llm.solutions import Asking, Solutions, Views, in_words, tried_of
from gensim2.design.llm.stages import code as code_stage
from gensim2.design.llm.stages import composition, decomposition, free, proposal, solving
from gensim2.design.llm.stages.proposal import Wish
from gensim2.design.llm.stages.solving import Config, StepToSolve
from gensim2.design.llm.templating import Prompts
from gensim2.design.sandbox import task_code
from gensim2.robots import robot
from gensim2.tasks.library import load_task
from gensim2.tasks.likeness import first_alike
from gensim2.tasks.spec import HAND, ObjectSpec, Step, TaskSpec
from gensim2.tasks.strategies import Strategies

T = TypeVar("T")

#: The designer stops proposing after this many consecutive unusable proposals.
MAX_FAILURES = 5

#: Maximum number of alternative strategies of a step.
MAX_IN_TURN = 4

GRASPS: Strategies = {
    "grasp": {"grasp": "antipodal"},
    "grasp_from_any_side": {"grasp": "antipodal", "tilt": 1.6, "candidates": 60},
}
"""Strategies that grasp a rigid object by rule, like the paper's ``grasp``."""


class LLMDesigner:
    """Designer that queries a language model.

    Args:
        model: language model.
        prompts: prompt templates.
        asking: settings of requested designs, such as the mode, the target task or object, and the number of configs.
        robot_name: name of the robot. Configs may name only keypoints of this robot's hand.
        views: renderer of scenes for the model; None: the model gets no pictures of scenes.
    """

    def __init__(
        self,
        model: LanguageModel,
        prompts: Prompts,
        asking: Asking,
        robot_name: str = "panda",
        views: Views | None = None,
    ) -> None:
        self.model, self.prompts, self.asking = model, prompts, asking
        self.talk = Conversations(model, prompts, asking.max_rounds)
        self._solutions = Solutions(self.talk, asking, views)
        self._profile = robot(robot_name)
        self._proposed: list[TaskSpec] = []
        self._skills: dict[str, Mapping[str, Strategies]] = {}
        self._sentences: dict[str, Mapping[str, str]] = {}
        self._notes: list[str] = []

    @property
    def name(self) -> str:
        """Name of the designer: ``llm:`` and the model's name."""
        return f"llm:{self.model.options.model}"[:100]

    @property
    def notes(self) -> Sequence[str]:
        """Notes for the report: why the proposals ended, and how many questions were dropped or refused."""
        dropped = sum(each.outcome == "dropped" for each in self.talk.log.conversations)
        refused = sum(each.outcome == "refused" for each in self.talk.log.conversations)
        counts = []
        if dropped:
            counts.append(f"{dropped} request{'s' * (dropped > 1)} to the model had no usable answer")
        if refused:
            counts.append(f"the model rejected {refused} of its own proposals")
        return [*self._notes, *counts]

    @property
    def patience(self) -> int:
        """Maximum number of refinements of a task whose candidates nearly always fail.

        A task that nearly always fails gets all permitted rounds, because the model receives the diagnosis of each
        failure.
        """
        return self.asking.max_rounds

    def open(self, folder: Path) -> None:
        """Store questions, answers and outcomes in ``folder/model``."""
        self.talk.open(folder)

    def propose(self, brief: Brief, seed: int) -> Iterator[TaskSpec]:
        """Yield the model's proposals until the model gives no more valid proposals."""
        self.talk.seed = seed
        refused: list[str] = []
        failures = 0
        for number in itertools.count():
            if failures == MAX_FAILURES:
                self._notes.append(f"stopped after {failures} consecutive proposals that could not be used")
                return
            try:
                task = self._proposal(brief, number, refused)
            except Dropped as error:
                refused.append(str(error)[:300])
                task = None
            except BudgetSpent as error:
                self._notes.append(f"no more tasks were proposed: {error}")
                return
            failures = 0 if task is not None else failures + 1
            if task is not None:
                self._proposed.append(task)
                if first_alike(task, brief.familiar) is not None:
                    refused.append(
                        f"{task.name} ({task.description}): the benchmark has this task already, so it does not "
                        "count as a new one; propose another object or another goal"
                    )
                yield task
                if task.name in brief.refused:
                    refused.append(f"{task.name} ({task.description}): {brief.refused[task.name]}")
                if self.asking.target_task is not None:
                    return

    def candidates(self, task: TaskSpec, brief: Brief, seed: int) -> list[Candidate]:
        """Ask for solver configs of each step without a known or rule-based strategy. Combine them into candidates.

        In a single-step task, candidate n uses the model's n-th config.

        In a task with several steps, candidate n has the n-th config of every step first. The other configs follow, and
        the planner tries them if it finds no plan.

        Raises:
            Declined: the model's answers cannot be used, or the budget is spent.
        """
        self.talk.seed = seed
        fixed = {step.name: found for step in task.steps if (found := self._fixed(task, step)) is not None}
        jobs = [self._job(task, step, brief) for step in task.steps if step.name not in fixed]
        try:
            asked = [partial(self._solutions.configs, job, brief, fixed) for job in jobs]
            designed = _in_threads(self.model.options.concurrency, asked)
        except (Dropped, BudgetSpent) as error:
            raise Declined(str(error)) from error
        ways = {job.step.name: found for job, found in zip(jobs, designed, strict=True)}
        count = max((len(found) for found in ways.values()), default=1)
        choices = [(f"trial {n + 1}", {name: _from(found, n) for name, found in ways.items()}) for n in range(count)]
        if task.is_single_step:
            choices = [(label, {name: found[:1] for name, found in chosen.items()}) for label, chosen in choices]
        made = []
        for label, chosen in choices:
            steps = {
                step.name: dict(fixed[step.name])
                if step.name in fixed
                else _in_turn(step.strategies[0], chosen[step.name])
                for step in task.steps
            }
            made.append(self._candidate(label, steps, {name: each[0] for name, each in chosen.items()}))
        return made

    def refine(
        self, task: TaskSpec, brief: Brief, results: Sequence[CandidateResult], seed: int, round: int
    ) -> list[Candidate]:
        """Ask for better configs of the step that failed, with a description of the failures."""
        if round >= self.asking.max_rounds or not results:
            return []
        parent = _furthest(task, results)
        step = self._to_blame(task, parent)
        if step is None:
            return []
        self.talk.seed = seed
        name = step.strategies[0]
        told = [parent, *(each for each in results if each is not parent)]
        tried = tried_of(step, [each for each in told if name in each.candidate.steps[step.name]])
        ask = solving.regeneration(self.prompts, self._job(task, step, brief), tried, self.asking.trials, round)
        try:
            found, _ = self.talk.ask(ask)
        except (Dropped, BudgetSpent) as error:
            self._notes.append(f"{task.name}: no better configs: {error}")
            return []
        seen = [result.candidate.steps for result in results]
        children = []
        for number, config in enumerate(found):
            former = [] if task.is_single_step else list(parent.candidate.steps[step.name].values())
            steps = {**parent.candidate.steps, step.name: _in_turn(name, [config, *former])}
            if steps not in seen:
                label = f"round {round + 1}, config {number + 1}"
                children.append(self._candidate(label, steps, {step.name: config}, round + 1))
        return children

    def _proposal(self, brief: Brief, number: int, refused: list[str]) -> TaskSpec | None:
        """Ask the model for a task and whether the task is good. Return None if the model rejects the task."""
        catalog = Catalog.of(brief, articulated_only=self.asking.mode == "explore")
        catalog = replace(
            catalog, known=tuple({task.name: task for task in (*catalog.known, *self._proposed)}.values())
        )
        wish = Wish(self.asking.mode == "topdown", self.asking.target_task, self.asking.target_object)
        if self.asking.mode == "bottomup":
            return self._composed(brief, catalog, wish, number, refused)
        if self.asking.mode == "free":
            return self._whole(brief, catalog, wish, number, refused)
        found, record = self.talk.ask(proposal.proposal(self.prompts, catalog, wish, refused, number))
        self.talk.log.settle(record, found.name, "used")
        if not self._approved(
            record, found.name, found.sentence, proposal.reflection(self.prompts, catalog, found, wish), refused
        ):
            return None
        if wish.long:
            made, _ = self.talk.ask(decomposition.decomposition(self.prompts, catalog, found, self.name))
            task = made.task
            self._sentences[task.name] = made.sentences
        else:
            task = proposal.task_of(found, catalog, self.name)
        return self._as_code(task, brief) if self.asking.code else task

    def _composed(
        self, brief: Brief, catalog: Catalog, wish: Wish, number: int, refused: Sequence[str]
    ) -> TaskSpec | None:
        skills = composition.skills_of(brief.known, catalog)
        if not skills:
            raise Dropped("there are no verified tasks of one step to put together")
        ask = composition.composition(self.prompts, catalog, skills, wish, refused, number, self.name)
        found, record = self.talk.ask(ask)
        self.talk.log.settle(record, found.task.name, "used")
        self._skills[found.task.name] = found.strategies
        return self._as_code(found.task, brief) if self.asking.code else found.task

    def _approved(
        self, record: ConversationRecord, name: str, sentence: str, ask: Ask[tuple[bool, str]], refused: list[str]
    ) -> bool:
        """Return whether the model accepts a proposal on reflection.

        Record rejections and add them to ``refused``.
        """
        (good, why), _ = self.talk.ask(ask)
        if not good:
            self.talk.log.settle(record, name, "refused", why)
            refused.append(f"{name} ({sentence}): {why}")
        return good

    def _whole(self, brief: Brief, catalog: Catalog, wish: Wish, number: int, refused: list[str]) -> TaskSpec | None:
        good = [load_task(name) for name in self.prompts.good_tasks(long=True)]
        found, record = self.talk.ask(free.whole_task(self.prompts, catalog, good, wish, refused, number, self.name))
        task = found.task
        self.talk.log.settle(record, task.name, "used")
        classes = [thing.asset_class for thing in task.objects.values()]
        about = proposal.reflection_on(
            self.prompts, catalog.about(*classes), free.as_answer(task), task.name, long=True, free=True
        )
        if not self._approved(record, task.name, task.description, about, refused):
            return None
        self._sentences[task.name] = found.sentences
        return self._as_code(task, brief) if self.asking.code else task

    def _as_code(self, task: TaskSpec, brief: Brief) -> TaskSpec:
        """Ask the model for code of ``task``. Return the task of the code, whose placements may differ."""
        known = [each.task for each in brief.known if each.task.is_single_step == task.is_single_step]
        # If all stored tasks are hidden, show the example tasks of the prompts, which are never hidden.
        if not known:
            known = [load_task(name) for name in self.prompts.good_tasks(long=not task.is_single_step)]
        references = [(each.name, task_code(each)) for each in known[: code_stage.REFERENCES]]
        found, _ = self.talk.ask(code_stage.code(self.prompts, task, references))
        names = {step.name: step.strategies for step in task.steps}
        steps = tuple(step.model_copy(update={"strategies": names[step.name]}) for step in found.steps)
        # If the code gives no placement for an object, keep the original placement.
        placed = dict(zip(found.objects, task.objects.values(), strict=True))
        objects = {
            name: placed[name] if thing == ObjectSpec(asset_class=thing.asset_class) else thing
            for name, thing in found.objects.items()
        }
        return found.model_copy(update={"steps": steps, "objects": objects, "provenance": task.provenance})

    def _fixed(self, task: TaskSpec, step: Step) -> Strategies | None:
        """Return the strategies of a step that are known or rule-based; None if the model must be asked."""
        known = self._skills.get(task.name, {}).get(step.name)
        if known is not None:
            return known
        return GRASPS if step.tool == HAND and step.name.startswith("grasp") else None

    def _job(self, task: TaskSpec, step: Step, brief: Brief) -> StepToSolve:
        sentence = self._sentences.get(task.name, {}).get(step.name)
        return StepToSolve(task, step, brief.of(task), brief.settings, self._profile, sentence)

    def _to_blame(self, task: TaskSpec, result: CandidateResult) -> Step | None:
        """Return the step with the model's configs that fails most often, or else the last such step.

        Return None if no step has configs of the model.
        """
        own = [step for step in task.steps if self._fixed(task, step) is None]
        blamed = (step for each in result.diagnoses for step in own if step.name == each.step)
        return next(blamed, own[-1] if own else None)

    def _candidate(
        self, label: str, steps: Mapping[str, Strategies], written: Mapping[str, Config], round: int = 0
    ) -> Candidate:
        told = [
            f"{name}: {in_words(config)}" if len(steps) > 1 else in_words(config) for name, config in written.items()
        ]
        ways = {name: dict(each) for name, each in steps.items()}
        labels = {name: in_words(config) for step in written for name, config in ways[step].items()}
        return Candidate(f"{label}: {'; '.join(told)}"[:400], ways, {"by": self.name, "round": round}, labels)


def _in_threads(count: int, questions: Sequence[Callable[[], T]]) -> list[T]:
    """Ask in at most ``count`` daemon threads, which Ctrl-C does not wait for; return answers in order."""
    waiting: queue.SimpleQueue[int] = queue.SimpleQueue()
    answers: queue.SimpleQueue[tuple[int, T | BaseException]] = queue.SimpleQueue()
    for number in range(len(questions)):
        waiting.put(number)

    def work() -> None:
        while True:
            try:
                number = waiting.get_nowait()
            except queue.Empty:
                return
            try:
                answers.put((number, questions[number]()))
            except BaseException as error:  # noqa: BLE001 - it is raised in the thread that waits
                answers.put((number, error))

    for _ in range(min(count, len(questions))):
        threading.Thread(target=work, daemon=True, name="question").start()
    found = dict(answers.get() for _ in questions)
    values: list[T] = []
    for number in range(len(questions)):
        answer = found[number]
        if isinstance(answer, BaseException):
            raise answer
        values.append(answer)
    return values


def _furthest(task: TaskSpec, results: Sequence[CandidateResult]) -> CandidateResult:
    """Return the best candidate (first in ``results``), or among equals the one that fails latest in the task."""
    order = [step.name for step in task.steps]

    def reached(result: CandidateResult) -> int:
        blamed = result.diagnoses[0].step if result.diagnoses else None
        return order.index(blamed) if blamed in order else -1

    same = [each for each in results if each.episodes and each.physics_score == results[0].physics_score]
    return max(same, key=reached, default=results[0])


def _from(configs: Sequence[Config], first: int) -> list[Config]:
    """Return the configs rotated so that config number ``first`` comes first."""
    first %= len(configs)
    return [*configs[first:], *configs[:first]]


def _in_turn(name: str, configs: Sequence[Config]) -> Strategies:
    """Return the configs as named strategies in order of preference; the first is called ``name``."""
    return {name if n == 0 else f"{name}_{n + 1}": config for n, config in enumerate(configs[:MAX_IN_TURN])}
