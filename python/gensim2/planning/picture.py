"""Draw a planned step without a graphics driver: the scene, the arm, keypoints, keyframes and residuals."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

import gensim2_kpam as kpam
from gensim2.core.arrays import Array
from gensim2.objects.shapes import transform
from gensim2.perception.raycast.drawing import Drawing, fitting_distance
from gensim2.perception.raycast.kinematics import Tree, read_urdf
from gensim2.perception.raycast.shapes import Surface, read_links
from gensim2.planning.hulls import surface
from gensim2.planning.scene import Scene
from gensim2.planning.show import FIXTURE, MOVING, RIGID, STANDING
from gensim2.robots import RobotProfile

if TYPE_CHECKING:
    from PIL import Image


SIZE = 440
"""Width and height of each of the two views, pixels."""
MARGIN, LINE = 10, 17
"""Margin around the text and height of a text line, pixels."""
COLUMNS = 128
"""Maximum number of characters in a line of text."""
DIRECTIONS = ((-0.45, -1.0, 0.65), (-0.15, 1.0, 0.4))
"""Directions from the centre of each view to its camera, world frame: from the robot's right, and from its left."""
NEAREST = (1.5, 0.35)
"""Minimum distance from the centre of each view to its camera, m."""
EDGE = 1.25
"""Distance of the camera, relative to the smallest distance at which the view contains everything near the hand."""
KEYPOINT, TOOL, TARGET, INK, BAD = "#c2410c", "#00796b", "#a21caf", "#1c2430", "#c22525"
APART = 0.005
"""Distance (m) from every keypoint of the objects above which a target is marked by itself."""


def plan_picture(
    scene: Scene,
    plan: kpam.Plan | None,
    profile: RobotProfile,
    *,
    title: str,
    reason: str = "",
    targets: Sequence[Array] = (),
) -> Image.Image:
    """Draw the scene with the arm at the actuation pose, from two sides, and the residuals of the constraints.

    Both views contain the hand, the task's objects, keyframes and targets. If no pose is feasible, they show the arm in
    the pose with the smallest violation. Keypoints of the object are orange, keypoints of the tool green, and targets
    at other places purple. Keyframes that were not reached are small.

    Args:
        scene: scene in which the step was planned.
        plan: plan of the step. None draws the arm at its start, without keyframes.
        title: first line of text under both views.
        reason: reason why no motion was found.
        targets: (3,) targets of the point constraints, m, base frame.

    Raises:
        InputError: a file of the robot cannot be used.
        MissingExtraError: Embree is not installed.
    """
    from PIL import Image, ImageDraw, ImageFont

    q = scene.q
    if plan is not None:
        q = next((each for each in (plan.q_plan, plan.q_actuation, plan.q_best_effort) if each is not None), q)
    links = _robot(profile, q)
    solids = [*links.values(), *_bodies(scene)]
    tool = _tool(profile, q) if plan is not None else {}
    keypoints = {
        f"{name} {key.removeprefix('articulated_object_').removeprefix('rigidbody_object_')}": place
        for name, thing in scene.objects.items()
        for key, place in thing.keypoints.items()
    }
    places = list(keypoints.values())
    own = [at for at in targets if all(float(np.linalg.norm(at - place)) > APART for place in places)]
    aims = {f"target {number}" if len(own) > 1 else "target": at for number, at in enumerate(own, 1)}
    seen = [
        transform(body.T_base_body, hull)
        for thing in scene.objects.values()
        for body in thing.bodies
        for hull in body.hulls
    ]
    hand = [
        transform(links[name][1], links[name][0].vertices.astype(np.float64))
        for name in _hand(profile)
        if name in links
    ]
    frames = () if plan is None else plan.keyframes
    points = [*places, *tool.values(), *own, *(np.asarray(frame["T_base_hand"])[:3, 3] for frame in frames)]
    near = np.concatenate([*seen, *hand, np.array(points).reshape(-1, 3)])
    middle = (near.min(axis=0) + near.max(axis=0)) / 2
    turn = scene.T_world_base[:3, :3].T
    views = []
    for direction, nearest in zip(DIRECTIONS, NEAREST, strict=True):
        away = turn @ np.array(direction) / np.linalg.norm(direction)
        distance = max(nearest, EDGE * fitting_distance(near - middle, away))
        drawing = Drawing(solids, middle + distance * away, middle, SIZE)
        for frame in frames:
            drawing.frame(np.asarray(frame["T_base_hand"]), 0.05 if frame["reached"] else 0.03, _frame_label(frame))
        for named, color in ((keypoints, KEYPOINT), (tool, TOOL), (aims, TARGET)):
            for name, place in named.items():
                drawing.point(place, color, name)
        views.append(drawing.picture())
    lines = _lines(title, reason, plan)
    sheet = Image.new("RGB", (2 * SIZE + 4, SIZE + 2 * MARGIN + LINE * len(lines)), "#ffffff")
    for number, view in enumerate(views):
        sheet.paste(view, (number * (SIZE + 4), 0))
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(size=13)
    for number, (text, color) in enumerate(lines):
        draw.text((MARGIN, SIZE + MARGIN + LINE * number), text, fill=color, font=font)
    return sheet


