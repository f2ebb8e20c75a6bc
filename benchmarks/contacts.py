"""Which bodies may touch during which part of a motion, by their roles: docs/reference/solver.md, "Contacts"."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from judge import Pair
from mechanism import Mechanism, MovingJoint, motion
from parts import Moved, Part

Array = np.ndarray

#: A look at a keyframe may be off its time by rounding, seconds.
INSTANT = 1e-9


@dataclass
class Obstacle:
    """A rigid body of a scene: ``role`` is table, object_body, moving_link, rigid, target or attached.

    ``pose`` (4, 4) is in the base frame; of an attached body, in the hand frame.
    """

    name: str
    role: str
    parts: list[Part]
    pose: Array


@dataclass
class Hinge:
    """The object's joint in the base frame: it turns about, or slides along, ``axis`` (3,) through ``origin`` (3,)."""

    turns: bool
    origin: Array
    axis: Array

    def moved(self, pose: Array, travel: Array) -> Array:
        """Poses (M, 4, 4) of a body that is at ``pose`` where the joint has not moved, after ``travel`` (M,)."""
        joint = MovingJoint("", self.turns, self.axis, -np.inf, np.inf, np.inf)
        there = np.eye(4)
        there[:3, 3] = self.origin
        return there @ motion(joint, travel) @ np.linalg.inv(there) @ pose


@dataclass
class Clock:
    """When the contact rules change, and how far the object's joint has moved.

    They change at keyframes, each of which belongs to what comes before it and to what comes after: the clearance that
    a motion has to keep is that of its own ends.

    Attributes:
        touching_from: from then on hand and fingers may touch the moving link, seconds.
        moving_from: from then on that link moves, seconds.
        hinge: its joint.
        travel: (M,) rad or m at the times that are looked at, NaN where it is unknown; None throughout.
        letting_go: from then on what the hand held stands where it was, seconds.
    """

    touching_from: float
    moving_from: float
    hinge: Hinge | None = None
    travel: Array | None = None
    letting_go: float = np.inf

    def let_go(self, times: Array) -> Array:
        """Return at which of the (M,) times the hand has let go, (M,) bool."""
        return times > self.letting_go + INSTANT


def held_bodies(obstacles: Sequence[Obstacle], clock: Clock, times: Array, hands: Array) -> list[Moved]:
    """Return bodies in the hand, whose poses are (M, 4, 4); from when it lets go they stay where they are."""
    holding = hands.copy()
    left = clock.let_go(times)
    holding[left] = holding[np.flatnonzero(~left)[-1]]
    return [Moved(each.name, each.parts, holding @ each.pose) for each in obstacles if each.role == "attached"]


def touching_pairs(arm: Mechanism, obstacles: Sequence[Obstacle], clock: Clock, times: Array, q: Array) -> list[Pair]:
    """Every pair that may touch somewhere along a motion, judged where it may; arguments as :func:`checked_pairs`.

    What the hand holds is left out, and so is what moves by an amount that cannot be told.
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
    """Every pair that is judged somewhere along a motion, with its group: self, table or object.

    Args:
        arm: the robot.
        obstacles: the scene.
        clock: clock of the contact rules.
        times: (M,) seconds.
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
                # What moves as the hand does keeps its place against what it holds.
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
