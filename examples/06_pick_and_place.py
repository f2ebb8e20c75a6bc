"""Plan to pick a cube, carry it over a wall and set it down, without a simulator."""

import numpy as np

import gensim2_kpam as kpam
from gensim2.robots import robot

panda = robot("panda")


def at(*xyz: float) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, 3] = xyz
    return pose


def reach(tool: str, target: str, post: list) -> kpam.SolverConfig:
    """Return a config that brings a tool keypoint to a target from 10 cm above, with the fingers pointing down."""
    axis = {"type": "frame_axis_parallel", "axis_from_keypoint_name": "tool_head", "target_axis_frame": "world"}
    axis |= {"target_inner_product": 1, "tolerance": 0.02}
    point = {"type": "point2point_constraint", "keypoint_name": tool, "target_keypoint_name": target}
    constraints = [
        {**point, "tolerance": 0.001},
        {**axis, "axis_to_keypoint_name": "tool_tail", "target_axis": [0, 0, 1]},
        {**axis, "axis_to_keypoint_name": "tool_side", "target_axis": [0, 1, 0]},
    ]
    motions = {"pre_actuation_motions": [["translate_z", -0.1]], "post_actuation_motions": post}
    return kpam.SolverConfig({"constraint_list": constraints, **motions})


block = [kpam.Shape.box([0.02, 0.02, 0.02])]
scene = kpam.Scene(
    panda.model,
    [
        kpam.Body("table", "table", [kpam.Shape.box([0.65, 0.65, 0.025])], at(0.615, 0, -0.0255)),
        kpam.Body("wall", "rigid", [kpam.Shape.box([0.1, 0.01, 0.06])], at(0.5, 0, 0.06)),
        kpam.Body("cube", "rigid", block, at(0.5, -0.15, 0.02), keypoints={"center": [0, 0, 0]}),
    ],
)
q = np.array(panda.reset_qpos)
pick = kpam.plan(
    scene.problem(
        reach("tool_head", "cube/center", ["move-up"]),
        q,
        tool_keypoints=panda.tool_keypoints,
        options={"pick": ["cube"]},  # the cube moves with the hand after the actuation pose
    )
)
held = scene.attached("cube", pick.q_plan)
place = kpam.plan(
    held.problem(
        reach("cube/center", "spot", ["move-up"]),  # keypoints of the grasped cube are tool keypoints
        pick.trajectory.positions[-1],
        tool_keypoints=panda.tool_keypoints,
        object_keypoints={"spot": [0.5, 0.15, 0.025]},
        options={"release": ["cube"]},
    )
)
print("pick:", pick.status, "place:", place.status)
print("the cube stands at", held.detached("cube", place.q_plan).bodies[2].pose[:3, 3].round(3))
