"""Whether two tasks are the same to a person, though their names, roles, numbers or words differ.

By structure: the same goal on the same classes, reached by the same chain of verbs. By meaning: the same goal on the
same classes in sentences that are nearly alike, or one and the same sentence.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

from rapidfuzz import fuzz

from gensim2.tasks.criteria import Criterion
from gensim2.tasks.spec import HAND, Step, TaskSpec

ALIKE = 85.0
"""Likeness of two sentences, 0 to 100, from which on they say the same of the same goal."""

#: What a person may say for one and the same; each word on the left stands for those on the right.
SAYINGS = {
    "close": ("shut", "closed"),
    "open": ("opened",),
    "put": ("place", "drop", "set", "stash", "store", "lay", "insert", "deposit", "move", "stow"),
    "take": ("grab", "grasp", "get", "fetch", "pick"),
    "turn": ("rotate", "swing", "twist"),
    "lift": ("raise",),
    "into": ("in", "inside", "within"),
    "onto": ("on", "upon", "top"),
    "refrigerator": ("fridge",),
    "laptop": ("notebook", "computer"),
    "faucet": ("tap",),
    "trash": ("garbage", "rubbish", "waste"),
}
_FOR = {said: word for word, others in SAYINGS.items() for said in others}
_EMPTY = frozenset(
    word
    for words in (
        "a an the it its",
        "and then after so that",
        "at by from of to with",
        "you have all please",
        "robot arm",
    )
    for word in words.split()
)

Classes = tuple[str, ...]
Fact = tuple[str, ...]
"""Of a goal or a step: a type of criterion, its words, and the objects that it is about, as class and number."""


@dataclass(frozen=True)
class NormalForm:
    """A task without names and numbers.

    Attributes:
        classes: of its objects that a step or the goal is about, sorted.
        goal: what must hold at the end.
        chain: what each step does, in order.
        words: of its sentence, each in the form that stands for it.
    """

    classes: Classes
    goal: frozenset[Fact]
    chain: tuple[tuple[Fact, ...], ...]
    words: tuple[str, ...]


def normal_form(task: TaskSpec) -> NormalForm:
    """The normal form of a task: steps in which nothing need hold, such as a release, are left out."""
    called = _called(task)
    chain: list[tuple[Fact, ...]] = []
    for step in task.steps:
        link = _link(step, called)
        if step.done and (not chain or chain[-1] != link):
            chain.append(link)
    goal = frozenset(_fact(criterion, called) for criterion in task.success)
    classes = tuple(sorted(task.objects[name].asset_class for name in _concerned(task)))
    return NormalForm(classes, goal, tuple(chain), normal_words(task.description))


def why_alike(one: TaskSpec, other: TaskSpec) -> str | None:
    """Why two tasks are the same to a person; None where they are not."""
    first, second = normal_form(one), normal_form(other)
    if first.words == second.words and first.words:
        return "says the same"
    if first.classes != second.classes or first.goal != second.goal:
        return None
    if first.chain == second.chain:
        return "has the same goal on the same objects, reached by the same steps"
    if likeness(first.words, second.words) >= ALIKE:
        return "has the same goal on the same objects, in nearly the same words"
    return None


def first_alike(task: TaskSpec, others: Iterable[TaskSpec]) -> tuple[TaskSpec, str] | None:
    """The first of other tasks that is the same to a person, and why; None where each is another."""
    for other in others:
        if (why := why_alike(task, other)) is not None:
            return other, why
    return None


def normal_words(sentence: str) -> tuple[str, ...]:
    """The words that carry a sentence's meaning, in order, each in the form that stands for it."""
    words = re.findall(r"[^\W\d_]+", sentence.lower())  # letters of any script
    return tuple(_FOR.get(word, word) for word in words if word not in _EMPTY)


def likeness(one: tuple[str, ...], other: tuple[str, ...]) -> float:
    """Return the similarity of the words of two sentences, in whatever order and however often: 0 to 100."""
    return float(fuzz.token_sort_ratio(" ".join(set(one)), " ".join(set(other))))


def _concerned(task: TaskSpec) -> list[str]:
    """Objects in the order in which steps and goal come to them; what only stands about is none of them."""
    named = [name for step in task.steps for name in (step.object, step.tool) if name != HAND]
    return list(dict.fromkeys([*named, *(name for criterion in task.success for name in criterion.objects)]))


def _called(task: TaskSpec) -> dict[str, str]:
    """Return the name of each object: its class, with a number where there are several."""
    seen: Counter[str] = Counter()
    called = {}
    for name in [*_concerned(task), *task.objects]:
        if name not in called:
            asset_class = task.objects[name].asset_class
            seen[asset_class] += 1
            called[name] = f"{asset_class} {seen[asset_class]}"
    return called


def _link(step: Step, called: dict[str, str]) -> tuple[Fact, ...]:
    acted = ("acts", called[step.object], called.get(step.tool, HAND))
    return (acted, *sorted({_fact(criterion, called) for criterion in step.done}))


def _fact(criterion: Criterion, called: dict[str, str]) -> Fact:
    """A criterion without its numbers: they say how far, not what."""
    fields = criterion.model_dump()
    words = [f"{name}={called.get(value, value)}" for name, value in sorted(fields.items()) if isinstance(value, str)]
    return tuple(words)
