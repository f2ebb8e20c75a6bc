"""Define the types of objects: keypoints, placements, articulated and rigid objects, joint motion, and errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal, Protocol

import numpy as np
import numpy.typing as npt
from pydantic import PlainSerializer, PlainValidator

from gensim2.core.errors import InputError


class AssetError(InputError):
    """Raised when an object's files cannot be used."""


class MissingFileError(AssetError):
    """A file that an object names does not exist."""


#: An array of float64 numbers. In JSON, the array is a nested list.
Array = Annotated[
    npt.NDArray[np.float64],
    PlainValidator(lambda values: np.array(values, dtype=np.float64)),
    PlainSerializer(lambda values: values.tolist()),
]


def joint_motion(kind: str, axis: Array, value: npt.ArrayLike, origin: Array | None = None) -> Array:
    """Return the rigid motion of a joint from value zero to ``value``, in the frame of ``axis`` and ``origin``.

    Args:
        kind: ``"prismatic"``, ``"revolute"`` or ``"continuous"``.
        axis: (3,) unit axis.
        value: joint values in rad or m, an array of any shape.
        origin: (3,) point on the axis, m; None: the origin of the frame.

    Returns:
        Transforms (..., 4, 4), one for each value.
    """
    values = np.asarray(value, dtype=np.float64)[..., None]
    found = np.zeros((*values.shape[:-1], 4, 4))
    found[...] = np.eye(4)
    if kind == "prismatic":
        found[..., :3, 3] = values * axis
        return found
    from scipy.spatial.transform import Rotation  # imported here because naming objects does not need SciPy

    found[..., :3, :3] = Rotation.from_rotvec(values * axis).as_matrix()
    if origin is not None:
        found[..., :3, 3] = origin - found[..., :3, :3] @ origin
    return found


Kind = Literal["articulated", "rigid"]
Source = Literal["generated", "real"]
Hulls = Literal["default", "original"]
"""Method by which real meshes become collision parts: ``"default"`` decomposes them so that cavities stay open;
``"original"``, as in the original GenSim2, takes the convex hull of each connected piece. Generated objects consist of
convex parts, so both give the same.
"""


@dataclass(frozen=True)
class Keypoint:
    """A named point fixed to one link.

    Attributes:
        link: name of the link in the URDF; ``"body"`` for a rigid object.
        position: (3,) position in the frame of ``link``, m, at the object's final size.
        description: short phrase that tells a reader or a language model what the keypoint is.
    """

    link: str
    position: Array
    description: str


@dataclass(frozen=True)
class MovingJoint:
    """The only movable joint of an object.

    Attributes:
        name: joint name in the URDF.
        type: ``"revolute"`` or ``"prismatic"``.
        child_link: link that the joint moves.
        origin: (3,) a point on the axis, metres, in the root frame.
        axis: (3,) unit axis in the root frame.
        lower, upper: limits in rad or m, at openness 0 and 1.
        friction: Coulomb friction in N m or N that keeps the joint in place.
        damping: viscous damping in N m s/rad or N s/m.
        T_root_child: (4, 4) frame of the child link in the root frame at joint value zero.
    """

    name: str
    type: Literal["revolute", "prismatic"]
    child_link: str
    origin: Array
    axis: Array
    lower: float
    upper: float
    friction: float
    damping: float
    T_root_child: Array

    def T_root_child_at(self, value: float) -> Array:
        """Return the frame (4, 4) of the child link in the root frame at a joint value (rad or m)."""
        return np.asarray(joint_motion(self.type, self.axis, value, self.origin) @ self.T_root_child)


@dataclass(frozen=True)
class Placement:
    """Pose of an object before randomization.

    Attributes:
        position: (3,) position of the root in the world. The lowest point touches the table, z = 0. A rigid object is
            at x = y = 0.
        quaternion: (4,) rotation (w, x, y, z) to the world, which turns the contact side to the robot, or the resting
            pose of a rigid object.
    """

    position: Array
    quaternion: Array

    @property
    def rotation(self) -> Array:
        """Rotation matrix (3, 3), root to world."""
        from scipy.spatial.transform import Rotation  # imported here because naming objects does not need SciPy

        return np.asarray(Rotation.from_quat(self.quaternion, scalar_first=True).as_matrix())


class ObjectModel(Protocol):
    """Interface that articulated and rigid objects share."""

    @property
    def asset_class(self) -> str:
        """Name of the class, such as ``"box_rotate"`` or ``"mug"``."""

    @property
    def id(self) -> str:
        """Id of the object in its class; ``"0"`` for a rigid object."""

    @property
    def source(self) -> Source:
        """Origin of the object: ``"generated"`` or ``"real"``."""

    @property
    def license(self) -> str:
        """Licence terms of the data."""

    @property
    def content_hash(self) -> str:
        """Hex digest of all inputs of the object."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """Irregularities in the object's files, and how they were repaired."""

    @property
    def mass(self) -> float:
        """Total mass, kg."""

    @property
    def keypoints(self) -> Mapping[str, Keypoint]:
        """Keypoints of the object, by name."""

    @property
    def hulls(self) -> Mapping[str, tuple[Array, ...]]:
        """Convex vertex sets by link name (``"body"`` for a rigid object), each (N, 3) metres in the link frame."""

    @property
    def placement(self) -> Placement:
        """Pose of the object before randomization."""

    @property
    def joint(self) -> MovingJoint | None:
        """The movable joint; None for a rigid object."""


