"""Ask for a new task with one or several steps, and then ask the model whether the task is good."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from gensim2.design.llm.catalog import NAMED_SCHEMA, Catalog, name_of, sentence_of
from gensim2.design.llm.conversations import Ask, Wrong
from gensim2.design.llm.extraction import Data
from gensim2.design.llm.specs import CRITERIA, single_step
from gensim2.design.llm.templating import Prompts
from gensim2.tasks.criteria import CLOSED, OPEN
from gensim2.tasks.spec import TaskSpec

#: Phrases that ask for something that no criterion can measure, such as "5 cm", "halfway" or "to the left".
_UNMEASURED = re.compile(
    r"\b(\d+(\.\d+)? ?(mm|cm|m|degrees?|percent)|half(way)?|slightly|a (little|bit)|to the (left|right)|twice)\b"
)

#: Maximum deviation of the initial openness from its mean.
SPREAD = 0.15

KEYS = ("task-name", "task-description", "assets-used", "success-criteria")

SCHEMA: dict[str, Any] = {
    "type": "object",
    "properties": {
        **NAMED_SCHEMA,
        "assets-used": {"type": "array", "items": {"type": "string"}},
        "success-criteria": {"type": "array", "items": {"type": "string", "enum": list(CRITERIA)}},
    },
    "required": list(KEYS),
}

REFLECTION_SCHEMA: dict[str, Any] = {
    "type": "object",
    "properties": {
        "verdict": {"type": "string", "enum": ["good", "bad"]},
        "reasons": {"type": "array", "items": {"type": "string"}},
        "usefulness": {"type": "number"},
    },
    "required": ["verdict", "reasons", "usefulness"],
}


@dataclass(frozen=True)
class Proposal:
    """A task that the model proposed. :meth:`to_dict` returns the four keys of a proposal in the GenSim2 paper.

    Attributes:
        name: name in CamelCase.
        sentence: instruction in everyday words.
        rigid: class of the rigid object; None if the task has no rigid object.
        criteria: types of the criteria that must hold at the end.
    """

    name: str
    sentence: str
    articulated: str
    rigid: str | None
    criteria: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the proposal as a dictionary with the four keys that the GenSim2 paper uses."""
        return {
            "task-name": self.name,
            "task-description": self.sentence,
            "assets-used": [self.articulated] + ([self.rigid] if self.rigid else []),
            "success-criteria": list(self.criteria),
        }


@dataclass(frozen=True)
class Wish:
    """Restrictions that the user places on proposed tasks.

    Attributes:
        long: whether the tasks have several steps.
        task: name of the task; None: any.
        object: class that the task must use; None: any.
    """

    long: bool
    task: str | None = None
    object: str | None = None


def proposal(prompts: Prompts, catalog: Catalog, wish: Wish, refused: Sequence[str], number: int) -> Ask[Proposal]:
    """Return the question that asks for a new task.

    Args:
        catalog: robot, objects and known tasks.
        wish: restrictions on the task.
        refused: rejected proposals, with reasons.
        number: number of the proposal in the run.
    """
    bank = prompts.bank
    text = prompts.text(
        "proposal",
        **catalog.for_prompts(),
        good=bank["long" if wish.long else "single"],
        bad=bank["bad"],
        long=wish.long,
        target_task=wish.task,
        target_object=wish.object,
        refused=list(refused),
    )
    return Ask(
        "proposal",
        "",
        f"proposal {number + 1}",
        text,
        SCHEMA,
        lambda data: read_proposal(data, catalog, wish, [*bank["single"], *bank["long"]]),
        sample=number,
    )


def read_proposal(data: Sequence[Data], catalog: Catalog, wish: Wish, shown: Sequence[Data] = ()) -> Proposal:
    """Return the proposal in an answer; if the model corrects itself, return the last proposal.

    Args:
        data: mappings in the answer.
        catalog: robot, objects and known tasks.
        wish: restrictions on the task.
        shown: good examples of the prompt, which a proposal must not repeat.

    Raises:
        Wrong: the proposal breaks rules; the message lists all of them.
    """
    given = next((_in_kebab(each) for each in reversed(data) if "task-name" in _in_kebab(each)), None)
    if given is None:
        raise Wrong(["there is no JSON object with the keys " + ", ".join(f'"{key}"' for key in KEYS)])
    problems = [f'the key "{key}" is missing' for key in KEYS if key not in given]
    if problems:
        raise Wrong(problems)
    if wish.task is None:
        name = name_of(given["task-name"], problems, catalog.known)
    else:
        name = name_of(kebab(wish.task), problems, ())
    sentence = sentence_of(given["task-description"], problems)
    articulated, rigid = _objects(given["assets-used"], catalog, wish, problems)
    criteria = _criteria(given["success-criteria"], bool(rigid), wish, problems)
    if problems:
        raise Wrong(problems)
    found = Proposal(name, sentence, articulated, rigid, criteria)
    if wish.long:
        _check_place(found, catalog, problems)
    else:
        _check_single(found, catalog, problems)
    if (unmeasured := _UNMEASURED.search(found.sentence)) is not None:
        problems.append(f'"task-description": no success criterion measures "{unmeasured[0]}"; propose another goal')
    same = (found.to_dict()["assets-used"], set(criteria))
    if wish.task is None and any((each["assets-used"], set(each["success-criteria"])) == same for each in shown):
        problems.append("this repeats one of the good examples; propose a task with another object or another goal")
    if problems:
        raise Wrong(problems)
    return found


def task_of(found: Proposal, catalog: Catalog, origin: str) -> TaskSpec:
    """Convert a single-step proposal to a task."""
    thing = catalog.articulated[found.articulated]
    return single_step(found.name, found.sentence, thing, found.criteria[0], origin)


