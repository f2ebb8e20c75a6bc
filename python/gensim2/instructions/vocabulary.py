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
    "open": ("open", "opened", "wide open"),
    "shut": ("shut", "closed"),
    "on": ("on",),
    "off": ("off",),
    "up": ("up", "upwards", "upward"),
    "down": ("down", "downwards", "downward"),
    "in": ("in", "inwards"),
    "out": ("out", "outwards"),
    "over": (
        "over",
        "across",
        *(
            f"{before}{side} side"
            for before in ("", "over ", "across ")
            for side in ("to the other", "to the opposite", "to its other")
        ),
    ),
    "back": (
        "back",
        "backwards",
        "backward",
        *(f"{to} the back{end}" for to in ("to", "toward", "towards") for end in ("", " of the table")),
    ),
    "forward": ("forward", "forwards"),
    "away": (
        "away",
        "further",
        "farther",
        "further off",
        "farther off",
        "along",
        "along the table",
        "out of the way",
        "out of my way",
        "away from you",
        "away from yourself",
        "away from me",
        "away from us",
        "away from the robot",
    ),
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
    "run": ("run", "running", "flow", "flowing", "going", "from running", "from flowing"),
    "stop": ("stop",),
    "fall": ("fall", "drop"),
    "lifted": ("off the table", "from the table", "off the floor", "off the ground", "into the air"),
    "half": ("halfway", "half way", "half", "to half", "partly", "partway", "partially", "ajar"),
}

#: Phrases that do not change the meaning of an instruction.
NEUTRAL: Final = (
    "a bit",
    "a little",
    "a little bit",
    "again",
    "all the way",
    "as far as it goes",
    "as far as possible",
    "as far as you can",
    "as wide as possible",
    "at once",
    "also",
    "as well",
    "behind me",
    "behind you",
    "carefully",
    "completely",
    "entirely",
    "firmly",
    "for me",
    "for now",
    "for us",
    "fully",
    "gently",
    "if you can",
    "if you please",
    "if you would",
    "immediately",
    "just",
    "now",
    "once",
    "once more",
    "please",
    "properly",
    "quickly",
    "quietly",
    "right away",
    "right now",
    "slightly",
    "slowly",
    "softly",
    "some more",
    "straight away",
    "tightly",
    "thank you",
    "thanks",
    "too",
    "wide",
    "with one hand",
    "with your hand",
)

#: Places of an object that do not change the meaning of an instruction, unless the object is put there.
PLACES: Final = ("on the table", "on the desk", "on the counter", "on the floor", "in the kitchen", "in front of you")

