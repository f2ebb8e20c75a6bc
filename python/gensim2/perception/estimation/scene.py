"""Convert estimated objects to a scene for the planner. Boxes around the cloud's points on other bodies become
obstacles. The estimated joint limits are widened, so that an error of the estimate does not end a push too early.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from gensim2.core.arrays import Array
from gensim2.objects.types import joint_motion
from gensim2.perception.estimation.estimator import EDGES, LEVEL, ObjectEstimate, Points
from gensim2.planning.scene import JointState, Scene, SceneBody, SceneObject
from gensim2.planning.world import TABLE
from gensim2.robots import RobotProfile
from gensim2.scenes.table import HALF_SIZE, corners

CELL = 0.02
"""Side of the grid cells whose points are enclosed in one box, m."""
SKIN = 0.002
"""Margin of a box around its points, m."""
LEAST_IN_CELL = 2
"""Minimum number of points in a cell to get a box, because single points may be stray points."""
BORDER, LEAST_BESIDE = 0.03, 4
"""Distance (m) from the moving part within which a point of the fixed part needs this number of points of the fixed
part within ``CELL``, itself included. The network labels single points of the moving part as fixed."""
LEAST_HEIGHT = 0.03
"""Minimum height above the table (m) at which the hand pushes an object along the table."""
LEAST_DEPTH = 0.07
"""Minimum depth (m) below the highest point at which the hand pushes an object along the table, if half of the object
is not lower. Fingers that push near a rounded top slip over it."""
BEYOND = {"revolute": 0.2, "prismatic": 0.02}
"""Extension (rad or m) of the estimated joint limits, so that pushes do not stop short."""
LEVER = 0.05
"""Extension of the limits (m) of a vertical sliding part, such as a lever, whose range is short and uncertain."""
DEVIATIONS = 2.0
"""Extension of the limits in standard deviations of the joint value, if this is more than ``BEYOND``."""

_TABLE_HULLS = (corners(),)
_SIGNS = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).T.reshape(-1, 3)


def planning_scene(objects: Mapping[str, SceneObject], obstacles: Points, q: Array, profile: RobotProfile) -> Scene:
    """Return a scene of the planner with estimated objects on the table.

    Args:
        objects: articulated and rigid objects by name in the task.
        obstacles: (N, 3) points of other bodies, base frame, m.
        q: (n,) joint values of the robot.
        profile: robot profile.
    """
    table = np.eye(4)
    table[2, 3] = -HALF_SIZE[2]
    fixtures = [SceneBody(TABLE, _TABLE_HULLS, np.linalg.inv(profile.T_world_base) @ table)]
    hulls = boxes(obstacles)
    if hulls:
        fixtures.append(SceneBody("others", hulls, np.eye(4)))
    return Scene(
        q=q, qvel=np.zeros_like(q), T_world_base=profile.T_world_base, objects=dict(objects), fixtures=tuple(fixtures)
    )


def scene_object(name: str, found: ObjectEstimate, cloud: Points, floor: float | None = None) -> SceneObject:
    """Return an estimate as an object of the planner's scene.

    Args:
        name: name of the object in the task.
        found: estimated object.
        cloud: (N, 3) point cloud from which the object was estimated, base frame, m.
        floor: height of the floor of the moving part in the base frame, m. Cameras above an open drawer may not see its
            floor, and the planner would move the hand through it. None: the part has no floor.
    """
    bodies = []
    upright = np.asarray(Rotation.from_euler("z", found.yaw).as_matrix())
    turned = joint_motion(found.joint.type, found.joint.axis, found.joint.value)[:3, :3] @ upright
    fixed, moving = cloud[found.points[~found.moving]], cloud[found.points[found.moving]]
    for link, points, frame in (("base", _without_border(fixed, moving), upright), ("moving", moving, turned)):
        hulls = boxes(points, frame)
        if link == "moving" and hulls and floor is not None:
            hulls = (*hulls, _slab(moving, found.joint.axis, floor))
        if hulls:
            bodies.append(SceneBody(f"{name}/{link}", hulls, np.eye(4)))
    joint = found.joint
    beyond = max(BEYOND[joint.type], DEVIATIONS * joint.openness_deviation * (joint.upper - joint.lower))
    if joint.type == "prismatic" and abs(joint.axis[2]) > 1.0 - LEVEL and not found.moving.all():
        beyond = max(beyond, LEVER)
    return SceneObject(
        name=name,
        bodies=tuple(bodies),
        T_base_object=found.T_base_object,
        keypoints=dict(found.keypoints),
        joint=JointState(
            type=joint.type,
            origin=joint.origin,
            axis=joint.axis,
            value=joint.value,
            lower=joint.lower - beyond,
            upper=joint.upper + beyond,
            moves=tuple(body.name for body in bodies if body.name.endswith("/moving")),
        ),
        object_axis=found.object_axis,
        yaw=found.yaw,
    )


def at_push_height(found: ObjectEstimate, cloud: Points, profile: RobotProfile) -> ObjectEstimate:
    """Return an estimate of which the moving keypoints are at a height at which the hand can push them, if the joint
    slides horizontally. They are high enough above the table for the fingers, but not higher than the object. If the
    object moves as a whole, they are also far enough below its highest point.

    Args:
        found: estimated object.
        cloud: (N, 3) point cloud from which the object was estimated, base frame, m.
        profile: robot profile.
    """
    if found.joint.type != "prismatic" or abs(found.joint.axis[2]) > LEVEL:
        return found
    table = -float(profile.T_world_base[2, 3])
    top = float(cloud[found.points, 2].max())
    least, most = min(table + LEAST_HEIGHT, top), np.inf
    if found.moving.all():
        most = max(top - min(LEAST_DEPTH, 0.5 * (top - table)), least)
    keypoints = dict(found.keypoints)
    for name in found.moving_keypoints:
        keypoints[name] = np.append(keypoints[name][:2], np.clip(keypoints[name][2], least, most))
    return replace(found, keypoints=keypoints)


def _without_border(fixed: Points, moving: Points) -> Points:
    """Return the points (N, 3) of the fixed part without isolated points beside the moving part (M, 3)."""
    if not len(fixed) or not len(moving):
        return fixed
    near = np.flatnonzero(cKDTree(moving).query(fixed)[0] < BORDER)
    beside = cKDTree(fixed).query_ball_point(fixed[near], CELL, return_length=True)
    return np.delete(fixed, near[beside < LEAST_BESIDE], axis=0)


def _slab(points: Points, axis: Array, height: float) -> Array:
    """Return the corners (8, 3) of a horizontal slab that lies at ``height`` (m) under points (N, 3). Two of its sides
    are parallel to a horizontal axis (3,).
    """
    along = np.array([axis[0], axis[1], 0.0]) / np.hypot(axis[0], axis[1])
    frame = np.stack([along, np.array([-along[1], along[0], 0.0]), np.array([0.0, 0.0, 1.0])])
    local = points.astype(np.float64) @ frame.T
    low, high = np.quantile(local, EDGES, axis=0)
    low[2], high[2] = height - SKIN, height + SKIN
    return np.asarray(np.where(_SIGNS, high, low) @ frame)


def boxes(points: Points, frame: Array | None = None) -> tuple[Array, ...]:
    """Divide points among the cells of a grid, and return the corners (8, 3) of a box around the points of each cell.
    The planner uses the boxes as obstacles. Cells with fewer than ``LEAST_IN_CELL`` points get no box.

    Args:
        points: (N, 3) points, m.
        frame: (3, 3) rotation of the grid and the boxes. If the faces of a body are parallel to the grid, its boxes are
            thinner. None: the grid is parallel to the axes.
    """
    if not len(points):
        return ()
    if frame is not None:
        return tuple(each @ frame.T for each in boxes(np.asarray(points @ frame, dtype=np.float32)))
    cells, rows = np.unique(np.floor(points / CELL).astype(np.int64), axis=0, return_inverse=True)
    order = np.argsort(rows.reshape(-1), kind="stable")
    counts = np.bincount(rows.reshape(-1), minlength=len(cells))
    found = []
    for part in np.split(points[order].astype(np.float64), np.cumsum(counts)[:-1]):
        if len(part) >= LEAST_IN_CELL:
            low, high = part.min(axis=0) - SKIN, part.max(axis=0) + SKIN
            found.append(np.where(_SIGNS, high, low))
    return tuple(found)
