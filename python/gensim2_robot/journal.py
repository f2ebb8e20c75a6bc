"""Whoever is told of everything that goes through the line: a log, a page, several of them, or none."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from gensim2_robot.devices import ArmState, Frame
from gensim2_robot.limits import Sent
from gensim2_robot.mind import Answer, Question


class Journal(Protocol):
    """Log of a run. Nothing here waits."""

    @property
    def trouble(self) -> str | None:
        """Why nothing more can be written; None: all is well."""
        ...

    def state(self, state: ArmState) -> None: ...
    def frame(self, frame: Frame) -> None: ...
    def sent(self, time: float, sent: Sent, gripper: float) -> None: ...
    def question(self, time: float, question: Question) -> None: ...
    def answer(self, time: float, answer: Answer) -> None: ...
    def change(self, time: float, state: str, reason: str) -> None: ...
    def clocks(self, time: float, late: float, ages: dict[str, float]) -> None: ...


class NoJournal:
    """Writes nothing down."""

    trouble: str | None = None

    def state(self, state: ArmState) -> None:
        """Nothing."""

    def frame(self, frame: Frame) -> None:
        """Nothing."""

    def sent(self, time: float, sent: Sent, gripper: float) -> None:
        """Nothing."""

    def question(self, time: float, question: Question) -> None:
        """Nothing."""

    def answer(self, time: float, answer: Answer) -> None:
        """Nothing."""

    def change(self, time: float, state: str, reason: str) -> None:
        """Nothing."""

    def clocks(self, time: float, late: float, ages: dict[str, float]) -> None:
        """Nothing."""


class Journals:
    """Several journals as one; the trouble of any is its trouble.

    Args:
        several: that are told, in this order.
    """

    def __init__(self, several: Sequence[Journal]) -> None:
        self._several = tuple(several)

    @property
    def trouble(self) -> str | None:
        """The first trouble that there is."""
        return next((each.trouble for each in self._several if each.trouble is not None), None)

    def state(self, state: ArmState) -> None:
        """Pass on."""
        for each in self._several:
            each.state(state)

    def frame(self, frame: Frame) -> None:
        """Pass on."""
        for each in self._several:
            each.frame(frame)

    def sent(self, time: float, sent: Sent, gripper: float) -> None:
        """Pass on."""
        for each in self._several:
            each.sent(time, sent, gripper)

    def question(self, time: float, question: Question) -> None:
        """Pass on."""
        for each in self._several:
            each.question(time, question)

    def answer(self, time: float, answer: Answer) -> None:
        """Pass on."""
        for each in self._several:
            each.answer(time, answer)

    def change(self, time: float, state: str, reason: str) -> None:
        """Pass on."""
        for each in self._several:
            each.change(time, state, reason)

    def clocks(self, time: float, late: float, ages: dict[str, float]) -> None:
        """Pass on."""
        for each in self._several:
            each.clocks(time, late, ages)
