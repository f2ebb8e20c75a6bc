"""Estimate the articulated object in a point cloud, with class, parts, joint and keypoints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
import numpy.typing as npt
import torch
from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator
from scipy.spatial.transform import Rotation

from gensim2.core.arrays import Array
from gensim2.core.files import write_json
from gensim2.core.record_files import read_record
from gensim2.core.weights import (
    Digest,
    FileName,
    half_precision,
    load_half_precision,
    remove_other_weights,
    write_weights,
)
from gensim2.objects.types import joint_motion
from gensim2.perception.estimation.bail import raised_bail
from gensim2.perception.estimation.classes import DIRECTIONS, ClassConstants, by_name
from gensim2.perception.estimation.door import IN_CABINET, in_box, in_cabinet, on_door
from gensim2.perception.estimation.lever import lever_near
from gensim2.perception.estimation.network import OTHER, TARGET, EncodedCloud, SceneNetwork, features_of
from gensim2.robots import DEFAULT_ROBOT, RobotProfile, robot

Points = npt.NDArray[np.float32]

ESTIMATOR_JSON = "estimator.json"
BUILTIN = "builtin"
"""Name of the estimator that comes with the package, and of its folder in the package."""
MAX_BYTES = 10 * 2**20
"""Maximum size of the weights, bytes."""
_REMEDY = "train it again: gensim2 perceive train"

LEAST_POINTS = 24
"""Minimum number of cloud points on an articulated object; with fewer points no object is reported."""
HYPOTHESES = 3
"""Maximum number of reported directions of the joint axis."""
LEAST_SHARE = 0.02
"""Minimum probability of a reported direction of the joint axis."""

DEVIATIONS = ("openness", "axis", "keypoints")
"""Names of the estimates whose predicted standard deviation is scaled by the calibration."""

LEVEL = 0.35
"""Maximum vertical component of a unit normal at which the surface counts as upright."""
CONCENTRATED = 0.6
"""Minimum concentration of the upright normals (0 to 1) for an object to count as a box."""
PART_CONCENTRATED = 0.35
"""Minimum concentration of the normals of a moving part; lower, because the part often contains points of the base."""
MOST_REFINED = 0.2
"""Maximum correction of the yaw that upright surfaces may cause, rad."""
LEAST_SPAN, MOST_SPAN = 0.8, 1.8
"""Range of the estimated joint range, as multiples of the smallest and largest joint range of the training objects."""
MEASURED, MEASURED_OPENNESS = 0.01, 0.05
"""Standard deviations of the axis position and the keypoint (m) and of the openness of a bail that is measured."""
LOWERED = 0.31
"""Minimum standard deviation of the openness of a bail that cannot be measured, because it is on the rim."""
OPEN_ENOUGH = 0.4
"""Minimum estimated openness of a sliding part at which its visible points show its width."""
EDGES = (0.05, 0.95)
"""Quantiles of the points that count as the left and the right edge of a sliding part."""
FRONT = 0.9
"""Quantile of the points along the joint that counts as the front of a sliding part, in spite of its handle."""
INSIDE_HEIGHT, MOST_RAISED = 0.4, 0.06
"""Height of the keypoint inside a drawer as a fraction of the height of its sides, and maximum correction (m)."""
MOST_TURNED = 0.6
"""Maximum correction of a revolute joint's value that the surfaces of the moving part may cause, rad."""


@dataclass(frozen=True, eq=False)
class JointEstimate:
    """Estimated joint of an object.

    Attributes:
        type: type of the joint.
        axis: (3,) unit direction of the most probable axis, in the base frame.
        origin: (3,) point on the axis in the base frame, m.
        origin_deviation: standard deviation of the distance from ``origin`` to the true axis of a revolute joint, m.
        openness: fraction of the joint range, 0 to 1.
        openness_deviation: standard deviation of ``openness``.
        lower, upper: joint limits, rad or m.
        hypotheses: possible directions (3,) of the axis with their probabilities, the most probable first.
    """

    type: Literal["revolute", "prismatic"]
    axis: Array
    origin: Array
    origin_deviation: float
    openness: float
    openness_deviation: float
    lower: float
    upper: float
    hypotheses: tuple[tuple[Array, float], ...]

    @property
    def value(self) -> float:
        """Value of the joint, rad or m."""
        return self.lower + self.openness * (self.upper - self.lower)


