"""Describe a contact and a motion that move an object's joint, and convert the description to a solver config.

The joint frame has its origin at the contact keypoint (docs/architecture.md). Its y axis is the direction in which the
keypoint moves as the joint opens, z is the joint axis, and x points away from the hinge. Therefore one description can
fit a lid, a door and a drawer.
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

#: Distance (m) by which the hand retreats at the end, so that success is evaluated while the hand touches nothing.
LET_GO = 0.06


@dataclass(frozen=True)
class Direction:
    """A unit vector in a named frame, with a name for reports."""

    name: str
    frame: Frame
    vector: Vector


@dataclass(frozen=True)
class Manipulation:
    """Contact, approach and motion that move a joint.

    Attributes:
        keypoint: contact keypoint of the object.
        gripper: ``"closed"``: the closed fingertips push; ``"grasp"``: the fingers grasp; ``"open"``: one finger of the
            open gripper pushes.
        approach: direction of the fingers.
        roll: axis of the joint frame that is perpendicular to the line through the fingertips. None: any roll angle.
        behind: offset in metres from the keypoint to the contact, against the direction of the motion.
        inset: offset in metres from the keypoint to the contact, towards the hinge (along -x of the joint frame).
        retreat: length (m) of the straight approach to the contact, along the fingers.
        motion: motion after the actuation pose. The hand follows the joint and may rotate with it.
        goal_openness: openness at which the motion ends; it may lie beyond the joint's range.
        tolerance: angular tolerance of the approach direction, rad.
        opening: whether the motion opens the joint.
        let_go: distance in metres by which the open hand retreats after the motion.
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
        """Return one phrase that describes the manipulation in the report."""
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
        """Return the parameters as a dictionary for JSON."""
        return asdict(self)

    def config(self) -> dict[str, Any]:
        """Return the solver config as a dictionary."""
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
