"""Interface of grippers for grasping: commands to joints, joints to the distance of the pads, forces to commands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    import gensim2_kpam as kpam

Array = npt.NDArray[np.float64]
Row = npt.NDArray[np.float32]

OPEN, CLOSED = 1.0, -1.0
"""Gripper commands: the last number of an action."""


@dataclass(frozen=True)
class Mimic:
    """A joint that follows another one: its value is ``multiplier`` times the other's, plus ``offset``.

    Attributes:
        joint: name of the one that is followed; a driven one.
        multiplier: rad or m of this joint for each rad or m of the other.
        offset: rad or m.
    """

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


class Gripper(Protocol):
    """Two pads that open and close on one command from -1 (closed) to 1 (open).

    Attributes:
        joints: names of all the g moving joints below the hand, in active joint order.
        driven: of those that have a motor; the command is their target.
        fingers: of those whose drives press the pads together: driven ones, or such that follow.
        mimics: of those that follow a driven one.
        passive: of those that neither a motor nor a transmission moves; they rest at 0. The URDF says so by a
            ``mimic`` element with the multiplier 0.
        pads: names of the links that touch what is held.
        travel_seconds: time that the fingers are given to open or to close.
        friction: coefficient of the pads' surface, static and dynamic.
        widest: distance of the pads (m) at the command 1.
    """

    @property
    def joints(self) -> tuple[str, ...]: ...
    @property
    def driven(self) -> tuple[str, ...]: ...
    @property
    def fingers(self) -> tuple[str, ...]: ...
    @property
    def mimics(self) -> Mapping[str, Mimic]: ...
    @property
    def passive(self) -> tuple[str, ...]: ...
    @property
    def pads(self) -> tuple[str, ...]: ...
    @property
    def travel_seconds(self) -> float: ...
    @property
    def friction(self) -> float: ...
    @property
    def widest(self) -> float: ...

    def target(self, command: Row) -> Row:
        """Return the targets (rad or m) of a driven joint for commands of any shape, clipped to -1 and 1."""

    @property
    def range(self) -> tuple[float, float]:
        """Targets of a driven joint for the commands -1 and 1."""

    def command(self, opening: float) -> float:
        """Return the command that opens the pads to ``opening`` (m); not clipped."""

    def command_at(self, q: Array) -> float:
        """Return the command that holds the (g,) joints where they are; not clipped."""

    def grip(self, opening: float, force: float, stiffness: float) -> float:
        """Return the command by which each pad presses with ``force`` (N) on what keeps them ``opening`` (m) apart.

        Args:
            stiffness: of the drives of ``fingers``, N/m or N m/rad.
        """

    def opening(self, q: Array) -> float:
        """Return the distance of the pads (m) at the (g,) joints."""

    def at_opening(self, opening: float) -> Array:
        """Return the (g,) joints with the pads ``opening`` (m) apart."""

    def at_command(self, command: float) -> Array:
        """Return the (g,) joints at a command, with nothing between the pads."""

    def planned(self, opening: float) -> float:
        """Return the value of the driven joints at ``opening`` (m): the solver's ``finger_width``."""

    def travel(self, command: float, other: float) -> float:
        """Return the metres that a finger goes from one command to another; negative where it opens."""

    def grasping(self, model: kpam.Robot, tool_keypoints: Mapping[str, Array]) -> kpam.ParallelGripper:
        """Return the gripper as the solver's search for grasps takes it."""