@dataclass(frozen=True, eq=False)
class ObjectEstimate:
    """Estimated articulated object.

    Attributes:
        asset_class: object class that was assumed for the estimate.
        confidence: probability of the assumed class.
        classes: probability of each class that the estimator knows.
        points: (M,) row indices of cloud points on the object.
        moving: (M,) whether each point in ``points`` lies on the moving link.
        yaw: rotation about the vertical from the default placement, rad.
        T_base_object: (4, 4) object frame in the base frame.
        joint: estimated joint.
        keypoints: positions (3,) by name, in the base frame, m.
        keypoint_deviations: standard deviation of the distance from each estimated keypoint to the true one, m.
        size: (3,) extent along the world's axes in the default placement, m.
        object_axis: axis of the object frame that "rotate" motions turn about.
        moving_keypoints: names of the keypoints on the moving link.
        is_bail: whether the moving part is a bail, the arched handle of a bucket.
    """

    asset_class: str
    confidence: float
    classes: Mapping[str, float]
    points: npt.NDArray[np.int64]
    moving: npt.NDArray[np.bool_]
    yaw: float
    T_base_object: Array
    joint: JointEstimate
    keypoints: Mapping[str, Array]
    keypoint_deviations: Mapping[str, float]
    size: Array
    object_axis: Literal["x", "y", "z"]
    moving_keypoints: tuple[str, ...] = ()
    is_bail: bool = False

    def at(self, openness: float, deviation: float) -> ObjectEstimate:
        """Return the estimate with a new openness and a new standard deviation of the openness. The object frame
        rotates with the joint, but the points and keypoints are not changed.
        """
        joint = replace(self.joint, openness=openness, openness_deviation=deviation)
        T = self.T_base_object.copy()
        T[:3, :3] = joint_motion(joint.type, joint.axis, joint.value - self.joint.value)[:3, :3] @ T[:3, :3]
        return replace(self, joint=joint, T_base_object=T)


@dataclass(frozen=True, eq=False)
class SceneEstimate:
    """Estimated scene.

    Attributes:
        objects: estimated articulated objects.
        others: (K,) row indices of cloud points on other bodies.
    """

    objects: tuple[ObjectEstimate, ...]
    others: npt.NDArray[np.int64]


class _Record(BaseModel):
    """Content of ``estimator.json``."""

    model_config = ConfigDict(extra="forbid")

    schema_version: Literal[1] = 1
    kind: Literal["gensim2-estimator"] = "gensim2-estimator"
    classes: Annotated[tuple[ClassConstants, ...], Field(min_length=1, max_length=1000)]
    scales: dict[str, Annotated[float, Field(gt=0, le=1000)]]
    stand_ins: tuple[str, ...] = ()
    file: FileName
    sha256: Digest

    @field_validator("stand_ins")
    @classmethod
    def _are_known(cls, stand_ins: tuple[str, ...], info: ValidationInfo) -> tuple[str, ...]:
        known = info.data.get("classes", ())  # invalid classes are missing here, and have an error of their own
        for name in stand_ins if known else ():
            if name not in [each.name for each in known]:
                raise ValueError(f"the estimator has no class {name!r}")
        return stand_ins


def estimator_folder(place: Path | str) -> Path:
    """Return an estimator's folder; ``"builtin"`` stands for the estimator that comes with the package.

    To use a folder that is named ``builtin``, give ``./builtin`` or ``Path("builtin")``.
    """
    return Path(__file__).parent / BUILTIN if place == BUILTIN else Path(place)


