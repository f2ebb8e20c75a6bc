"""Generate labelled point clouds of randomly placed objects by ray casting."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from gensim2.core.arrays import Array
from gensim2.core.seeding import rng
from gensim2.objects import ArticulatedObject, Library, ObjectModel
from gensim2.perception.camera import View, observation_cameras
from gensim2.perception.cloud import CloudSettings, EmptyCloudError, PointCloud, point_cloud, to_steps
from gensim2.perception.estimation.classes import SLOTS, direction_of
from gensim2.perception.estimation.network import OTHER, STRAY, TARGET
from gensim2.perception.noise import DEPLOYED, DepthNoise
from gensim2.perception.raycast.scene import RaycastScene
from gensim2.robots import RobotProfile, robot
from gensim2.scenes.footprint import keypoint_in_root, swept_points
from gensim2.scenes.initial_state import PlacedObject
from gensim2.scenes.randomize import placed

Example = dict[str, npt.NDArray[Any]]

SETTINGS = CloudSettings(robot="none", low=(0.15, -0.62, 0.015), outliers=1.5)
"""Settings of the estimator's point clouds: the robot and most stray points of depth cameras are removed."""

STRAY_DISTANCE = 0.012
"""Distance (m) from the nearest surface beyond which a point is labelled as a stray point."""

SPREAD, MOST_YAW = 0.15, 0.8
"""Maximum offset of objects from their default placement: along x and y (m), and yaw (rad)."""
AT_AN_END = 0.15
"""Fraction of the clouds in which the joint is fully closed, and fraction in which it is fully open."""
NOISY = 0.5
"""Fraction of the training clouds that have the noise of a deployed camera."""
REACHING = 0.5
"""Fraction of the clouds in which the hand is near the first keypoint instead of at rest."""
ACCOMPANIED = 0.25
"""Fraction of the training clouds with an additional rigid object."""
TARGET_NAME, OTHER_NAME = "object", "other"


@dataclass(frozen=True)
class LabelledCloud:
    """A point cloud with labels.

    Attributes:
        cloud: point cloud from all cameras.
        group: (N,) group of each point: ``STRAY``, ``OTHER`` or ``TARGET``.
        moving: (N,) whether each point lies on the moving link of the articulated object.
        placed: placed articulated object.
    """

    cloud: PointCloud
    group: npt.NDArray[np.uint8]
    moving: npt.NDArray[np.bool_]
    placed: PlacedObject


class Cameras:
    """Fixed cameras that observe one articulated object, optionally with a rigid object beside it.

    Args:
        profile: robot profile.
        model: articulated object.
        other: rigid object, or None.
    """

    def __init__(self, profile: RobotProfile, model: ArticulatedObject, other: ObjectModel | None = None) -> None:
        self._profile, self._model, self._other = profile, model, other
        objects: dict[str, ObjectModel] = {TARGET_NAME: model} | ({} if other is None else {OTHER_NAME: other})
        self._scene = RaycastScene(profile, objects, observation_cameras(profile))
        tree = self._scene.tree(TARGET_NAME)
        moving = [name for name, still in zip(tree.names, tree.still, strict=True) if not still]
        self._moving = set(self._scene.ids(TARGET_NAME, moving))
        self._target = set(self._scene.ids(TARGET_NAME))
        self._things = self._target | set(self._scene.ids(OTHER_NAME))

    def look(
        self, placed: PlacedObject, q: Array, noise: DepthNoise | None, generator: np.random.Generator
    ) -> LabelledCloud | None:
        """Return a labelled cloud; None if the articulated object is hidden or outside the workspace.

        Args:
            placed: articulated object with its placement.
            q: (n,) joint values of the robot.
            noise: camera noise, whose calibration errors are drawn once for the cloud; None: exact images.
            generator: random generator.
        """
        views = self._scene.see(self._scene.poses(self._states(placed, q, generator))[0])
        points, ids = _surface(views, self._things)
        if not len(points):
            return None
        seen = views if noise is None else tuple(_noisy(views, noise, generator))
        try:
            cloud = point_cloud(seen, SETTINGS, self._scene.robot)
        except EmptyCloudError:
            return None
        distance, nearest = cKDTree(points).query(cloud.xyz)
        owner = ids[nearest]
        target = np.isin(owner, list(self._target))
        group = np.where(distance > STRAY_DISTANCE, STRAY, np.where(target, TARGET, OTHER)).astype(np.uint8)
        if (group == TARGET).sum() < 32:
            return None
        return LabelledCloud(cloud, group, np.isin(owner, list(self._moving)), placed)

    def _states(self, placed: PlacedObject, q: Array, generator: np.random.Generator) -> dict[str, Any]:
        arm = np.zeros((1, 13 + 2 * len(q)), dtype=np.float32)
        base = self._profile.T_world_base
        arm[0, :3] = base[:3, 3]
        arm[0, 3:7] = Rotation.from_matrix(base[:3, :3]).as_quat(scalar_first=True)
        arm[0, 13 : 13 + len(q)] = q
        row = np.zeros((1, 15), dtype=np.float32)
        row[0, :3], row[0, 3:7], row[0, 13] = placed.position, placed.quaternion, placed.joint_value
        states: dict[str, Any] = {"articulations": {self._profile.agent: arm, TARGET_NAME: row}, "actors": {}}
        if self._other is not None:
            states["actors"][OTHER_NAME] = _beside(self._other, placed, generator)
        return states


