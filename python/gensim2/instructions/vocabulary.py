"""Define the words that the parser of instructions knows: verbs, nouns, modifiers and function words.

Words come from ``vocabulary.toml`` and nouns from ``objects/words.toml``. The sentences of that file, such as "press
the stapler", show to which end of a joint a verb moves the joint (:mod:`~gensim2.instructions.meanings`).
"""

from __future__ import annotations

import re
import tomllib
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from importlib import resources
from typing import Any, Final

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


#: Contractions and spellings of spoken English, with the words for which they stand.
_SPOKEN: Final = tuple(
    (re.compile(pattern), words)
    for pattern, words in (
        (r"\bcan't\b|\bcannot\b|\bcant\b", "can not"),
        (r"\bwon't\b|\bwont\b", "will not"),
        (r"\bdont\b", "do not"),
        (r"\bdoesnt\b", "does not"),
        (r"n't\b", " not"),
        (r"\blet's\b", "let us"),
        (r"'m\b", " am"),
        (r"'re\b", " are"),
        (r"'ve\b", " have"),
        (r"'ll\b", " will"),
        (r"'d\b", " would"),
        (r"'em\b", "them"),
        (r"\bgonna\b", "going to"),
        (r"\bgotta\b", "got to"),
        (r"\bya\b", "you"),
        (r"\bd'you\b", "do you"),
        (r"\b(pls|plz)\b", "please"),
        (r"'?\b(cause|cos|cuz)\b", "because"),
        (r",?\s*\b(um+|uh+|uhm|erm?|hmm+|you know|i mean|sort of|kind of)\b\s*,?", " "),
        (r"\s-+\s|--+|[\N{EN DASH}\N{EM DASH}\N{HORIZONTAL ELLIPSIS}()]|\.\.+", " , "),
        (r"-", " "),
    )
)


def spelled(text: str) -> Words:
    """Split a text into the words and punctuation marks by which the parser reads it, in lower case.

    Contractions are written out, and fillers such as "um" are left out.
    """
    plain = text.lower().replace("\N{RIGHT SINGLE QUOTATION MARK}", "'")
    for pattern, written in _SPOKEN:
        plain = pattern.sub(written, plain)
    return tuple(re.findall(r"'s\b|[^\W_]+|[^\w\s]", plain))


class Phrases:
    """A set of phrases, which finds the longest that begins at a word.

    Args:
        patterns: phrases in the notation of ``vocabulary.toml``.
    """

    def __init__(self, patterns: Iterable[str]) -> None:
        found = {spelled(phrase) for pattern in patterns for phrase in _alternatives(pattern)}
        self._by_word: dict[str, list[Words]] = defaultdict(list)
        for phrase in sorted(found - {()}, key=len, reverse=True):
            self._by_word[phrase[0]].append(phrase)

    def __iter__(self) -> Iterator[Words]:
        return (phrase for phrases in self._by_word.values() for phrase in phrases)

    def length(self, at: int, sentence: Words) -> int:
        """Return the number of words of the longest phrase that begins at word ``at``; 0 without any."""
        if at >= len(sentence):
            return 0
        phrases = self._by_word.get(sentence[at], ())
        return next((len(each) for each in phrases if sentence[at : at + len(each)] == each), 0)


def _alternatives(pattern: str) -> list[str]:
    """Return the phrases for which a pattern stands: "(a|b) c" stands for "a c" and "b c"."""
    choice = re.search(r"\(([^()]*)\)", pattern)
    if choice is None:
        return [pattern]
    before, behind = pattern[: choice.start()], pattern[choice.end() :]
    return [phrase for each in choice[1].split("|") for phrase in _alternatives(before + each + behind)]


def _table() -> dict[str, Any]:
    return tomllib.loads((resources.files("gensim2.instructions") / "vocabulary.toml").read_text(encoding="utf-8"))


_TABLE: Final = _table()


def _phrases() -> dict[str, Phrases]:
    """Return the phrases of ``vocabulary.toml``, and the purposes and headings of the tasks in ``words.toml``."""
    found: dict[str, list[str]] = _TABLE["phrases"]
    sentences = [each.sentence for each in words.to_and_fro()]
    found["reasons"] += [each.say.removeprefix("{} ") for each in words.purposes()]
    found["reasons"] += [f"to {end}" for each in sentences if (end := each.partition(" to ")[2])]
    found["headings"] += [each.partition(":")[0] for each in sentences if ":" in each]
    return {name: Phrases(each) for name, each in found.items()}


