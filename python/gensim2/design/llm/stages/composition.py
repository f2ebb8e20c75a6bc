"""Bottom-up mode: ask a model for a long task composed of tasks that the robot already solves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from gensim2.design.base import Known
from gensim2.design.llm.catalog import NAMED_SCHEMA, Catalog, name_of, sentence_of
from gensim2.design.llm.conversations import Ask, Wrong
from gensim2.design.llm.extraction import Data
from gensim2.design.llm.specs import criterion, long_task, next_step, roles_of
from gensim2.design.llm.stages.decomposition import BRINGING, GRASP, WORKING
from gensim2.design.llm.stages.proposal import Wish
from gensim2.design.llm.templating import Prompts
from gensim2.tasks.spec import HAND, Step, TaskSpec
from gensim2.tasks.strategies import Strategies

#: Maximum number of steps of a composed task.
MAX_STEPS = 5

PLACE = "place"

SCHEMA: dict[str, Any] = {
    "type": "object",
    "properties": {
        **NAMED_SCHEMA,
        "steps": {
            "type": "array",
            "items": {
                "type": "object",
                "properties": {"skill": {"type": "string"}, "object": {"type": "string"}, "into": {"type": "string"}},
                "required": ["skill", "object"],
            },
        },
    },
    "required": ["task-name", "task-description", "steps"],
}


@dataclass(frozen=True)
class Skill:
    """A single-step task that the robot solves.

    Attributes:
        kind: type of its success criterion.
    """

    name: str
    object: str
    kind: str
    strategies: Strategies

    @property
    def before(self) -> str:
        """Preconditions of the skill, in words for the model."""
        return "empty hand, closed or ajar" if self.kind == "articulated_open" else "empty hand, open or ajar"

    @property
    def after(self) -> str:
        """Effect of the skill in words: its success criterion."""
        return self.kind


@dataclass(frozen=True)
class Composition:
    """A composed task, and the known strategies of its steps."""

    task: TaskSpec
    strategies: Mapping[str, Strategies]


def skills_of(known: Sequence[Known], catalog: Catalog) -> list[Skill]:
    """Return the known tasks with a single step and one articulated object.

    Longer tasks can use these tasks as steps.
    """
    found = []
    for each in known:
        task = each.task
        if not task.is_single_step or len(task.success) != 1 or task.success[0].type not in WORKING:
            continue
        (thing, *rest) = task.objects.values()
        if not rest and thing.asset_class in catalog.articulated:
            found.append(Skill(task.name, thing.asset_class, task.success[0].type, each.strategies))
    return sorted(found, key=lambda skill: (skill.object, skill.name))


def composition(
    prompts: Prompts,
    catalog: Catalog,
    skills: Sequence[Skill],
    wish: Wish,
    refused: Sequence[str],
    number: int,
    origin: str,
) -> Ask[Composition]:
    """Return the question that asks for a new task composed of ``skills``."""
    text = prompts.text(
        "composition",
        **catalog.for_prompts(),
        skills=skills,
        target_object=wish.object,
        refused=list(refused),
        max_steps=MAX_STEPS,
    )
    return Ask(
        "composition",
        "",
        f"proposal {number + 1}",
        text,
        SCHEMA,
        lambda data: read_composition(data, catalog, skills, wish, origin),
        sample=number,
    )


def read_composition(
    data: Sequence[Data], catalog: Catalog, skills: Sequence[Skill], wish: Wish, origin: str
) -> Composition:
    """Return the task in an answer.

    Raises:
        Wrong: a step is unknown or its precondition fails; the problems name the step.
    """
    given = next((each for each in reversed(data) if "steps" in each), None)
    if given is None:
        raise Wrong(['there is no JSON object with the keys "task-name", "task-description" and "steps"'])
    problems: list[str] = []
    name = name_of(given.get("task-name"), problems, catalog.known)
    sentence = sentence_of(given.get("task-description"), problems)
    steps = given["steps"]
    if not isinstance(steps, list) or not all(isinstance(step, dict) for step in steps):
        problems.append('"steps" must be a list of objects')
    elif not 2 <= len(steps) <= MAX_STEPS:
        problems.append(f'"steps" must be 2 to {MAX_STEPS}, not {len(steps)}')
    if problems:
        raise Wrong(problems)
    classes = _classes(steps, catalog, skills, wish, problems)
    if problems:
        raise Wrong(problems)
    articulated, rigid = catalog.articulated[classes[0]], catalog.rigid[classes[1]] if classes[1] else None
    role, other = roles_of(articulated, rigid)
    chain = _Chain(role, other, {skill.name: skill for skill in skills}, problems)
    for number, step in enumerate(steps):
        chain.add(f"step {number + 1}", str(step.get("skill", "")).strip())
    chain.end()
    if problems:
        raise Wrong(problems)
    task = long_task(name, sentence, articulated, rigid, chain.steps, chain.goal, origin)
    return Composition(task, chain.strategies)


def _classes(
    steps: Sequence[Data], catalog: Catalog, skills: Sequence[Skill], wish: Wish, problems: list[str]
) -> tuple[str, str | None]:
    known = {skill.name: skill for skill in skills}
    articulated: set[str] = set()
    rigid: set[str] = set()
    for number, step in enumerate(steps):
        skill, thing = str(step.get("skill", "")).strip(), str(step.get("object", "")).strip()
        where = f"step {number + 1}"
        if skill in known:
            articulated.add(known[skill].object)
            if thing and thing != known[skill].object:
                problems.append(f"{where}: {skill} works on {known[skill].object}, not on {thing[:80]}")
        elif skill in (GRASP, PLACE):
            if thing in catalog.rigid:
                rigid.add(thing)
            else:
                problems.append(f"{where}: {skill} needs a rigid object: {catalog.unknown(thing)}")
            into = str(step.get("into", "")).strip()
            if skill == PLACE and into in catalog.articulated:
                articulated.add(into)
                if catalog.articulated[into].place is None:
                    problems.append(f"{where}: {into} has no place for an object")
            elif skill == PLACE:
                problems.append(f'{where}: "into" must be an articulated object: {catalog.unknown(into)}')
        else:
            problems.append(f"{where}: there is no skill {skill[:80]!r}")
    if not problems and (len(articulated) != 1 or len(rigid) > 1):
        problems.append(
            f"the steps are about {', '.join(sorted(articulated | rigid))}; one articulated object and at most one "
            "rigid one are allowed"
        )
    if wish.object is not None and wish.object not in articulated | rigid:
        problems.append(f"the steps must be about {wish.object}")
    return next(iter(articulated), ""), next(iter(rigid), None)


class _Chain:
    """Builder of steps from an answer.

    The builder tracks the hand and the joint, and finds preconditions that are not met.
    """

    def __init__(self, role: str, other: str | None, skills: Mapping[str, Skill], problems: list[str]) -> None:
        self.role, self.other, self.skills, self.problems = role, other, skills, problems
        self.steps: list[Step] = []
        self.strategies: dict[str, Strategies] = {}
        self._held = False
        self._joint: str | None = None
        self._placed = False

    @property
    def goal(self) -> list[str]:
        """Return the types of criteria that hold at the end."""
        return ([BRINGING] if self._placed else []) + ([self._joint] if self._joint else [])

    def add(self, where: str, skill: str) -> None:
        if skill == GRASP:
            self._grasp(where)
        elif skill == PLACE:
            self._place(where)
        elif self._held:
            self.problems.append(f"{where}: the hand holds an object; place it before {skill}")
        elif self.skills[skill].kind == self._joint:
            self.problems.append(f"{where}: {skill} brings about what is so already")
        else:
            self._joint = self.skills[skill].kind
            found = self._step("open" if self._joint == "articulated_open" else "close", self.role, HAND, self._joint)
            self.strategies[found] = self.skills[skill].strategies

    def end(self) -> None:
        if self._held:
            self.problems.append("at the end the hand still holds the object; place it")

    def _grasp(self, where: str) -> None:
        if self._held:
            self.problems.append(f"{where}: the hand holds an object already")
            return
        self._step(GRASP, str(self.other), HAND, "distance_gripper_rigidbody")
        self._held = True

    def _place(self, where: str) -> None:
        if not self._held:
            self.problems.append(f"{where}: nothing is held; grasp it before")
            return
        if self._joint == "articulated_closed":
            self.problems.append(f"{where}: nothing can be put into what was closed just before")
        self._step(PLACE, self.role, str(self.other), BRINGING)
        self._held, self._placed = False, True

    def _step(self, verb: str, on: str, tool: str, kind: str) -> str:
        self.steps.append(next_step(self.steps, verb, on, tool, criterion(kind, self.role, self.other)))
        return self.steps[-1].name
