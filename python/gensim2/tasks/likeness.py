"""Detect tasks with the same meaning, even if their names, numbers or wording differ.

Two tasks have the same structure if their goals, their object classes and their sequences of steps are the same. They
have the same meaning if their goals and object classes are the same and their sentences similar, or if their sentences
are the same.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

from gensim2.tasks.criteria import Criterion
from gensim2.tasks.spec import HAND, Step, TaskSpec

ALIKE = 85.0
"""Similarity of two sentences, 0 to 100, above which tasks with the same goal and object classes count as the same."""

#: Synonyms in instructions. Before sentences are compared, each word in a value is replaced by its key.
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
"""Part of a goal or a step: criterion type, its text fields, and its objects as class and number."""


@dataclass(frozen=True)
class NormalForm:
    """Form of a task for comparisons, without names and numbers.

    Attributes:
        classes: classes of the objects that steps or goal use, sorted.
        goal: criteria that must hold at the end.
        chain: criteria of each step, in the order of the steps.
        words: words of the sentence, with synonyms replaced.
    """

    classes: Classes
    goal: frozenset[Fact]
    chain: tuple[tuple[Fact, ...], ...]
    words: tuple[str, ...]


def normal_form(task: TaskSpec) -> NormalForm:
    """Return the form of a task for comparisons; steps without criteria, such as a release, are left out."""
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
    """Return the reason why two tasks count as the same; None if they differ."""
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
    """Return the first of ``others`` that counts as the same task, and the reason; None if all differ."""
    for other in others:
        if (why := why_alike(task, other)) is not None:
            return other, why
    return None


def normal_words(sentence: str) -> tuple[str, ...]:
    """Return the meaningful words of a sentence in order, with synonyms replaced."""
    words = re.findall(r"[^\W\d_]+", sentence.lower())  # letters of any script
    return tuple(_FOR.get(word, word) for word in words if word not in _EMPTY)


def likeness(one: tuple[str, ...], other: tuple[str, ...]) -> float:
    """Return the similarity of two sets of words, 0 to 100, regardless of order and repetition.

    The words are sorted and joined. The similarity is 100 times the ratio 2 M / T, where M is the length of the longest
    common subsequence of letters and T the total length.
    """
    first, second = " ".join(sorted(set(one))), " ".join(sorted(set(other)))
    lengths = [0] * (len(second) + 1)
    for letter in first:
        before = lengths
        lengths = [0]
        for place, each in enumerate(second):
            lengths.append(before[place] + 1 if letter == each else max(before[place + 1], lengths[place]))
    total = len(first) + len(second)
    return 200.0 * lengths[-1] / total if total else 100.0


def _concerned(task: TaskSpec) -> list[str]:
    """Return the names of the objects that steps and goal use, in the order in which they are first used."""
    named = [name for step in task.steps for name in (step.object, step.tool) if name != HAND]
    return list(dict.fromkeys([*named, *(name for criterion in task.success for name in criterion.objects)]))


def _called(task: TaskSpec) -> dict[str, str]:
    """Return a neutral name for each object: its class, with a number if several objects have this class."""
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
    """Return the text fields of a criterion without its numbers. Objects are replaced by the names in ``called``."""
    fields = criterion.model_dump()
    words = [f"{name}={called.get(value, value)}" for name, value in sorted(fields.items()) if isinstance(value, str)]
    return tuple(words)
