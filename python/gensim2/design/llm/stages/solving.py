"""Ask the model for solver configs.

Questions ask for constraints first, then for motions, and after simulations for better configs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from gensim2.design.affordance import Affordance
from gensim2.design.base import Known, RobotSummary
from gensim2.design.llm import configs
from gensim2.design.llm.configs import CONSTRAINTS, FINGERS, MOTIONS
from gensim2.design.llm.conversations import Ask, Wrong
from gensim2.design.llm.extraction import ITEMS, Data
from gensim2.design.llm.templating import Prompts
from gensim2.design.pictures import LazyPicture
from gensim2.planning.strategies import PLANNER_FIELDS
from gensim2.robots import RobotProfile
from gensim2.tasks.criteria import ArticulatedBetween, ArticulatedClosed, ArticulatedOpen
from gensim2.tasks.spec import HAND, Step, TaskSpec
from gensim2.tasks.wording import criteria_in_words

Config = dict[str, Any]

#: Maximum number of examples in a prompt.
EXAMPLES = 3

_LIST = {"type": "array"}
_MOTION_FIELDS: dict[str, Any] = {
    "pre_actuation_motions": _LIST,
    "post_actuation_motions": _LIST,
    "gripper": {"type": "string", "enum": ["open", "closed", "grasp", "hold", "release"]},
    "let_go": {"type": "number"},
}
_CONSTRAINT_FIELDS: dict[str, Any] = {CONSTRAINTS: {"type": "array", "items": {"type": "object"}}}


def _schema(properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "object", "properties": properties, "required": list(properties)}


def _listed_schema(field: str, properties: dict[str, Any]) -> dict[str, Any]:
    return _schema({field: {"type": "array", "items": {"type": "object", "properties": properties}}})


@dataclass(frozen=True)
class StepToSolve:
    """A step of a task for which the model is asked for solver configs.

    Attributes:
        step: step for which configs are requested.
        things: facts about each object's class, by the object's name in the task.
        settings: summary of the robot, which includes the keypoints of its hand.
        profile: robot profile, which defines the valid keypoint names of the hand.
        sentence: the model's description of the step; None if the model wrote no description.
    """

    task: TaskSpec
    step: Step
    things: Mapping[str, Affordance]
    settings: RobotSummary
    profile: RobotProfile
    sentence: str | None = None

    @property
    def held(self) -> Affordance | None:
        """Affordance of the grasped object, or None."""
        return None if self.step.tool == HAND else self.things[self.step.tool]

    @property
    def moves_joint(self) -> bool:
        """Whether the step moves the joint of its object, so that configs may use the joint's frame."""
        if self.things[self.step.object].joint_type is None:
            return False
        return self.held is None or any(
            isinstance(each, ArticulatedOpen | ArticulatedClosed | ArticulatedBetween) for each in self.step.done
        )

    @property
    def openness(self) -> float | None:
        """Openness of the step's object after all earlier steps have succeeded; None for a rigid object."""
        spec, thing = self.task.objects[self.step.object], self.things[self.step.object]
        found = spec.randomization.openness_mean
        found = thing.default_openness if found is None else found
        for criterion in (each for step in self._before for each in step.done):
            if self.step.object not in criterion.objects:
                continue
            if isinstance(criterion, ArticulatedOpen):
                found = (1.0 + criterion.threshold) / 2
            elif isinstance(criterion, ArticulatedClosed):
                found = criterion.threshold / 2
            elif isinstance(criterion, ArticulatedBetween):
                found = (criterion.low + criterion.high) / 2
        return found

    @property
    def _before(self) -> tuple[Step, ...]:
        return self.task.steps[: self.task.steps.index(self.step)]

    def for_prompts(self) -> dict[str, Any]:
        """Return the values shared by all solver prompts."""
        done = criteria_in_words(self.step.done)
        sentence = self.sentence or (self.task.description if self.task.is_single_step else f"{self.step.name}: {done}")
        thing, spec = self.things[self.step.object], self.task.objects[self.step.object]
        return {
            "spec": spec,
            "openness": self.openness,
            "facts": {} if self.openness is None else thing.facts(self.openness, spec.place.at),
            "before": [(each.name, criteria_in_words(each.done)) for each in self._before],
            "sentence": sentence,
            "goal": done,
            "description": self.task.description,
            "task_name": self.task.name,
            "step_name": self.step.name,
            "thing": thing,
            "moves_joint": self.moves_joint,
            "held": self.held,
            "settings": self.settings,
            "tool_keypoints": self.settings.tool_keypoints,
        }

    def problems(self, config: Mapping[str, Any]) -> list[str]:
        """Return the faults of a solver config for this step, as sentences."""
        found = configs.problems_of_config(config)
        gripper = config.get("gripper", "open")
        if not found and self.held is not None and gripper not in ("hold", "release"):
            found = [f"gripper: the hand holds {self.held.asset_class}; use release (or hold), not {gripper}"]
        if not found and self.held is None and gripper in ("hold", "release"):
            found = [f"gripper: nothing is held; use open, closed or grasp, not {gripper}"]
        if not found:
            found = configs.problems_of_names(self.task, self.step, config, self.things, self.profile)
        return found


