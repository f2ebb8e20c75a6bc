"""Convert between gripper commands, finger joints, pad distance and grip force."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np
import numpy.typing as npt

from gensim2.core.arrays import Array

if TYPE_CHECKING:
    import gensim2_kpam as kpam

Row = npt.NDArray[np.float32]

OPEN, CLOSED = 1.0, -1.0
"""Values of the gripper command, which is the last number of an action."""


@dataclass(frozen=True)
class Mimic:
    """A joint whose value is ``multiplier`` times the value of another joint, plus ``offset``.

    Attributes:
        joint: name of the driven joint that this joint follows.
        multiplier: motion of this joint (rad or m) for each rad or m of the driven joint.
        offset: value of this joint when the driven joint is at 0, rad or m.
    """

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


class Gripper(Protocol):
    """Two pads whose distance is set by one command, from -1 (closed) to 1 (open).

    Attributes:
        joints: names of all g movable joints below the hand, in active joint order.
        driven: names of the motorized joints; the command determines their target.
        fingers: names of the joints whose drives press the pads together; they are driven or follow a driven joint.
        mimics: joints that follow a driven joint, by name.
        passive: joints without a motor that rest at 0. In the URDF their ``mimic`` has the multiplier 0.
        pads: names of the links that touch a grasped object.
        travel_seconds: time for opening or closing the fingers.
        friction: static and dynamic friction coefficient of the pads' surface.
        widest: distance of the pads (m) at command 1.
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
        """Return the target of a driven joint, rad or m, for commands of any shape. Commands are clipped to -1..1."""

    @property
    def range(self) -> tuple[float, float]:
        """Targets of a driven joint at commands -1 and 1."""

    def command(self, opening: float) -> float:
        """Return the command that opens the pads to ``opening`` (m), without clipping to -1 and 1."""

    def command_at(self, q: Array) -> float:
        """Return the command for the values ``q`` (g,) of the gripper joints. The command may lie outside -1..1."""

    def grip(self, opening: float, force: float, stiffness: float) -> float:
        """Return the command with which each pad presses with ``force`` (N) on an object between the pads.

        Args:
            opening: distance of the pads, which is the width of the object, m.
            force: force of each pad, N.
            stiffness: stiffness of the drives of ``fingers``, N/m or N m/rad.
        """

    def opening(self, q: Array) -> float:
        """Return the distance of the pads (m) at the joints (g,)."""

    def at_opening(self, opening: float) -> Array:
        """Return the joint values (g,) at which the distance of the pads is ``opening``, m."""

    def at_command(self, command: float) -> Array:
        """Return the gripper's joint values (g,) after it has executed a command without an object between the pads."""

    def planned(self, opening: float) -> float:
        """Return the value of the driven joints at which the distance of the pads is ``opening``, m.

        The planner gives the returned value to the solver as the option ``finger_width``.
        """

    def travel(self, command: float, other: float) -> float:
        """Return the distance (m) that a finger moves from ``command`` to ``other``; negative if the gripper opens."""

    def grasping(self, model: kpam.Robot, tool_keypoints: Mapping[str, Array]) -> kpam.ParallelGripper:
        """Return this gripper's description for the grasp search of ``gensim2_kpam``."""


@dataclass(frozen=True)
class SlidingGripper:
    """Gripper with two fingers that slide by equal distances. Each finger has a motor, or one motor moves both.

    Attributes:
        joints, driven, mimics, passive, pads, travel_seconds, friction: as in :class:`Gripper`. By default, both joints
            are driven.
        fingers: names of the two sliding joints, which are at 0 when the pads touch.
        open, closed: targets (m) of a sliding joint at the commands 1 and -1. ``closed`` lies beyond the position where
            the pads meet.
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
        """Return the targets, with the same floating-point rounding as ManiSkill's controller."""
        middle, half_span = self._targets
        return middle + half_span * np.minimum(np.maximum(command, np.float32(CLOSED)), np.float32(OPEN))

    @cached_property
    def _targets(self) -> tuple[np.float32, np.float32]:
        """Return a driven joint's target at command 0, and the difference between the targets at 1 and 0."""
        low, high, half = *map(np.float32, self.range), np.float32(0.5)
        return half * (high + low), half * (high - low)

    @property
    def range(self) -> tuple[float, float]:
        return self._driven_at(self.closed), self._driven_at(self.open)

    @property
    def widest(self) -> float:
        return len(self.fingers) * self.open

    def command(self, opening: float) -> float:
        return self._command(opening / len(self.fingers))

    def command_at(self, q: Array) -> float:
        return self._command(float(q[self._sliding[0]]))

    def grip(self, opening: float, force: float, stiffness: float) -> float:
        return self._command(opening / len(self.fingers) - force / stiffness)

    def opening(self, q: Array) -> float:
        return float(sum(q[index] for index in self._sliding))

    def at_opening(self, opening: float) -> Array:
        return self._joints_at(opening / len(self.fingers))

    def at_command(self, command: float) -> Array:
        value = 0.5 * (self.open + self.closed) + 0.5 * (self.open - self.closed) * command
        return self._joints_at(float(max(value, 0.0)))

    def planned(self, opening: float) -> float:
        return self._driven_at(opening / len(self.fingers))

    def travel(self, command: float, other: float) -> float:
        return 0.5 * (command - other) * (self.open - self.closed)

    def grasping(self, model: kpam.Robot, tool_keypoints: Mapping[str, Array]) -> kpam.ParallelGripper:
        """Derive pads and stroke from the geometry and joint limits in the URDF."""
        import gensim2_kpam as kpam

        return kpam.ParallelGripper.of_robot(model, **tool_keypoints)

    def _command(self, finger: float) -> float:
        return (2.0 * finger - self.open - self.closed) / (self.open - self.closed)

    def _driven_at(self, finger: float) -> float:
        """Return the value of a driven joint for a finger position (m)."""
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