#: Phrases by their purpose, which ``vocabulary.toml`` explains.
PHRASES: Final[Mapping[str, Phrases]] = _phrases()
#: Words by their purpose.
WORDS: Final[Mapping[str, frozenset[str]]] = {name: frozenset(each.split()) for name, each in _TABLE["words"].items()}
#: Modifiers of verbs, with all phrases that express them.
MODIFIERS: Final = {name: Phrases(each) for name, each in _TABLE["modifiers"].items()}
#: Phrases that say to whom an object is handed, by direction.
HANDING: Final = {name: Phrases(each) for name, each in _TABLE["handing"].items()}
#: Adjectives that state whether a container is open.
STATES: Final[Mapping[str, str]] = _TABLE["states"]
#: For each modifier of a state that is not wanted, the modifier of its opposite.
OPPOSITES: Final[Mapping[str, str]] = _TABLE["opposites"]
#: Other names of parts.
PART_SYNONYMS: Final[Mapping[str, str]] = _TABLE["parts"]
#: Phrases that stand for a verb.
PHRASAL: Final = {spelled(phrase): verb for phrase, verb in _TABLE["phrasal"].items()}

#: Verbs by their participles and gerunds.
PARTICIPLES: Final = {forms.split()[0]: verb for verb, forms in _TABLE["forms"].items()}
GERUNDS: Final = {forms.split()[1]: verb for verb, forms in _TABLE["forms"].items()}

Actions = dict[Words, Action]
"""Actions of a verb, by its modifiers in alphabetical order, without "half"."""


def _actions(entry: Mapping[str, Any]) -> Actions:
    """Return the actions of a verb, or of a group of verbs that have actions in common."""
    found: Actions = {}
    for group in entry.get("like", ()):
        found |= _actions(_TABLE["groups"][group])
    own = {tuple(sorted(key.split())): Action(each) for key, each in entry.items() if key != "like"}
    return found | own


#: Actions of each verb.
VERBS: Final[Mapping[str, Actions]] = {verb: _actions(entry) for verb, entry in _TABLE["verbs"].items()}

#: Actions on a part of an object: to tip a bucket over is not to swing its handle.
SWINGS: Final = frozenset((Action.SWING, Action.SWING_BACK))


@dataclass(frozen=True)
class StatementVerbs:
    """Verbs of statements, which the robot does not carry out.

    Attributes:
        base: base forms, such as "bark".
        finite: forms of the third person and of the past, such as "barks" and "barked".
    """

    base: frozenset[str]
    finite: frozenset[str]


@cache
def statement_verbs() -> StatementVerbs:
    """Return the verbs of statements, with the forms that follow from the rules of spelling."""
    base = frozenset(_TABLE["statements"]["verbs"].split())
    finite = set(_TABLE["statements"]["irregular"].split())
    for verb in base:
        stem = verb[:-1] + "i" if re.search(r"[^aeiou]y$", verb) else verb
        finite.add(stem + ("es" if re.search(r"(s|sh|ch|x|z|i)$", stem) else "s"))
        double = verb[-1] if re.search(r"^[^aeiou]*[aeiou][bdglmnprt]$", verb) else ""
        finite.add(stem + double + ("d" if stem.endswith("e") else "ed"))
    finite |= {verb + ("es" if re.search(r"(s|sh|ch|x)$", verb) else "s") for verb in VERBS}
    return StatementVerbs(base, frozenset(finite))


@dataclass(frozen=True)
class Noun:
    """A noun that the parser knows.

    Attributes:
        name: the noun, as in ``words.toml``.
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


@cache
def noun_phrases() -> Phrases:
    """Return all spellings of nouns as phrases."""
    return Phrases(" ".join(each) for each in nouns())


def named_noun(at: int, sentence: Words) -> tuple[Noun | None, int]:
    """Return the noun that begins at word ``at`` of a sentence, and its number of words."""
    length = noun_phrases().length(at, sentence)
    return (nouns()[sentence[at : at + length]] if length else None), length


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


#: Meaning of actions for a cover, whose lifting opens an object, that have another meaning for the whole object.
OF_COVER: Final = {
    Action.LIFT: Action.OPEN,
    Action.RELEASE: Action.OPEN,
    Action.TAKE: Action.OPEN,
    Action.LOWER: Action.CLOSE,
    Action.PRESS: Action.CLOSE,
    Action.PUT: Action.CLOSE,
}
#: Meaning of actions for a part that is pressed when it is pushed.
OF_PRESSED: Final = {Action.PUSH: Action.PRESS, Action.LOWER: Action.PRESS, Action.LIFT: Action.RELEASE}