class SceneEstimator:
    """Estimates articulated objects in a point cloud.

    Args:
        network: network in evaluation mode.
        classes: constants of the classes, in the network's order.
        profile: robot whose base frame the clouds use.
        scales: calibration factors. Each predicted standard deviation is multiplied by the factor with its name in
            ``DEVIATIONS``. None: all factors are 1.
        stand_ins: names of known classes whose estimates are used for objects of an unknown class.
        refine: whether to align the estimated yaw with the upright surfaces in the cloud, and the value of a revolute
            joint with the surfaces of the moving part.

    Example:
        >>> estimator = SceneEstimator.load()
        >>> [found] = estimator.estimate(observation.cloud.xyz).objects
        >>> found.asset_class, found.joint.axis
    """

    def __init__(
        self,
        network: SceneNetwork,
        classes: Sequence[ClassConstants],
        profile: RobotProfile,
        scales: Mapping[str, float] | None = None,
        *,
        stand_ins: Sequence[str] = (),
        refine: bool = True,
    ) -> None:
        self.network, self.classes, self.profile, self.refine = network, tuple(classes), profile, refine
        self.scales: dict[str, float] = dict.fromkeys(DEVIATIONS, 1.0) | dict(scales or {})
        self.stand_ins = tuple(self.classes[by_name(self.classes, name)] for name in stand_ins)

    @classmethod
    def load(cls, folder: Path | str = BUILTIN, profile: RobotProfile | None = None) -> Self:
        """Load an estimator that ``gensim2 perceive train`` has written.

        Args:
            folder: folder of the estimator, or ``"builtin"`` for the estimator of the package.
            profile: robot whose base frame the clouds use; None: the default robot.

        Raises:
            InputError: a file is missing, damaged or too large.
        """
        folder, profile = estimator_folder(folder), robot(DEFAULT_ROBOT) if profile is None else profile
        record = read_record(Path(folder) / ESTIMATOR_JSON, _Record, _REMEDY)
        network = SceneNetwork(len(record.classes))
        load_half_precision(network, Path(folder) / record.file, record.sha256, MAX_BYTES, _REMEDY)
        return cls(network, record.classes, profile, record.scales, stand_ins=record.stand_ins)

    def save(self, folder: Path) -> None:
        """Write ``estimator.json`` and the weights atomically. The weights are stored with 16 bits each; the rounding
        moves an estimate by far less than its error.

        Raises:
            WriteError: the folder cannot be written to.
        """
        name, digest = write_weights(folder, half_precision(self.network))
        names = tuple(each.name for each in self.stand_ins)
        record = _Record(classes=self.classes, scales=self.scales, stand_ins=names, file=name, sha256=digest)
        write_json(folder / ESTIMATOR_JSON, record.model_dump(mode="json"))
        remove_other_weights(folder, name)

    def estimate(self, xyz: Points, asset_class: str | None = None) -> SceneEstimate:
        """Estimate the scene in a point cloud.

        If the cloud shows no articulated object, the result has no objects. If the cloud shows several articulated
        objects, the estimator treats them as a single object.

        Args:
            xyz: (N, 3) finite points in the base frame, m, without points of the robot.
            asset_class: class to assume for the object; None: the most probable class. The reported class probabilities
                do not depend on this argument.

        Raises:
            InputError: the estimator does not know the class.
        """
        given = None if asset_class is None else by_name(self.classes, asset_class)
        if len(xyz) < LEAST_POINTS:
            return SceneEstimate((), np.arange(len(xyz)))
        with torch.inference_mode():
            found = np.asarray(xyz, dtype=np.float32)
            more = features_of(found)
            seen = self.network.see(torch.from_numpy(found)[None], torch.from_numpy(more)[None])
            group = seen.group.argmax(-1)
            mask, others = group == TARGET, np.flatnonzero(group[0].numpy() == OTHER)
            if int(mask.sum()) < LEAST_POINTS:
                return SceneEstimate((), others)
            estimate = self._object(seen, mask, found, more, given)
        return SceneEstimate((self.measured(estimate, found),), others)

    def measured(self, found: ObjectEstimate, cloud: Points) -> ObjectEstimate:
        """Return an estimate that is corrected by the points (N, 3) of its cloud, if the object has a bail, a lever, or
        a door with a vertical axis.
        """
        if not self.refine:
            return found
        if self.classes[by_name(self.classes, found.asset_class)].is_bail:
            return with_bail(found, cloud)
        if not found.moving_keypoints or abs(found.joint.axis[2]) <= 1.0 - LEVEL:
            return found
        name, points = found.moving_keypoints[0], cloud[found.points]
        at, deviation = found.keypoints[name], found.keypoint_deviations[name]
        if found.joint.type == "revolute" and IN_CABINET in found.keypoints:
            turn = float(np.sign(found.joint.axis[2]))
            at, deviation = on_door(at, deviation, points[found.moving], found.joint.origin, turn)
        elif found.joint.type == "prismatic" and not found.moving.all():
            forwards = self.profile.T_world_base[:3, :3].T @ [np.cos(found.yaw), np.sin(found.yaw), 0.0]
            lever = lever_near(at, deviation, points, forwards)
            if lever is not None:
                at, deviation = lever.end, deviation if lever.end is at else MEASURED
                found = replace(found, moving=lever.points)
        return replace(
            found,
            keypoints={**found.keypoints, name: at},
            keypoint_deviations={**found.keypoint_deviations, name: deviation},
        )

    def stand_in(self, xyz: Points, joint_type: str | None = None) -> ClassConstants:
        """Return the most probable stand-in for the object in a point cloud, whose class is unknown.

        Args:
            xyz: (N, 3) finite points in the base frame, m, without points of the robot.
            joint_type: ``"revolute"`` or ``"prismatic"``: type of the joint of the stand-in, if there is one; None: any
                type.
        """
        found = self.estimate(xyz).objects
        alike = [each for each in self.stand_ins if each.joint_type == joint_type] or self.stand_ins
        return max(alike, key=lambda each: found[0].classes[each.name] if found else 0.0)

    def _object(
        self, seen: EncodedCloud, mask: torch.Tensor, xyz: Points, more: Points, given: int | None
    ) -> ObjectEstimate:
        gathered = self.network.gather(seen, mask)
        chances = self.network.classify(gathered)[0].softmax(-1).numpy()
        number = int(chances.argmax()) if given is None else given
        raw = self.network.estimate(seen, gathered, mask, torch.tensor([number]))
        found = {name: value[0].double().numpy() for name, value in raw.items()}
        deviations = np.exp(found["log_deviations"])
        kind = self.classes[number]
        rows = np.flatnonzero(mask[0].numpy())
        moving = found["moving"][rows] > 0
        yaw = float(np.arctan2(found["yaw"][1], found["yaw"][0]))
        if self.refine:
            still = ~moving if (~moving).sum() > moving.sum() / 2 else np.ones_like(moving)
            yaw = squared_yaw(more[rows[still], :3], yaw)
        turn = np.asarray(Rotation.from_euler("z", yaw).as_matrix())
        to_base = self.profile.T_world_base[:3, :3].T
        likely = torch.from_numpy(found["direction"]).softmax(-1).numpy()
        order = [each for each in np.argsort(-likely)[:HYPOTHESES] if likely[each] >= LEAST_SHARE]
        hypotheses = tuple((to_base @ turn @ DIRECTIONS[each], float(likely[each])) for each in order)
        lower, upper = map(float, np.sort(found["limits"]))
        upper = max(upper, lower + 1e-3)
        if kind.span is not None:
            upper = lower + float(np.clip(upper - lower, LEAST_SPAN * kind.span[0], MOST_SPAN * kind.span[1]))
        openness = float(np.clip(found["openness"], 0.0, 1.0))
        if self.refine and kind.joint_type == "revolute":
            value = lower + openness * (upper - lower)
            value = squared_value(more[rows[moving], :3], hypotheses[0][0], yaw, value)
            openness = float(np.clip((value - lower) / (upper - lower), 0.0, 1.0))
        joint = JointEstimate(
            type=kind.joint_type,
            axis=hypotheses[0][0],
            origin=found["places"][0],
            origin_deviation=self.scales["axis"] * float(deviations[2]),
            openness=openness,
            openness_deviation=self.scales["openness"] * float(deviations[1]),
            lower=lower,
            upper=upper,
            hypotheses=hypotheses,
        )
        keypoints = dict(zip(kind.keypoints, found["places"][1:], strict=False))
        if self.refine and kind.joint_type == "prismatic" and len(kind.keypoints) > 1 and kind.moving[-1]:
            keypoints = in_open_drawer(keypoints, xyz[rows[moving]], joint)
        is_container = self.refine and kind.joint_type == "revolute" and IN_CABINET in keypoints
        inwards = to_base @ turn[:, 0]
        if is_container and abs(joint.axis[2]) <= 1.0 - LEVEL:
            keypoints[IN_CABINET] = in_box(keypoints[IN_CABINET], joint.origin, inwards)
        elif is_container:
            keypoints[IN_CABINET] = in_cabinet(keypoints[IN_CABINET], xyz[rows[moving]], joint.origin, inwards)
        T = joint_motion(joint.type, joint.axis, joint.value, joint.origin)
        T[:3, :3] = T[:3, :3] @ to_base @ turn @ np.array(kind.frame)
        T[:3, 3] = xyz[rows[moving] if moving.any() else rows].mean(axis=0)
        return ObjectEstimate(
            asset_class=kind.name,
            confidence=float(chances[number]),
            classes={each.name: float(chance) for each, chance in zip(self.classes, chances, strict=True)},
            points=rows,
            moving=moving,
            yaw=yaw,
            T_base_object=T,
            joint=joint,
            keypoints=keypoints,
            keypoint_deviations={
                name: self.scales["keypoints"] * float(each)
                for name, each in zip(kind.keypoints, deviations[3:], strict=False)
            },
            size=found["size"],
            object_axis=kind.object_axis,
            moving_keypoints=tuple(name for name, moves in zip(kind.keypoints, kind.moving, strict=True) if moves),
            is_bail=kind.is_bail,
        )


