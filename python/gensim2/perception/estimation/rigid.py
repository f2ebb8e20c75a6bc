"""Estimate rigid objects in a point cloud: divide the cloud into clusters, assign the clusters to the classes of a task
by their dimensions, and fit the shape of each class to its cluster.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import product

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares, linear_sum_assignment
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError, cKDTree
from scipy.spatial.transform import Rotation

from gensim2.core.arrays import Array
from gensim2.core.seeding import rng
from gensim2.objects import ObjectModel, RigidObject, open_library
from gensim2.objects.types import BODY
from gensim2.planning.hulls import surface
from gensim2.planning.scene import SceneBody, SceneObject

Indices = npt.NDArray[np.int64]

LINK = 0.02
"""Maximum distance (m) between two neighbouring points of a cluster."""
LEAST_IN_CLUSTER = 6
"""Minimum number of points of a cluster."""
TABLE = 0.03
"""Maximum height (m) of a cluster's lowest point above the table for an object that stands on the table."""
SAMPLES = 600
"""Number of points that represent the surface of a class's shape."""
SIZE_ERROR, SIZE_SPREAD = 0.008, 0.12
"""Standard deviation of an object's dimension: a constant error of the measurement (m), and the spread within the
class, as a fraction of the dimension.
"""
LYING = 2.0
"""Negative log likelihood of an object that does not stand in its usual pose."""
MAX_COST = 9.0
"""Maximum negative log likelihood of the dimensions of a cluster for an object of the class."""
SCALES = (0.8, 1.3)
"""Limits of the ratio of an object's dimension to the dimension of its class's shape."""
SCALE_ERROR = 0.06
"""Standard deviation of the ratio of the horizontal dimensions in a fit."""
FIT_ERROR = 0.004
"""Typical distance (m) of a cluster's points from the fitted shape."""
YAWS = 6
"""Number of initial yaw angles of a fit."""
CLOSER = (0.013, 0.01, 0.008)
"""An object in a body is searched for at these distances (m) between its points and the points of the body."""
LEAST_INSIDE = 20
"""Minimum number of points of an object in another body."""
MAX_COST_INSIDE, MAX_ERROR_INSIDE = 4.0, 0.0023
"""Maximum negative log likelihood of the dimensions, and maximum mean distance (m) from the fitted shape, of points in
another body that show an object.
"""
DEEP = 0.008
"""Depth (m) below the surface of a fitted shape at which there must be no points."""
PREFERRED = 0.9
"""Factor by which another initial yaw must reduce the cost of a fit, relative to the best one so far."""


@dataclass(frozen=True, eq=False)
class RigidShape:
    """Shape and physical constants of a class of rigid objects.

    Attributes:
        asset_class: name of the class.
        hulls: convex parts (N, 3) in the object frame, m.
        samples: (S, 3) points on the surface, in the object frame, m.
        keypoints: positions (3,) of the keypoints by name, in the object frame, m.
        center_of_mass: (3,) centre of mass in the object frame, m.
        mass: mass, kg.
        friction: friction coefficient of the surface.
        rotation: (3, 3) rotation from the object frame to the world in the usual pose on a table.
    """

    asset_class: str
    hulls: tuple[Array, ...]
    samples: Array
    keypoints: Mapping[str, Array]
    center_of_mass: Array
    mass: float
    friction: float
    rotation: Array

    @staticmethod
    def of(model: RigidObject) -> RigidShape:
        """Return the shape and the constants of a generated object."""
        hulls = model.hulls[BODY]
        vertices, faces = surface(hulls)
        corners = vertices[faces].astype(np.float64)
        sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        areas = np.linalg.norm(sides, axis=1)
        generator = rng(0, f"perception/rigid/{model.asset_class}")
        chosen = corners[generator.choice(len(faces), SAMPLES, p=areas / areas.sum())]
        u, v = generator.random((2, SAMPLES, 1))
        flip = u + v > 1.0
        u, v = np.where(flip, 1.0 - u, u), np.where(flip, 1.0 - v, v)
        return RigidShape(
            asset_class=model.asset_class,
            hulls=hulls,
            samples=chosen[:, 0] + u * (chosen[:, 1] - chosen[:, 0]) + v * (chosen[:, 2] - chosen[:, 0]),
            keypoints={name: np.asarray(each.position) for name, each in model.keypoints.items()},
            center_of_mass=model.center_of_mass,
            mass=model.mass,
            friction=model.friction,
            rotation=model.placement.rotation,
        )

    def rotations(self) -> list[Array]:
        """Return the rotations (3, 3) from the object frame to the world in which the object may stand, with a yaw of
        zero. The usual pose is the first; the others are turned about the world's x or y axis by quarter turns.
        """
        turns = [np.eye(3)] + [Rotation.from_euler(axis, 90 * n, degrees=True).as_matrix() for axis, n in _QUARTERS]
        return [turn @ self.rotation for turn in turns]


