"""Random targets to press, push and pull, for ``keypoint_arms.py``."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import coal
import numpy as np
import pinocchio as pin
from contacts import Hinge, Obstacle
from keypoint_robots import KEYPOINTS, KeypointArm
from mechanism import touches
from parts import Part, part, shape_distance, transform
from scipy.optimize import least_squares

import gensim2_kpam as kpam
from gensim2.core import seeding

Array = np.ndarray

KINDS = ("press", "push", "pull")
#: Errors of a pose (m, rad) below which inverse kinematics counts as solved.
POSE_ERROR = 1e-6
#: Start values of the inverse kinematics of each keyframe when a target is drawn.
STARTS = 24


@dataclass
class Block:
    """A box of an object: half extents (3,), m, and its pose (4, 4) in the base frame."""

    name: str
    role: str
    half: Array
    pose: Array

    def body(self) -> kpam.Body:
        """Return the box for the solver."""
        return kpam.Body(self.name, self.role, [kpam.Shape.box(self.half)], self.pose)  # type: ignore[arg-type]

    def obstacle(self) -> Obstacle:
        """Return the box for the checks."""
        return Obstacle(self.name, self.role, [part(coal.Box(*(2.0 * self.half)), np.eye(4))], self.pose)


@dataclass
class Target:
    """A problem of one kind, and the joints ``q_contact`` that meet its constraints.

    ``hinge`` is the joint of the object, and ``travel`` (m or rad) the travel of the joint in the motion.
    """

    kind: str
    number: int
    config: dict[str, Any]
    points: dict[str, Array]
    blocks: list[Block]
    hinge: Hinge
    travel: float
    q_contact: Array

    def moved(self, contact: Array, travel: float) -> Array:
        """Return the hand pose (4, 4) after ``travel`` (m or rad) of the joint for a hand pose at the contact.

        To pull, the hand moves rigidly with the object. Otherwise the tip moves with the object, and the hand keeps its
        orientation.
        """
        if self.kind == "pull":
            return np.asarray(self.hinge.moved(contact, np.array([travel]))[0])
        tip = contact[:3, :3] @ KEYPOINTS["tool_head"] + contact[:3, 3]
        at = self.hinge.moved(shifted(tip), np.array([travel]))[0]
        pose = contact.copy()
        pose[:3, 3] += at[:3, 3] - tip
        return pose

    def keyframes(self, contact: Array) -> list[tuple[str, Array, float]]:
        """Return label, hand pose and joint travel of every keyframe for a hand pose (4, 4) at the contact."""
        (_, back) = self.config["pre_actuation_motions"][0]
        before = contact @ shifted(np.array([0.0, 0.0, back]))
        moved = self.moved(contact, self.travel)
        after = moved @ shifted(np.array([0.0, 0.0, -self.config["let_go"]]))
        return [
            ("pre_0", before, 0.0),
            ("actuation", contact, 0.0),
            ("post_0", moved, self.travel),
            ("let_go", after, self.travel),
        ]

    def problem(self, arm: KeypointArm, scene_blocks: list[Block]) -> kpam.KeypointProblem:
        """Return the problem for the solver, with default options except speed."""
        kind = "revolute" if self.hinge.turns else "prismatic"
        joint = kpam.Joint(kind, self.hinge.origin, self.hinge.axis, 0.0, -2.0, 2.0)  # type: ignore[arg-type]
        return kpam.KeypointProblem(
            arm.robot,
            kpam.SolverConfig(self.config),
            arm.home,
            tool_keypoints=KEYPOINTS,
            object_keypoints=self.points,
            T_base_object=np.eye(4),
            joint=joint,
            bodies=[block.body() for block in scene_blocks],
            options={"velocity_scale": 1.0, "acceleration_scale": 1.0},
        )


def shifted(way: Array) -> Array:
    """Return the pose (4, 4) of a translation."""
    pose = np.eye(4)
    pose[:3, 3] = way
    return pose


def table() -> Block:
    """Return the table on which every arm stands: 2.4 m x 2.4 m, 5 mm below the base frame."""
    return Block("table", "table", np.array([1.2, 1.2, 0.02]), shifted(np.array([0.0, 0.0, -0.025])))


def tilted(axis: Array, most: float, draw: np.random.Generator) -> Array:
    """Return a unit vector at a random angle of at most ``most`` (rad) from a unit vector."""
    side = np.cross(axis, draw.normal(size=3))
    angle = most * np.sqrt(draw.random())
    return np.asarray(np.cos(angle) * axis + np.sin(angle) * side / np.linalg.norm(side))


def parallel(end: str, axis: Array, tolerance: float) -> dict[str, Any]:
    """Return the constraint that the direction from ``tool_tail`` or ``tool_head`` is parallel to an axis (world)."""
    return {
        "type": "frame_axis_parallel",
        "axis_from_keypoint_name": "tool_tail" if end == "tool_head" else "tool_head",
        "axis_to_keypoint_name": end,
        "target_axis": [float(value) for value in axis],
        "target_axis_frame": "world",
        "target_inner_product": 1.0,
        "tolerance": tolerance,
    }


def drawn(kind: str, number: int, hand: Array, q: Array, draw: np.random.Generator) -> Target:
    """Return a target whose constraints a hand pose (4, 4) at the joints ``q`` meets.

    - ``press``: a button of 30 mm on a plate; the rod presses the button by 12 mm, at most 0.15 rad from its axis.
    - ``push``: a block of 80 mm slides 120 mm; the rod is at most 0.4 rad from the direction of the motion.
    - ``pull``: a bar in front of a panel; the hand has a given orientation, within 0.1 rad, and the panel slides 120 mm
      toward the hand or turns 0.5 rad about a hinge.
    """
    tip = hand[:3, :3] @ KEYPOINTS["tool_head"] + hand[:3, 3]
    most = {"press": 0.12, "push": 0.35, "pull": 0.05}[kind]
    axis = tilted(hand[:3, 2], most, draw)
    side = hand[:3, 1] - axis * (hand[:3, 1] @ axis)
    side /= np.linalg.norm(side)
    frame = np.eye(4)
    frame[:3, :3] = np.column_stack([np.cross(side, axis), side, axis])
    frame[:3, 3] = tip

    def block(name: str, role: str, half: list[float], way: list[float]) -> Block:
        return Block(name, role, np.array(half), frame @ shifted(np.array(way)))

    point = {
        "type": "point2point_constraint",
        "keypoint_name": "tool_head",
        "target_keypoint_name": "contact",
        "tolerance": {"press": 0.002, "push": 0.005, "pull": 0.002}[kind],
    }
    constraints = [point, parallel("tool_head", axis, {"press": 0.15, "push": 0.4, "pull": 0.1}[kind])]
    turns = kind == "pull" and bool(draw.random() < 0.5)
    if kind == "press":
        travel, along, origin = 0.012, axis, tip
        blocks = [
            block("button", "moving_link", [0.015, 0.015, 0.01], [0.0, 0.0, 0.01]),
            block("plate", "object_body", [0.05, 0.05, 0.01], [0.0, 0.0, 0.026]),
        ]
    elif kind == "push":
        travel, along, origin = 0.12, axis, tip
        # The target lies 6 mm in front of the face, so that no point within the tolerance is deep inside the block.
        blocks = [block("block", "moving_link", [0.04, 0.04, 0.04], [0.0, 0.0, 0.046])]
    else:
        constraints.append(parallel("tool_side", side, 0.1))
        across = frame[:3, 0]
        radius = float(draw.uniform(0.25, 0.35))
        travel, along, origin = (0.5, side, tip + radius * across) if turns else (0.12, -axis, tip)
        if turns:
            # The bar moves toward the hand at first.
            travel *= float(np.sign(np.cross(side, tip - origin) @ -axis))
        blocks = [
            block("bar", "moving_link", [0.008, 0.05, 0.008], [0.0, 0.0, 0.008]),
            block("panel", "moving_link", [0.06, 0.06, 0.008], [0.0, 0.0, 0.064]),
        ]
    config = {
        "constraint_list": constraints,
        "pre_actuation_motions": [["translate_z", -0.08]],
        "post_actuation_motions": [["follow_joint" if kind == "pull" else "trace_joint", travel]],
        "gripper": "grasp" if kind == "pull" else "closed",
        "let_go": 0.06,
    }
    return Target(kind, number, config, {"contact": tip}, blocks, Hinge(turns, origin, along), travel, q)


def pose_errors(arm: KeypointArm, q: Array, goal: Array) -> Array:
    """Return the errors (6,) of the hand's position (m) and rotation (rad) at joints ``q``."""
    hand = arm.hand(q)
    return np.r_[hand[:3, 3] - goal[:3, 3], pin.log3(goal[:3, :3].T @ hand[:3, :3])]