@dataclass(frozen=True)
class CaptionedPictures:
    """Pictures for a prompt, each with a caption."""

    captions: tuple[str, ...] = ()
    pictures: tuple[LazyPicture, ...] = ()


def constraints(prompts: Prompts, job: StepToSolve, known: Sequence[Known], sight: CaptionedPictures) -> Ask[list[Any]]:
    """Return the question of stage 1, which asks for the constraints of the actuation pose."""
    stage = "constraints_visual" if sight.pictures else "constraints"
    examples = [
        {"name": each.name, "sentence": each.sentence, "constraints": {CONSTRAINTS: each.config[CONSTRAINTS]}}
        for each in examples_for(job, known)
    ]
    text = prompts.text(stage, **job.for_prompts(), examples=examples, captions=sight.captions)
    schema = _schema(_CONSTRAINT_FIELDS)
    return Ask(
        stage, job.task.name, job.step.name, text, schema, lambda data: read_constraints(data, job), sight.pictures
    )


def read_constraints(data: Sequence[Data], job: StepToSolve) -> list[Any]:
    """Return the constraint list in an answer.

    Raises:
        Wrong: a constraint is invalid, or names an unknown keypoint.
    """
    found = next((each[CONSTRAINTS] for each in data if CONSTRAINTS in each), None)
    if found is None:
        found = next((each[ITEMS] for each in data if isinstance(each.get(ITEMS), list)), None)
    if found is None:
        raise Wrong([f'there is no field "{CONSTRAINTS}"'])
    problems = configs.problems_of_constraints(found)
    if (
        not problems
        and not job.moves_joint
        and any(
            each.get("target_axis_frame") == "joint" or each.get("target_offset_frame") == "joint" for each in found
        )
    ):
        problems = ["the frame joint is not available, because this step moves no joint; use object or world"]
    if not problems:
        fingers = "closed" if job.held is None else "hold" if job.moves_joint else "release"
        whole = {CONSTRAINTS: found, "pre_actuation_motions": [["translate_z", -0.08]], "gripper": fingers}
        problems = configs.problems_of_names(job.task, job.step, whole, job.things, job.profile)
    if problems:
        raise Wrong(problems)
    return list(found)


def motions(
    prompts: Prompts,
    job: StepToSolve,
    known: Sequence[Known],
    constraint_list: Sequence[Any],
    trials: int,
    sight: CaptionedPictures,
) -> Ask[list[Config]]:
    """Return the question of stage 2, which asks for ``trials`` configs with motions to and from the actuation pose."""
    stage = "motions_visual" if sight.pictures else "motions"
    examples = [
        {"name": each.name, "sentence": each.sentence, "motions": _motions_of(each.config)}
        for each in examples_for(job, known)
    ]
    text = prompts.text(
        stage,
        **job.for_prompts(),
        examples=examples,
        constraints={CONSTRAINTS: list(constraint_list)},
        trials=trials,
        captions=sight.captions,
    )
    schema = _listed_schema("trials", _MOTION_FIELDS)

    def read(data: list[Data]) -> list[Config]:
        given = _several(data, "trials", {*MOTIONS, *FINGERS})
        whole = [{CONSTRAINTS: list(constraint_list), **configs.cleaned(each)} for each in given]
        return _valid(whole, job, trials, remarks)

    remarks: list[str] = []
    return Ask(stage, job.task.name, job.step.name, text, schema, read, sight.pictures, remarks=remarks)