_QUARTERS = (("x", 1), ("x", 3), ("y", 1), ("y", 3), ("x", 2))


@cache
def shape_of(asset_class: str) -> RigidShape | None:
    """Return the shape of a class of rigid objects, from the generated object of this class; None if there is no
    generated rigid object of this class.
    """
    library = open_library("builtin")
    if asset_class not in library.classes("rigid"):
        return None
    model: ObjectModel = library.load(asset_class, "0")
    assert isinstance(model, RigidObject)
    return RigidShape.of(model)


@dataclass(frozen=True, eq=False)
class RigidEstimate:
    """Estimated rigid object.

    Attributes:
        shape: shape of the object's class.
        scale: (3,) ratios of the object's dimensions to the dimensions of the shape, along the axes of the object
            frame.
        T_world_object: (4, 4) object frame in the world.
        yaw: rotation about the vertical from the usual pose, rad.
        error: mean distance of the cloud's points from the fitted surface, m.
    """

    shape: RigidShape
    scale: Array
    T_world_object: Array
    yaw: float
    error: float

    @property
    def samples(self) -> Array:
        """Points (S, 3) on the surface, in the world frame, m."""
        return self.in_world(self.shape.samples)

    @property
    def bounds(self) -> Array:
        """Lowest and highest corner (2, 3) of the bounding box in the world frame, m."""
        points = self.in_world(np.concatenate(self.shape.hulls))
        return np.stack([points.min(axis=0), points.max(axis=0)])

    @property
    def size(self) -> Array:
        """Dimensions (3,) along the axes of the object frame, m."""
        return np.asarray(np.ptp(np.concatenate(self.shape.hulls), axis=0) * self.scale)

    @property
    def keypoints(self) -> dict[str, Array]:
        """Positions (3,) of the keypoints by name, in the world frame, m."""
        return {name: self.in_world(at) for name, at in self.shape.keypoints.items()}

    @property
    def center(self) -> Array:
        """Centre of mass (3,) in the world frame, m."""
        return self.in_world(self.shape.center_of_mass)

    @property
    def pose(self) -> Array:
        """Pose (7,) in the world frame: x, y, z (m), qw, qx, qy, qz."""
        rotation = Rotation.from_matrix(self.T_world_object[:3, :3])
        return np.concatenate([self.T_world_object[:3, 3], rotation.as_quat(scalar_first=True)])

    def in_world(self, points: Array) -> Array:
        """Transform points (..., 3) of the shape to the world frame."""
        return np.asarray(points * self.scale @ self.T_world_object[:3, :3].T + self.T_world_object[:3, 3])

    def at(self, T_world_object: Array) -> RigidEstimate:
        """Return the estimate with another pose (4, 4) in the world."""
        return replace(self, T_world_object=T_world_object)

    def moved(self, by: Array) -> RigidEstimate:
        """Return the estimate after a displacement (3,) in the world, m."""
        T = self.T_world_object.copy()
        T[:3, 3] += by
        return self.at(T)

    def scene_object(self, name: str, T_base_world: Array) -> SceneObject:
        """Return the estimate as an object of the planner's scene.

        Args:
            name: name of the object in the task.
            T_base_world: (4, 4) world frame in the robot's base frame.
        """
        pose = T_base_world @ self.T_world_object
        points = {key: at * self.scale for key, at in self.shape.keypoints.items()}
        return SceneObject(
            name=name,
            bodies=(SceneBody(name, tuple(hull * self.scale for hull in self.shape.hulls), pose),),
            T_base_object=pose,
            keypoints={key: pose[:3, :3] @ at + pose[:3, 3] for key, at in points.items()},
            yaw=self.yaw,
            center_of_mass=self.shape.center_of_mass * self.scale,
            mass=self.shape.mass * float(np.prod(self.scale)),
            friction=self.shape.friction,
        )


