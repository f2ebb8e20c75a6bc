"""Find grasps of a mug for the Panda, and a grasp with which the arm can also carry the mug to another place."""

import numpy as np

import gensim2_kpam as kpam
from gensim2.objects import open_library
from gensim2.robots import robot

panda = robot("panda")
gripper = kpam.ParallelGripper.of_robot(panda.model, **panda.tool_keypoints)
print(gripper)

mug = open_library("builtin").load_rigid("mug")


def mug_at(x: float, y: float, lifted: float = 0.0) -> np.ndarray:
    """Return T_base_object (4, 4) of the mug at rest on the table, or ``lifted`` metres above it."""
    pose = np.eye(4)
    pose[:3, :3] = mug.placement.rotation
    pose[:3, 3] = mug.placement.position + np.array([x, y, lifted])
    return pose


body = kpam.Body("mug", "target", [kpam.Shape.convex_hull(hull) for hull in mug.hulls["body"]], mug_at(0.5, -0.1))
T_base_table = np.eye(4)
T_base_table[:3, 3] = [0.615, 0.0, -0.025]
table = kpam.Body("table", "table", [kpam.Shape.box([0.65, 0.65, 0.025])], T_base_table)

scene = kpam.Scene(panda.model, [table, body])
grasps = scene.grasps("mug", gripper, center_of_mass=mug.center_of_mass)
print(f"{len(grasps)} grasps; the best:")
for grasp in grasps[:3]:
    quality = ", ".join(f"{name} {value:.3f}" for name, value in grasp.quality.items())
    print(f"  score {grasp.score:.2f}, {1e3 * grasp.width:.0f} mm wide: {quality}")

targets = [(mug_at(0.45, 0.2, lifted=0.005), [0, 0, 1])]  # any rotation about the vertical axis is accepted
found = scene.plan_grasp("mug", gripper, panda.reset_qpos, grasps, targets=targets)
if found is None:
    print("no grasp allows both the pick and the carry")
else:
    seconds = [plan.trajectory.duration for plan in (found.pick, *found.carries)]
    print(f"grasp {found.index} picks the mug in {seconds[0]:.1f} s and carries it in {seconds[1]:.1f} s")
