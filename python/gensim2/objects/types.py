"""Object models: keypoints, placements, articulated and rigid objects, the motion of a joint, and errors about them."""

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
    """An object that cannot be used."""


class MissingFileError(AssetError):
    """A file that an object names is not there."""


#: An array of numbers; in JSON nested lists.
Array = Annotated[
    npt.NDArray[np.float64],
    PlainValidator(lambda values: np.array(values, dtype=np.float64)),
    PlainSerializer(lambda values: values.tolist()),
]


def joint_motion(kind: str, axis: Array, value: npt.ArrayLike, origin: Array | None = None) -> Array:
    """Return the rigid motion from joint value zero, in the frame of ``axis`` and ``origin``.

    Args:
        kind: ``"prismatic"``, or ``"revolute"`` or ``"continuous"``.
        axis: (3,) unit axis.
        value: rad or m, of any shape.
        origin: (3,) m, a point on the axis; None: the frame's own origin.

    Returns:
        (..., 4, 4), one for each value.
    """
    values = np.asarray(value, dtype=np.float64)[..., None]
    found = np.zeros((*values.shape[:-1], 4, 4))
    found[...] = np.eye(4)
    if kind == "prismatic":
        found[..., :3, 3] = values * axis
        return found
    from scipy.spatial.transform import Rotation  # here: whoever only names objects needs no SciPy

    found[..., :3, :3] = Rotation.from_rotvec(values * axis).as_matrix()
    if origin is not None:
        found[..., :3, 3] = origin - found[..., :3, :3] @ origin
    return found


Kind = Literal["articulated", "rigid"]
Source = Literal["generated", "real"]
Hulls = Literal["default", "original"]
"""Method by which real meshes become collision parts: taken apart so that cavities stay open, or, as in the original
GenSim2, each connected piece of a file as its convex hull. Generated objects are made of convex parts: both are the
same there."""


@dataclass(frozen=True)
class Keypoint:
    """A named point fixed to one link.

    Attributes:
        link: name of the link in the URDF; ``"body"``, the only one, of a rigid object.
        position: (3,) metres in that link's frame, scale applied.
        description: one phrase for a person or a language model.
    """

    link: str
    position: Array
    description: str


@dataclass(frozen=True)
class MovingJoint:
    """The one unfixed joint of an object.

    Attributes:
        name: joint name in the URDF.
        type: ``"revolute"`` or ``"prismatic"``.
        child_link: the link that it moves.
        origin: (3,) a point on the axis, metres, in the root frame.
        axis: (3,) unit axis in the root frame.
        lower, upper: limits in rad or m; openness 0 is ``lower`` and 1 is ``upper``.
        friction: Coulomb friction in N m or N that holds the joint where it was left.
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
        """(4, 4) frame of the child link in the root frame at a joint value (rad or m)."""
        return np.asarray(joint_motion(self.type, self.axis, value, self.origin) @ self.T_root_child)


@dataclass(frozen=True)
class Placement:
    """Pose of an object before randomization.

    Attributes:
        position: (3,) root position in the world frame; its lowest point rests on the table at z = 0. A rigid object
            stands above the world's origin.
        quaternion: (4,) (w, x, y, z), root to world; the side of an articulated object that the robot works on faces
            the robot, a rigid one rests.
    """

    position: Array
    quaternion: Array

    @property
    def rotation(self) -> Array:
        """(3, 3) of the quaternion, root to world."""
        from scipy.spatial.transform import Rotation  # here: whoever only names objects needs no SciPy

        return np.asarray(Rotation.from_quat(self.quaternion, scalar_first=True).as_matrix())


class ObjectModel(Protocol):
    """Interface that articulated and rigid objects share: what scenes, placement, records and checks need of one."""

    @property
    def asset_class(self) -> str:
        """For example ``"box_rotate"`` or ``"mug"``."""

    @property
    def id(self) -> str:
        """Which of its class; ``"0"`` of a rigid object."""

    @property
    def source(self) -> Source:
        """Source of its data."""

    @property
    def license(self) -> str:
        """Terms that the data carries."""

    @property
    def content_hash(self) -> str:
        """Hex digest of everything that it was made from."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """Oddities of its files, each with the rule by which it was repaired."""

    @property
    def mass(self) -> float:
        """Kg, all of it."""

    @property
    def keypoints(self) -> Mapping[str, Keypoint]:
        """By name."""

    @property
    def hulls(self) -> Mapping[str, tuple[Array, ...]]:
        """Link name (``"body"`` of a rigid object) to convex vertex sets, each (N, 3) metres in the link frame."""

    @property
    def placement(self) -> Placement:
        """Pose before randomization."""

    @property
    def joint(self) -> MovingJoint | None:
        """The joint that moves; None: it is rigid."""


@dataclass(frozen=True)
class ArticulatedObject:
    """An articulated object ready to be simulated and planned for.

    ``urdf`` is scaled, has inertials, limits and joint dynamics, and one convex mesh a collision element: SAPIEN and
    urdf-rs load it as it is. ``hulls`` holds the same convex collision parts for planning.

    Attributes:
        asset_class: for example ``"box_rotate"``.
        id: instance id, for example ``"100141"``; generated instances are numbered ``"0"``, ``"1"``, ....
        source: ``"generated"`` or ``"real"``.
        urdf: file in the cache folder, with its meshes beside it.
        joint: the moving joint.
        keypoints: by name.
        T_link_object: (4, 4) object frame in the moving link's frame (see docs/architecture.md).
        object_axis: ``"x"``, ``"y"`` or ``"z"``: axis of the object frame that "rotate" turns about.
        hulls: link name to convex vertex sets, each (N, 3) metres in the link frame.
        placement: default placement, computed from geometry.
        default_openness: mean of the randomized openness.
        mass: kg, all links.
        license: terms that the data carries.
        content_hash: hex digest of everything that the instance was made from.
        warnings: what was odd and by which rule it was repaired.
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
        """(4, 4) moving link in the root frame at an openness."""
        joint = self.joint
        return joint.T_root_child_at(joint.lower + openness * (joint.upper - joint.lower))

    def lever_arm(self, keypoint: str) -> float:
        """Distance in metres of a keypoint on the moving link from the joint axis."""
        point = self.joint.T_root_child @ np.append(self.keypoints[keypoint].position, 1.0)
        return float(np.linalg.norm(np.cross(point[:3] - self.joint.origin, self.joint.axis)))