def with_bail(found: ObjectEstimate, cloud: Points) -> ObjectEstimate:
    """Return an estimate of a bucket whose bail is measured in the points (N, 3) of its cloud. If the bail is on the
    rim, the points do not show on which side, and the openness becomes uncertain.
    """
    joint = found.joint
    bail = raised_bail(cloud[found.points], joint.axis, joint.origin)
    if bail is None:
        return found.at(joint.openness, max(joint.openness_deviation, LOWERED))
    turn = float(np.arctan2(np.cross(joint.axis, bail.axis)[2], joint.axis @ bail.axis))
    T, name = found.T_base_object.copy(), found.moving_keypoints[0]
    T[:3, :3] = Rotation.from_euler("z", turn).as_matrix() @ T[:3, :3]
    measured = replace(
        joint, axis=bail.axis, origin=bail.origin, origin_deviation=MEASURED, hypotheses=((bail.axis, 1.0),)
    )
    openness = float(np.clip(0.5 + bail.angle / (joint.upper - joint.lower), 0.0, 1.0))
    return replace(
        found,
        joint=measured,
        yaw=found.yaw + turn,
        T_base_object=T,
        moving=bail.points,
        keypoints={**found.keypoints, name: bail.middle},
        keypoint_deviations={**found.keypoint_deviations, name: MEASURED},
    ).at(openness, MEASURED_OPENNESS)


