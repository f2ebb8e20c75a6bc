"""Define the steps of an instruction, and the error for an instruction that is refused."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from gensim2.core.errors import InputError
from gensim2.objects.words import Direction, Goal, halfway, noun, words

SUPPORTS = {"bowl": "in", "plate": "on"}
"""Preposition for each rigid class that can hold another object."""


@dataclass(frozen=True)
class MoveJoint:
    """Move the joint of an object.

    Attributes:
        asset_class: class of the articulated object.
        goal: target of the joint.
    """

    asset_class: str
    goal: Goal

    @property
    def classes(self) -> tuple[str, ...]:
        """Classes of the objects that the step needs."""
        return (self.asset_class,)

    @property
    def text(self) -> str:
        """The step as an instruction, such as ``"open the drawer"``."""
        if self.goal == "articulated_open" or self.goal == "articulated_closed":
            return words(self.asset_class, self.goal).sentence
        phrase = halfway(self.asset_class, self.goal)
        assert phrase is not None, f"no words for {self}"
        return phrase.sentence.partition(" so that ")[0]


@dataclass(frozen=True)
class Put:
    """Put a rigid object into a container, or onto another rigid object.

    Attributes:
        thing: class of the rigid object.
        destination: class of the container, of the bowl or of the plate.
        source: class of the container in which the rigid object lies at the start; None for the table.
    """

    thing: str
    destination: str
    source: str | None = None

    @property
    def classes(self) -> tuple[str, ...]:
        """Classes of the objects that the step needs."""
        return tuple(each for each in (self.source, self.destination, self.thing) if each is not None)

    @property
    def text(self) -> str:
        """The step as an instruction, such as ``"put the apple into the drawer"``."""
        where = f"{SUPPORTS.get(self.destination, 'into')} the {noun(self.destination)}"
        if self.source is None:
            return f"put the {noun(self.thing)} {where}"
        return f"take the {noun(self.thing)} out of the {noun(self.source)} and put it {where}"


@dataclass(frozen=True)
class Lift:
    """Pick up a rigid object.

    Attributes:
        thing: class of the rigid object.
    """

    thing: str

    @property
    def classes(self) -> tuple[str, ...]:
        """Classes of the objects that the step needs."""
        return (self.thing,)

    @property
    def text(self) -> str:
        """The step as an instruction, such as ``"pick up the mug"``."""
        return f"pick up the {noun(self.thing)}"


@dataclass(frozen=True)
class HandOver:
    """Hand a rigid object to a person.

    Attributes:
        thing: class of the rigid object.
        direction: direction of the person, as seen from the robot.
    """

    thing: str
    direction: Direction

    @property
    def classes(self) -> tuple[str, ...]:
        """Classes of the objects that the step needs."""
        return (self.thing,)

    @property
    def text(self) -> str:
        """The step as an instruction."""
        where = "across the table" if self.direction == "away" else f"on the {self.direction}"
        return f"hand the {noun(self.thing)} to the person {where}"


Step = MoveJoint | Put | Lift | HandOver
"""One step of an instruction."""


class Refusal(StrEnum):
    """Reason why an instruction is refused."""

    EMPTY = "there is no instruction"
    NEGATION = "negations and exceptions are not understood"
    UNKNOWN_VERB = "unknown verb"
    UNKNOWN_OBJECT = "unknown object"
    NOT_UNDERSTOOD = "not understood"
    IMPOSSIBLE = "no task of the library does this"
    AMBIGUOUS = "ambiguous"
    INCOMPLETE = "incomplete"
    ORDER = "the steps do not follow from each other"
    NO_ROOM = "the table has no room for all objects"


class SentenceError(InputError):
    """An instruction is refused, because a part of it is not understood or cannot be done.

    Args:
        reason: reason of the refusal.
        part: part of the instruction that causes the refusal.
        remedy: suggestion to the user.

    Attributes:
        reason, part: as above.
    """

    def __init__(self, reason: Refusal, part: str, remedy: str) -> None:
        super().__init__(f"{part!r}: {reason}" if part else str(reason), field="sentence", remedy=remedy)
        self.reason, self.part = reason, part

    def __reduce__(self) -> tuple[type[SentenceError], tuple[Refusal, str, str]]:
        return type(self), (self.reason, self.part, self.remedy or "")