#: Phrases in front of an instruction that do not change its meaning.
POLITE: Final = (
    "alright",
    "be so kind as to",
    "be sure to",
    "can you",
    "could you",
    "do you mind",
    "go and",
    "go ahead and",
    "hello",
    "help me",
    "help me to",
    "hey",
    "hi",
    "i'd like you to",
    "i need you to",
    "i want you to",
    "i would like you to",
    "just",
    "kindly",
    "let's",
    "make sure to",
    "make sure you",
    "make sure that you",
    "ok",
    "okay",
    "please",
    "robot",
    "will you",
    "would you",
    "would you mind",
    "you can",
    "you have to",
    "you must",
    "you need to",
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
REASONS: Final = (
    "so that",
    *(
        f"so {subject}"
        for subject in ("i", "you", "he", "she", "it", "we", "they", "the", "my", "our", "your", "there")
    ),
    *(
        f"so {subject}"
        for subject in ("nobody", "no one", "nothing", "somebody", "someone", "anyone", "everyone", "people")
    ),
    "because",
    "in order to",
    "since",
    *(f"to {verb}" for verb in ("let", "look", "see", "check", "keep", "save", "protect", "use", "reach", "access")),
    *(f"to {verb}" for verb in ("get", "make", "toast", "start it", "wash", "fill", "dry", "cool", "pack", "work")),
    "for a quick look",
)

#: Forms of verbs: the verb, its participle and its gerund.
_FORMS: Final = (
    ("open", "opened", "opening"),
    ("close", "closed", "closing"),
    ("shut", "shut", "shutting"),
    ("turn", "turned", "turning"),
    ("switch", "switched", "switching"),
    ("flip", "flipped", "flipping"),
    ("fold", "folded", "folding"),
    ("unfold", "unfolded", "unfolding"),
    ("tip", "tipped", "tipping"),
    ("put", "put", "putting"),
    ("press", "pressed", "pressing"),
    ("push", "pushed", "pushing"),
    ("shove", "shoved", "shoving"),
    ("pull", "pulled", "pulling"),
    ("move", "moved", "moving"),
    ("slide", "slid", "sliding"),
    ("swing", "swung", "swinging"),
    ("lift", "lifted", "lifting"),
    ("raise", "raised", "raising"),
    ("lower", "lowered", "lowering"),
    ("pick", "picked", "picking"),
    ("start", "started", "starting"),
    ("stop", "stopped", "stopping"),
    ("cut", "cut", "cutting"),
)

#: Words for a state that is asked for, with the verb and the modifiers that bring it about.
PARTICIPLES: Final[dict[str, tuple[str, tuple[str, ...]]]] = {
    **{participle: (verb, ()) for verb, participle, _ in _FORMS},
    "open": ("open", ()),
    "on": ("turn", ("on",)),
    "off": ("turn", ("off",)),
    "running": ("turn", ("on",)),
    "flowing": ("turn", ("on",)),
}

GERUNDS: Final = {gerund: verb for verb, _, gerund in _FORMS}

#: Phrases that begin a wish for a state, with the phrases that come between the object and the state.
WISHES: Final[dict[tuple[str, ...], tuple[str, ...]]] = {
    (
        "make sure",
        "make sure that",
        "make certain",
        "make certain that",
        "be sure",
        "be sure that",
        "ensure",
        "ensure that",
        "see to it that",
        "see that",
        "take care that",
    ): ("is", "are", "gets", "get"),
    ("i want", "we want", "i need", "we need", "i would like", "we would like", "i'd like", "we'd like"): ("", "to be"),
    ("",): (
        *(f"{must} be" for must in ("must", "should", "ought to", "has to", "have to", "needs to", "need to", "is to")),
        *(f"{must} get" for must in ("must", "should", "has to", "have to", "needs to", "need to")),
    ),
}

#: Phrases before a gerund that ask for an action: on the object before them, and on the object behind the gerund.
NEEDS: Final = ("needs", "need")
MIND: Final = ("would you mind", "do you mind")

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
        "running",
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

#: Phrases before a part with which an action is done, such as "by its handle".
BY_PART: Final = (
    *(
        "by",
        "with",
        "using",
        "at",
        "holding",
        "holding it by",
        "grabbing",
        "grabbing it by",
        "by using",
        "holding on to",
    ),
    *(
        f"by {doing}"
        for doing in ("pressing", "pushing", "pulling", "lifting", "turning", "moving", "grabbing", "holding")
    ),
    *(f"by {doing} down" for doing in ("pressing", "pushing", "pulling")),
)

Actions = dict[Words, Action]
"""Actions of a verb, by its modifiers in alphabetical order, without "half"."""

_MOVES: Actions = {
    ("away",): Action.PUSH,
    ("away", "back"): Action.PUSH,
    ("back",): Action.PUSH,
    ("back", "closer"): Action.PULL,
    ("closer",): Action.PULL,
}
_FORWARD: Actions = {("forward",): Action.PUSH, ("away", "forward"): Action.PUSH}
_SWITCH: Actions = {("on",): Action.TURN_ON, ("off",): Action.TURN_OFF}
_CLOSED: Actions = {
    ("shut",): Action.CLOSE,
    ("back", "shut"): Action.CLOSE,
    ("down", "shut"): Action.CLOSE,
}
_SHUT: Actions = {**_CLOSED, ("in",): Action.CLOSE, ("back", "in"): Action.CLOSE}
_OPENED: Actions = {("open",): Action.OPEN, ("open", "up"): Action.OPEN}
_ENDS: Actions = {**_OPENED, **_CLOSED}
_OVER: Actions = {("over",): Action.SWING, ("back", "over"): Action.SWING_BACK}
_TIPPED: Actions = {
    **_ENDS,
    ("up",): Action.LIFT,
    ("down",): Action.LOWER,
    ("back",): Action.SWING_BACK,
    **_OVER,
}
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
    "open": {(): Action.OPEN, ("up",): Action.OPEN, ("back", "up"): Action.OPEN, **_OPENED},
    "unfold": {(): Action.OPEN, **_OPENED},
    "close": {(): Action.CLOSE, ("up",): Action.CLOSE, ("back", "up"): Action.CLOSE, **_CLOSED},
    "shut": {(): Action.CLOSE, ("up",): Action.CLOSE, ("down",): Action.CLOSE, ("off",): Action.TURN_OFF},
    "uncover": {(): Action.OPEN},
    "pop": _ENDS,
    "slam": {(): Action.CLOSE, **_CLOSED},
    "leave": {},
    "have": _ENDS,
    "make": {("run",): Action.TURN_ON, ("stop",): Action.TURN_OFF},
    "turn": {
        **_SWITCH,
        ("down",): Action.TURN_OFF,
        **_OVER,
        ("back",): Action.SWING_BACK,
    },
    "rotate": _OVER,
    "switch": _SWITCH,
    "start": {(): Action.TURN_ON, ("run",): Action.TURN_ON, ("up",): Action.TURN_ON},
    "run": {(): Action.TURN_ON},
    "stop": {(): Action.TURN_OFF, ("run",): Action.TURN_OFF},
    "cut": {(): Action.TURN_OFF, ("off",): Action.TURN_OFF},
    "let": {
        ("run",): Action.TURN_ON,
        ("down",): Action.LOWER,
        ("fall",): Action.PUT,
        ("down", "fall"): Action.LOWER,
        ("fall", "shut"): Action.CLOSE,
        ("fall", "over"): Action.SWING,
    },
    "flip": {**_TIPPED, **_SWITCH, (): Action.SWING},
    "tip": _TIPPED,
    "tilt": _TIPPED,
    "fold": {**_TIPPED, ("down",): Action.CLOSE},
    "put": {**_PUT, **_SWITCH, **_CLOSED, **_OVER, ("up",): Action.RELEASE},
    "press": {
        (): Action.PRESS,
        ("down",): Action.PRESS,
        ("in",): Action.PRESS,
        ("on",): Action.PRESS,
        ("down", "on"): Action.PRESS,
        **_CLOSED,
    },
    "depress": {(): Action.PRESS},
    "push": {
        (): Action.PUSH,
        ("down",): Action.PRESS,
        ("down", "on"): Action.PRESS,
        ("up",): Action.RELEASE,
        **_MOVES,
        **_FORWARD,
        **_SHUT,
        **_OPENED,
        **_OVER,
    },
    "shove": {(): Action.PUSH, **_MOVES, **_FORWARD, **_SHUT, **_OPENED},
    "nudge": {**_MOVES, **_FORWARD, **_ENDS},
    "pull": {
        (): Action.PULL,
        **_MOVES,
        ("back",): Action.PULL,
        ("up",): Action.RELEASE,
        ("back", "up"): Action.RELEASE,
        ("down",): Action.PRESS,
        **_CLOSED,
        **_OPENED,
        **_OUT,
        **_OVER,
    },
    "yank": {**_OPENED, **_OUT, **_CLOSED},
    "draw": {**_OPENED, **_OUT, **_CLOSED, ("closer",): Action.PULL},
    "drag": _MOVES | {("back",): Action.PULL} | _OPENED,
    "bring": {
        ("closer",): Action.PULL,
        ("back",): Action.PULL,
        ("back", "closer"): Action.PULL,
        ("down",): Action.LOWER,
        ("up",): Action.RELEASE,
        **_CLOSED,
        **_OVER,
    },
    "move": {**_MOVES, **_FORWARD, **_OVER, (): Action.PUT, ("up",): Action.RELEASE, ("down",): Action.LOWER},
    "shift": _MOVES | _FORWARD,
    "scoot": _MOVES | _FORWARD,
    "slide": {
        **_MOVES,
        **_FORWARD,
        ("open",): Action.SLIDE_OPEN,
        ("shut",): Action.SLIDE_SHUT,
        ("back", "shut"): Action.SLIDE_SHUT,
        ("out",): Action.OPEN,
        ("in",): Action.CLOSE,
        ("back", "in"): Action.CLOSE,
        ("down",): Action.LOWER,
    },
    "swing": {
        (): Action.SWING,
        ("back",): Action.SWING_BACK,
        **_OVER,
        ("up",): Action.LIFT,
        ("down",): Action.LOWER,
        **_ENDS,
    },
    "lift": _RAISE,
    "raise": _RAISE,
    "hoist": _RAISE,
    "pick": {("up",): Action.TAKE},
    "lower": {(): Action.LOWER, ("down",): Action.LOWER, **_CLOSED},
    "release": {(): Action.RELEASE},
    "unscrew": {(): Action.UNSCREW, ("off",): Action.UNSCREW},
    "tighten": {(): Action.TIGHTEN},
    "screw": {("on",): Action.TIGHTEN, ("back", "on"): Action.TIGHTEN, ("off",): Action.UNSCREW},
    "set": _PUT,
    "place": _PUT,
    "drop": {**_PUT, **_CLOSED},
    "lay": _PUT,
    "store": _PUT,
    "stash": _PUT,
    "stow": _PUT,
    "insert": _PUT,
    "deposit": _PUT,
    "throw": {**_PUT, **_ENDS},
    "toss": _PUT,
    "collect": _PUT,
    "transfer": _PUT,
    "take": _TAKE | {("off",): Action.OPEN},
    "get": {**_TAKE, **_ENDS, ("away",): Action.PUSH, **_SWITCH, ("run",): Action.TURN_ON},
    "fetch": _TAKE,
    "grab": _TAKE,
    "grasp": _TAKE,
    "remove": _TAKE | {("off",): Action.OPEN},
    "retrieve": _TAKE,
    "hand": {("over",): Action.HAND, (): Action.HAND},
    "pass": {("over",): Action.HAND, (): Action.HAND},
    "give": {(): Action.HAND},
}