def in_open_drawer(keypoints: Mapping[str, Array], moving: Points, joint: JointEstimate) -> dict[str, Array]:
    """Return the keypoints of a drawer, corrected by the points of the open drawer. Return them unchanged if the joint
    is not horizontal, if the drawer is hardly open, or if it has too few points.

    The last keypoint, which is inside the drawer, is moved to the middle between the sides, half of the joint range
    behind the front, and to a fixed fraction of the height of the sides if it is less than ``MOST_RAISED`` away from
    there. This is the middle of the part that is pulled out when the drawer is open. Other keypoints, such as the
    handle, are moved sideways to the middle only if they are not between the sides.

    The half of the points that lies farthest in the direction of opening shows the front and both sides. The other half
    often contains points of the cabinet.

    Args:
        keypoints: estimated keypoints (3,) by name, in a frame with a vertical z axis, m.
        moving: (M, 3) points of the drawer in this frame, m.
        joint: estimated joint in this frame.
    """
    if abs(joint.axis[2]) > LEVEL or joint.openness < OPEN_ENOUGH or len(moving) < LEAST_POINTS:
        return dict(keypoints)
    across = np.array([-joint.axis[1], joint.axis[0], 0.0])
    across /= np.linalg.norm(across)
    along = moving @ joint.axis
    outer = moving[along >= np.median(along)]
    left, right = np.quantile(outer @ across, EDGES)
    bottom, top = np.quantile(outer[:, 2], EDGES)
    front = float(np.quantile(along, FRONT))
    found = {}
    for name, at in keypoints.items():
        is_inside = name == list(keypoints)[-1]
        is_between = left <= at @ across <= right and not is_inside
        found[name] = at if is_between else at + (0.5 * (left + right) - at @ across) * across
        if is_inside:
            raised = bottom + INSIDE_HEIGHT * (top - bottom) - at[2]
            if abs(raised) < MOST_RAISED:
                found[name] = found[name] + np.array([0.0, 0.0, raised])
            found[name] = found[name] + (front - 0.5 * joint.upper - at @ joint.axis) * joint.axis
    return found


