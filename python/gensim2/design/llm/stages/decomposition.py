"""Top-down mode: decompose a long task into the sub-tasks of the GenSim2 paper, and convert the sub-tasks to steps.

In the paper, ``grasp`` and ``ungrasp`` are separate sub-tasks. In this project, each step has one actuation pose (the
pose of the hand at the contact) and one gripper command. The sub-tasks are therefore converted as follows:

- The grasp of a rigid object becomes a step with a rule-based strategy.
- The grasp of a handle becomes part of the step that moves the handle.
- The release of an object becomes part of the step that places the object.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from gensim2.design.llm.catalog import Catalog, sentence_of
from gensim2.design.llm.conversations import Ask, Wrong
from gensim2.design.llm.extraction import ITEMS, Data
from gensim2.design.llm.specs import CRITERIA, criterion, long_task, next_step, roles_of
from gensim2.design.llm.stages.proposal import Proposal
from gensim2.design.llm.templating import Prompts
from gensim2.tasks.criteria import Criterion
from gensim2.tasks.spec import HAND, Step, TaskSpec

#: Maximum number of sub-tasks, as in the paper.
MAX_SUBTASKS = 5

GRASP, UNGRASP = "grasp", "ungrasp"
WORKING = ("articulated_open", "articulated_closed")
BRINGING = "distance_articulated_rigidbody"

SCHEMA: dict[str, Any] = {
    "type": "object",
    "properties": {
        "sub-tasks": {
            "type": "array",
            "maxItems": MAX_SUBTASKS,
            "items": {
                "type": "object",
                "properties": {
                    "task-name": {"type": "string"},
                    "task-description": {"type": "string"},
                    "assets-used": {"type": "array", "items": {"type": "string"}},
                    "success-criteria": {"type": "array", "items": {"type": "string", "enum": list(CRITERIA)}},
                },
                "required": ["task-name"],
            },
        }
    },
    "required": ["sub-tasks"],
}


@dataclass(frozen=True)
class DecomposedTask:
    """A decomposed task and the model's descriptions of its steps.

    ``sentences`` maps a step's name to its description. Grasp steps have no description.
    """

    task: TaskSpec
    sentences: Mapping[str, str]


def decomposition(prompts: Prompts, catalog: Catalog, found: Proposal, origin: str) -> Ask[DecomposedTask]:
    """Return the prompt that asks the model to divide a long task into sub-tasks."""
    assert found.rigid is not None
    text = prompts.text(
        "decomposition",
        **catalog.about(found.articulated, found.rigid).for_prompts(),
        task=found.to_dict(),
        max_subtasks=MAX_SUBTASKS,
    )
    return Ask(
        "decomposition", found.name, "", text, SCHEMA, lambda data: read_decomposition(data, catalog, found, origin)
    )


def read_decomposition(data: Sequence[Data], catalog: Catalog, found: Proposal, origin: str) -> DecomposedTask:
    """Convert the sub-tasks of an answer to steps, and return the task with the description of each step.

    Raises:
        Wrong: a sub-task breaks a rule, or the sub-tasks do not reach the goal; the error lists the faults.
    """
    given = _listed(data)
    problems: list[str] = []
    if not 2 <= len(given) <= MAX_SUBTASKS:
        problems.append(f"there must be 2 to {MAX_SUBTASKS} sub-tasks, not {len(given)}")
    if problems:
        raise Wrong(problems)
    assert found.rigid is not None
    articulated, rigid = catalog.articulated[found.articulated], catalog.rigid[found.rigid]
    role, other = roles_of(articulated, rigid)
    assert other is not None
    chain = _Chain(found, role, other)
    for number, each in enumerate(given):
        chain.add(number + 1, each, given[number + 1 :])
    chain.end()
    _check_goal(found, chain.steps, chain.problems)
    if chain.problems:
        raise Wrong(chain.problems)
    task = long_task(found.name, found.sentence, articulated, rigid, chain.steps, found.criteria, origin)
    return DecomposedTask(task, chain.sentences)


def _listed(data: Sequence[Data]) -> list[Data]:
    """Return the sub-tasks in an answer.

    The sub-tasks are a list under a key, a list at the top level, or successive JSON objects.
    """
    for each in reversed(data):
        for key in ("sub-tasks", "subtasks", "sub_tasks", ITEMS):
            if isinstance(each.get(key), list):
                listed = each[key]
                if not all(isinstance(item, dict) for item in listed):
                    raise Wrong(["each sub-task must be an object"])
                return list(listed)
    named = [each for each in data if "task-name" in each]
    if not named:
        raise Wrong(['there is no JSON object with the key "sub-tasks"'])
    return named


@dataclass
class _Chain:
    """Builds task steps from an answer one by one, and tracks the state of the hand."""

    found: Proposal
    role: str
    other: str
    steps: list[Step] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    sentences: dict[str, str] = field(default_factory=dict)
    held: bool = False
    brought: bool = False
    on_handle: bool = False
    reached: Criterion | None = None

    def add(self, number: int, given: Data, rest: Sequence[Data]) -> None:
        name = str(given.get("task-name", "")).strip().lower()
        where = f"sub-task {number}"
        if name in (GRASP, UNGRASP):
            self._fingers(where, name, given, rest)
            return
        kind = self._kind(where, given)
        if kind is None:
            return
        before = len(self.steps)
        sentence = sentence_of(given["task-description"], self.problems, f"{where}: task-description")
        if kind == BRINGING:
            self._bring(where)
        elif kind in WORKING:
            self._work(where, kind)
        elif kind == "distance_gripper_rigidbody" and self._grasps_next(rest):
            # The grasp of the next sub-task becomes a step with the criterion of this sub-task. No other step is needed
            # here.
            self.reached = criterion(kind, self.role, self.other)
        else:
            on = self.other if kind == "distance_gripper_rigidbody" else self.role
            self._step("reach", on, HAND, kind)
        self.sentences.update((step.name, sentence) for step in self.steps[before:])

    def end(self) -> None:
        if self.held:
            self.problems.append(
                'at the end the hand still holds the object; bring it somewhere, then {"task-name": "ungrasp"}'
            )

    def _fingers(self, where: str, name: str, given: Data, rest: Sequence[Data]) -> None:
        if len(given) > 1:
            self.problems.append(f'{where}: {name} has no key but "task-name"')
        if name == GRASP and (self.held or self.on_handle):
            self.problems.append(f"{where}: the hand holds something already")
        elif name == GRASP and self.reached is None and _first_kind(rest) in WORKING:
            self.on_handle = True  # the next motion moves the part to which this handle belongs
        elif name == GRASP:
            self._step(GRASP, self.other, HAND, "distance_gripper_rigidbody")
            self.held, self.brought, self.reached = True, False, None
        elif self.held and not self.brought:
            self.problems.append(f"{where}: the object is let go before it is brought anywhere ({BRINGING})")
        elif not (self.held or self.on_handle):
            self.problems.append(f"{where}: there is nothing in the hand to let go")
        else:
            self.held = self.brought = self.on_handle = False

    def _kind(self, where: str, given: Data) -> str | None:
        lacking = [key for key in ("task-description", "assets-used", "success-criteria") if key not in given]
        if lacking:
            self.problems.append(f"{where}: lacks " + ", ".join(f'"{key}"' for key in lacking))
            return None
        assets, kinds = _as_list(given["assets-used"]), _as_list(given["success-criteria"])
        own = (self.found.articulated, self.found.rigid)
        if len(assets) != 1 or assets[0] not in own:
            self.problems.append(f'{where}: "assets-used" must be one of {own[0]} and {own[1]}, not {_short(assets)}')
        if len(kinds) != 1 or kinds[0] not in CRITERIA:
            self.problems.append(
                f'{where}: "success-criteria" must be one of {", ".join(CRITERIA)}, not {_short(kinds)}'
            )
            return None
        return str(kinds[0])

    def _bring(self, where: str) -> None:
        if not self.held:
            self.problems.append(f'{where}: nothing is held; put {{"task-name": "grasp"}} before it')
            return
        self._step("place", self.role, self.other, BRINGING)
        self.brought = True

    def _work(self, where: str, kind: str) -> None:
        if self.held:
            self.problems.append(f'{where}: the hand holds the object; put {{"task-name": "ungrasp"}} before it')
            return
        self._step("open" if kind == "articulated_open" else "close", self.role, HAND, kind)

    def _step(self, verb: str, on: str, tool: str, kind: str) -> None:
        self.steps.append(next_step(self.steps, verb, on, tool, criterion(kind, self.role, self.other)))

    @staticmethod
    def _grasps_next(rest: Sequence[Data]) -> bool:
        return bool(rest) and str(rest[0].get("task-name", "")).strip().lower() == GRASP


def _first_kind(rest: Sequence[Data]) -> str | None:
    for each in rest:
        kinds = _as_list(each.get("success-criteria", []))
        if kinds:
            return str(kinds[0])
    return None


def _check_goal(found: Proposal, steps: Sequence[Step], problems: list[str]) -> None:
    """Append a fault to ``problems`` for each criterion of the proposed goal that the steps do not reach."""
    if not steps or problems:
        return
    done = [criterion.type for step in steps for criterion in step.done]
    worked = [kind for kind in done if kind in WORKING]
    for kind in found.criteria:
        if kind in WORKING and (not worked or worked[-1] != kind):
            problems.append(f"the task ends with {kind}, and no sub-task brings that about last")
        if kind == BRINGING and kind not in done:
            problems.append(f"the task ends with {kind}, and no sub-task brings that about")


def _as_list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [value]


def _short(values: Sequence[Any]) -> str:
    return ", ".join(str(value) for value in values)[:120] or "nothing"