def clusters(points: Array, link: float = LINK) -> list[Indices]:
    """Divide points (N, 3) into clusters, and return the row indices of each cluster, the largest cluster first.

    Two points belong to the same cluster if a chain of points with distances of at most ``link`` (m) connects them.
    Clusters with fewer than ``LEAST_IN_CLUSTER`` points are left out.
    """
    if len(points) < LEAST_IN_CLUSTER:
        return []
    pairs = cKDTree(points).query_pairs(link, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(points), len(points)))
    count, labels = connected_components(graph, directed=False)
    found = [np.flatnonzero(labels == number) for number in range(count)]
    return sorted((rows for rows in found if len(rows) >= LEAST_IN_CLUSTER), key=lambda rows: (-len(rows), rows[0]))


def rectangle(points: Array) -> tuple[float, float]:
    """Return the length and the width (m) of the smallest rectangle around points (N, 2). A side of the rectangle is
    parallel to a side of the points' convex hull.
    """
    try:
        corners = points[ConvexHull(points).vertices]
    except QhullError:  # All points lie on a line.
        return float(np.linalg.norm(np.ptp(points, axis=0))), 0.0
    sides = np.roll(corners, -1, axis=0) - corners
    angles = np.arctan2(sides[:, 1], sides[:, 0])
    extents = [np.ptp(corners @ np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]), axis=0) for a in angles]
    best = min(extents, key=np.prod)
    return float(max(best)), float(min(best))


def cost(shape: RigidShape, points: Array) -> tuple[float, int]:
    """Return the negative log likelihood that points show an object of a class, judged by their dimensions alone, and
    the most likely pose, as an index of :meth:`RigidShape.rotations`.

    Args:
        shape: shape of the class.
        points: (N, 3) points in the world frame, m.
    """
    length, width = rectangle(points[:, :2])
    low, high = float(points[:, 2].min()), float(points[:, 2].max())
    height = high if low < TABLE else high - low
    seen = np.array([length, width, height])
    costs = []
    for number, rotation in enumerate(shape.rotations()):
        placed = shape.samples @ rotation.T
        size = np.array([*rectangle(placed[:, :2]), np.ptp(placed[:, 2])])
        doubt = SIZE_ERROR + SIZE_SPREAD * size
        costs.append((0.5 * float((((seen - size) / doubt) ** 2).sum()) + LYING * (number > 0), number))
    return min(costs)


def fitted(shape: RigidShape, points: Array, number: int = 0) -> RigidEstimate:
    """Fit the shape of a class to points: its position, its yaw and its dimensions.

    If the points reach down to the table, the highest point gives the height of the object. Otherwise the height is
    that of the shape. The horizontal position, the yaw and the horizontal scale minimize the distances of the points
    from the surface.

    Args:
        shape: shape of the class.
        points: (N, 3) points of one object in the world frame, m.
        number: index of the pose in :meth:`RigidShape.rotations`.
    """
    rotation = shape.rotations()[number]
    placed = shape.samples @ rotation.T
    center, height = 0.5 * (placed.min(axis=0) + placed.max(axis=0)), float(np.ptp(placed[:, 2]))
    placed = placed - center
    low, high = points[:, 2].min(), points[:, 2].max()
    up = float(np.clip(high / height, *SCALES)) if low < TABLE else 1.0
    middle = np.array([*(0.5 * (points[:, :2].min(axis=0) + points[:, :2].max(axis=0))), high - 0.5 * up * height])
    stretched = placed * np.array([1.0, 1.0, up])
    tree = cKDTree(stretched)

    def errors(values: Array) -> Array:
        x, y, angle, scale = values
        local = points - middle - np.array([x, y, 0.0])
        c, s = np.cos(angle), np.sin(angle)
        local = np.column_stack([c * local[:, 0] + s * local[:, 1], c * local[:, 1] - s * local[:, 0], local[:, 2]])
        local[:, :2] /= scale
        distances = tree.query(local)[0] / FIT_ERROR
        weight = np.sqrt(len(points) / 40.0)
        return np.append(distances, weight * (scale - 1.0) / SCALE_ERROR)

    best: tuple[float, Array] | None = None
    for start in np.linspace(0.0, 2.0 * np.pi, YAWS, endpoint=False).tolist():
        bounds = ([-0.1, -0.1, -10.0, SCALES[0]], [0.1, 0.1, 10.0, SCALES[1]])
        found = least_squares(
            errors,
            [0.0, 0.0, start, 1.0],
            bounds=bounds,
            loss="soft_l1",
            diff_step=1e-3,
            x_scale=[0.005, 0.005, 0.2, 0.05],
            max_nfev=25,
        )
        if best is None or found.cost < PREFERRED * best[0]:
            best = found.cost, found.x
    assert best is not None
    x, y, angle, scale = best[1]
    angle = float((angle + np.pi) % (2.0 * np.pi) - np.pi)
    # The scale along an axis of the object frame is a mean of the scales along the world's axes.
    along = (rotation.T**2) @ np.array([scale, scale, up])
    turn = np.asarray(Rotation.from_euler("z", angle).as_matrix()) @ rotation
    T = np.eye(4)
    T[:3, :3] = turn
    T[:3, 3] = middle + np.array([x, y, 0.0]) - turn @ (rotation.T @ center * along)
    found = RigidEstimate(shape, along, T, angle, 0.0)
    return replace(found, error=distance(found, points))


