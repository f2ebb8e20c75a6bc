"""Plan a motion from keypoint constraints, without a simulator: touch a point from above, then move 10 cm forward."""

import numpy as np

import gensim2_kpam as kpam
from gensim2.robots import robot

panda = robot("panda")

touch = {"type": "point2point_constraint", "keypoint_name": "tool_head", "target_keypoint_name": "button"}
upright = {"type": "frame_axis_parallel", "axis_from_keypoint_name": "tool_head", "axis_to_keypoint_name": "tool_tail"}
up = {"target_axis": [0, 0, 1], "target_axis_frame": "world", "target_inner_product": 1}
config = {
    "constraint_list": [{**touch, "tolerance": 0.001}, {**upright, **up, "tolerance": 0.01}],
    "pre_actuation_motions": [["translate_z", -0.1]],  # approach along the hand's z axis from 10 cm away
    "post_actuation_motions": ["move-forward"],
}
problem = kpam.KeypointProblem(
    panda.model,
    kpam.SolverConfig(config),
    np.array(panda.reset_qpos),
    tool_keypoints=panda.tool_keypoints,
    object_keypoints={"button": np.array([0.5, 0.1, 0.2])},  # metres, in the robot's base frame
    T_base_object=np.eye(4),
)
plan = kpam.plan(problem)
print("status:", plan.status, plan.reason)
for residual in plan.residuals:
    print(f"  {residual['name']}: {residual['residual']:.1e} of {residual['tolerance']:.0e}")
print(f"motion of {plan.trajectory.duration:.2f} s through", [frame["label"] for frame in plan.keyframes])