def _beside(other: ObjectModel, target: PlacedObject, generator: np.random.Generator) -> npt.NDArray[np.float32]:
    """Return a random state (1, 13) of a rigid object on the table, outside the space through which the articulated
    object moves.
    """
    swept = target.in_world(swept_points(target.model))
    radius = float(np.linalg.norm(swept[:, :2] - swept[:, :2].mean(0), axis=1).max()) + 0.08
    angle = generator.uniform(0.25 * np.pi, 0.75 * np.pi) * generator.choice([-1.0, 1.0])
    at = swept[:, :2].mean(0) + radius * np.array([-np.cos(angle), np.sin(angle)])
    position, quaternion = placed(
        other.placement.position, other.placement.quaternion, 0.0, 0.0, float(generator.uniform(-np.pi, np.pi))
    )
    row = np.zeros((1, 13), dtype=np.float32)
    row[0, :2], row[0, 2], row[0, 3:7] = at, position[2], quaternion
    return row


def _surface(views: Sequence[View], ids: set[int]) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int16]]:
    """Return the points (M, 3), m in the base frame, of all pixels whose segmentation id is in ``ids``, and the
    segmentation ids (M,) of these pixels.
    """
    points, found = [], []
    for view in views:
        segmentation = view.segmentation
        assert segmentation is not None
        shown = np.isin(segmentation, list(ids)) & (view.depth > 0)
        points.append(view.camera.position + view.depth[shown][:, None] * view.camera.rays[shown])
        found.append(segmentation[shown])
    return np.concatenate(points), np.concatenate(found)


def _noisy(views: Sequence[Any], noise: DepthNoise, generator: np.random.Generator) -> Iterator[View]:
    """Yield depth images with noise and with the random calibration errors of one episode."""
    drawn = noise.drawn(generator)
    for view in views:
        error = noise.error(generator)
        depth = error.on(drawn.on(view.depth, generator, None, float(view.camera.intrinsic[1, 1])))
        yield view.measured(replace(view.camera, T_base_camera=view.camera.T_base_camera @ error.T), depth)


def object_looks(
    library: Library,
    profile: RobotProfile,
    asset_class: str,
    instance: str,
    count: int,
    generator: np.random.Generator,
    *,
    noisy: float = NOISY,
    accompanied: float = ACCOMPANIED,
) -> Iterator[LabelledCloud]:
    """Yield up to ``count`` labelled clouds of one object; clouds that do not show the object are left out.

    Args:
        library: library that contains the object.
        profile: robot profile.
        asset_class, instance: class and id of the object.
        count: number of random scenes.
        generator: random generator.
        noisy: fraction of the clouds with the depth noise of a real camera (``--noise deployed``).
        accompanied: fraction of the clouds with an additional rigid object.
    """
    model = library.load(asset_class, instance, "default")
    assert isinstance(model, ArticulatedObject)
    rigid = [name for name in library.classes() if library.kind(name) == "rigid"]
    other = library.load(rigid[int(generator.integers(len(rigid)))], "0", "default")
    alone, together = Cameras(profile, model), Cameras(profile, model, other)
    for _ in range(count):
        cameras = together if generator.random() < accompanied else alone
        thing = _put(model, generator)
        q = _posture(profile, thing, generator)
        found = cameras.look(thing, q, DEPLOYED if generator.random() < noisy else None, generator)
        if found is not None:
            yield found


def _put(model: ArticulatedObject, generator: np.random.Generator) -> PlacedObject:
    """Place an object at random, with a random joint value."""
    x, y = generator.uniform(-SPREAD, SPREAD, 2)
    yaw = float(generator.uniform(-MOST_YAW, MOST_YAW))
    where = generator.random()
    openness = 0.0 if where < AT_AN_END else 1.0 if where > 1 - AT_AN_END else float(generator.random())
    position, quaternion = placed(np.asarray(model.placement.position), model.placement.quaternion, x, y, yaw)
    return PlacedObject(model, position, quaternion, yaw, openness)


@lru_cache(maxsize=4)
def _postures(name: str) -> tuple[Array, Array]:
    """Return random robot joints (M, n) with the hand above the table, and tool positions (M, 3) in the base frame."""
    profile = robot(name)
    model, size = profile.model, profile.arm_size
    generator = rng(0, "perception/postures")
    q = np.tile(np.array(profile.reset_qpos), (4000, 1))
    low, high = np.array(model.lower[:size]), np.array(model.upper[:size])
    q[:, :size] = generator.uniform(low, high, (len(q), size))
    at = np.asarray(model.forward_kinematics(q, profile.tool_link))[:, :3, 3]
    kept = (at[:, 2] > 0.03) & (at[:, 2] < 0.7) & (at[:, 0] > 0.15)
    return q[kept], at[kept]