def reflection(prompts: Prompts, catalog: Catalog, found: Proposal, wish: Wish) -> Ask[tuple[bool, str]]:
    """Return the question that asks whether a proposal is good. The answer is a verdict with reasons."""
    classes = [name for name in (found.articulated, found.rigid) if name]
    return reflection_on(prompts, catalog.about(*classes), found.to_dict(), found.name, long=wish.long)


def reflection_on(
    prompts: Prompts, catalog: Catalog, task: Mapping[str, Any], name: str, *, long: bool, free: bool = False
) -> Ask[tuple[bool, str]]:
    """Return the question that asks the model whether a proposed task is good.

    Args:
        catalog: robot, objects and known tasks.
        task: the task as the model wrote it.
        long: whether the task has several steps.
        free: whether all criteria and several objects are allowed. The prompt then has no bad examples.
    """
    values = catalog.for_prompts()
    text = prompts.text("reflection", **values, task=dict(task), bad=prompts.bank["bad"], long=long, free=free)
    return Ask("reflection", name, "", text, REFLECTION_SCHEMA, read_reflection)


def read_reflection(data: Sequence[Data]) -> tuple[bool, str]:
    """Return whether the model finds a proposal good, and its reasons.

    Raises:
        Wrong: the answer has no verdict.
    """
    given = next((each for each in reversed(data) if "verdict" in each), {})
    verdict = str(given.get("verdict", "")).strip().lower()
    if verdict not in ("good", "bad"):
        raise Wrong(['the key "verdict" must be "good" or "bad"'])
    reasons = given.get("reasons", [])
    said = [str(each) for each in reasons] if isinstance(reasons, list) else [str(reasons)]
    return verdict == "good", " ".join(" ".join(said).split())[:500]


def kebab(name: str) -> str:
    """Convert ``"OpenSafe"`` to ``"open-safe"``."""
    return "".join(f"-{c.lower()}" if c.isupper() else c for c in name).strip("-")


def _in_kebab(given: Data) -> Data:
    return {str(key).strip().lower().replace("_", "-").replace(" ", "-"): value for key, value in given.items()}


def _objects(given: Any, catalog: Catalog, wish: Wish, problems: list[str]) -> tuple[str, str | None]:
    names = [given] if isinstance(given, str) else given
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        problems.append('"assets-used" must be a list of object names')
        return "", None
    for name in names:
        if name not in catalog.articulated and name not in catalog.rigid:
            problems.append(f'"assets-used": {catalog.unknown(name)}')
    articulated = [name for name in names if name in catalog.articulated]
    rigid = [name for name in names if name in catalog.rigid]
    if len(articulated) != 1:
        problems.append(f'"assets-used" must name exactly one articulated object, not {len(articulated)}')
    if wish.long and len(rigid) != 1:
        problems.append(f'"assets-used" must name exactly one rigid object, not {len(rigid)}')
    if not wish.long and rigid:
        problems.append(f'"assets-used": a task of one motion uses no rigid object, take out {", ".join(rigid)}')
    if wish.object is not None and wish.object not in names:
        problems.append(f'"assets-used" must name {wish.object}')
    return (articulated[0] if articulated else ""), (rigid[0] if rigid else None)


def _criteria(given: Any, has_rigid: bool, wish: Wish, problems: list[str]) -> tuple[str, ...]:
    kinds = [given] if isinstance(given, str) else given
    if not isinstance(kinds, list) or not kinds or not all(isinstance(kind, str) for kind in kinds):
        problems.append('"success-criteria" must be a list of kinds')
        return ()
    found = tuple(dict.fromkeys(kind.strip() for kind in kinds))
    for kind in found:
        if kind not in CRITERIA:
            problems.append(f'"success-criteria": there is no kind {kind[:80]!r}; the kinds are {", ".join(CRITERIA)}')
        elif "rigidbody" in kind and not has_rigid:
            problems.append(f'"success-criteria": {kind} needs a rigid object')
    if {"articulated_open", "articulated_closed"} <= set(found):
        problems.append('"success-criteria": nothing is both open and closed at the end')
    if not wish.long and len(found) > 1:
        problems.append('"success-criteria": a task of one motion has one')
    return found


def _check_place(found: Proposal, catalog: Catalog, problems: list[str]) -> None:
    """Append a fault to ``problems`` if the articulated object has no place for another object."""
    if catalog.articulated[found.articulated].place is None:
        places = ", ".join(name for name, thing in catalog.articulated.items() if thing.place is not None)
        problems.append(f"{found.articulated} has no place for an object; these have one: {places or 'none'}")


def _check_single(found: Proposal, catalog: Catalog, problems: list[str]) -> None:
    """Append faults of a single-step task: goal met at the start, no moving keypoint, or known class and goal."""
    thing, (kind,) = catalog.articulated[found.articulated], found.criteria
    start = thing.default_openness or 0.0
    if kind == "articulated_open" and start + SPREAD >= OPEN:
        problems.append(f"{found.articulated} is open at the start already (openness about {start:.2f})")
    if kind == "articulated_closed" and start - SPREAD <= CLOSED:
        problems.append(f"{found.articulated} is closed at the start already (openness about {start:.2f})")
    if not thing.lever_arms:
        problems.append(f"{found.articulated} has no keypoint on the part that moves; take another object")
    for task in catalog.known:
        same = [each.asset_class for each in task.objects.values()] == [found.articulated]
        if task.is_single_step and same and [c.type for c in task.success] == [kind] and task.name != found.name:
            problems.append(f"the task {task.name} is the same: {kind} of {found.articulated}")