#: Phrases that stand for a verb.
PHRASAL: Final = dict.fromkeys(("hold", "take hold of", "get hold of", "grab hold of", "grab onto"), "grasp")

#: Verbs that take hold of a part without moving it.
GRASPS: Final = frozenset(("grasp", "grab"))

#: Actions on a part of an object: to tip a bucket over is not to swing its handle.
SWINGS: Final = frozenset((Action.SWING, Action.SWING_BACK))
#: Verbs that move only a part of an object up or down.
OF_PARTS: Final = frozenset(("turn", "flip", "tip", "tilt", "fold", "swing"))


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


#: Other names of parts.
PART_SYNONYMS: Final = {
    "top": "lid",
    "cover": "lid",
    "flaps": "flap",
    "display": "screen",
    "monitor": "screen",
    "grip": "handle",
    "knob": "handle",
    "handle": "lever",
}


@cache
def parts() -> frozenset[str]:
    """Return the names of all parts of objects, such as "lid"."""
    own = frozenset(part for each in words.articulated_classes() for part in words.parts(each))
    return own | frozenset(PART_SYNONYMS)


def own_part(noun: Noun | None, word: str) -> str | None:
    """Return the part of the objects of a noun that a word names; None if the objects have no such part."""
    own = {part for each in noun.classes for part in words.parts(each)} if noun is not None else set()
    return next((each for each in (word, PART_SYNONYMS.get(word)) if each in own), None)


