"""Replay of a log: observations made today against those given to the controller then, byte for byte."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.core.errors import GenSim2Error, InputError, one_line
from gensim2.robots import robot
from gensim2_robot.devices import Frame
from gensim2_robot.eyes import Eyes, Sight, inputs
from gensim2_robot.log_messages import About, AnswerMessage, AnyMessage, PictureMessage, QuestionMessage
from gensim2_robot.log_reader import messages, unclosed

KEPT = 50
"""Newest pictures of a camera that are kept: more than a question can be about when its answer comes."""
KEPT_BYTES = 1 << 28
"""Bytes of all pictures that are kept."""
MAX_DIFFERENT = 1000
"""Arrays that came out otherwise of which the names are kept."""


@dataclass(frozen=True)
class Replay:
    """Result of a comparison.

    Attributes:
        questions: that were answered.
        compared: arrays.
        clouds: of them point clouds.
        different: names of the first 1000 arrays that came out otherwise, with the number of the question.
        missing: questions whose pictures are in a file that is gone, or are no longer kept.
        unclosed: names of files that have no end, because the run was killed; what they hold was compared.
    """

    questions: int
    compared: int
    clouds: int
    different: tuple[str, ...]
    missing: int
    unclosed: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {**vars(self), "different": list(self.different), "unclosed": list(self.unclosed)}


def replay(folder: Path) -> Replay:
    """Make every observation of a log anew and compare it with what was logged.

    Raises:
        InputError: there is no log, it is damaged, or an observation cannot be made.
    """
    found = _Replayed()
    for _, message in messages(folder):
        try:
            found.take(message)
        except GenSim2Error as error:
            raise InputError(f"cannot be replayed: {error}", file=folder) from error
    return found.result(unclosed(folder))


class _Replayed:
    """Messages of a log so far, and what came of their comparison."""

    def __init__(self) -> None:
        self._eyes: list[Eyes] = []  # at nothing but the robot's own state, then through the cameras
        self._joints = 0
        self._frames: dict[str, dict[int, Frame]] = {}
        self._asked: dict[int, QuestionMessage] = {}
        self._questions = self._compared = self._clouds = self._missing = 0
        self._different: list[str] = []

    def take(self, message: AnyMessage) -> None:
        """Take the next message of the log.

        Raises:
            GenSim2Error: an observation cannot be made.
        """
        if isinstance(message, About):
            if not self._eyes:
                self._open_eyes(message)
        elif isinstance(message, PictureMessage):
            self._keep(message.frame())
        elif isinstance(message, QuestionMessage):
            self._asked[message.number] = message
            if len(self._asked) > KEPT:
                del self._asked[next(iter(self._asked))]
        elif isinstance(message, AnswerMessage) and message.seen:
            question = self._asked.pop(message.number, None)
            if question is not None:
                self._compare(question, message.seen)

    def result(self, cut: list[str]) -> Replay:
        """Return the comparison of a log of which the files ``cut`` have no end."""
        different = tuple(self._different)
        return Replay(self._questions, self._compared, self._clouds, different, self._missing, tuple(cut))

    def _open_eyes(self, about: About) -> None:
        cameras, spec = tuple(each.camera() for each in about.cameras), about.spec()
        pixels = np.inf if about.pixels is None else about.pixels
        profile = robot(about.robot)
        self._joints = len(profile.reset_qpos)
        for each in (replace(spec, modalities=()), spec):
            self._eyes.append(Eyes(each, profile, cameras, about.language, pixels))

    def _keep(self, frame: Frame) -> None:
        """Keep the newest pictures: numbers of a device have gaps, and begin anew."""
        kept = self._frames.setdefault(frame.camera, {})
        most = min(KEPT, max(1, KEPT_BYTES // (len(self._frames) * (frame.depth.nbytes + frame.colors.nbytes))))
        kept.pop(frame.number, None)
        kept[frame.number] = frame
        while len(kept) > most:
            del kept[next(iter(kept))]

    def _compare(self, question: QuestionMessage, seen: dict[str, npt.NDArray[Any]]) -> None:
        names = list(question.frames.items())
        if any(number not in self._frames.get(name, {}) for name, number in names):
            self._missing += 1
            return
        if any(len(q) != self._joints for q in (question.q, question.v, *question.posed.values())):
            raise InputError(f"question {question.number} is not of {self._joints} joints")
        shown = tuple(self._frames[name][number] for name, number in names)
        sight = Sight(question.step, question.q, question.v, question.gripper, shown, question.posed)
        found: dict[str, npt.NDArray[Any]] = {}
        for eyes in self._eyes:  # pictures that nobody looked at then may show what no cloud is made of
            if not found.keys() >= seen.keys():
                found = inputs(eyes.observe(sight))
        self._questions += 1
        for name, then in seen.items():
            now = found.get(name)
            self._compared += 1
            self._clouds += name == "point_cloud"
            differs = now is None or then.dtype != now.dtype or then.tobytes() != now.tobytes()
            if differs and len(self._different) < MAX_DIFFERENT:
                self._different.append(one_line(f"{name} of question {question.number}"))