@dataclass(frozen=True)
class Tried:
    """A simulated solver config and its results, described in sentences for the model.

    Attributes:
        outcome: sentences that state how often the planner found a plan and how often the config succeeded.
        diagnosis: one sentence for each kind of failure.
    """

    config: Config
    outcome: str
    diagnosis: tuple[str, ...]


def regeneration(
    prompts: Prompts, job: StepToSolve, tried: Sequence[Tried], trials: int, round: int
) -> Ask[list[Config]]:
    """Return the question that asks for better configs, given the results of earlier configs."""
    text = prompts.text("regeneration", **job.for_prompts(), tried=tried, trials=trials)
    schema = _listed_schema("configs", {**_CONSTRAINT_FIELDS, **_MOTION_FIELDS})

    def read(data: list[Data]) -> list[Config]:
        whole = [configs.cleaned(each) for each in _several(data, "configs", {CONSTRAINTS})]
        return _valid(whole, job, trials, remarks)

    about = f"{job.step.name}, round {round + 1}"
    remarks: list[str] = []
    return Ask("regeneration", job.task.name, about, text, schema, read, sample=round, remarks=remarks)


@dataclass(frozen=True)
class Example:
    """A solver config of a stored task, shown to the model as an example."""

    name: str
    sentence: str
    config: Config


def examples_for(job: StepToSolve, known: Sequence[Known]) -> list[Example]:
    """Return up to ``EXAMPLES`` stored configs as examples for the step.

    The examples are configs of the steps that are most similar in tool, goal and class, with at most one per class.
    """
    own = job.things[job.step.object]
    kinds = [criterion.type for criterion in job.step.done]
    ranked: list[tuple[tuple[bool, ...], str, Example, str]] = []
    for each in known:
        for step in each.task.steps:
            name = step.strategies[0]
            config = each.strategies.get(name, {})
            asset_class = each.task.objects[step.object].asset_class
            same = (asset_class, [criterion.type for criterion in step.done]) == (own.asset_class, kinds)
            if CONSTRAINTS not in config or each.task.name == job.task.name or (same and job.task.is_single_step):
                # Skip this example, because it would show the model the stored solution of the task to be solved.
                continue
            unlike = (
                (step.tool == HAND) != (job.step.tool == HAND),
                [criterion.type for criterion in step.done] != kinds,
                asset_class != own.asset_class,
                not each.task.is_single_step,
            )
            shown = {field: value for field, value in config.items() if field not in configs.DROPPED}
            sentence = each.task.description if each.task.is_single_step else f"{step.name} ({each.task.description})"
            ranked.append((unlike, each.task.name, Example(each.task.name, sentence, shown), asset_class))
    chosen: list[Example] = []
    classes: set[str] = set()
    for _, _, example, asset_class in sorted(ranked, key=lambda item: item[:2]):
        if asset_class not in classes and len(chosen) < EXAMPLES:
            classes.add(asset_class)
            chosen.append(example)
    return chosen


def _motions_of(config: Mapping[str, Any]) -> Config:
    return {name: config[name] for name in (*MOTIONS, *FINGERS, *PLANNER_FIELDS) if name in config}


def _several(data: Sequence[Data], field: str, marks: set[str]) -> list[Data]:
    """Return the JSON objects in an answer: under ``field``, at the top, or each object with a key of ``marks``."""
    for each in data:
        for name in (field, ITEMS):
            if isinstance(each.get(name), list):
                listed = [item for item in each[name] if isinstance(item, dict)]
                if listed:
                    return listed
    loose = [each for each in data if marks & set(each)]
    if not loose:
        raise Wrong([f'there is no list "{field}"'])
    return loose


def _valid(given: Sequence[Config], job: StepToSolve, max_count: int, remarks: list[str]) -> list[Config]:
    """Return the valid configs without duplicates and add faults to ``remarks``.

    Raise an error only if no config is valid.
    """
    found: list[Config] = []
    problems: list[str] = []
    for number, config in enumerate(given[: 4 * max_count]):
        wrong = job.problems(config)
        problems += [f"number {number + 1}: {problem}" for problem in wrong]
        if not wrong and config not in found:
            found.append(config)
    if not found:
        raise Wrong(problems or ["the list is empty"])
    remarks += problems
    return found[:max_count]
