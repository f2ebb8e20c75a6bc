"""Wording for objects and for what can be done with them."""

from __future__ import annotations

import hashlib
import re
import tomllib
import unicodedata
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any, Literal

End = Literal["articulated_open", "articulated_closed"]
"""The ends of a joint: openness 1 and 0."""

Goal = Literal["articulated_open", "articulated_closed", "half_open", "half_closed"]
"""Target of a joint: an end, or halfway from the closed or from the open side."""

UNKNOWN = 0.6
"""Usefulness of what no table knows: below what people are known to ask for, above what they are known not to."""

#: Endings of class names that say how the object moves, with what to say and what to call it for both ends.
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
    """A task on one joint, as a person would put it.

    Attributes:
        name: CamelCase, for example ``"PressStapler"``.
        sentence: what a person would ask for, in lower case: ``"press the stapler"``.
        noun: what the object is called: ``"stapler"``.
        usefulness: how likely anybody is to ask for it. 1: as such, any day (open, close, switch, press, lift). 0.5:
            now and then, or as part of a chore. 0.1: hardly ever, because the object does it by itself or because it
            only undoes what was wanted.
    """

    name: str
    sentence: str
    noun: str
    usefulness: float


@dataclass(frozen=True)
class Purpose:
    """Purpose of several actions.

    Attributes:
        say: what a person would say, ``{}`` where it is said what is done: ``"{} to tidy the desk"``.
        goals: classes and the ends to which their joints are brought for it.
        errands: such a class and end, and what is put on or into what besides: both classes, the thing last.
    """

    say: str
    goals: tuple[tuple[str, End], ...]
    errands: tuple[tuple[tuple[str, End], tuple[str, str]], ...]


@dataclass(frozen=True)
class ToAndFro:
    """Joint that is brought to one end and back.

    Attributes:
        asset_class: of the object.
        name, sentence: as in :class:`Phrase`.
        there, back: verbs of the two steps.
    """

    asset_class: str
    name: str
    sentence: str
    there: str
    back: str


def words(asset_class: str, goal: End, joint_type: str = "revolute") -> Phrase:
    """Return the phrase that asks for a class's joint to be brought to one end.

    Args:
        asset_class: articulated; one that the table does not know gets a plain phrase from its name.
        goal: which end.
        joint_type: ``"revolute"`` or ``"prismatic"``, for a class whose name does not say how it moves.
    """
    entry = _table()["articulated"].get(asset_class)
    if entry is not None:
        name, sentence, usefulness = entry["open" if goal == "articulated_open" else "closed"]
        return Phrase(name, sentence, entry["noun"], float(usefulness))
    spoken, motion = _taken_apart(asset_class)
    name, sentence = (MOTIONS[motion] if motion else BY_JOINT[joint_type])[goal == "articulated_closed"]
    return Phrase(name.format(camel_case(spoken)), sentence.format(spoken), spoken, UNKNOWN)


def halfway(asset_class: str, goal: Goal) -> Phrase | None:
    """Return the phrase that asks for a class's joint to be left halfway; None where there is none."""
    entry = _table()["articulated"].get(asset_class, {})
    if goal not in entry:
        return None
    name, sentence, usefulness = entry[goal]
    return Phrase(name, sentence, entry["noun"], float(usefulness))


def purposes() -> tuple[Purpose, ...]:
    """Return the purposes for which people do several things."""
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
    """Return the joints that people bring to one end and back."""
    return tuple(ToAndFro(**entry) for entry in _table()["to_and_fro"])


def handled(how: str) -> tuple[str, ...]:
    """Classes of rigid objects that people ask to be ``"lifted"`` or ``"handed over"``, the likeliest first."""
    return tuple(_table()["handled"].get(how, ()))


def belongs(asset_class: str) -> tuple[str, ...]:
    """Classes of rigid objects that people keep in or put on one of this class, the likeliest first."""
    return tuple(_table()["belongs"].get(asset_class, ()))


def noun(asset_class: str) -> str:
    """Return the noun for an object of a class, articulated or rigid; the class's name where no table has one."""
    table = _table()
    if asset_class in table["articulated"]:
        return str(table["articulated"][asset_class]["noun"])
    return str(table["rigid"].get(asset_class) or _taken_apart(asset_class)[0])


def _taken_apart(asset_class: str) -> tuple[str, str | None]:
    """The noun in a class's name, and the ending that says how it moves."""
    parts = [part for part in re.split(r"[\W_]+", asset_class) if part]
    motion = parts.pop() if len(parts) > 1 and parts[-1] in MOTIONS else None
    return " ".join(parts).lower() or "object", motion


def in_ascii(phrase: str) -> str:
    """ASCII words that stand for a phrase in names; a number where it has other letters, for names must differ."""
    plain = [unicodedata.normalize("NFKD", word).encode("ascii", "ignore").decode() for word in phrase.split()]
    # An accent may go, a letter may not.
    whole = sum(map(str.isalnum, unicodedata.normalize("NFKD", phrase)))
    if plain and sum(map(str.isalnum, "".join(plain))) == whole:
        return " ".join(plain)
    return f"object {int(hashlib.sha256(phrase.encode()).hexdigest()[:6], 16)}"


def camel_case(phrase: str) -> str:
    """``"box of crackers"`` is ``"BoxOfCrackers"``."""
    return "".join(word[0].upper() + word[1:] for word in in_ascii(phrase.replace("'", "")).split())


@cache
def _table() -> dict[str, Any]:
    return tomllib.loads((resources.files("gensim2.objects") / "words.toml").read_text(encoding="utf-8"))
