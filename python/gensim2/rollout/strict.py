"""Evaluate the verdict ``strict``, which requires the goal and further conditions that a person would require."""

from __future__ import annotations

import math
from collections.abc import Set
from typing import Any

import numpy as np

from gensim2.planning.scene import Scene
from gensim2.robots import RobotProfile
from gensim2.rollout.motion import change, changes, gripper_distance
from gensim2.rollout.record import StrictMiss
from gensim2.rollout.world import World
from gensim2.tasks.criteria import OF_GRIPPER, RigidLifted, all_hold
from gensim2.tasks.measurement import Measurement
from gensim2.tasks.spec import TaskSpec

StrictMisses = dict[StrictMiss, dict[str, Any]]
"""Measured values for each unmet condition, as plain data."""

RETREAT = 0.05
"""Minimum distance (m) between keypoints of the gripper and of its objects at the end."""

LINEAR_SPEED, ANGULAR_SPEED = 0.01, 0.05
"""Speeds (m/s and rad/s) below which objects are at rest."""

DISTURBED_OPENNESS, DISTURBED_DISTANCE = 0.02, 0.005
"""Maximum openness change and displacement (m) of objects before the first actuation pose."""

DEEPEST = 0.001
"""Maximum depth (m) to which a rigid object may penetrate a body. A larger depth is an artefact of the contact
solver.
"""

OTHERS_DISTANCE, OTHERS_TILT = 0.03, math.radians(20.0)
"""Maximum displacement (m) and rotation (rad) of objects that no step acts on."""


def strict_misses(
    world: World, start: Measurement, at_actuation: Measurement | None, before: Measurement, later: Measurement
) -> StrictMisses:
    """Return the reasons why an episode that reached its goal does not pass the ``strict`` verdict.

    Args:
        world: simulated world one second after the last command.
        start: measurement before the first control step.
        at_actuation: measurement at the first actuation pose. None: it was not reported, so motions before it cannot be
            checked.
        before: measurement one control step before ``later``.
    """
    task = world.task
    acted_on = task.acted_on
    misses: StrictMisses = {}
    if not is_about_the_gripper(task):
        touched = sorted(world.touched() & acted_on)
        if touched:
            misses[StrictMiss.NOT_LET_GO] = {"touches": touched}
        near = {name: distance for name in acted_on if (distance := gripper_distance(later, name)) < RETREAT}
        if near:
            misses[StrictMiss.NOT_RETREATED] = {"distances": near}
    if not all_hold(task.success, later):
        misses[StrictMiss.NOT_LASTING] = {}
    if speeds := _moving(world, before, later):
        misses[StrictMiss.MOVING] = {"speeds": speeds}
    if at_actuation is not None and (disturbed := _disturbed(start, at_actuation)):
        misses[StrictMiss.DISTURBED] = {"objects": disturbed}
    if moved := _moved_beside(start, later, acted_on):
        misses[StrictMiss.OTHERS_MOVED] = {"objects": moved}
    if pressed := pressed_in(world.scene_state(), world.profile):
        misses[StrictMiss.PRESSED_IN] = {"objects": pressed}
    return misses


def is_about_the_gripper(task: TaskSpec) -> bool:
    """Return whether the goal requires a gripper state or a lifted object."""
    return any(isinstance(c, (*OF_GRIPPER, RigidLifted)) for c in task.success)


def pressed_in(scene: Scene, robot: RobotProfile) -> dict[str, dict[str, float]]:
    """Return the rigid objects that overlap other bodies by more than ``DEEPEST`` (m).

    The planner's library measures the overlaps, independently of the engine. Overlaps with the robot do not count.

    Returns:
        Depth of each overlap (m), by the name of the rigid object and the name of the other body.
    """
    import gensim2_kpam as kpam  # imported here: reading records does not need the solver

    q = np.clip(scene.q, robot.model.lower, robot.model.upper)
    T_hand_base = np.linalg.inv(robot.model.forward_kinematics(q))
    shapes = {
        body.name: [kpam.Shape.convex_hull(np.ascontiguousarray(hull)) for hull in body.hulls] for body in scene.bodies
    }
    found: dict[str, dict[str, float]] = {}
    for name, thing in scene.objects.items():
        if not thing.is_rigid:
            continue
        # The object counts as attached to the hand, so that it is checked against all other bodies.
        bodies = [
            kpam.Body(body.name, "attached", shapes[body.name], T_hand_base @ body.T_base_body)
            if body.name == name
            else kpam.Body(body.name, "rigid", shapes[body.name], body.T_base_body)
            for body in scene.bodies
        ]
        for pair in kpam.Scene(robot.model, bodies).check(q):
            other = next((each for each in pair["bodies"] if each != name), name)
            if name in pair["bodies"] and other in shapes and pair["distance"] < -DEEPEST:
                found.setdefault(name, {})[other] = -pair["distance"]
    return found


def _moving(world: World, before: Measurement, later: Measurement) -> dict[str, float]:
    """Return the speeds of objects that are not at rest, m/s or rad/s.

    The speeds are computed from displacements, because the speeds of PhysX contain corrections.
    """
    moving, rate = {}, world.profile.control_hz
    for name, moved in changes(before, later).items():
        if name in later.openness:
            joint = world.initial_state.objects[name].model.joint
            assert joint is not None, "what has an openness has a joint"
            speed = rate * abs(moved.openness) * (joint.upper - joint.lower)
            if not speed < (LINEAR_SPEED if joint.type == "prismatic" else ANGULAR_SPEED):
                moving[name] = speed
        elif not rate * moved.distance < LINEAR_SPEED:
            moving[name] = rate * moved.distance
        elif not rate * moved.turn < ANGULAR_SPEED:
            moving[name] = rate * moved.turn
    return moving


def _disturbed(start: Measurement, at_actuation: Measurement) -> dict[str, float]:
    """Return the displacements (openness or m) of objects that moved before the actuation pose."""
    return {
        name: abs(moved.openness) if name in start.openness else moved.distance
        for name, moved in changes(start, at_actuation).items()
        if moved.exceeds(DISTURBED_OPENNESS, DISTURBED_DISTANCE)
    }


def _moved_beside(start: Measurement, later: Measurement, acted_on: Set[str]) -> dict[str, dict[str, float]]:
    """Return the objects that no step acts on but that moved farther than the tolerance, with their displacements."""
    moved = {}
    for name, points in later.keypoints.items():
        if name in acted_on:
            continue
        distance = max(float(np.linalg.norm(at - start.keypoints[name][key])) for key, at in points.items())
        tilt = change(start, later, name).tilt
        if not (distance <= OTHERS_DISTANCE and tilt <= OTHERS_TILT):
            moved[name] = {"distance": distance, "tilt": tilt}
    return moved