BODY = "body"
"""Name of the only link."""
ONLY_ID = "0"
"""Id of the only instance of a class of rigid objects."""


@dataclass(frozen=True)
class Grip:
    """Grasp of two parallel fingers on the object at rest, as long as nothing else is in the way.

    Attributes:
        point: (3,) middle between the fingertips, metres in the object frame.
        axis: (3,) unit direction in which the fingers close, object frame; level when the object rests.
        width: metres between the fingertips.
    """

    point: Array
    axis: Array
    width: float


@dataclass(frozen=True)
class RigidObject:
    """A rigid object ready to be simulated and planned for; the object frame is that of its only link.

    Attributes:
        asset_class: its name, for example ``"mug"``; it is the only one of its class.
        source: ``"generated"`` or ``"real"``.
        folder: prepared files: ``visual.glb`` and ``hull_<i>.obj``, object frame, metres.
        hulls: ``"body"`` to convex collision parts, each (N, 3) metres in the object frame.
        mass: kg.
        center_of_mass: (3,) metres in the object frame.
        inertia: (3, 3) kg m² about the centre of mass, along the axes of the object frame.
        friction: of its surface, static and dynamic.
        keypoints: by name, on ``"body"``; ``rigidbody_object_head`` always, ``rigidbody_object_tail`` where it has two
            ends.
        placement: pose, object to world, in which it stays on a table at z = 0, its origin above the world's.
        grip: the narrowest hold in that pose.
        license: terms that the data carries.
        content_hash: hex digest of everything that the object was made from.
        warnings: what was odd and by which rule it was repaired.
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
        """``"0"``."""
        return ONLY_ID

    @property
    def joint(self) -> None:
        """It has none."""
        return None

    @property
    def size(self) -> Array:
        """(3,) extents in metres along the axes of the object frame."""
        return np.asarray(np.ptp(np.concatenate(self.hulls[BODY]), axis=0))

    @property
    def visual(self) -> Path | None:
        """File to look at, or None where the object has none."""
        file = self.folder / "visual.glb"
        return file if file.is_file() else None

    def hull_file(self, index: int) -> Path:
        """Wavefront OBJ of collision part ``index``."""
        return self.folder / f"hull_{index}.obj"