def found_inside(shape: RigidShape, points: Array) -> tuple[RigidEstimate, Indices] | None:
    """Seek an object in the points of a body that contains it, such as an open box.

    The object touches the body, so their points form one cluster. But most of its points are farther from the body than
    from each other. Therefore clusters with shorter distances are compared with the dimensions and the shape of the
    class. There must be no points inside the fitted shape.

    Args:
        shape: shape of the class.
        points: (N, 3) points of the body and of the object in the world frame, m.

    Returns:
        The fitted object and the row indices of its points; None if no cluster fits.
    """
    found: list[tuple[float, RigidEstimate, Indices]] = []
    for link in CLOSER:
        for rows in clusters(points, link):
            if len(rows) < LEAST_INSIDE:
                break
            value, number = cost(shape, points[rows])
            if value <= MAX_COST_INSIDE:
                fit = fitted(shape, points[rows], number)
                if fit.error <= MAX_ERROR_INSIDE and not _is_filled(fit, points):
                    found.append((value, fit, rows))
    return min(found, key=lambda each: each[0])[1:] if found else None


def _is_filled(found: RigidEstimate, points: Array) -> bool:
    """Return whether a point (N, 3) lies deep inside an estimated object."""
    for hull in found.shape.hulls:
        planes = ConvexHull(found.in_world(hull)).equations
        if ((points @ planes[:, :3].T + planes[:, 3]).max(axis=1) < -DEEP).any():
            return True
    return False


def distance(found: RigidEstimate, points: Array) -> float:
    """Return the mean distance (m) of points (N, 3) in the world frame from an estimated surface."""
    return float(cKDTree(found.samples).query(points)[0].mean())


def assigned(
    shapes: Mapping[str, RigidShape],
    candidates: Sequence[Array],
    penalties: Sequence[float],
    overlapping: Sequence[tuple[int, int]] = (),
) -> dict[str, tuple[int, int]]:
    """Assign clusters to the rigid objects of a task, so that the sum of the costs is minimal.

    Args:
        shapes: shapes of the objects' classes, by name of the object.
        candidates: points (N, 3) of each cluster in the world frame, m.
        penalties: additional cost of each cluster.
        overlapping: indices of two clusters that contain the same points. Only one of the two can show an object, so
            the cluster with the higher cost is left out.

    Returns:
        Index of the cluster, and of its pose in :meth:`RigidShape.rotations`, by name of the object. Objects without a
        cluster of their size are missing.
    """
    names = list(shapes)
    if not names or not candidates:
        return {}
    known = [[cost(shapes[name], points) for points in candidates] for name in names]
    # A dummy column for each object stands for "not seen".
    costs = np.full((len(names), len(candidates) + len(names)), MAX_COST)
    for row, column in product(range(len(names)), range(len(candidates))):
        costs[row, column] = min(known[row][column][0] + penalties[column], MAX_COST + 1.0)
    while True:
        rows, columns = linear_sum_assignment(costs)
        spent = {int(column): float(costs[row, column]) for row, column in zip(rows, columns, strict=True)}
        both = next((pair for pair in overlapping if spent.keys() >= set(pair)), None)
        if both is None:
            break
        costs[:, max(both, key=spent.__getitem__)] = MAX_COST + 1.0
    return {
        names[row]: (int(column), known[row][column][1])
        for row, column in zip(rows, columns, strict=True)
        if column < len(candidates)
    }
