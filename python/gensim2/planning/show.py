"""Show a plan in the browser: arm, scene, hand path, keyframes and keypoints (extra ``viz``)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import gensim2_kpam as kpam
from gensim2.core.arrays import Array
from gensim2.core.errors import required
from gensim2.planning.hulls import surface
from gensim2.planning.scene import Scene, SceneBody
from gensim2.robots import RobotProfile
from gensim2_kpam.show import STEP, add_clock, add_text

APART = 0.06
"""Minimum distance between two labels, m; closer labels are merged."""
#: RGB colours of fixtures, of the fixed and the moving parts of articulated objects, and of rigid objects.
FIXTURE, STANDING, MOVING, RIGID = (205, 190, 170), (120, 150, 190), (230, 150, 60), (120, 180, 120)


def show(scene: Scene, plan: kpam.Plan, profile: RobotProfile, *, host: str = "localhost", port: int = 8080) -> Any:
    """Serve a web page that animates the plan, and return at once.

    The page shows the arm at the time of the slider, hulls, the path of the hand, keypoints and keyframes. Keyframes
    that were not reached are small. A grasped object moves along. Without a motion, the arm is at its start.

    Args:
        scene: planned scene.
        host: address to listen on.
        port: port of the page; if this port is in use, the next free port.

    Returns:
        The ``viser.ViserServer``; its ``stop()`` ends the page.

    Raises:
        MissingExtraError: viser or yourdfpy is not installed.
    """
    model = required("yourdfpy", "viz").URDF.load(str(profile.urdf))
    server = open_page(host, port, (1.5, -1.0, 0.9), (0.4, 0.0, 0.2), f"{plan.status}: {plan.reason}")
    arm = required("viser.extras", "viz").ViserUrdf(server, model, root_node_name="/arm")
    riding = _draw_scene(server, scene)
    draw_plans(server, {"plan": plan}, profile)
    robot = profile.model
    places = [robot.joint_names.index(name) for name in arm.get_actuated_joint_names()]
    T_hand_held: Array = np.eye(4)
    if riding is not None and scene.held is not None:
        T_base_held = scene.objects[scene.held].T_base_object
        T_hand_held = np.linalg.inv(robot.forward_kinematics(scene.q)) @ T_base_held

    def pose_at(q: Array) -> None:
        arm.update_cfg(np.asarray(q)[places])
        if riding is not None:
            pose = robot.forward_kinematics(q) @ T_hand_held
            riding.position, riding.wxyz = pose[:3, 3], quaternion(pose)

    trajectory = plan.trajectory
    if trajectory is None:
        pose_at(scene.q)
        return server
    add_clock(server, trajectory, pose_at)
    return server


def open_page(host: str, port: int, eye: Sequence[float], target: Sequence[float], title: str) -> Any:
    """Serve a page with a title, seen from ``eye`` towards ``target`` (3,), m, and return its ``viser.ViserServer``.

    Raises:
        MissingExtraError: viser is not installed.
    """
    server = required("viser", "viz").ViserServer(host=host, port=port, verbose=False)
    server.scene.set_up_direction("+z")
    server.initial_camera.position, server.initial_camera.look_at = eye, target
    add_text(server, title)
    return server


def wait(server: Any) -> None:
    """Keep serving the page until the user presses Ctrl-C."""
    try:
        server.sleep_forever()
    except KeyboardInterrupt:
        server.stop()


def quaternion(pose: Array) -> Array:
    """Return the rotation (w, x, y, z) of a pose (4, 4), as viser takes it."""
    return np.asarray(Rotation.from_matrix(pose[:3, :3]).as_quat(scalar_first=True))


def _draw_body(server: Any, body: SceneBody, color: tuple[int, int, int]) -> Any:
    vertices, faces = surface(body.hulls)
    return server.scene.add_mesh_simple(
        f"/scene/{body.name}",
        vertices,
        faces.astype(np.uint32),
        color=color,
        flat_shading=True,
        position=body.T_base_body[:3, 3],
        wxyz=quaternion(body.T_base_body),
    )


def _draw_scene(server: Any, scene: Scene) -> Any:
    """Draw the scene, and return the drawn shape of the grasped object; None if no object is grasped."""
    riding, labels = None, []
    for body in scene.fixtures:
        _draw_body(server, body, FIXTURE)
    for name, thing in scene.objects.items():
        moves = () if thing.joint is None else thing.joint.moves
        for body in thing.bodies:
            color = RIGID if thing.is_rigid else MOVING if body.name in moves else STANDING
            drawn = _draw_body(server, body, color)
            riding = drawn if name == scene.held else riding
        for key, place in thing.keypoints.items():
            label = key.removeprefix("articulated_object_").removeprefix("rigidbody_object_")
            server.scene.add_icosphere(f"/keypoints/{name}/{key}", 0.008, color=(220, 40, 40), position=place)
            labels.append((f"{name} {label}", np.asarray(place)))
    _add_labels(server, "/keypoints/labels", labels, anchor="top-left")
    return riding


def draw_plans(server: Any, plans: Mapping[str, kpam.Plan], profile: RobotProfile) -> None:
    """Draw the labelled keyframes and the hand paths of plans; a keyframe that is not reached is drawn small.

    Args:
        server: a ``viser.ViserServer``.
        plans: plans in the base frame by name. If there are several, labels begin with the first word of the name.
    """
    labels = []
    for name, plan in plans.items():
        part = f"/plan/{name.replace(' ', '_')}"
        for frame in plan.keyframes:
            pose = np.asarray(frame["T_base_hand"], dtype=np.float64)
            server.scene.add_frame(
                f"{part}/keyframes/{frame['label']}",
                axes_length=0.06 if frame["reached"] else 0.03,
                axes_radius=0.003,
                wxyz=quaternion(pose),
                position=pose[:3, 3],
            )
            text = frame["label"] if frame["reached"] else f"{frame['label']} (not reached)"
            labels.append((f"{name.partition(' ')[0]}: {text}" if len(plans) > 1 else text, pose[:3, 3]))
        if plan.trajectory is not None:
            path = profile.model.forward_kinematics(plan.trajectory.sample_every(STEP))[:, :3, 3]
            if len(path) > 1:
                server.scene.add_line_segments(
                    f"{part}/path",
                    np.stack([path[:-1], path[1:]], axis=1).astype(np.float32),
                    (40, 90, 220),
                    thickness=0.003,
                )
    _add_labels(server, "/plan/labels", labels, anchor="bottom-right")


def _add_labels(server: Any, name: str, labels: Sequence[tuple[str, Array]], *, anchor: str) -> None:
    """Add text labels whose corner ``anchor`` is at the labelled point. Labels closer than ``APART`` are merged.

    Keypoints and keyframes have opposite anchors, so that no label covers a label of the other kind.
    """
    groups: list[tuple[list[str], Array]] = []
    for text, place in labels:
        near = next((texts for texts, first in groups if np.linalg.norm(first - place) < APART), None)
        if near is None:
            groups.append(([text], place))
        else:
            near.append(text)
    for number, (texts, place) in enumerate(groups):
        server.scene.add_label(f"{name}/{number}", ", ".join(texts), position=place, anchor=anchor)
