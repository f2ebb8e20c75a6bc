"""Choose everyday words for objects and for actions on objects."""

from __future__ import annotations

import hashlib
import re
import tomllib
import unicodedata
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any, Literal, get_args

End = Literal["articulated_open", "articulated_closed"]
"""End states of a joint: openness 1 and 0."""

Goal = Literal["articulated_open", "articulated_closed", "half_open", "half_closed"]
GOALS: tuple[Goal, ...] = get_args(Goal)
Direction = Literal["left", "right", "away"]
"""Person to whom an object is handed, as seen from the robot."""
"""Target of a joint: fully open, fully closed, or half open, starting from either limit."""

UNKNOWN = 0.6
"""Usefulness of a task that no table lists, between common tasks (1) and rare tasks (0.1)."""

#: Names and instructions of tasks for the upper and the lower joint limit, by suffix of the class; ``{}`` is the
#: object.
MOTIONS: dict[str, tuple[tuple[str, str], tuple[str, str]]] = {
    "cap": (("Unscrew{}Cap", "unscrew the cap of the {}"), ("Tighten{}Cap", "tighten the cap of the {}")),
    "lift": (("Lift{}", "lift the {}"), ("Lower{}", "set the {} down")),
    "move": (("Push{}", "push the {} away"), ("Pull{}", "pull the {} closer")),
    "press": (("Press{}", "press the {}"), ("Release{}", "release the {}")),
    "push": (("Slide{}Open", "slide the {} open"), ("Slide{}Shut", "slide the {} shut")),
    "rotate": (("Open{}", "open the {}"), ("Close{}", "close the {}")),
    "swing": (("Swing{}", "swing the handle of the {} over"), ("Swing{}Back", "swing the handle of the {} back")),
}
BY_JOINT = {"revolute": MOTIONS["rotate"], "prismatic": MOTIONS["push"]}


@dataclass(frozen=True)
class Phrase:
    """Everyday instruction for a task on one joint.

    Attributes:
        name: name in CamelCase, such as ``"PressStapler"``.
        sentence: instruction in lower case, such as ``"press the stapler"``.
        noun: name of the object, such as ``"stapler"``.
        usefulness: how likely it is that people ask for the task. 1: everyday requests (open, close, switch, press,
            lift); 0.5: occasional requests or parts of chores; 0.1: tasks that only undo others or happen by
            themselves.
    """

    name: str
    sentence: str
    noun: str
    usefulness: float


@dataclass(frozen=True)
class Purpose:
    """Common purpose of several actions.

    Attributes:
        say: sentence with ``{}`` in place of the actions, such as ``"{} to tidy the desk"``.
        goals: joint goals of the purpose. Each has a class of objects and the limit to which its joint is moved.
        errands: pairs of actions. The first is a joint goal as in ``goals``. The second puts a rigid object on or into
            another object, and has the class of this other object and the rigid class.
    """

    say: str
    goals: tuple[tuple[str, End], ...]
    errands: tuple[tuple[tuple[str, End], tuple[str, str]], ...]


@dataclass(frozen=True)
class ToAndFro:
    """A joint that people move to one limit and back in one task.

    Attributes:
        name, sentence: as in :class:`Phrase`.
        there, back: verbs of the two steps.
    """

    asset_class: str
    name: str
    sentence: str
    there: str
    back: str


def words(asset_class: str, goal: End, joint_type: str = "revolute") -> Phrase:
    """Return the instruction for moving the joint of a class of objects to one of its limits.

    Args:
        asset_class: articulated class. If the package has no words for it, its name forms the instruction.
        goal: ``"articulated_open"`` for the upper limit of the joint, ``"articulated_closed"`` for the lower limit.
        joint_type: ``"revolute"`` or ``"prismatic"``, for a class whose name does not say how its joint moves.
    """
    entry = _table()["articulated"].get(asset_class)
    if entry is not None:
        name, sentence, usefulness = entry["open" if goal == "articulated_open" else "closed"]
        return Phrase(name, sentence, entry["noun"], float(usefulness))
    spoken, motion = _taken_apart(asset_class)
    name, sentence = (MOTIONS[motion] if motion else BY_JOINT[joint_type])[goal == "articulated_closed"]
    return Phrase(name.format(camel_case(spoken)), sentence.format(spoken), spoken, UNKNOWN)