def _posture(profile: RobotProfile, thing: PlacedObject, generator: np.random.Generator) -> Array:
    """Return random joint positions (n,) of the robot: near the rest posture, or such that the hand is near the
    object's first keypoint.
    """
    if generator.random() >= REACHING:
        q = np.array(profile.reset_qpos)
        q[: profile.arm_size] += 0.1 * generator.standard_normal(profile.arm_size)
        return np.asarray(np.clip(q, profile.model.lower, profile.model.upper))
    postures, tools = _postures(profile.name)
    model = thing.model
    assert isinstance(model, ArticulatedObject)
    point = thing.in_world(keypoint_in_root(model, next(iter(model.keypoints)), thing.joint_value))
    base = (np.linalg.inv(profile.T_world_base) @ np.append(point, 1.0))[:3]
    order = np.argsort(np.linalg.norm(tools - base, axis=1))
    return np.asarray(postures[order[int(generator.integers(min(60, len(order))))]])


def example(look: LabelledCloud, classes: Sequence[str], profile: RobotProfile) -> Example:
    """Return a labelled cloud as arrays: points with labels, and the true state of the object.

    Returns:
        These arrays; positions and directions are in the base frame:

        - ``points`` (N, 3): points as int16, by :func:`~gensim2.perception.cloud.to_steps`.
        - ``group`` (N,): label of each point.
        - ``moving`` (N,): whether the point lies on the moving link.
        - ``class``: index of the object's class in ``classes``.
        - ``direction``: row of ``DIRECTIONS``.
        - ``revolute``: whether the joint is revolute.
        - ``axis`` (3,), ``origin`` (3,): joint axis, and a point on the axis in m.
        - ``yaw`` (2,): cosine and sine of the object's yaw.
        - ``openness``, ``value``, ``limits`` (2,): openness, joint position, and joint limits in m or rad.
        - ``keypoints`` (SLOTS, 3), ``known`` (SLOTS,): keypoints in m, and whether the object has each keypoint.
        - ``size`` (3,): extents of the object in m, along axes that are rotated by the object's yaw.
    """
    thing, model = look.placed, look.placed.model
    assert isinstance(model, ArticulatedObject)
    T = np.linalg.inv(profile.T_world_base)
    joint, turn = model.joint, Rotation.from_quat(thing.quaternion, scalar_first=True).as_matrix()
    keypoints, known = np.zeros((SLOTS, 3)), np.zeros(SLOTS, dtype=np.uint8)
    for slot, name in enumerate(model.keypoints):
        at = thing.in_world(keypoint_in_root(model, name, thing.joint_value))
        keypoints[slot], known[slot] = T[:3, :3] @ at + T[:3, 3], 1
    whole = np.concatenate(thing.hulls_in_world()) @ Rotation.from_euler("z", thing.yaw).as_matrix()
    return {
        "points": to_steps(look.cloud.xyz),
        "group": look.group,
        "moving": look.moving.astype(np.uint8),
        "class": np.int16(list(classes).index(model.asset_class)),
        "direction": np.int8(direction_of(model)),
        "revolute": np.uint8(joint.type == "revolute"),
        "axis": (T[:3, :3] @ turn @ joint.axis).astype(np.float32),
        "origin": (T[:3, :3] @ thing.in_world(joint.origin) + T[:3, 3]).astype(np.float32),
        "yaw": np.array([np.cos(thing.yaw), np.sin(thing.yaw)], dtype=np.float32),
        "openness": np.float32(thing.openness),
        "value": np.float32(thing.joint_value),
        "limits": np.array([joint.lower, joint.upper], dtype=np.float32),
        "keypoints": keypoints.astype(np.float32),
        "known": known,
        "size": np.ptp(whole, axis=0).astype(np.float32),
    }


def stacked(examples: Sequence[Example]) -> Example:
    """Stack the arrays of examples, one row for each example."""
    return {name: np.stack([each[name] for each in examples]) for name in examples[0]}


def training_instances(library: Library, counts: Mapping[str, int], seed: int) -> Mapping[str, tuple[str, ...]]:
    """Return the ids of training objects by class. ``counts`` contains the number of objects of each class.

    For generated classes, the ids exclude all objects that ``--instances all`` or ``--instances new`` selects, because
    these objects serve for evaluation. For classes from a folder of objects, the ids are those of the training split.
    """
    found: dict[str, tuple[str, ...]] = {}
    for name, count in counts.items():
        if library.source(name) == "real":
            found[name] = library.choose(name, "train")[:count]
            continue
        kept_out = {*library.choose(name, "all"), *library.choose(name, "new")}
        drawn = library.sample(name, count + len(kept_out), seed)
        found[name] = tuple(each for each in drawn if each not in kept_out)[:count]
    return found