@cache
def usual_part(word: str) -> str:
    """Return the part that a word names if its object is not known: a cover is a lid, but a handle is a handle."""
    known = any(word in words.parts(each) for each in words.articulated_classes())
    return word if known else PART_SYNONYMS[word]


#: Parts whose lifting opens an object, and whose lowering closes it.
COVERS: Final = frozenset(("lid", "screen", "flap"))
#: Meaning of actions for a cover that have another meaning for the whole object.
OF_COVER: Final = {
    Action.LIFT: Action.OPEN,
    Action.RELEASE: Action.OPEN,
    Action.TAKE: Action.OPEN,
    Action.LOWER: Action.CLOSE,
    Action.PRESS: Action.CLOSE,
    Action.PUT: Action.CLOSE,
}
#: Parts that are pressed when they are pushed.
PRESSED: Final = frozenset(("button", "lever"))
#: Meaning of actions for a part that is pressed.
OF_PRESSED: Final = {Action.PUSH: Action.PRESS, Action.LOWER: Action.PRESS, Action.LIFT: Action.RELEASE}


def longest(at: int, sentence: Words, phrases: Sequence[Words]) -> int:
    """Return the length of the longest of ``phrases`` that begins at word ``at`` of a sentence; 0 without any."""
    return max((len(each) for each in phrases if sentence[at : at + len(each)] == each), default=0)