def _frame_label(frame: kpam.Keyframe) -> str:
    return frame["label"] if frame["reached"] else f"{frame['label']} (not reached)"


def _lines(title: str, reason: str, plan: kpam.Plan | None) -> list[tuple[str, str]]:
    lines = [(text, INK) for text in textwrap.wrap(title, COLUMNS)]
    lines += [(text, INK) for text in textwrap.wrap(reason, COLUMNS)]
    for each in () if plan is None else plan.residuals:
        unit = "m" if each["name"].startswith("point2point") else "rad"
        told = f"residual {each['residual']:.4f} {unit} of {each['tolerance']:g} allowed: {each['name']}"
        lines += [(text, INK if each["satisfied"] else BAD) for text in textwrap.wrap(told, COLUMNS)]
    return lines


def _robot(profile: RobotProfile, q: Array) -> dict[str, tuple[Surface, Array]]:
    """Return the surface and the pose (4, 4) of each link that has a surface, by name."""
    tree = Tree.of(read_urdf(profile.urdf), profile.model.joint_names)
    surfaces = read_links(profile.urdf)
    poses = tree.poses(np.eye(4)[None], np.asarray(q, dtype=np.float64)[None])[0]
    found = {name: (surfaces.get(name), pose) for name, pose in zip(tree.names, poses, strict=True)}
    return {name: (surface, pose) for name, (surface, pose) in found.items() if surface is not None}


def _hand(profile: RobotProfile) -> set[str]:
    """Return the names of the hand link and of all links below it."""
    names = {profile.hand_link}
    joints = read_urdf(profile.urdf).joints
    while below := {joint.child for joint in joints if joint.parent in names} - names:
        names |= below
    return names


def _bodies(scene: Scene) -> list[tuple[Surface, Array]]:
    colors = {body.name: FIXTURE for body in scene.fixtures}
    for thing in scene.objects.values():
        moves = () if thing.joint is None else thing.joint.moves
        for body in thing.bodies:
            colors[body.name] = RIGID if thing.is_rigid else MOVING if body.name in moves else STANDING
    found = []
    for body in scene.bodies:
        corners, faces = surface(body.hulls)
        bare = Surface(corners, faces, np.zeros((len(faces), 3), np.uint8))
        found.append((bare.painted(colors[body.name]), body.T_base_body))
    return found


def _tool(profile: RobotProfile, q: Array) -> dict[str, Array]:
    T = profile.model.forward_kinematics(q)
    return {name: T[:3, :3] @ point + T[:3, 3] for name, point in profile.tool_keypoints.items()}