def halfway(asset_class: str, goal: Goal) -> Phrase | None:
    """Return the instruction that moves the joint of an object halfway, or None if people seldom ask for it."""
    entry = _table()["articulated"].get(asset_class, {})
    if goal not in entry:
        return None
    name, sentence, usefulness = entry[goal]
    return Phrase(name, sentence, entry["noun"], float(usefulness))


def purposes() -> tuple[Purpose, ...]:
    """Return the purposes that combine several tasks, such as tidying a desk."""
    ends: dict[str, End] = {"open": "articulated_open", "closed": "articulated_closed"}
    found = []
    for entry in _table()["purposes"]:
        goals = (goal.split() for goal in entry.get("goals", ()))
        errands = (errand.split() for errand in entry.get("errands", ()))
        found.append(
            Purpose(
                entry["say"],
                tuple((name, ends[end]) for name, end in goals),
                tuple(((name, ends[end]), (below, thing)) for name, end, below, thing in errands),
            )
        )
    return tuple(found)


def to_and_fro() -> tuple[ToAndFro, ...]:
    """Return the tasks in which people move a joint to one end and back."""
    return tuple(ToAndFro(**entry) for entry in _table()["to_and_fro"])


def handled(how: str) -> tuple[str, ...]:
    """Return the rigid classes that people ask to have ``"lifted"`` or ``"handed over"``, the most likely first."""
    return tuple(_table()["handled"].get(how, ()))


def belongs(asset_class: str) -> tuple[str, ...]:
    """Return the rigid classes that people keep in or put on an object of this class, the most likely first."""
    return tuple(_table()["belongs"].get(asset_class, ()))


def noun(asset_class: str) -> str:
    """Return the noun for an object of a class. If no noun is stored, derive it from the name of the class."""
    table = _table()
    if asset_class in table["articulated"]:
        return str(table["articulated"][asset_class]["noun"])
    return str(table["rigid"].get(asset_class) or _taken_apart(asset_class)[0])


def parts(asset_class: str) -> tuple[str, ...]:
    """Return the parts of an object of a class that people name, such as ``("lid",)`` for a box that opens."""
    return tuple(_table()["articulated"].get(asset_class, {}).get("parts", ()))


def articulated_classes() -> tuple[str, ...]:
    """Return the articulated classes for which the package has words."""
    return tuple(_table()["articulated"])


def rigid_classes() -> tuple[str, ...]:
    """Return the rigid classes for which the package has words."""
    return tuple(_table()["rigid"])


def synonyms(noun: str) -> tuple[str, ...]:
    """Return other nouns for the objects that the package calls ``noun``."""
    return tuple(_table()["synonyms"].get(noun, ()))


def _taken_apart(asset_class: str) -> tuple[str, str | None]:
    """Split a class's name into the noun and the suffix that describes the motion."""
    parts = [part for part in re.split(r"[\W_]+", asset_class) if part]
    motion = parts.pop() if len(parts) > 1 and parts[-1] in MOTIONS else None
    return " ".join(parts).lower() or "object", motion


def in_ascii(phrase: str) -> str:
    """Convert a phrase to ASCII words for names.

    If this is impossible, return ``object`` and a number computed from the phrase.
    """
    plain = [unicodedata.normalize("NFKD", word).encode("ascii", "ignore").decode() for word in phrase.split()]
    # The words have lost their accents, but also the letters without an ASCII form. The words are used only if no
    # letter was lost.
    whole = sum(map(str.isalnum, unicodedata.normalize("NFKD", phrase)))
    if plain and sum(map(str.isalnum, "".join(plain))) == whole:
        return " ".join(plain)
    return f"object {int(hashlib.sha256(phrase.encode()).hexdigest()[:6], 16)}"


def camel_case(phrase: str) -> str:
    """Convert ``"box of crackers"`` to ``"BoxOfCrackers"``."""
    return "".join(word[0].upper() + word[1:] for word in in_ascii(phrase.replace("'", "")).split())


@cache
def _table() -> dict[str, Any]:
    return tomllib.loads((resources.files("gensim2.objects") / "words.toml").read_text(encoding="utf-8"))