def pose_slopes(arm: KeypointArm, q: Array, goal: Array) -> Array:
    """Return the derivatives (6, n) of :func:`pose_errors`, by Pinocchio."""
    columns = pin.computeFrameJacobian(arm.model, arm.data, q, arm.frame, pin.LOCAL_WORLD_ALIGNED)
    hand = arm.hand(q)
    turn = pin.Jlog3(goal[:3, :3].T @ hand[:3, :3]) @ hand[:3, :3].T
    return np.vstack([columns[:3], turn @ columns[3:]])


def joints_at(
    arm: KeypointArm, goal: Array, starts: Iterator[Array], count: int, free: Callable[[Array], bool]
) -> Array | None:
    """Return joints with the hand at a pose that ``free`` accepts, from at most ``count`` start values; None if none
    was found.
    """
    for _ in range(count):
        begin = np.clip(next(starts), arm.low + 1e-9, arm.high - 1e-9)
        found = least_squares(
            lambda q: pose_errors(arm, q, goal),
            begin,
            lambda q: pose_slopes(arm, q, goal),
            bounds=(arm.low, arm.high),
            xtol=1e-12,
            ftol=1e-14,
            gtol=1e-12,
            max_nfev=60,
        )
        if np.abs(found.fun).max() < POSE_ERROR and free(found.x):
            return np.asarray(found.x)
    return None


