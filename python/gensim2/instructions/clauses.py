"""Parse a sentence into clauses: a verb with its modifiers, objects and prepositional phrases.

Every word of a sentence must have a role. A word without a role makes the parser refuse the whole sentence.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Literal

from gensim2.instructions import vocabulary
from gensim2.instructions.steps import Refusal, SentenceError
from gensim2.instructions.vocabulary import Action, Noun, Words, longest, spelled
from gensim2.objects import words

Pronoun = Literal["it", "them", "there"]


@dataclass(frozen=True)
class Mention:
    """A noun phrase.

    Attributes:
        text: the phrase as the user wrote it.
        noun: the noun; None for a pronoun, and for a part whose object is not named.
        part: part of the object, such as ``"lid"``.
        pronoun: the pronoun, if the phrase is one.
        state: ``"open"`` or ``"closed"`` if an adjective says so.
    """

    text: str
    noun: Noun | None = None
    part: str | None = None
    pronoun: Pronoun | None = None
    state: str | None = None


THERE = Mention("there", pronoun="there")


@dataclass
class Clause:
    """A verb with its objects.

    Attributes:
        text: the clause as the user wrote it.
        verbs: the verbs; two verbs share their objects, as in "open and close the box".
        modifiers: modifiers of the verb, in the order of the sentence.
        half: whether the clause has a modifier such as "halfway".
        objects: direct objects.
        into, onto, to, source: objects of the prepositional phrases.
        direction: direction in which an object is handed over.
        gripped: whether the clause names the part by which the object is taken, as in "by its handle".
        restates: whether the clause may say again what another clause asks for, as in "the box must be closed".
    """

    text: str
    verbs: tuple[str, ...]
    modifiers: list[str] = field(default_factory=list)
    half: bool = False
    objects: list[Mention] = field(default_factory=list)
    into: Mention | None = None
    onto: Mention | None = None
    to: Mention | None = None
    source: Mention | None = None
    direction: str | None = None
    gripped: bool = False
    restates: bool = False

    @property
    def actions(self) -> tuple[Action, ...]:
        """Actions that the verbs stand for.

        Raises:
            SentenceError: a verb does not go with the modifiers.
        """
        return tuple(self._action(verb) for verb in self.verbs)

    def _action(self, verb: str) -> Action:
        parts = {each.part for each in self.objects}
        if verb == "leave":
            if self.half and self.modifiers in ([], ["open"]):
                return Action.CLOSE
            raise SentenceError(Refusal.NOT_UNDERSTOOD, self.text, "say 'leave the door ajar', or what to do")
        modifiers = {*self.modifiers} - {"lifted"}
        found = vocabulary.VERBS[verb].get(tuple(sorted(modifiers)))
        lifted = "lifted" in self.modifiers and found not in (Action.LIFT, Action.TAKE)
        of_part = found in vocabulary.SWINGS
        of_part |= found in (Action.LIFT, Action.LOWER) and verb in vocabulary.OF_PARTS
        if found is None or lifted or (of_part and None in parts):
            raise SentenceError(Refusal.NOT_UNDERSTOOD, self.text, f"{verb!r} does not go with the other words")
        if found is Action.TAKE and verb in vocabulary.GRASPS and not modifiers:
            return found
        if parts & vocabulary.COVERS:
            return vocabulary.OF_COVER.get(found, found)
        if parts & vocabulary.PRESSED:
            return vocabulary.OF_PRESSED.get(found, found)
        return found


class ClauseParser:
    """Parser of the clauses of one sentence.

    Args:
        sentence: the sentence as words, without its reason.
    """

    def __init__(self, sentence: Words) -> None:
        self._words, self._at = sentence, 0

    def clauses(self) -> list[Clause]:
        """Return the clauses in the order of the sentence.

        Raises:
            SentenceError: a part of the sentence is not understood.
        """
        found: list[Clause] = []
        while True:
            self._skip(_CONNECTORS, _POLITE, _NEUTRAL)
            if self._at == len(self._words):
                return found
            start = self._at
            more = self._state()
            if more is None and found:
                more = self._continuation(found[-1])
            if more is not None:
                found.append(more)
                continue
            verbs = self._verbs()
            if not verbs:
                raise self._no_verb(start)
            found.append(self._completed(Clause("", verbs), start))

    def next_mention(self) -> Mention | None:
        """Return the next noun phrase with a known noun, and skip the words before it; None if there is no other."""
        while self._at < len(self._words):
            found = self._phrase(self._at, take=True)
            if found is not None and found.noun is not None:
                return found
            self._at += 1
        return None

    def mention(self, attach: frozenset[str]) -> Mention | None:
        """Read a noun phrase, if one begins at the current word.

        Args:
            attach: prepositions that may join a part to its object, as in "the lid of the box".
        """
        start = self._at
        if self._word() in vocabulary.IT | vocabulary.THEM:
            pronoun: Pronoun = "it" if self._word() in vocabulary.IT else "them"
            # "this" and "both" are also determiners
            after = self._phrase(start + 1)
            if after is None or self._word() in ("it", "them"):
                self._at = start + 1
                return Mention(self._words[start], pronoun=pronoun)
        return self._phrase(start, attach, take=True)

    def _phrase(self, start: int, attach: frozenset[str] = frozenset(), take: bool = False) -> Mention | None:
        """Return the noun phrase that begins at the word ``start``; with ``take``, also move behind it."""
        before, self._at = self._at, start
        found = self._noun_phrase(attach)
        if found is None or not take:
            self._at = before
        return found

    def _noun_phrase(self, attach: frozenset[str]) -> Mention | None:
        start, state = self._at, None
        while self._word() in vocabulary.DETERMINERS:
            self._at += 1
        while True:
            if (length := longest(self._at, self._words, _NOUNS)) > 0:
                noun = vocabulary.nouns()[self._words[self._at : self._at + length]]
                # "door" is a noun, and a part of other objects
                is_part = self._words[self._at] in vocabulary.parts() and self._joins(self._at + 1, attach)
                if not is_part:
                    self._at += length
                    if self._word() == "'s":
                        self._at += 1
                    part = self._own_part(noun)
                    return Mention(self._text(start), noun, part, state=state)
            if self._word() in vocabulary.parts():
                part, self._at = self._word(), self._at + 1
                if self._joins(self._at, attach):
                    self._at += 1
                    inner = self._noun_phrase(frozenset())
                    assert inner is not None
                    part = vocabulary.own_part(inner.noun, part) or part
                    return Mention(self._text(start), inner.noun, part, state=state)
                return Mention(self._text(start), part=vocabulary.usual_part(part), state=state)
            word = self._word()
            if word in vocabulary.STATES:
                state = vocabulary.STATES[word]
            elif word not in vocabulary.ADJECTIVES:
                return None
            self._at += 1

    def _joins(self, at: int, attach: frozenset[str]) -> bool:
        """Return whether a preposition and the object of a part come at the word ``at``."""
        if at >= len(self._words) or self._words[at] not in attach:
            return False
        found = self._phrase(at + 1)
        return found is not None and found.noun is not None

    def _own_part(self, noun: Noun) -> str | None:
        """Read a part that follows its object, as in "the microwave door"."""
        part = vocabulary.own_part(noun, self._word())
        self._at += part is not None
        return part

    def _verbs(self) -> tuple[str, ...]:
        """Read one verb, or two verbs with the same objects; empty if no verb comes."""
        if (length := longest(self._at, self._words, list(_PHRASAL))) > 0:
            self._at += length
            return (_PHRASAL[self._words[self._at - length : self._at]],)
        first = self._word()
        if first not in vocabulary.VERBS:
            return ()
        self._at += 1
        if self._word() == "and" and self._word(1) in vocabulary.VERBS:
            self._at += 2
            return first, self._words[self._at - 1]
        return (first,)

    def _state(self) -> Clause | None:
        """Read a wish for a state, as in "make sure the box is shut" or "the box must be closed"."""
        start = self._at
        verb = vocabulary.GERUNDS.get(self._word())
        if verb is not None and any(self._words[start - len(each) : start] == each for each in _MIND):
            self._at += 1
            return self._completed(Clause("", (verb,)), start)
        for wishes, links in _WISHES.items():
            self._at = start
            if not self._comes_longest(wishes) and () not in wishes:
                continue
            wanted = self.mention(frozenset(("of", "on", "from")))
            if wanted is None:
                continue
            verb = vocabulary.GERUNDS.get(self._word(1))
            if () in wishes and verb is not None and self._comes_longest(_NEEDS):
                self._at += 1
                return self._completed(Clause("", (verb,), objects=[wanted], restates=True), start)
            if not self._comes_longest(links) and () not in links:
                continue
            self._skip(_NEUTRAL)
            if self._word() in vocabulary.PARTICIPLES:
                verb, modifiers = vocabulary.PARTICIPLES[self._word()]
                self._at += 1
                clause = Clause("", (verb,), list(modifiers), objects=[wanted], restates=True)
                return self._completed(clause, start)
        self._at = start
        return None

    def _completed(self, clause: Clause, start: int) -> Clause:
        """Read the rest of a clause that begins at the word ``start``."""
        self._complete(clause)
        clause.text = self._text(start)
        return clause

    def _continuation(self, last: Clause) -> Clause | None:
        """Read a clause that shares the verb of the clause before: "... and off again", or "... and the pear on the
        plate".
        """
        start, verb = self._at, last.verbs[-1]
        modifier = self._modifier()
        self._skip(_NEUTRAL)
        if modifier is not None and modifier != "half" and self._ends():
            return Clause(self._text(start), (verb,), [modifier], objects=list(last.objects), restates=True)
        self._at = start
        if self._word() in vocabulary.VERBS and self._phrase(start) is None:
            return None
        clause = Clause("", (verb,))
        if self._phrase(start) is None or Action.PUT not in vocabulary.VERBS[verb].values():
            return None
        return self._completed(clause, start)

    def _complete(self, clause: Clause) -> None:
        """Read everything that belongs to the verb of a clause."""
        attach = frozenset(("of",)) if self._puts(clause) else frozenset(("of", "on", "off", "from"))
        while True:
            if self._by_part():
                clause.gripped = True
                continue
            if self._ends():
                break
            if clause.objects and (self._same_object(clause) or self._prepositional(clause)):
                continue
            if not clause.objects and self._objects(clause, attach):
                continue
            if self._word() == "to" and self._ends(1):
                self._at += 1
                clause.modifiers.append("shut")
                continue
            if self._comes("half", "open"):
                clause.half = True
                clause.modifiers.append("open")
                continue
            if (clause.modifiers or not self._puts(clause)) and self._skip(_PLACES):
                continue
            modifier = self._modifier()
            if modifier is not None:
                clause.half |= modifier == "half"
                clause.modifiers += [modifier] if modifier != "half" else []
                continue
            if self._skip(_NEUTRAL):
                continue
            if clause.objects and self._comes("but", "leave", "it", "ajar"):
                clause.half = True
                continue
            raise self._unknown(clause)
        # To turn something down is not to turn it off.
        clause.half |= "turn" in clause.verbs and clause.modifiers == ["down"]

    def _puts(self, clause: Clause) -> bool:
        """Return whether the verb can take a destination, so that "on" does not join a part to its object."""
        return any(Action.PUT in vocabulary.VERBS[verb].values() for verb in clause.verbs)

    def _objects(self, clause: Clause, attach: frozenset[str]) -> bool:
        """Read the direct objects of a verb, such as "the apple, the pear and the plum"."""
        first = self.mention(attach)
        if first is None:
            return False
        clause.objects.append(first)
        while True:
            before = self._at
            comma, conjunction = self._comes(","), self._comes("and")
            more = None
            if (comma or conjunction) and not (self._word() in vocabulary.VERBS and self._phrase(self._at) is None):
                more = self.mention(attach)
            # A pronoun after "and" would be the object of another verb.
            if more is None or more.pronoun is not None:
                self._at = before
                return True
            clause.objects.append(more)

    def _prepositional(self, clause: Clause) -> bool:
        """Read a prepositional phrase or a word such as "there"."""
        if Action.HAND in {a for verb in clause.verbs for a in vocabulary.VERBS[verb].values()}:
            for direction, phrases in _HANDING.items():
                if (length := longest(self._at, self._words, phrases)) > 0:
                    self._at += length
                    clause.direction = direction
                    return True
        puts = self._puts(clause)
        takes = Action.TAKE in {a for verb in clause.verbs for a in vocabulary.VERBS[verb].values()}
        for field_name, prepositions in (("into", _INTO), ("onto", _ONTO), ("to", _TO), ("source", _OUT_OF)):
            for preposition in prepositions:
                end = self._at + len(preposition)
                if self._words[self._at : end] != preposition or getattr(clause, field_name) is not None:
                    continue
                before, self._at = self._at, end
                found = self.mention(frozenset(("of",)))
                if found is None or (found.noun is None and found.pronoun is None):
                    self._at = before
                    continue
                setattr(clause, field_name, found)
                return True
        if puts and clause.into is None and clause.onto is None and clause.to is None:
            length = longest(self._at, self._words, _THERE)
            if length and self._words[self._at] != "away":
                self._at += length
                clause.into = THERE
                return True
        away = longest(self._at, self._words, _MODIFIERS["away"]) > 0
        if takes and not away and clause.source is None and self._comes("out"):
            clause.source = THERE
            return True
        return False

    def _same_object(self, clause: Clause) -> bool:
        """Read a phrase that names the object a second time with another noun, as in "the water from the tap"."""
        start, first = self._at, clause.objects[0]
        if self._comes_longest(_OF_SAME):
            found = self.mention(frozenset())
            if (
                found is not None
                and found.noun is not None
                and found.noun is first.noun
                and found.text.split()[-1] != first.text.split()[-1]
            ):
                return True
        self._at = start
        return False

    def _by_part(self) -> bool:
        """Read a phrase such as "by its handle"."""
        start = self._at
        self._comes(",")
        if self._comes_longest(_BY_PART):
            self._at += self._word() in vocabulary.DETERMINERS
            if self._word() in vocabulary.parts():
                self._at += 1
                return True
        self._at = start
        return False

    def _modifier(self) -> str | None:
        """Read a modifier, such as "off" or "halfway", if one comes."""
        best = max(_MODIFIERS, key=lambda name: longest(self._at, self._words, _MODIFIERS[name]))
        length = longest(self._at, self._words, _MODIFIERS[best])
        self._at += length
        return best if length else None

    def _skip(self, *groups: Sequence[Words]) -> bool:
        """Skip phrases without meaning, and return whether there were any."""
        start = self._at
        while (length := max(longest(self._at, self._words, group) for group in groups)) > 0:
            self._at += length
        return self._at > start

    def _comes(self, *phrase: str) -> bool:
        """Read a phrase, if it comes next."""
        if self._words[self._at : self._at + len(phrase)] != phrase:
            return False
        self._at += len(phrase)
        return True

    def _comes_longest(self, phrases: Sequence[Words]) -> bool:
        """Read the longest of several phrases, if one comes next."""
        length = longest(self._at, self._words, phrases)
        self._at += length
        return length > 0

    def _ends(self, ahead: int = 0) -> bool:
        """Return whether the clause ends at the current word, or ``ahead`` words behind it."""
        at = self._at + ahead
        return (
            at == len(self._words) or longest(at, self._words, [*_CONNECTORS, *_NEUTRAL] if ahead else _CONNECTORS) > 0
        )

    def _word(self, ahead: int = 0) -> str:
        at = self._at + ahead
        return self._words[at] if at < len(self._words) else ""

    def _text(self, start: int) -> str:
        return " ".join(self._words[start : self._at]).replace(" 's", "'s")

    def _rest(self) -> str:
        """Return the words up to the next connector, for error messages."""
        start, end = self._at, self._at
        while end < len(self._words) and (end == start or self._words[end] not in vocabulary.ENDS):
            end += 1
        return " ".join(self._words[start:end]).replace(" 's", "'s")

    def _no_verb(self, start: int) -> SentenceError:
        self._at = start
        return SentenceError(Refusal.UNKNOWN_VERB, self._rest(), known_verbs())

    def _unknown(self, clause: Clause) -> SentenceError:
        """Return the error for a word in a clause that has no role."""
        rest = self._rest()
        follows_determiner = self._word() in vocabulary.DETERMINERS
        if not clause.objects or follows_determiner or self._words[self._at - 1] in _PREPOSITIONS:
            return SentenceError(Refusal.UNKNOWN_OBJECT, rest, known_objects())
        if longest(self._at, self._words, [*_INTO, *_ONTO, *_TO, *_OUT_OF]):
            return SentenceError(Refusal.UNKNOWN_OBJECT, rest, known_objects())
        return SentenceError(Refusal.NOT_UNDERSTOOD, rest, "leave these words out, or use other words")


def known_verbs() -> str:
    """Return the hint that lists what the program can do."""
    return (
        "I know how to open, close, turn on, turn off, push, pull, press, lift, lower and swing objects, to put things "
        "into or onto others, and to take them out"
    )


def known_objects() -> str:
    """Return the hint that lists the objects."""
    names = dict.fromkeys(each.name for each in vocabulary.nouns().values() if not each.rigid)
    return f"I know {', '.join(names)}, and things such as apple, mug, marker or tennis ball"


def _group(phrases: Sequence[str]) -> list[Words]:
    return [spelled(each) for each in phrases]


_CONNECTORS = _group(vocabulary.CONNECTORS)
_POLITE = _group(vocabulary.POLITE)
_NEUTRAL = _group(vocabulary.NEUTRAL)
_PLACES, _BY_PART = _group(vocabulary.PLACES), _group(vocabulary.BY_PART)
_OF_SAME = _group(("of", "from", "out of", "at", "in", "on"))
_NEEDS, _MIND = _group(vocabulary.NEEDS), _group(vocabulary.MIND)
_WISHES = {tuple(_group(wishes)): _group(links) for wishes, links in vocabulary.WISHES.items()}
_PHRASAL = {spelled(phrase): verb for phrase, verb in vocabulary.PHRASAL.items()}
_NOUNS = list(vocabulary.nouns())
_INTO, _ONTO, _TO = _group(vocabulary.INTO), _group(vocabulary.ONTO), _group(vocabulary.TO)
_OUT_OF, _THERE = _group(vocabulary.OUT_OF), _group(vocabulary.THERE)
_REASONS = _group(vocabulary.REASONS)
_PREPOSITIONS = {each[-1] for each in (*_INTO, *_ONTO, *_TO, *_OUT_OF)}
_MODIFIERS = {name: _group(phrases) for name, phrases in vocabulary.MODIFIERS.items()}
_HANDING = {name: _group(phrases) for name, phrases in vocabulary.HANDING.items()}


def without_reason(sentence: Words) -> Words:
    """Return a sentence without its reasons, such as "so that it can dry" or "to tidy the desk". A reason ends before
    the next instruction.
    """
    for purpose in _purposes():
        if sentence[-len(purpose) :] == purpose:
            sentence = sentence[: -len(purpose)]
    starts = (at for at in range(1, len(sentence)) if longest(at, sentence, _REASONS))
    # "I want you to get the box open" is polite, and not a reason.
    start = next((at for at in starts if not any(sentence[: at + 1][-len(each) :] == each for each in _POLITE)), None)
    if start is None:
        return sentence
    end = next((at for at in range(start, len(sentence)) if _begins_instruction(at, sentence)), len(sentence))
    return (*sentence[:start], *without_reason(sentence[end:]))


def _begins_instruction(at: int, sentence: Words) -> bool:
    """Return whether a connector and a verb come at the word ``at``."""
    first = at
    while (length := longest(at, sentence, _CONNECTORS)) > 0:
        at += length
    return at > first and at < len(sentence) and sentence[at] in vocabulary.VERBS


@cache
def _purposes() -> tuple[Words, ...]:
    """Return the purposes in ``words.toml``, such as "to tidy the desk"."""
    ends = [each.say.removeprefix("{}") for each in words.purposes()]
    ends += [f"to {end}" for each in words.to_and_fro() if (end := each.sentence.partition(" to ")[2])]
    return tuple(spelled(each) for each in ends)
