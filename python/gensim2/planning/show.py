"""A plan in the browser: the arm moving through its scene, the hand's path, keyframes and keypoints (extra ``viz``)."""

from __future__ import annotations

import importlib
import time
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh
from scipy.spatial.transform import Rotation

import gensim2_kpam as kpam
from gensim2.errors import MissingExtraError
from gensim2.planning.scene import Scene
from gensim2.robots import DEFAULT
from gensim2.robots import robot as robot_profile

Array = npt.NDArray[np.float64]

#: Colours by a body's role, RGB.
COLORS = {
    "table": (205, 190, 170),
    "object_body": (120, 150, 190),
    "moving_link": (230, 150, 60),
    "rigid": (120, 180, 120),
}
#: Seconds between two pictures while a motion plays, and between two points of the path that is drawn.
STEP = 0.04


def show(scene: Scene, plan: kpam.Plan, *, robot: str = DEFAULT, host: str = "localhost", port: int = 8080) -> Any:
    """Serve a page on which the plan can be watched; return at once.

    The page shows the arm at the slider's time, the scene's collision hulls, the hand's path, every keyframe (small
    where it is not reached) and the object's keypoints with their names. Without a motion the arm stands at its start.

    Args:
        scene: what was planned in.
        plan: what was found.
        robot: name of the profile that it was found for.
        host: address to listen on.
        port: of the page; the next free one is taken where it is in use.

    Returns:
        The ``viser.ViserServer``; ``stop()`` ends it.

    Raises:
        MissingExtraError: viser or yourdfpy is not installed.
    """
    viser, extras = _load("viser"), _load("viser.extras")
    profile = robot_profile(robot)
    model = _load("yourdfpy").URDF.load(str(profile.urdf))
    server = viser.ViserServer(host=host, port=port, verbose=False)
    server.scene.set_up_direction("+z")
    arm = extras.ViserUrdf(server, model, root_node_name="/arm")
    _draw_scene(server, scene)
    _draw_plan(server, plan, profile.model)
    places = [profile.model.joint_names.index(name) for name in arm.get_actuated_joint_names()]

    def pose_at(q: Array) -> None:
        arm.update_cfg(np.asarray(q)[places])

    trajectory = plan.trajectory
    server.gui.add_markdown(f"**{plan.status}**: {plan.reason}")
    pose_at(scene.q if trajectory is None else trajectory.positions[0])
    if trajectory is None:
        return server
    start, end = float(trajectory.times[0]), float(trajectory.times[-1])
    slider = server.gui.add_slider("time [s]", min=start, max=end, step=STEP / 4, initial_value=start)

    def move(_: Any) -> None:
        pose_at(trajectory.sample(slider.value)[0])

    def play(_: Any) -> None:
        for t in np.append(np.arange(start, end, STEP), end):
            slider.value = float(t)
            time.sleep(STEP)

    slider.on_update(move)
    server.gui.add_button("play").on_click(play)
    return server


def wait(server: Any) -> None:
    """Keep the page up until Ctrl-C."""
    try:
        server.sleep_forever()
    except KeyboardInterrupt:
        server.stop()


def _load(module: str) -> Any:
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise MissingExtraError(module, "viz") from error


def _draw_scene(server: Any, scene: Scene) -> None:
    for body in scene.bodies:
        parts = [trimesh.convex.convex_hull(hull) for hull in body.hulls]
        mesh = trimesh.util.concatenate(parts)
        mesh.apply_transform(body.T_base_body)
        server.scene.add_mesh_simple(
            f"/scene/{body.name}",
            np.asarray(mesh.vertices, dtype=np.float32),
            np.asarray(mesh.faces, dtype=np.uint32),
            color=COLORS[body.role],
            flat_shading=True,
        )
    for name, place in scene.object_keypoints.items():
        server.scene.add_icosphere(f"/keypoints/{name}", 0.008, color=(220, 40, 40), position=place)
        server.scene.add_label(f"/keypoints/{name}/label", name.removeprefix("articulated_object_"))


def _draw_plan(server: Any, plan: kpam.Plan, robot: kpam.Robot) -> None:
    for frame in plan.keyframes:
        pose = np.asarray(frame["T_base_hand"], dtype=np.float64)
        server.scene.add_frame(
            f"/keyframes/{frame['label']}",
            axes_length=0.06 if frame["reached"] else 0.03,
            axes_radius=0.003,
            wxyz=Rotation.from_matrix(pose[:3, :3]).as_quat(scalar_first=True),
            position=pose[:3, 3],
        )
        text = frame["label"] if frame["reached"] else f"{frame['label']} (not reached)"
        server.scene.add_label(f"/keyframes/{frame['label']}/label", text)
    if plan.trajectory is not None:
        path = robot.forward_kinematics(plan.trajectory.sample_every(STEP))[:, :3, 3]
        if len(path) > 1:
            server.scene.add_line_segments(
                "/path", np.stack([path[:-1], path[1:]], axis=1).astype(np.float32), (40, 90, 220), thickness=0.003
            )
