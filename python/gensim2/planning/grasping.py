"""Find grasps of a rigid object, and create the solver config that executes a grasp."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

import gensim2_kpam as kpam
from gensim2.core.arrays import Array
from gensim2.planning.scene import Scene, SceneObject
from gensim2.planning.strategies import GraspStrategy
from gensim2.robots import RobotProfile

#: Height (m) by which ``move-up`` of the config language raises the hand.
STRIDE = 0.06

#: Maximum number of feasible grasps that are compared to find one with which the next step can use its first strategy.
COMPARED = 6

#: Motions that pull an object out from under an obstacle before the lift.
ASIDE = ("move-backward", "move-left", "move-right", "move-forward")

#: Maximum number of grasps with a blocked lift that are tried again with a motion of ``ASIDE`` before the lift.
DRAWN_OUT = 8

#: Two hand poses count as the same grasp if their distance (m) and rotation angle (rad) are below these limits.
SAME_PLACE, SAME_TURN = 0.015, 0.3

#: A grasp counts as secure if its contact forces lie at least this angle (rad) inside the friction cone.
HELD = 0.03

#: When grasps of a slippery object are ranked, lever arms are rounded to multiples of this length (m).
LEVER_STEP = 0.005

#: Position (m) and angular (rad) tolerance of the hand at a grasp.
AT, ALONG = 0.001, 0.02


def grasps_of(
    world: kpam.Scene,
    scene: Scene,
    name: str,
    gripper: kpam.ParallelGripper,
    profile: RobotProfile,
    strategy: GraspStrategy,
    lost: Sequence[Array] = (),
) -> list[kpam.Grasp]:
    """Return the collision-free grasps of a rigid object, best first. Their tilt is within the strategy's limits.

    The strategy's friction coefficient determines the order of the grasps. If the scene's coefficient is lower, grasps
    that would slip with it move to the end. Grasps near the centre of mass then come first, because other grasps slowly
    rotate in the pads. An order by the scene's coefficient would give too much weight to small misalignments of the
    pads.

    Args:
        world: ``scene`` in the solver's form.
        scene: scene at the start of the step.
        gripper: gripper in the solver's form.
        lost: (4, 4) hand poses, in the object's frame, of grasps that slipped. Similar grasps come last.
    """
    found = world.grasps(
        name,
        gripper,
        center_of_mass=scene.objects[name].center_of_mass,
        options={
            "friction": strategy.friction,
            "approach": strategy.approach,
            "up": np.linalg.inv(scene.T_world_base)[:3, 2],
            "tilt": (strategy.least_tilt, strategy.tilt),
        },
    )
    slips = (scene.grip_friction(name) or strategy.friction) < strategy.friction
    late = [
        (
            any(is_near(grasp.T_object_hand, each) for each in lost),
            margin_of(grasp, scene, name, strategy) < HELD,
            int(lever_of(grasp, scene.objects[name], profile) / LEVER_STEP) if slips else 0,
        )
        for grasp in found
    ]
    ranked = [grasp for _, grasp in sorted(zip(late, found, strict=True), key=lambda pair: pair[0])]
    return ranked[: strategy.candidates]


def margin_of(grasp: kpam.Grasp, scene: Scene, name: str, strategy: GraspStrategy) -> float:
    """Return the angle (rad) from a grasp's closing direction to the edge of the friction cone.

    The cone belongs to the smaller friction coefficient of strategy and scene.
    """
    friction = min(strategy.friction, scene.grip_friction(name) or strategy.friction)
    return grasp.quality["friction_margin"] - float(np.arctan(strategy.friction) - np.arctan(friction))


def lever_of(grasp: kpam.Grasp, thing: SceneObject, profile: RobotProfile) -> float:
    """Return the distance (m) of an object's centre of mass from the line through the pads; 0 if it is unknown."""
    if thing.center_of_mass is None:
        return 0.0
    center = np.linalg.solve(grasp.T_object_hand, np.append(thing.center_of_mass, 1.0))[:3]
    return float(np.linalg.norm((center - profile.tool_keypoints["tool_head"])[[0, 2]]))


def is_near(T_object_hand: Array, other: Array) -> bool:
    """Return whether two hand poses (4, 4) are the same grasp.

    Poses with swapped fingers also count as the same grasp.
    """
    from scipy.spatial.transform import Rotation  # imported here because checking arguments does not need SciPy

    turn = T_object_hand[:3, :3].T @ other[:3, :3]
    turned = min(Rotation.from_matrix(turn @ swap).magnitude() for swap in (np.eye(3), np.diag([-1.0, -1.0, 1.0])))
    apart = float(np.linalg.norm(T_object_hand[:3, 3] - other[:3, 3]))
    return apart < SAME_PLACE and turned < SAME_TURN


def grasp_config(
    scene: Scene,
    grasp: kpam.Grasp,
    profile: RobotProfile,
    strategy: GraspStrategy,
    swapped: bool,
    aside: str | None = None,
) -> tuple[dict[str, Array], kpam.SolverConfig]:
    """Return keypoints (3,) in the base frame, and the solver config that grasps the object and lifts it.

    Args:
        scene: scene at the start of the step.
        grasp: grasp to execute.
        swapped: whether the fingers are swapped.
        aside: element of ``ASIDE``, a horizontal motion before the lift; None: lift at once.
    """
    keypoints, constraints = hand_at(scene, grasp, profile, swapped)
    ups = max(1, round(strategy.lift / STRIDE))
    config = kpam.SolverConfig(
        {
            "constraint_list": constraints,
            "pre_actuation_motions": [["translate_z", -strategy.approach]],
            "post_actuation_motions": [*([] if aside is None else [aside]), *(["move-up"] * ups)],
            "gripper": "grasp",
        }
    )
    return keypoints, config


def hand_at(
    scene: Scene, grasp: kpam.Grasp, profile: RobotProfile, swapped: bool
) -> tuple[dict[str, Array], list[dict[str, Any]]]:
    """Return the keypoint (3,) of a grasp in the base frame, and the constraints that bring the hand to the grasp.

    Args:
        scene: scene at the start of the step.
        grasp: grasp to execute.
        swapped: whether the fingers are swapped.
    """
    T_base_hand = np.array(grasp.T_base_hand)
    if swapped:
        T_base_hand[:3, :2] *= -1.0
    tool = {name: T_base_hand[:3, :3] @ at + T_base_hand[:3, 3] for name, at in profile.tool_keypoints.items()}
    T_world_base = scene.T_world_base
    constraints: list[dict[str, Any]] = [
        {
            "type": "point2point_constraint",
            "keypoint_name": "tool_head",
            "target_keypoint_name": "grasp",
            "tolerance": AT,
        }
    ]
    for end in ("tool_tail", "tool_side"):
        axis = T_world_base[:3, :3] @ (tool[end] - tool["tool_head"])
        constraints.append(
            {
                "type": "frame_axis_parallel",
                "axis_from_keypoint_name": "tool_head",
                "axis_to_keypoint_name": end,
                "target_axis": list(axis / np.linalg.norm(axis)),
                "target_axis_frame": "world",
                "target_inner_product": 1.0,
                "tolerance": ALONG,
            }
        )
    return {"grasp": tool["tool_head"]}, constraints
