"""Grasps of a scene's rigid object, and the config that brings the hand to one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

import gensim2_kpam as kpam
from gensim2.planning.scene import Scene, SceneObject
from gensim2.planning.strategies import GraspStrategy
from gensim2.robots import RobotProfile

Array = npt.NDArray[np.float64]

#: Height (m) by which the config language's ``move-up`` raises the hand.
STRIDE = 0.06

#: Grasps that are compared, from the first that serves on: the one is taken with which the next step can be done by the
#: first of its strategies.
COMPARED = 6

#: Ways in which a thing is drawn out from under what bars its way up, and of how many grasps they are tried.
ASIDE = ("move-backward", "move-left", "move-right", "move-forward")
DRAWN_OUT = 8

#: Hand poses nearer to each other than this are the same grasp: m and rad.
SAME_PLACE, SAME_TURN = 0.015, 0.3

#: Margin (rad) within the friction cone from which on a grasp counts as one that holds.
HELD = 0.03

#: Metres of lever within which grasps of a thing that may slip keep their order.
LEVER_STEP = 0.005

#: How exactly the hand comes to a grasp: m and rad.
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
    """Grasps of a rigid object as it lies among all else, best first, of those that lean as far as is asked for.

    They are sought and ranked by the strategy's friction: by that of a slippery scene alone, what is a little askew
    would count for more than where the centre of mass lies. What the scene's own friction does not hold comes behind;
    and where that friction is less than the strategy's, those come first whose pads are nearest to the centre of mass,
    also along the fingers: what is carried turns any way round, and creeps about the line between the pads.

    Args:
        world: ``scene`` as the solver's own.
        profile: the robot.
        lost: (4, 4) hand poses in the object's frame from which it slipped before: what is near to one of them comes
            last.
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
    """Angle (rad) that is left to the edge of the friction cone of the scene; at most the strategy's."""
    friction = min(strategy.friction, scene.grip_friction(name) or strategy.friction)
    return grasp.quality["friction_margin"] - float(np.arctan(strategy.friction) - np.arctan(friction))


def lever_of(grasp: kpam.Grasp, thing: SceneObject, profile: RobotProfile) -> float:
    """Distance (m) of an object's centre of mass from the line between the pads; 0 where it is unknown."""
    if thing.center_of_mass is None:
        return 0.0
    center = np.linalg.solve(grasp.T_object_hand, np.append(thing.center_of_mass, 1.0))[:3]
    return float(np.linalg.norm((center - profile.tool_keypoints["tool_head"])[[0, 2]]))


def is_near(T_object_hand: Array, other: Array) -> bool:
    """Whether two hand poses (4, 4) are the same grasp, the fingers either way round."""
    from scipy.spatial.transform import Rotation  # here: refusing arguments needs none

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
    """The config that brings the hand to a grasp and lifts, and the (3,) keypoints that it names, in the base frame.

    Args:
        swapped: the fingers the other way round.
        aside: one of ``ASIDE``: how the hand moves before it lifts.
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
    """The (3,) keypoint of a grasp, in the base frame, and the constraints that bring the hand to it.

    Args:
        swapped: the fingers the other way round.
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
