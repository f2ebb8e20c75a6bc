"""Define the words that the parser of instructions knows: verbs, nouns, modifiers and function words.

Nouns come from ``objects/words.toml``. The meaning of a verb for an object comes from the same file: sentences such as
"press the stapler" show for which end of a joint a verb stands (:mod:`~gensim2.instructions.meanings`).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from typing import Final

from gensim2.core.errors import InputError
from gensim2.objects import words

Words = tuple[str, ...]
"""Consecutive words of a sentence."""


class Action(StrEnum):
    """Meaning of a verb with its modifiers, apart from the object."""

    OPEN = "open"
    CLOSE = "close"
    SLIDE_OPEN = "slide open"
    SLIDE_SHUT = "slide shut"
    TURN_ON = "turn on"
    TURN_OFF = "turn off"
    PUSH = "push away"
    PULL = "pull closer"
    PRESS = "press"
    RELEASE = "release"
    LIFT = "lift"
    LOWER = "lower"
    SWING = "swing over"
    SWING_BACK = "swing back"
    UNSCREW = "unscrew"
    TIGHTEN = "tighten"
    PUT = "put somewhere"
    TAKE = "take out"
    HAND = "hand over"


#: Modifiers of verbs, with all phrases that express them.
MODIFIERS: Final[dict[str, tuple[str, ...]]] = {
    "open": ("open", "wide open"),
    "shut": ("shut", "closed"),
    "on": ("on",),
    "off": ("off",),
    "up": ("up", "upwards", "upward"),
    "down": ("down", "downwards", "downward"),
    "in": ("in", "inwards"),
    "out": ("out", "outwards"),
    "over": ("over",),
    "back": ("back",),
    "away": ("away", "further away", "farther away", "forward", "forwards", "further", "farther", "away from you"),
    "closer": (
        "closer",
        "nearer",
        "closer to you",
        "nearer to you",
        "closer to yourself",
        "closer to the robot",
        "towards you",
        "toward you",
        "towards yourself",
        "towards the robot",
        "to you",
        "here",
    ),
    "half": ("halfway", "half way", "half", "to half", "partly", "partway", "partially", "ajar"),
}

#: Phrases that do not change the meaning of an instruction.
NEUTRAL: Final = (
    "a bit",
    "a little",
    "a little bit",
    "again",
    "all the way",
    "also",
    "as well",
    "carefully",
    "completely",
    "entirely",
    "for me",
    "fully",
    "gently",
    "now",
    "once",
    "once more",
    "please",
    "quickly",
    "quietly",
    "right now",
    "slightly",
    "slowly",
    "too",
)

#: Phrases in front of an instruction that do not change its meaning.
POLITE: Final = (
    "can you",
    "could you",
    "go and",
    "go ahead and",
    "hello",
    "hey",
    "hi",
    "i need you to",
    "i want you to",
    "i would like you to",
    "kindly",
    "ok",
    "okay",
    "please",
    "robot",
    "will you",
    "would you",
    "you can",
    "you should",
    "your task is to",
)

#: Words between two instructions.
CONNECTORS: Final = (
    ",",
    ".",
    ";",
    "!",
    "?",
    "and",
    "then",
    "next",
    "afterwards",
    "after that",
    "finally",
    "first",
    "firstly",
    "lastly",
    "secondly",
)

#: Words that end the part of a sentence that an error message quotes.
ENDS: Final = frozenset((",", ".", ";", "!", "?", "and", "then"))

#: Words that negate an instruction or except something from it.
NEGATIONS: Final = frozenset(
    (
        "not",
        "no",
        "never",
        "nothing",
        "none",
        "neither",
        "nor",
        "without",
        "except",
        "unless",
        "avoid",
        "refuse",
        "stop",
        "refrain",
        "dont",
        "doesnt",
        "cannot",
        "cant",
        "wont",
        "n't",
        "rather",
        "instead",
    )
)

#: Words that begin the reason of an instruction, which the parser leaves out.
REASONS: Final = ("so that", "because", "in order to", "since", "to let", "to look", "for a quick look")

DETERMINERS: Final = frozenset(
    (
        "a",
        "an",
        "the",
        "this",
        "that",
        "my",
        "your",
        "our",
        "his",
        "her",
        "its",
        "their",
        "both",
        "some",
        "one",
    )
)

#: Adjectives that do not change which object is meant, because a scene has one object of each class.
ADJECTIVES: Final = frozenset(
    (
        "small",
        "little",
        "big",
        "large",
        "tiny",
        "huge",
        "red",
        "green",
        "blue",
        "yellow",
        "white",
        "black",
        "brown",
        "grey",
        "gray",
        "silver",
        "golden",
        "wooden",
        "metal",
        "plastic",
        "old",
        "new",
        "nice",
        "empty",
        "full",
        "ripe",
        "fresh",
        "whole",
        "kitchen",
        "bathroom",
        "office",
        "heavy",
        "clean",
        "dirty",
        "round",
    )
)

#: Adjectives that state whether a container is open.
STATES: Final = {"open": "open", "opened": "open", "closed": "closed", "shut": "closed"}

#: Pronouns for one object, and for the objects of the previous instruction.
IT: Final = frozenset(("it", "this", "that"))
THEM: Final = frozenset(("them", "these", "those", "both"))
THERE: Final = ("in there", "there", "inside", "in", "in it", "inside it", "therein", "away")
"""Phrases for the container that was named before. In the order in which they are tried, longer phrases come first."""

INTO: Final = ("into", "inside of", "inside", "in to", "in", "within")
ONTO: Final = ("on top of", "on to", "onto", "on", "upon")
TO: Final = ("to",)
OUT_OF: Final = ("out of", "from inside", "from", "off of", "off")
"""Prepositions before a destination, or before the place from which an object is taken."""

#: Phrases that say to whom an object is handed, by direction.
HANDING: Final = {
    "left": ("to the person on the left", "to the person on your left", "to the left"),
    "right": ("to the person on the right", "to the person on your right", "to the right"),
    "away": ("to the person across the table", "to the person across", "across the table", "across"),
}

Actions = dict[Words, Action]
"""Actions of a verb, by its modifiers in alphabetical order, without "half"."""

_MOVES: Actions = {("away",): Action.PUSH, ("back",): Action.PUSH, ("closer",): Action.PULL}
_SWITCH: Actions = {("on",): Action.TURN_ON, ("off",): Action.TURN_OFF}
_SHUT: Actions = {("shut",): Action.CLOSE, ("in",): Action.CLOSE}
_OPENED: Actions = {("open",): Action.OPEN}
_OUT: Actions = {("out",): Action.OPEN, ("open", "out"): Action.OPEN}
_PUT: Actions = {
    (): Action.PUT,
    ("back",): Action.PUT,
    ("away",): Action.PUT,
    ("in",): Action.PUT,
    ("down",): Action.LOWER,
}
_TAKE: Actions = {(): Action.TAKE, ("out",): Action.TAKE, ("up",): Action.TAKE}
_RAISE: Actions = {(): Action.LIFT, ("up",): Action.LIFT, ("off",): Action.OPEN, **_OPENED}

#: Actions of each verb.
VERBS: Final[dict[str, Actions]] = {
    "open": {(): Action.OPEN, ("up",): Action.OPEN},
    "close": {(): Action.CLOSE, ("up",): Action.CLOSE},
    "shut": {(): Action.CLOSE, ("up",): Action.CLOSE, ("down",): Action.CLOSE},
    "leave": {},
    "turn": {**_SWITCH, ("down",): Action.TURN_OFF},
    "switch": _SWITCH,
    "flip": _SWITCH,
    "put": {**_PUT, **_SWITCH},
    "press": {(): Action.PRESS, ("down",): Action.PRESS, ("in",): Action.PRESS},
    "push": {(): Action.PUSH, ("down",): Action.PRESS, **_MOVES, **_SHUT, **_OPENED},
    "shove": {(): Action.PUSH, **_MOVES, **_SHUT},
    "pull": {
        (): Action.PULL,
        **_MOVES,
        ("back",): Action.PULL,
        ("up",): Action.RELEASE,
        ("back", "up"): Action.RELEASE,
        ("down",): Action.PRESS,
        ("shut",): Action.CLOSE,
        **_OPENED,
        **_OUT,
    },
    "drag": _MOVES | {("back",): Action.PULL} | _OPENED,
    "bring": {("closer",): Action.PULL, ("back",): Action.PULL},
    "move": {**_MOVES, (): Action.PUT},
    "slide": {
        ("open",): Action.SLIDE_OPEN,
        ("shut",): Action.SLIDE_SHUT,
        ("out",): Action.OPEN,
        ("in",): Action.CLOSE,
        ("away",): Action.PUSH,
        ("closer",): Action.PULL,
    },
    "swing": {
        (): Action.SWING,
        ("over",): Action.SWING,
        ("back",): Action.SWING_BACK,
        ("back", "over"): Action.SWING_BACK,
        **_OPENED,
        ("shut",): Action.CLOSE,
    },
    "lift": _RAISE,
    "raise": _RAISE,
    "pick": {("up",): Action.TAKE},
    "lower": {(): Action.LOWER, ("down",): Action.LOWER},
    "release": {(): Action.RELEASE},
    "unscrew": {(): Action.UNSCREW, ("off",): Action.UNSCREW},
    "tighten": {(): Action.TIGHTEN},
    "screw": {("on",): Action.TIGHTEN, ("back", "on"): Action.TIGHTEN, ("off",): Action.UNSCREW},
    "set": {**_PUT, (): Action.PUT},
    "place": _PUT,
    "drop": _PUT,
    "lay": _PUT,
    "store": _PUT,
    "stash": _PUT,
    "stow": _PUT,
    "insert": _PUT,
    "deposit": _PUT,
    "throw": _PUT,
    "toss": _PUT,
    "collect": _PUT,
    "transfer": _PUT,
    "take": _TAKE | {("off",): Action.OPEN},
    "get": _TAKE,
    "fetch": _TAKE,
    "grab": _TAKE,
    "grasp": _TAKE,
    "remove": _TAKE | {("off",): Action.OPEN},
    "retrieve": _TAKE,
    "hand": {("over",): Action.HAND, (): Action.HAND},
    "pass": {("over",): Action.HAND, (): Action.HAND},
    "give": {(): Action.HAND},
}


def spelled(text: str) -> Words:
    """Split a text into the words and punctuation marks by which the parser reads it, in lower case."""
    plain = text.lower().replace("\N{RIGHT SINGLE QUOTATION MARK}", "'").replace("-", " ")
    plain = re.sub(r"n't\b", " not", plain)
    return tuple(re.findall(r"'s\b|[^\W_]+|[^\w\s]", plain))


@dataclass(frozen=True)
class Noun:
    """A noun that the parser knows.

    Attributes:
        name: the noun, as in ``words.toml``.
        classes: classes of objects that the noun names.
        rigid: whether the objects are rigid.
    """

    name: str
    classes: tuple[str, ...]
    rigid: bool


@cache
def nouns() -> dict[Words, Noun]:
    """Return all nouns by the words in which they are spelled, with synonyms."""
    found: dict[Words, Noun] = {}
    for rigid, classes in ((False, words.articulated_classes()), (True, words.rigid_classes())):
        for name in dict.fromkeys(words.noun(each) for each in classes):
            own = tuple(each for each in classes if words.noun(each) == name)
            noun = Noun(name, own, rigid)
            for spelling in _spellings(name, own if rigid else ()):
                other = found.setdefault(spelled(spelling), noun)
                if other is not noun:
                    raise InputError(f"{spelling!r} names {other.name} and {name}", file="words.toml", field="synonyms")
    return found


def _spellings(name: str, classes: Iterable[str]) -> Iterable[str]:
    """Return all spellings of a noun: "box of sugar" is also "sugar box", and a class name is a spelling, too."""
    yield name
    yield from words.synonyms(name)
    kind, _, content = name.partition(" of ")
    if content:
        yield f"{content} {kind}"
    for each in classes:
        if (spelling := each.replace("_", " ")) not in (name, f"{content} {kind}"):
            yield spelling


@cache
def parts() -> frozenset[str]:
    """Return the names of all parts of objects, such as "lid"."""
    return frozenset(part for each in words.articulated_classes() for part in words.parts(each))


#: Parts whose lifting opens an object, and whose lowering closes it.
COVERS: Final = frozenset(("lid", "screen", "flap"))
#: Parts that are pressed when they are pushed.
PRESSED: Final = frozenset(("button", "lever"))


def longest(at: int, sentence: Words, phrases: Sequence[Words]) -> int:
    """Return the length of the longest of ``phrases`` that begins at word ``at`` of a sentence; 0 without any."""
    return max((len(each) for each in phrases if sentence[at : at + len(each)] == each), default=0)