def collides(
    arm: KeypointArm, q: Array, blocks: list[Block], hinge: Hinge | None, travel: float, touching: str
) -> bool:
    """Return whether the arm overlaps itself or a block by coal. The hand may touch bodies with the role ``touching``
    by up to 3 mm.
    """
    mechanism = arm.mechanism
    placed = {name: pose[0] for name, pose in mechanism.place(np.asarray(q)[None]).items()}
    for one, two in mechanism.self_pairs:
        if touches(mechanism.parts[one], placed[one], mechanism.parts[two], placed[two]):
            return True
    for block in blocks:
        pose = block.pose
        if block.role == "moving_link" and hinge is not None:
            pose = hinge.moved(pose, np.array([travel]))[0]
        box = block.obstacle().parts
        for name in mechanism.moving_links:
            deepest = -0.003 if name == "hand" and block.role == touching else 0.0
            if nearest(mechanism.parts[name], placed[name], box, pose) < deepest:
                return True
    return False


def nearest(ones: list[Part], at_one: Array, twos: list[Part], at_two: Array) -> float:
    """Return the signed distance of two bodies, m."""
    return min(
        shape_distance(a.shape, transform(at_one @ a.pose), b.shape, transform(at_two @ b.pose))
        for a in ones
        for b in twos
    )


def targets(arm: KeypointArm, kind: str, count: int, seed: int) -> Iterator[Target]:
    """Yield reachable targets.

    A random joint configuration is the contact. It keeps the tool 3 cm above the table, and neither the arm nor the
    object collides. The hand poses before and after the contact that follow from the configuration are plausible: for
    each, inverse kinematics finds joints within the limits that do not collide, with the object where the motion has
    brought it. The object leaves 5 cm of room around the arm at its start.
    """
    ground = table()
    found = 0
    draw = seeding.rng(seed, f"keypoint targets {arm.name} {kind}")
    while found < count:
        q = arm.draw(draw)
        hand = arm.hand(q)
        if (hand[:3, :3] @ KEYPOINTS["tool_head"] + hand[:3, 3])[2] < 0.03:
            continue
        target = drawn(kind, found, hand, q, draw)
        if is_plausible(arm, target, [ground, *target.blocks], draw):
            found += 1
            yield target


def is_plausible(arm: KeypointArm, target: Target, blocks: list[Block], draw: np.random.Generator) -> bool:
    """Return whether the keyframes of a target can be reached one by one, as in :func:`targets`."""
    if collides(arm, target.q_contact, blocks, None, 0.0, "moving_link"):
        return False
    mechanism = arm.mechanism
    home = {name: pose[0] for name, pose in mechanism.place(arm.home[None]).items()}
    for block in target.blocks:
        corners = block.obstacle().parts[0].corners @ block.pose[:3, :3].T + block.pose[:3, 3]
        if corners[:, 2].min() < 0.0:
            return False
        shapes = block.obstacle().parts
        if any(nearest(parts, home[name], shapes, block.pose) < 0.05 for name, parts in mechanism.parts.items()):
            return False
    for label, pose, travel in target.keyframes(arm.hand(target.q_contact)):
        if label == "actuation":
            continue

        def starts() -> Iterator[Array]:
            yield target.q_contact
            while True:
                yield arm.draw(draw)

        touching = "moving_link" if label == "post_0" else ""

        def free(q: Array, travel: float = travel, touching: str = touching) -> bool:
            return not collides(arm, q, blocks, target.hinge, travel, touching)

        if joints_at(arm, pose, starts(), STARTS, free) is None:
            return False
    return True
