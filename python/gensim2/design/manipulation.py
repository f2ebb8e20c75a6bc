"""A way to work an object's joint, written in the joint's own frame, and the solver config that it stands for.

Everything is relative to the joint frame at the contact keypoint (docs/architecture.md): y is where the keypoint goes
as the joint opens, z the axis, x away from the hinge. So one manipulation reads the same for a lid, a door and a
drawer.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

Frame = Literal["joint", "world"]
Vector = tuple[float, float, float]
Axis = Literal["x", "y", "z"]
Motion = Literal["follow_joint_to", "trace_joint_to"]

#: Position tolerance of the contact, metres.
CONTACT_TOLERANCE = 0.001

#: Metres by which the hand backs off at the end: a hand that still holds the part has not shown that it stays.
LET_GO = 0.06


@dataclass(frozen=True)
class Direction:
    """A unit vector in a frame, with a name for people."""

    name: str
    frame: Frame
    vector: Vector


@dataclass(frozen=True)
class Manipulation:
    """One way to move the joint.

    Attributes:
        keypoint: contact keypoint of the object.
        gripper: ``"closed"`` pushes with the fingertips, ``"grasp"`` closes on the part; ``"open"`` hooks.
        approach: where the fingers point.
        roll: axis of the joint frame that the line between the fingers is orthogonal to, or None for any.
        behind: metres from the keypoint to the contact, against the wanted motion.
        inset: metres from the keypoint to the contact, towards the hinge (or against joint-frame x).
        retreat: metres along the fingers from which the hand comes to the contact.
        motion: post-actuation motion that follows the joint, with or without turning the hand.
        goal_openness: where that motion ends; may overshoot.
        tolerance: of the alignment, radians.
        opening: whether the joint is to open.
        let_go: metres by which the hand backs off, fingers open, when the motion is done.
    """

    keypoint: str
    gripper: Literal["open", "closed", "grasp"]
    approach: Direction
    roll: Axis | None
    behind: float
    inset: float
    retreat: float
    motion: Motion
    goal_openness: float
    tolerance: float
    opening: bool
    let_go: float = LET_GO

    @property
    def label(self) -> str:
        """One phrase for the report."""
        verb = {"closed": "push", "open": "push with open fingers", "grasp": "grasp"}[self.gripper]
        roll = f", fingers across {self.roll}" if self.roll else ""
        offset = "".join(
            f", {1000 * value:.0f} mm {word}"
            for value, word in ((self.behind, "behind"), (self.inset, "inset"))
            if value
        )
        how = "turning" if self.motion == "follow_joint_to" else "keeping the hand turned as it is"
        return (
            f"{verb} at {self.keypoint.removeprefix('articulated_object_')}, fingers along {self.approach.name}"
            f"{roll}{offset}, {how} to openness {self.goal_openness:.2f}"
        )

    def provenance(self) -> dict[str, Any]:
        """Return the parameters as plain data."""
        return asdict(self)

    def config(self) -> dict[str, Any]:
        """Return the solver config as plain data."""
        sign = 1.0 if self.opening else -1.0
        contact: dict[str, Any] = {
            "type": "point2point_constraint",
            "keypoint_name": "tool_head",
            "target_keypoint_name": self.keypoint,
            "tolerance": CONTACT_TOLERANCE,
        }
        if self.behind or self.inset:
            contact["target_offset"] = [-self.inset, -sign * self.behind, 0.0]
            contact["target_offset_frame"] = "joint"
        constraints = [
            contact,
            {
                "type": "frame_axis_parallel",
                "axis_from_keypoint_name": "tool_tail",
                "axis_to_keypoint_name": "tool_head",
                "target_axis": list(self.approach.vector),
                "target_axis_frame": self.approach.frame,
                "target_inner_product": 1.0,
                "tolerance": self.tolerance,
            },
        ]
        if self.roll is not None:
            constraints.append(
                {
                    "type": "frame_axis_orthogonal",
                    "axis_from_keypoint_name": "tool_head",
                    "axis_to_keypoint_name": "tool_side",
                    "target_axis": [float(axis == self.roll) for axis in "xyz"],
                    "target_axis_frame": "joint",
                    "target_inner_product": 0.0,
                    "tolerance": self.tolerance,
                }
            )
        return {
            "tool_keypoint_name_list": ["tool_head", "tool_tail", "tool_side"],
            "object_keypoint_name_list": [self.keypoint],
            "constraint_list": constraints,
            "pre_actuation_motions": [["translate_z", -self.retreat]],
            "post_actuation_motions": [[self.motion, self.goal_openness]],
            "gripper": self.gripper,
            "let_go": self.let_go,
        }
