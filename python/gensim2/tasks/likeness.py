"""Detect tasks that are the same although their names, numbers or wording differ.

Two tasks have the same structure if they have the same goal, the same object classes and the same sequence of steps.
Two tasks have the same meaning in two cases: their instructions are the same, or their goals and object classes are the
same and their instructions are similar.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

from gensim2.objects.words import Goal
from gensim2.tasks.criteria import ArticulatedBetween, ArticulatedClosed, ArticulatedOpen, Criterion
from gensim2.tasks.spec import HAND, Step, TaskSpec

ALIKE = 85.0
"""Similarity of two sentences, 0 to 100, above which tasks with the same goal and object classes count as the same."""

#: Synonyms. Before instructions are compared, the words on the right are replaced by the word on the left.
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
    """A task in a form that contains no names and numbers, so that tasks can be compared with each other.

    Attributes:
        classes: classes of the objects that the steps or the goal use, sorted.
        goal: criteria of the goal, without their numbers.
        chain: sequence of the steps: the criteria of each step, without their numbers.
        words: words of the instruction, with synonyms replaced.
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
    # the pattern matches letters of every script, not only Latin letters
    words = re.findall(r"[^\W\d_]+", sentence.lower())
    return tuple(_FOR.get(word, word) for word in words if word not in _EMPTY)


def likeness(one: tuple[str, ...], other: tuple[str, ...]) -> float:
    """Return the similarity of two instructions, from 0 to 100. The order of words does not matter, and repeated words
    count once.

    First the different words of each instruction are sorted and joined to a string. Then M is the length of the longest
    common subsequence of the two strings, and T is the sum of their lengths. The similarity is 200 M / T.
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
    """Return a criterion's text fields as ``field=value``, with neutral names ``called`` of the objects."""
    fields = criterion.model_dump()
    words = [f"{name}={called.get(value, value)}" for name, value in sorted(fields.items()) if isinstance(value, str)]
    return tuple(words)


def joint_goal(task: TaskSpec) -> tuple[str, Goal] | None:
    """Return the class and the goal of a single-step joint task; None for any other task."""
    if not task.is_single_step or len(task.success) != 1:
        return None
    criterion = task.success[0]
    if isinstance(criterion, ArticulatedOpen | ArticulatedClosed):
        return task.objects[criterion.object].asset_class, criterion.type
    if isinstance(criterion, ArticulatedBetween):
        goal: Goal = "half_open" if starts_below(task, criterion) else "half_closed"
        return task.objects[criterion.object].asset_class, goal
    return None


def starts_below(task: TaskSpec, criterion: ArticulatedBetween) -> bool:
    """Return whether the joint starts below the range of openness of ``criterion``, so that it must be opened."""
    return (task.objects[criterion.object].randomization.openness_mean or 0.0) < criterion.low
