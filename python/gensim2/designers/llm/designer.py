"""A designer that asks a language model, stage by stage as the paper does; physics is the judge of what it says."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, Protocol

from gensim2.designers.base import Brief, Candidate, CandidateResult, Declined, Strategies
from gensim2.designers.llm.conversations import Conversations, Dropped
from gensim2.designers.llm.ledger import BudgetSpent
from gensim2.designers.llm.model import Model
from gensim2.designers.llm.questions import Picture
from gensim2.designers.llm.stages import code as code_stage
from gensim2.designers.llm.stages import composition, decomposition, proposal, solving
from gensim2.designers.llm.stages.proposal import Wish
from gensim2.designers.llm.stages.solving import Config, Job, Sight
from gensim2.designers.llm.templating import Prompts
from gensim2.designers.llm.world import World
from gensim2.robots import robot
from gensim2.tasks.spec import HAND, Step, TaskSpec

Mode = Literal["explore", "topdown", "bottomup"]

#: Proposals in a row that come to nothing before no more are asked for.
MOST_FAILURES = 5

#: Configs of a step that are shown, with how they fared, when better ones are asked for.
SHOWN_TRIED = 3

GRASPS: Strategies = {
    "grasp": {"grasp": "antipodal"},
    "grasp_from_any_side": {"grasp": "antipodal", "tilt": 1.6, "candidates": 60},
}
"""How a rigid object is taken up: by rule, as the paper's ``grasp``."""


class Views(Protocol):
    """Draws what a model is shown."""

    def actuation(self, task: TaskSpec, steps: Mapping[str, Strategies], step: str) -> Picture | None:
        """The scene with the arm at the actuation pose that the strategies of ``step`` lead to; None: there is none."""
        ...


@dataclass(frozen=True)
class Asking:
    """How a model's designs are asked for.

    Attributes:
        mode: ``"explore"``: tasks of one motion; ``"topdown"``: long tasks, taken apart; ``"bottomup"``: long tasks, put
            together from verified ones.
        target_task: propose this task; None: any.
        target_object: propose tasks on this class; None: any.
        trials: configs of a step that are asked for at once.
        max_rounds: answers to a question before it is dropped, and rounds of better configs after physics.
        visual: show pictures.
        code: ask for each task as code, too.
    """

    mode: Mode = "explore"
    target_task: str | None = None
    target_object: str | None = None
    trials: int = 3
    max_rounds: int = 3
    visual: bool = False
    code: bool = False


