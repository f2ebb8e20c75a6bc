"""Determine which bodies may touch during which part of a motion (docs/reference/solver.md, "Contacts")."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from judge import Pair
from mechanism import Mechanism, MovingJoint, motion
from parts import Moved, Part

Array = np.ndarray

#: Tolerance for comparing the time of a sample with the time of a keyframe, s.
INSTANT = 1e-9


@dataclass
class Obstacle:
    """A rigid body of a scene.

    ``role`` is table, object_body, moving_link, rigid, target or attached. ``pose`` (4, 4) is in the base frame; the
    pose of an attached body is in the hand frame.
    """

    name: str
    role: str
    parts: list[Part]
    pose: Array


@dataclass
class Hinge:
    """Joint of the object: rotation about, or motion along, ``axis`` (3,) through ``origin`` (3,), base frame."""

    turns: bool
    origin: Array
    axis: Array

    def moved(self, pose: Array, travel: Array) -> Array:
        """Return the poses (M, 4, 4) after ``travel`` (M,) of a body that is at ``pose`` before the joint moves."""
        joint = MovingJoint("", self.turns, self.axis, -np.inf, np.inf, np.inf)
        there = np.eye(4)
        there[:3, 3] = self.origin
        return there @ motion(joint, travel) @ np.linalg.inv(there) @ pose


@dataclass
class Clock:
    """Times at which the contact rules change, and travel of the object's joint.

    The rules change at keyframes. A keyframe belongs both to the segment before it and to the segment after it.

    Attributes:
        touching_from: time from which hand and fingers may touch the moving link, s.
        moving_from: time from which the moving link moves, s.
        hinge: joint of the moving link.
        travel: (M,) travel of the joint at the checked times, rad or m, NaN if unknown; None if it is always unknown.
        letting_go: time from which the released object stays in place, s.
    """

    touching_from: float
    moving_from: float
    hinge: Hinge | None = None
    travel: Array | None = None
    letting_go: float = np.inf

    def let_go(self, times: Array) -> Array:
        """Return a mask (M,) of the times after the release."""
        return times > self.letting_go + INSTANT


def held_bodies(obstacles: Sequence[Obstacle], clock: Clock, times: Array, hands: Array) -> list[Moved]:
    """Return the bodies in the hand with poses (M, 4, 4); after the release the bodies stay in place."""
    holding = hands.copy()
    left = clock.let_go(times)
    holding[left] = holding[np.flatnonzero(~left)[-1]]
    return [Moved(each.name, each.parts, holding @ each.pose) for each in obstacles if each.role == "attached"]


def touching_pairs(arm: Mechanism, obstacles: Sequence[Obstacle], clock: Clock, times: Array, q: Array) -> list[Pair]:
    """Return every pair that may touch during a part of a motion; arguments as for :func:`checked_pairs`.

    Grasped objects and bodies with an unknown travel are left out.
    """
    placed = arm.place(q)
    hands = [Moved(name, arm.parts[name], placed[name]) for name in arm.parts if name in arm.touching_links]
    held = held_bodies(obstacles, clock, times, placed[arm.hand_link])
    pairs = []
    for obstacle in obstacles:
        still = Moved(obstacle.name, obstacle.parts, obstacle.pose[None])
        if obstacle.role == "target":
            always = np.ones(len(times), dtype=bool)
            pairs += [Pair(hand, still, always) for hand in hands]
            pairs += [Pair(body, still, ~clock.let_go(times)) for body in held]
        elif obstacle.role == "moving_link":
            standing = (times >= clock.touching_from) & (times < clock.moving_from)
            pairs += [Pair(hand, still, standing) for hand in hands]
            if clock.hinge is not None and clock.travel is not None:
                known = (times > clock.moving_from) & ~np.isnan(clock.travel)
                gone = Moved(
                    obstacle.name, obstacle.parts, clock.hinge.moved(obstacle.pose, np.nan_to_num(clock.travel))
                )
                pairs += [Pair(hand, gone, known) for hand in hands]
    return pairs


def checked_pairs(
    arm: Mechanism, obstacles: Sequence[Obstacle], clock: Clock, times: Array, q: Array
) -> list[tuple[str, Pair]]:
    """Return every pair that is checked during a part of a motion, with its group: self, table or object.

    Args:
        arm: robot.
        obstacles: bodies of the scene.
        clock: times at which the contact rules change.
        times: (M,) checked times, s.
        q: (M, n) joint vectors at those times.
    """
    placed = arm.place(q)
    links = {name: Moved(name, arm.parts[name], placed[name]) for name in arm.parts}
    held = held_bodies(obstacles, clock, times, placed[arm.hand_link])
    always = np.ones(len(times), dtype=bool)
    leaving = times >= clock.letting_go - INSTANT
    pairs = [("self", Pair(links[one], links[two], always)) for one, two in arm.self_pairs]
    carried = arm.movers(arm.hand_link)
    for body in held:
        for name in arm.parts:
            if name not in arm.holding_links:
                # Links that move with the hand do not move relative to a grasped object.
                pairs.append(("self", Pair(body, links[name], leaving if arm.movers(name) == carried else always)))
    movers = [links[name] for name in arm.moving_links] + held
    for obstacle in obstacles:
        if obstacle.role == "attached":
            continue
        still = Moved(obstacle.name, obstacle.parts, obstacle.pose[None])
        group = "table" if obstacle.role == "table" else "object"
        for body in movers:
            touches = body.name in arm.touching_links
            if obstacle.role == "target" and (touches or body in held):
                continue
            judged = always
            if obstacle.role == "moving_link":
                judged = times <= (clock.touching_from if touches else clock.moving_from) + INSTANT
            pairs.append((group, Pair(body, still, judged)))
        if obstacle.role == "moving_link" and clock.hinge is not None and clock.travel is not None:
            known = (times >= clock.moving_from - INSTANT) & ~np.isnan(clock.travel)
            poses = clock.hinge.moved(obstacle.pose, np.nan_to_num(clock.travel))
            gone = Moved(obstacle.name, obstacle.parts, poses)
            pairs += [
                (group, Pair(body, gone, known))
                for body in [links[name] for name in arm.parts if name not in arm.touching_links] + held
            ]
    return pairs
