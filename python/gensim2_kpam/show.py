"""Show a scene and a motion in the browser: the collision shapes, the arm, and the path of the hand. The page needs the
package extra ``viz``.
"""

from __future__ import annotations

import importlib
import time
from typing import Any

import numpy as np
import numpy.typing as npt

from . import Motion, Plan, Robot, Scene, Trajectory

Array = npt.NDArray[np.float64]

#: RGB colours of the robot, of other bodies, and of held bodies.
ROBOT, STANDING, HELD = (190, 190, 200), (205, 170, 120), (120, 180, 120)
#: Seconds between frames of the animation, and between points of the drawn path.
STEP = 0.04
_PLAIN = " :.,;%()/?=+-'\""
"""Punctuation without a meaning inside a line of Markdown."""


class MissingViewerError(ImportError):
    """viser is not installed; the message names the extra that provides it."""


def show(
    scene: Scene,
    motion: Plan | Motion | Trajectory | None = None,
    *,
    q: npt.ArrayLike | None = None,
    host: str = "localhost",
    port: int = 8080,
) -> Any:
    """Serve a web page that shows a scene and an optional motion, and return immediately.

    Args:
        scene: robot and bodies.
        motion: plan, motion or trajectory; without a trajectory, the page shows the arm at ``q``.
        q: (n,) joints, rad or m; default: middle of the joint ranges.
        host: address to listen on.
        port: port of the page; if it is in use, the next free port.

    Returns:
        The ``viser.ViserServer``; its ``stop()`` ends the page.

    Raises:
        MissingViewerError: viser is not installed.
    """
    viser = _viser()
    robot: Robot = scene.robot
    trajectory = motion if isinstance(motion, Trajectory) or motion is None else motion.trajectory
    server = viser.ViserServer(host=host, port=port, verbose=False)
    server.scene.set_up_direction("+z")
    links = [
        (name, drawn)
        for name in robot.link_names
        if (drawn := _draw(server, f"/robot/{name}", robot.surface(name), ROBOT))
    ]
    held = []
    for body in scene.bodies:
        rides = body.role == "attached"
        drawn = _draw(server, f"/scene/{body.name}", body.surface(), HELD if rides else STANDING)
        for handle in drawn:
            _place(handle, body.pose)
        if rides:
            held.append((body.pose, drawn))

    def pose_at(joints: Array) -> None:
        for name, drawn in links:
            pose = robot.forward_kinematics(joints, link=name)
            for handle in drawn:
                _place(handle, pose)
        hand = robot.forward_kinematics(joints)
        for pose, drawn in held:
            for handle in drawn:
                _place(handle, hand @ pose)

    if not isinstance(motion, Trajectory) and motion is not None:
        add_text(server, f"{motion.status}: {motion.reason}")
    if trajectory is None:
        pose_at(_middle(robot) if q is None else np.asarray(q, dtype=np.float64))
        return server
    path = robot.forward_kinematics(trajectory.sample_every(STEP))[:, :3, 3]
    if len(path) > 1:
        segments = np.stack([path[:-1], path[1:]], axis=1).astype(np.float32)
        server.scene.add_line_segments("/path", segments, (40, 90, 220), thickness=0.003)
    add_clock(server, trajectory, pose_at)
    return server


def add_text(server: Any, *lines: str) -> Any:
    """Add lines of plain text to a page, and return the handle of the Markdown element."""
    return server.gui.add_markdown(plain_markdown(*lines))


def plain_markdown(*lines: str) -> str:
    """Return Markdown that shows lines of plain text unchanged.

    Untrusted text must be escaped, because viser executes HTML and expressions in Markdown, and opens the files to
    which image links refer.
    """
    return "\n\n".join(_plain_line(" ".join(line.split())) for line in lines)


def _plain_line(line: str) -> str:
    shown = "".join(c if c.isalnum() or c in _PLAIN else f"&#{ord(c) if c.isprintable() else 0xFFFD};" for c in line)
    starts_markup = line.startswith(("import", "export")) or not line[:1].isalpha()
    return f"&#{ord(line[0])};{shown[1:]}" if starts_markup and shown[:1] == line[:1] != "" else shown


def _viser() -> Any:
    try:
        return importlib.import_module("viser")
    except ImportError as error:
        install = 'pip install "gensim2-kpam[viz]" (or "gensim2[viz]")'
        raise MissingViewerError(f"the viewer needs the package viser; install it with {install}") from error


def _middle(robot: Robot) -> Array:
    low, high = np.maximum(robot.lower, -np.pi), np.minimum(robot.upper, np.pi)
    return np.asarray(0.5 * (low + high))


def _draw(server: Any, name: str, surface: tuple[Array, Array], color: tuple[int, int, int]) -> list[Any]:
    """Add triangles and spheres to the page as scene nodes below ``name``, and return the handles of the nodes."""
    triangles, balls = surface
    out = []
    if len(triangles):
        out.append(
            server.scene.add_mesh_simple(
                f"{name}/hulls",
                triangles.reshape(-1, 3).astype(np.float32),
                np.arange(3 * len(triangles), dtype=np.uint32).reshape(-1, 3),
                color=color,
                flat_shading=True,
            )
        )
    if len(balls):
        out.append(
            server.scene.add_point_cloud(
                f"{name}/balls",
                balls[:, :3].astype(np.float32),
                np.tile(np.array(color, dtype=np.uint8), (len(balls), 1)),
                point_size=float(2.0 * np.median(balls[:, 3])),
            )
        )
    return out


def _place(handle: Any, pose: Array) -> None:
    handle.position = pose[:3, 3]
    handle.wxyz = _quaternion(pose[:3, :3])


def _quaternion(turn: Array) -> Array:
    """Return the unit quaternion w, x, y, z of a rotation matrix (Shepperd's method)."""
    m = turn
    diagonal = np.array([m.trace(), m[0, 0], m[1, 1], m[2, 2]])
    k = int(diagonal.argmax())
    if k == 0:
        q = np.array([1.0 + m.trace(), m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]])
    else:
        i, j, o = (k - 1), k % 3, (k + 1) % 3
        q = np.empty(4)
        q[0] = m[o, j] - m[j, o]
        q[1 + i] = 1.0 + m[i, i] - m[j, j] - m[o, o]
        q[1 + j] = m[j, i] + m[i, j]
        q[1 + o] = m[o, i] + m[i, o]
    return np.asarray(q / np.linalg.norm(q))


def add_clock(server: Any, trajectory: Trajectory, pose_at: Any) -> None:
    """Add a slider that selects the time of the motion, and a button that plays the motion."""
    start, end = float(trajectory.times[0]), float(trajectory.times[-1])
    pose_at(trajectory.sample(start)[0])
    if end <= start:
        return
    slider = server.gui.add_slider("time [s]", min=start, max=end, step=STEP / 4, initial_value=start)

    def move(_: Any) -> None:
        pose_at(trajectory.sample(slider.value)[0])

    def play(_: Any) -> None:
        for t in np.append(np.arange(start, end, STEP), end):
            slider.value = float(t)
            time.sleep(STEP)

    slider.on_update(move)
    server.gui.add_button("play").on_click(play)