def squared_yaw(normals: Points, yaw: float) -> float:
    """Return the yaw (rad) of a box, computed from the normals of its vertical faces. If the normals do not fit a box,
    return ``yaw``.

    The angles of the faces' normals in the horizontal plane differ by multiples of 90 degrees. Four times these angles
    differ by multiples of 360 degrees, so they are equal angles. The mean of these equal angles, divided by four, is
    the yaw.

    Args:
        normals: (M, 3) unit normals with either sign, in a frame with a vertical z axis.
        yaw: estimated yaw in this frame, rad.
    """
    upright = normals[np.abs(normals[:, 2]) < LEVEL]
    return _squared(np.arctan2(upright[:, 1], upright[:, 0]), yaw, CONCENTRATED, MOST_REFINED)


def squared_value(normals: Points, axis: Array, yaw: float, value: float) -> float:
    """Return the value (rad) of a revolute joint, computed from the normals of a box-shaped moving part such as a door
    or a lid. If the normals do not fit a box, return ``value``.

    If such a joint is at zero, the faces of the moving part are parallel to the faces of the object. Therefore the
    angle of a face about the axis, measured from a face of the object, is the joint value plus a multiple of 90
    degrees.

    Args:
        normals: (M, 3) unit normals of the moving part with either sign, in a frame with a vertical z axis.
        axis: (3,) unit direction of the joint axis in this frame; one of the axes of the object's faces.
        yaw: yaw of the object in this frame, rad.
        value: estimated joint value, rad.
    """
    across = normals[np.abs(normals @ axis) < LEVEL]
    front = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    first = front if abs(front @ axis) < LEVEL else np.array([0.0, 0.0, 1.0])
    angles = np.arctan2(across @ np.cross(axis, first), across @ first)
    return _squared(angles, value, PART_CONCENTRATED, MOST_TURNED)


def _squared(angles: Array, angle: float, concentrated: float, most: float) -> float:
    """Return the angle (rad) nearest to ``angle`` that differs from the angles (M,) of faces by a multiple of 90
    degrees. Return ``angle`` if there are too few faces, if their concentration (0 to 1) is below ``concentrated``, or
    if the result differs from ``angle`` by more than ``most`` (rad).
    """
    if len(angles) < LEAST_POINTS:
        return angle
    mean = np.exp(4j * angles).mean()
    if abs(mean) < concentrated:
        return angle
    quarter = 0.5 * np.pi
    by = (np.angle(mean) / 4 - angle + quarter / 2) % quarter - quarter / 2
    return angle + float(by) if abs(by) <= most else angle