@dataclass(frozen=True)
class SlidingGripper:
    """Two fingers that slide equally far, driven each by a motor of its own or both by one through a transmission.

    Attributes:
        joints, driven, mimics, passive, pads, travel_seconds, friction: as :class:`Gripper` has them; where ``driven``
            is empty, the sliding joints are.
        fingers: names of the two joints that slide; a finger joint stands at 0 where the pads touch.
        open, closed: targets (m) of a sliding joint for the commands 1 and -1; the closed one presses.
    """

    joints: tuple[str, ...]
    fingers: tuple[str, ...]
    pads: tuple[str, ...]
    open: float
    closed: float
    travel_seconds: float
    friction: float
    driven: tuple[str, ...] = ()
    mimics: Mapping[str, Mimic] = field(default_factory=dict)
    passive: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "driven", self.driven or self.fingers)

    def target(self, command: Row) -> Row:
        """In ManiSkill's arithmetic, bit for bit."""
        middle, half_span = self._targets
        return middle + half_span * np.minimum(np.maximum(command, np.float32(CLOSED)), np.float32(OPEN))

    @cached_property
    def _targets(self) -> tuple[np.float32, np.float32]:
        """Target of a driven joint for the command 0, and by how much it changes to that for 1."""
        low, high, half = *map(np.float32, self.range), np.float32(0.5)
        return half * (high + low), half * (high - low)

    @property
    def range(self) -> tuple[float, float]:
        """Targets of a driven joint for the commands -1 and 1."""
        return self._driven_at(self.closed), self._driven_at(self.open)

    @property
    def widest(self) -> float:
        """Distance of the pads (m) at the command 1."""
        return len(self.fingers) * self.open

    def command(self, opening: float) -> float:
        """The command that opens the pads to ``opening`` (m)."""
        return self._command(opening / len(self.fingers))

    def command_at(self, q: Array) -> float:
        """The command that holds the (g,) joints where they are."""
        return self._command(float(q[self._sliding[0]]))

    def grip(self, opening: float, force: float, stiffness: float) -> float:
        """The command by which each pad presses with ``force`` (N); the sliding drives are springs."""
        return self._command(opening / len(self.fingers) - force / stiffness)

    def opening(self, q: Array) -> float:
        """Distance of the pads (m) at the (g,) joints."""
        return float(sum(q[index] for index in self._sliding))

    def at_opening(self, opening: float) -> Array:
        """(g,) joints with the pads ``opening`` (m) apart."""
        return self._joints_at(opening / len(self.fingers))

    def at_command(self, command: float) -> Array:
        """(g,) joints at a command, with nothing between the pads."""
        value = 0.5 * (self.open + self.closed) + 0.5 * (self.open - self.closed) * command
        return self._joints_at(float(max(value, 0.0)))

    def planned(self, opening: float) -> float:
        """Value of the driven joints at ``opening`` (m)."""
        return self._driven_at(opening / len(self.fingers))

    def travel(self, command: float, other: float) -> float:
        """Metres that a finger goes from one command to another."""
        return 0.5 * (command - other) * (self.open - self.closed)

    def grasping(self, model: kpam.Robot, tool_keypoints: Mapping[str, Array]) -> kpam.ParallelGripper:
        """Pads and stroke from the shapes and limits of the URDF."""
        import gensim2_kpam as kpam

        return kpam.ParallelGripper.of_robot(model, **tool_keypoints)

    def _command(self, finger: float) -> float:
        return (2.0 * finger - self.open - self.closed) / (self.open - self.closed)

    def _driven_at(self, finger: float) -> float:
        """Value of a driven joint where the fingers stand at ``finger`` (m)."""
        mimic = self.mimics.get(self.fingers[0])
        return finger if mimic is None else (finger - mimic.offset) / mimic.multiplier

    def _joints_at(self, finger: float) -> Array:
        driven = self._driven_at(finger)
        found = np.zeros(len(self.joints))
        for index, name in enumerate(self.joints):
            mimic = self.mimics.get(name)
            if name in self.fingers:
                found[index] = finger
            elif mimic is not None:
                found[index] = mimic.multiplier * driven + mimic.offset
            elif name in self.driven:
                found[index] = driven
        return found

    @cached_property
    def _sliding(self) -> Sequence[int]:
        return [self.joints.index(name) for name in self.fingers]