@dataclass(frozen=True)
class ArticulatedObject:
    """An articulated object ready for simulation and planning.

    ``urdf`` is scaled and complete: it has inertials, limits, joint dynamics, and one convex mesh for each collision
    element. SAPIEN and urdf-rs load it directly. ``hulls`` are the same parts as arrays.

    Attributes:
        asset_class: name of the class, such as ``"box_rotate"``.
        id: instance id, such as ``"100141"``; generated instances are numbered ``"0"``, ``"1"``, ....
        source: ``"generated"`` or ``"real"``.
        urdf: file in the cache folder; its meshes are in the same folder.
        joint: movable joint.
        keypoints: keypoints by name.
        T_link_object: (4, 4) pose of the object frame (docs/architecture.md) in the frame of the moving link.
        object_axis: axis ``"x"``, ``"y"`` or ``"z"`` of the object frame for the planner's rotate motions.
        hulls: convex vertex sets by link name, each (N, 3) metres in the link frame.
        placement: default placement, computed from the geometry.
        default_openness: mean of the randomized openness.
        mass: total mass of all links, kg.
        license: licence terms of the data.
        content_hash: hex digest of all inputs of the instance.
        warnings: problems in the object's files, each with its repair.
    """

    asset_class: str
    id: str
    source: Source
    urdf: Path
    joint: MovingJoint
    keypoints: dict[str, Keypoint]
    T_link_object: Array
    object_axis: Literal["x", "y", "z"]
    hulls: dict[str, tuple[Array, ...]]
    placement: Placement
    default_openness: float
    mass: float
    license: str
    content_hash: str
    warnings: tuple[str, ...] = field(default=())

    def link_pose(self, openness: float) -> Array:
        """Return the pose (4, 4) of the moving link in the root frame at an openness."""
        joint = self.joint
        return joint.T_root_child_at(joint.lower + openness * (joint.upper - joint.lower))

    def lever_arm(self, keypoint: str) -> float:
        """Return the distance (m) between the joint axis and a keypoint on the moving link."""
        point = self.joint.T_root_child @ np.append(self.keypoints[keypoint].position, 1.0)
        return float(np.linalg.norm(np.cross(point[:3] - self.joint.origin, self.joint.axis)))


BODY = "body"
"""Name of a rigid object's only link."""
ONLY_ID = "0"
"""Id of the only instance of a rigid class."""


@dataclass(frozen=True)
class Grip:
    """Grasp of a resting object with two parallel fingers. Obstacles are not considered.

    Attributes:
        point: (3,) midpoint between the fingertips, metres in the object frame.
        axis: (3,) unit direction in which the fingers close, object frame; horizontal when the object rests.
        width: distance between the fingertips, m.
    """

    point: Array
    axis: Array
    width: float


@dataclass(frozen=True)
class RigidObject:
    """A rigid object ready for simulation and planning; the object frame is the frame of its only link.

    Attributes:
        asset_class: name of the class, such as ``"mug"``. The class contains only this object.
        source: ``"generated"`` or ``"real"``.
        folder: folder with ``visual.glb`` and ``hull_<i>.obj``, in metres in the object frame.
        hulls: convex collision parts (N, 3) of the only link ``"body"``, metres in the object frame.
        mass: mass, kg.
        center_of_mass: (3,) centre of mass in the object frame, m.
        inertia: (3, 3) inertia about the centre of mass, along the axes of the object frame, kg m².
        friction: friction coefficient of the surface, for both static and dynamic friction.
        keypoints: keypoints on ``"body"``: ``rigidbody_object_head``, and ``rigidbody_object_tail`` if the object has
            two ends.
        placement: stable pose of the object frame on a table at z = 0, above the origin of the world.
        grip: best grasp of the object in the pose ``placement``.
        license: licence terms of the data.
        content_hash: hex digest of all inputs of the object.
        warnings: irregularities in the object's files, and how they were repaired.
    """

    asset_class: str
    source: Source
    folder: Path
    hulls: dict[str, tuple[Array, ...]]
    mass: float
    center_of_mass: Array
    inertia: Array
    friction: float
    keypoints: dict[str, Keypoint]
    placement: Placement
    grip: Grip
    license: str
    content_hash: str
    warnings: tuple[str, ...] = field(default=())

    @property
    def id(self) -> str:
        """Id of the object, always ``"0"``."""
        return ONLY_ID

    @property
    def joint(self) -> None:
        """Always None, because a rigid object has no joint."""
        return None

    @property
    def size(self) -> Array:
        """Extents (3,) in metres along the axes of the object frame."""
        return np.asarray(np.ptp(np.concatenate(self.hulls[BODY]), axis=0))

    @property
    def visual(self) -> Path | None:
        """Path of the visual mesh, or None."""
        file = self.folder / "visual.glb"
        return file if file.is_file() else None

    def hull_file(self, index: int) -> Path:
        """Return the path of collision part ``index``, a Wavefront OBJ file."""
        return self.folder / f"hull_{index}.obj"