class LLMDesigner:
    """Fills :class:`~gensim2.designers.base.Designer`.

    Args:
        model: who is asked.
        prompts: in which words.
        asking: what for.
        robot_name: against whose keypoints configs are checked.
        views: draws actuation poses; None: they are not shown.
    """

    def __init__(
        self, model: Model, prompts: Prompts, asking: Asking, robot_name: str = "panda", views: Views | None = None
    ) -> None:
        self.model, self.prompts, self.asking, self.views = model, prompts, asking, views
        self.talk = Conversations(model, prompts, asking.max_rounds)
        self._profile = robot(robot_name)
        self._proposed: list[TaskSpec] = []
        self._skills: dict[str, Mapping[str, Strategies]] = {}
        self._notes: list[str] = []

    @property
    def name(self) -> str:
        """``llm:`` and the model's name."""
        return f"llm:{self.model.options.model}"[:100]

    @property
    def notes(self) -> Sequence[str]:
        """Why there are no more proposals, and how many questions had no answer that could be used."""
        dropped = sum(each.outcome == "dropped" for each in self.talk.log.conversations)
        refused = sum(each.outcome == "refused" for each in self.talk.log.conversations)
        counts = []
        if dropped:
            counts.append(f"{dropped} question{'s' * (dropped > 1)} had no answer that could be used and were dropped")
        if refused:
            counts.append(f"{refused} proposal{'s' * (refused > 1)} of the model were found bad by itself")
        return [*self._notes, *counts]

    def open(self, folder: Path) -> None:
        """Keep questions, answers and what became of them in ``folder/model``."""
        self.talk.open(folder)

    def propose(self, brief: Brief, seed: int) -> Iterator[TaskSpec]:
        """Yield what the model proposes, one after the other, until it has nothing more that can be used."""
        refused: list[str] = []
        failures = 0
        for number in itertools.count():
            if failures == MOST_FAILURES:
                self._notes.append(
                    f"{failures} proposals of the model in a row came to nothing; no more were asked for"
                )
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
                yield task
                if self.asking.target_task is not None:
                    return

    def candidates(self, task: TaskSpec, brief: Brief, seed: int) -> list[Candidate]:
        """Stages 1 and 2 for each step that is not known or done by rule; trial n of each step makes candidate n.

        Raises:
            Declined: the model's answers cannot be used, or the budget is spent.
        """
        fixed = {step.name: found for step in task.steps if (found := self._fixed(task, step)) is not None}
        jobs = [self._job(task, step, brief) for step in task.steps if step.name not in fixed]
        try:
            with ThreadPoolExecutor(max_workers=self.model.options.concurrency) as pool:
                designed = list(pool.map(lambda job: self._configs(job, brief, fixed), jobs))
        except (Dropped, BudgetSpent) as error:
            raise Declined(str(error)) from error
        ways = {job.step.name: found for job, found in zip(jobs, designed, strict=True)}
        count = max((len(found) for found in ways.values()), default=1)
        made = []
        for trial in range(count):
            chosen = {name: found[trial % len(found)] for name, found in ways.items()}
            steps = {
                step.name: dict(fixed[step.name]) if step.name in fixed else {step.strategies[0]: chosen[step.name]}
                for step in task.steps
            }
            made.append(self._candidate(f"trial {trial + 1}", steps, chosen))
        return made

    def refine(
        self, task: TaskSpec, brief: Brief, results: Sequence[CandidateResult], seed: int, round: int
    ) -> list[Candidate]:
        """Ask for better configs of the step that is to blame, with what went wrong in words."""
        if round >= self.asking.max_rounds or not results:
            return []
        step = self._to_blame(task, results[0])
        if step is None:
            return []
        name = step.strategies[0]
        tried = _tried(step, [each for each in results if name in each.candidate.steps[step.name]])
        ask = solving.regeneration(self.prompts, self._job(task, step, brief), tried, self.asking.trials, round)
        try:
            found, _ = self.talk.ask(ask)
        except (Dropped, BudgetSpent) as error:
            self._notes.append(f"{task.name}: no better configs: {error}")
            return []
        seen = [result.candidate.steps for result in results]
        children = []
        for number, config in enumerate(found):
            steps = {**results[0].candidate.steps, step.name: {name: config}}
            if steps not in seen:
                children.append(self._candidate(f"round {round + 1}, config {number + 1}", steps, {step.name: config}))
        return children

    def _proposal(self, brief: Brief, number: int, refused: list[str]) -> TaskSpec | None:
        """One proposal; None where the model itself finds it bad."""
        world = World.of(brief)
        world = replace(world, known=tuple({task.name: task for task in (*world.known, *self._proposed)}.values()))
        wish = Wish(self.asking.mode == "topdown", self.asking.target_task, self.asking.target_object)
        if self.asking.mode == "bottomup":
            return self._composed(brief, world, wish, number, refused)
        found, record = self.talk.ask(proposal.proposal(self.prompts, world, wish, refused, number))
        self.talk.log.settle(record, found.name, "used")
        (good, why), _ = self.talk.ask(proposal.reflection(self.prompts, world, found, wish))
        if not good:
            self.talk.log.settle(record, found.name, "refused", why)
            refused.append(f"{found.name} ({found.sentence}): {why}")
            return None
        if wish.long:
            task, _ = self.talk.ask(decomposition.decomposition(self.prompts, world, found, self.name))
        else:
            task = proposal.task_of(found, world, self.name)
        return self._as_code(task, brief) if self.asking.code else task

    def _composed(self, brief: Brief, world: World, wish: Wish, number: int, refused: Sequence[str]) -> TaskSpec | None:
        skills = composition.skills_of(brief.known, world)
        if not skills:
            raise Dropped("there are no verified tasks of one step to put together")
        ask = composition.composition(self.prompts, world, skills, wish, refused, number, self.name)
        found, record = self.talk.ask(ask)
        self.talk.log.settle(record, found.task.name, "used")
        self._skills[found.task.name] = found.strategies
        return self._as_code(found.task, brief) if self.asking.code else found.task

    def _as_code(self, task: TaskSpec, brief: Brief) -> TaskSpec:
        """The task by way of generated code in a sandbox; as it is where there is no sandbox."""
        from gensim2.designers.sandbox import NoSandboxError, run_task_code, task_code

        try:
            known = [each.task for each in brief.known if each.task.is_single_step == task.is_single_step]
            references = [(each.name, task_code(each)) for each in known[: code_stage.REFERENCES]]
            found, _ = self.talk.ask(code_stage.code(self.prompts, task, references, run_task_code))
        except NoSandboxError as error:
            self._notes.append(f"generated code is refused: {error}")
            return task
        names = {step.name: step.strategies for step in task.steps}
        steps = tuple(step.model_copy(update={"strategies": names[step.name]}) for step in found.steps)
        return found.model_copy(update={"steps": steps, "provenance": task.provenance})

    def _fixed(self, task: TaskSpec, step: Step) -> Strategies | None:
        """How a step is done that nobody is asked about."""
        known = self._skills.get(task.name, {}).get(step.name)
        if known is not None:
            return known
        return GRASPS if step.tool == HAND and step.name.startswith("grasp") else None

    def _job(self, task: TaskSpec, step: Step, brief: Brief) -> Job:
        return Job(task, step, brief.of(task), brief.settings.tool_keypoints, self._profile)

    def _configs(self, job: Job, brief: Brief, fixed: Mapping[str, Strategies]) -> list[Config]:
        """Both stages of the solver for one step."""
        sight = self._sight(job)
        found, _ = self.talk.ask(solving.constraints(self.prompts, job, brief.known, sight))
        sight = self._with_actuation(job, found, fixed, sight)
        trials, _ = self.talk.ask(solving.motions(self.prompts, job, brief.known, found, self.asking.trials, sight))
        return trials

    def _sight(self, job: Job) -> Sight:
        """Pictures of the step's objects, where pictures are wanted and can be had."""
        if not self.asking.visual:
            return Sight()
        captions, pictures = [], []
        for thing in (job.things[job.step.object], job.held):
            if thing is not None and thing.picture is not None:
                captions.append(f"`{thing.asset_class}` as the robot has it before it, its keypoints marked and named")
                pictures.append(Picture(f"class {thing.asset_class}", thing.picture))
        return Sight(tuple(captions), tuple(pictures))

    def _with_actuation(
        self, job: Job, constraint_list: list[Any], fixed: Mapping[str, Strategies], sight: Sight
    ) -> Sight:
        """With the actuation pose that the constraints of stage 1 lead to."""
        if not self.asking.visual or self.views is None:
            return sight
        fingers = "closed" if job.held is None else "release"
        name = job.step.strategies[0]
        config = {
            "constraint_list": constraint_list,
            "pre_actuation_motions": [["translate_z", -0.08]],
            "gripper": fingers,
        }
        picture = self.views.actuation(job.task, {**fixed, job.step.name: {name: config}}, job.step.name)
        if picture is None:
            return sight
        caption = (
            "the arm at the actuation pose that the constraints below lead to; red, green, blue: x, y, z of the base"
        )
        return Sight((*sight.captions, caption), (*sight.pictures, picture))

    def _to_blame(self, task: TaskSpec, result: CandidateResult) -> Step | None:
        """The step whose config is to be written anew: the one that failed, else the last that the model wrote."""
        own = [step for step in task.steps if self._fixed(task, step) is None]
        blamed = {each.step for each in result.diagnoses}
        return next((step for step in own if step.name in blamed), own[-1] if own else None)

    def _candidate(self, label: str, steps: Mapping[str, Strategies], written: Mapping[str, Config]) -> Candidate:
        ways = "; ".join(
            f"{name}: {_in_words(config)}" if len(steps) > 1 else _in_words(config) for name, config in written.items()
        )
        return Candidate(
            f"{label}: {ways}"[:400], {name: dict(each) for name, each in steps.items()}, {"by": self.name}
        )


