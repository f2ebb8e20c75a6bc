"""Find grasps of an object's moving link, and create the config that pulls the joint."""

from __future__ import annotations

import numpy as np

import gensim2_kpam as kpam
from gensim2.core.arrays import Array
from gensim2.planning.grasping import hand_at
from gensim2.planning.scene import JointState, Scene, SceneObject
from gensim2.planning.strategies import KeypointStrategy, PullStrategy
from gensim2.robots import RobotProfile

#: Minimum cosine between closing direction and joint motion at which a pad pulls by normal force.
PADS_PULL = 0.7

#: Number of surface points and number of hand poses to try. Both numbers are large, because few points lie on small
#: parts such as a knob, and many other grasps have a better rank.
SAMPLES, TRIALS = 2048, 400_000


def pulls_of(
    world: kpam.Scene, scene: Scene, thing: SceneObject, gripper: kpam.ParallelGripper, strategy: PullStrategy
) -> list[kpam.Grasp]:
    """Return grasps of an object's moving link, best first.

    Grasps that hook a pad behind the link come first. Within each group, grasps near the first keypoint come first.

    Args:
        world: ``scene`` in the solver's form.
        scene: scene at the start of the step.
        thing: articulated object.
        gripper: gripper in the solver's form.
    """
    assert thing.joint is not None
    bodies = {body.name: body for body in thing.bodies}
    options: kpam.GraspOptions = {
        "friction": strategy.friction,
        "approach": strategy.approach,
        "up": np.linalg.inv(scene.T_world_base)[:3, 2],
        "samples": SAMPLES,
        "per_part": True,
        "trials": TRIALS,
    }
    handle = next(iter(thing.points.values()))
    found: list[kpam.Grasp] = []
    for name in thing.joint.moves:
        in_body = np.linalg.solve(bodies[name].T_base_body, np.append(handle, 1.0))[:3]
        found += world.grasps(name, gripper, center_of_mass=in_body, options=options)
    joint = thing.joint
    ranked = sorted(found, key=lambda grasp: (not _pads_pull(grasp, joint, gripper), -grasp.score))
    return ranked[: strategy.candidates]


def _pads_pull(grasp: kpam.Grasp, joint: JointState, gripper: kpam.ParallelGripper) -> bool:
    T_base_grip = grasp.T_base_hand @ gripper.T_hand_grip
    way = np.asarray(joint.axis)
    if joint.type == "revolute":
        way = np.cross(way, T_base_grip[:3, 3] - joint.origin)
        length = np.linalg.norm(way)
        way = way / length if length > 0 else way
    return bool(abs(T_base_grip[:3, 0] @ way) > PADS_PULL)


def pull_config(
    scene: Scene, grasp: kpam.Grasp, profile: RobotProfile, strategy: PullStrategy, swapped: bool
) -> tuple[dict[str, Array], KeypointStrategy]:
    """Return keypoints (3,) in the base frame, and the solver config that grasps the link and moves the joint.

    Args:
        scene: scene at the start of the step.
        grasp: grasp to execute.
        swapped: whether the fingers are swapped.
    """
    keypoints, constraints = hand_at(scene, grasp, profile, swapped)
    config = {
        "constraint_list": constraints,
        "pre_actuation_motions": [["translate_z", -strategy.approach]],
        "post_actuation_motions": [["follow_joint_to", strategy.follow_joint_to]],
        "gripper": "grasp",
        "let_go": strategy.let_go,
        "opening": grasp.opening,
        "contact_speed": strategy.contact_speed,
    }
    return keypoints, KeypointStrategy(config)