def _tried(step: Step, results: Sequence[CandidateResult]) -> list[solving.Tried]:
    """The best configs of a step so far, each with how it fared."""
    name = step.strategies[0]
    found: list[solving.Tried] = []
    for result in results:
        config = result.candidate.steps[step.name][name]
        if len(found) == SHOWN_TRIED or any(each.config == config for each in found):
            continue
        told = f"Planned on {result.plan_score:.0%} of the scenes."
        if result.episodes:
            told += f" In physics it held in {result.held:.0f} of {result.episodes} episodes."
        words = tuple(str(each) for each in result.diagnoses if each.step in (None, step.name))
        found.append(solving.Tried(config, told, words))
    return found


def _in_words(config: Config) -> str:
    """What a config does, in one phrase."""
    contact = next((each for each in config["constraint_list"] if "target_keypoint_name" in each), {})
    motions = [
        " ".join(f"{part:g}" if isinstance(part, int | float) else str(part) for part in motion)
        if isinstance(motion, list)
        else str(motion)
        for motion in config.get("post_actuation_motions", [])
    ]
    target = str(contact.get("target_keypoint_name", "")).removeprefix("articulated_object_")
    return f"{config.get('gripper', 'open')} at {target}" + (f", {', '.join(motions)}" if motions else "")
