"""Define the contents of observations, and compute observations."""

from __future__ import annotations

import re
import reprlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from gensim2.core.errors import GenSim2Error, InputError
from gensim2.perception.camera import PLACES, Camera, View
from gensim2.perception.cloud import CloudSettings, PointCloud, RobotSegments, point_cloud
from gensim2.robots import RobotProfile

STATE, VELOCITY, TOOL_POSE, GRIPPER = "state", "velocity", "tool_pose", "gripper"
"""Names of proprioception columns, all float32: joint positions (n,), rad and m; velocities (n,); tool pose (7,) in the
base frame; gripper (2,): distance of the pads, m, and the last command, -1 to 1.
"""

PROPRIOCEPTION = (STATE, VELOCITY, TOOL_POSE, GRIPPER)

CLOUD, CLOUD_SEGMENTATION = "point_cloud", "point_segmentation"
"""Names of cloud columns: (N, 6) float32, x, y, z in the base frame (m) and red, green, blue (0 to 1); (N,) int16 ids.
"""

ENVIRONMENT_STATE = "environment_state"
"""Name of the column for clouds of keypoints in exports: (3 N,) float32, x, y, z of each point in the base frame, m."""

IMAGE, DEPTH, SEGMENTATION = "image_", "depth_", "segmentation_"
"""Prefixes of camera columns: colour (H, W, 3) uint8; depth (H, W) uint16 in mm, 0 for nothing; ids (H, W) int16."""


def cloud_column(xyz: npt.NDArray[Any], rgb: npt.NDArray[np.uint8] | None) -> npt.NDArray[np.float32]:
    """Return point clouds as one array of an exported data set. The array (..., N, 6) contains the coordinates (m) and
    the colour (0 to 1) of each point. If ``rgb`` is None, the array (..., N, 3) contains only the coordinates.
    """
    points = xyz.astype(np.float32)
    return points if rgb is None else np.concatenate([points, rgb.astype(np.float32) / 255], axis=-1)


def depth_column(depth: npt.NDArray[np.float32]) -> npt.NDArray[np.uint16]:
    """Return depth in integer millimetres."""
    found: npt.NDArray[np.uint16] = np.rint(1000.0 * depth).astype(np.uint16)
    return found


Row = npt.NDArray[np.float32]


class Proprioception(Mapping[str, Row]):
    """State of the robot at one instant, as a mapping with the keys ``state`` (joint positions), ``velocity``,
    ``tool_pose`` and ``gripper``.

    ``tool_pose`` and ``gripper`` are computed on first access. Few controllers need them in every step, and the forward
    kinematics for the tool pose takes a tenth of the duration of a control step. Pickling converts the object to a
    plain dict, so that another process can unpickle it without the robot's profile.

    Args:
        profile: profile of the robot.
        positions: (n,) positions of all active joints, rad or m.
        velocities: (n,) velocities of all active joints, rad/s or m/s.
        command: last gripper command, -1 to 1.
    """

    def __init__(
        self, profile: RobotProfile, positions: npt.ArrayLike, velocities: npt.ArrayLike, command: float
    ) -> None:
        self._profile, self._command = profile, command
        self._rows = {
            STATE: np.array(positions, dtype=np.float32),
            VELOCITY: np.array(velocities, dtype=np.float32),
        }

    def __getitem__(self, name: str) -> Row:
        if name not in self._rows:
            self._rows[name] = self._worked_out(name)
        return self._rows[name]

    def _worked_out(self, name: str) -> Row:
        state = self._rows[STATE]
        if name == TOOL_POSE:
            return tool_pose(self._profile, state)
        if name == GRIPPER:
            width = self._profile.gripper.opening(state[self._profile.arm_size :].astype(np.float64))
            return np.array([width, self._command], dtype=np.float32)
        raise KeyError(name)

    def __iter__(self) -> Iterator[str]:
        return iter((STATE, VELOCITY, TOOL_POSE, GRIPPER))

    def __len__(self) -> int:
        return 4

    def __reduce__(self) -> tuple[type[dict[str, Row]], tuple[dict[str, Row]]]:
        return dict, (dict(self),)


def tool_pose(profile: RobotProfile, positions: npt.NDArray[np.float32]) -> Row:
    """Return the pose (7,) of the tool link in the base frame: x, y, z, qw, qx, qy, qz, with qw at least 0.

    Args:
        positions: (n,) all active joints, rad or m; or (N, n) for N poses (N, 7), which is much faster than N calls.
    """
    from scipy.spatial.transform import Rotation  # import late, because SciPy is slow to import

    T_base_tool = profile.model.forward_kinematics(positions.astype(np.float64), profile.tool_link)
    rotation = Rotation.from_matrix(T_base_tool[..., :3, :3], assume_valid=True)
    quaternion = rotation.as_quat(canonical=True, scalar_first=True)
    return np.concatenate([T_base_tool[..., :3, 3], quaternion], axis=-1).astype(np.float32)


Modality = Literal["pointcloud", "rgb", "depth", "segmentation"]
MODALITIES: tuple[Modality, ...] = get_args(Modality)
CAMERAS: tuple[str, ...] = tuple(PLACES)
"""Names of the fixed cameras; a robot may have others (:class:`~gensim2.robots.MountedCamera`)."""

_NAME = re.compile(r"[a-z][a-z0-9_]{0,39}")


@dataclass(frozen=True)
class ObservationSpec:
    """Contents of an observation: the modalities, the cameras, and the settings of the point cloud.

    In addition to the modalities, every observation contains the time, the joint positions, the tool pose, the gripper
    state and the instruction.

    Attributes:
        modalities: any of ``pointcloud``, ``depth``, ``segmentation`` and ``rgb``. The first three are computed by ray
            casting, and ``rgb`` images by the renderer. An empty tuple requests only the robot's state.
        cameras: names of the cameras. The spec sorts these names: first the fixed cameras, in the order of ``CAMERAS``,
            then the cameras on the robot, in the given order.
        cloud: settings of point clouds; the noise in these settings also applies to depth images.
    """

    modalities: tuple[Modality, ...] = ("pointcloud",)
    cameras: tuple[str, ...] = CAMERAS
    cloud: CloudSettings = field(default_factory=CloudSettings)

    def __post_init__(self) -> None:
        own = [word for word in self.cameras if word not in CAMERAS and _NAME.fullmatch(str(word))]
        choices = (("modalities", self.modalities, MODALITIES), ("cameras", self.cameras, (*CAMERAS, *own)))
        for name, given, known in choices:
            unknown = [word for word in given if word not in known]
            if unknown or len(set(given)) < len(given) or (name == "cameras" and not given):
                beside = " and the names of the robot's own cameras" if name == "cameras" else ""
                said = ", ".join(map(str, given)) or "nothing"
                raise InputError(
                    f"must be a list of different names from {', '.join(known)}{beside}, got {said}", field=name
                )
            # Normalize the order of names, so that equal specs compare equal.
            object.__setattr__(self, name, tuple(word for word in known if word in given))

    @property
    def casts(self) -> bool:
        """Whether any of the modalities needs ray casting."""
        rays = {"depth", "segmentation"} if self.is_privileged else {"pointcloud", "depth", "segmentation"}
        return bool(rays & set(self.modalities))

    @property
    def is_privileged(self) -> bool:
        """Whether the cloud consists of keypoints, which only a simulator knows."""
        return "pointcloud" in self.modalities and self.cloud.source != "depth"

    @property
    def is_proprioceptive(self) -> bool:
        return not self.modalities

    @staticmethod
    def of(values: ObservationSpec | Mapping[str, Any] | None) -> ObservationSpec:
        """Return a spec from plain data in the form that :meth:`to_dict` returns. If ``values`` is None, return the
        default spec.

        The fields of :class:`CloudSettings` may stand at the top level of ``values`` or in its field ``cloud``.

        Raises:
            InputError: a setting is unknown or invalid.
        """
        try:
            return ObservationSpec._of(values)
        except (TypeError, ValueError, OverflowError) as error:
            raise InputError(f"is invalid: {error}", field="observation") from error

    @staticmethod
    def _of(values: ObservationSpec | Mapping[str, Any] | None) -> ObservationSpec:
        if isinstance(values, ObservationSpec):
            return values
        if not isinstance(values, Mapping | None):
            raise InputError(f"must be a mapping, got {reprlib.repr(values)}", field="observation")
        given = dict(values or {})
        found: dict[str, Any] = {}
        for name in ("modalities", "cameras"):
            if name in given:
                words = given.pop(name)
                words = (words,) if isinstance(words, str) else words
                if not isinstance(words, list | tuple) or not all(isinstance(word, str) for word in words):
                    raise InputError(f"must be a list of names, got {reprlib.repr(words)}", field=f"observation.{name}")
                found[name] = tuple(words)
        cloud = given.pop("cloud", None)
        if isinstance(cloud, CloudSettings) and not given:
            return ObservationSpec(**found, cloud=cloud)
        if not isinstance(cloud, Mapping | None):
            raise InputError(f"must be a mapping, got {reprlib.repr(cloud)}", field="observation.cloud")
        return ObservationSpec(**found, cloud=CloudSettings.of({**(cloud or {}), **given}))

    def to_dict(self) -> dict[str, Any]:
        """Return the spec as plain data for JSON."""
        return {"modalities": list(self.modalities), "cameras": list(self.cameras), "cloud": self.cloud.to_dict()}

    def require(self, other: ObservationSpec, what: str, *, of: str) -> None:
        """Check that the spec ``other`` equals this spec.

        Args:
            other: spec to compare.
            what: description of the owner of ``other``, such as a data set or a checkpoint; the error message quotes
                it.
            of: description of the owner of this spec; the error message quotes it.

        Raises:
            InputError: the specs differ. The message names the first differing field and its two values.
        """
        mine, theirs = _flat(self.to_dict()), _flat(other.to_dict())
        for name in mine:
            if mine[name] != theirs[name]:
                raise InputError(
                    f"the value is {theirs[name]!r} in {what}, but {mine[name]!r} in {of}",
                    field=f"observation.{name}",
                    remedy="use the same observation settings for both",
                )


def _flat(values: Mapping[str, Any]) -> dict[str, Any]:
    cloud = {f"cloud.{name}": value for name, value in values["cloud"].items()}
    return {name: value for name, value in values.items() if name != "cloud"} | {"cloud.source": "depth"} | cloud


Array = npt.NDArray[Any]


@dataclass(frozen=True, eq=False)
class Observation(Mapping[str, Array]):
    """Observation of one instant. It is also a mapping that contains the arrays under the names that exported data sets
    use.

    Attributes:
        step: number of control steps since the reset.
        time: time since the reset, s.
        language: instruction of the task.
        arrays: arrays by name (:mod:`gensim2.perception.observation`), except the point cloud.
        cloud: point cloud; None if it was not requested.
        cameras: cameras of the observation by name, with intrinsics and poses in the base frame.
    """

    step: int
    time: float
    language: str
    arrays: Mapping[str, Array]
    cloud: PointCloud | None
    cameras: Mapping[str, Camera]

    @property
    def joint_positions(self) -> npt.NDArray[np.float32]:
        """Positions (n,) of all active joints, rad and m."""
        return self.arrays[STATE]

    @property
    def joint_velocities(self) -> npt.NDArray[np.float32]:
        return self.arrays[VELOCITY]

    @property
    def T_base_tool(self) -> npt.NDArray[np.float64]:
        """Return the tool pose (4, 4) in the robot's base frame."""
        pose = self.arrays[TOOL_POSE].astype(np.float64)
        found = np.eye(4)
        from scipy.spatial.transform import Rotation  # import late

        found[:3, :3] = Rotation.from_quat(pose[3:], scalar_first=True).as_matrix()
        found[:3, 3] = pose[:3]
        return found

    @property
    def gripper_width(self) -> float:
        """Distance of the finger pads, m."""
        return float(self.arrays[GRIPPER][0])

    @property
    def gripper_command(self) -> float:
        """Last gripper command, from -1 (closed) to 1 (open)."""
        return float(self.arrays[GRIPPER][1])

    def _own_names(self) -> tuple[str, ...]:
        if self.cloud is None:
            return ()
        return (CLOUD,) if self.cloud.segmentation is None else (CLOUD, CLOUD_SEGMENTATION)

    def __getitem__(self, name: str) -> Array:
        if name in self._own_names():
            assert self.cloud is not None
            if name == CLOUD:
                return cloud_column(self.cloud.xyz, self.cloud.rgb)
            assert self.cloud.segmentation is not None
            return self.cloud.segmentation
        return self.arrays[name]

    def __iter__(self) -> Iterator[str]:
        yield from self.arrays
        yield from self._own_names()

    def __len__(self) -> int:
        return len(self.arrays) + len(self._own_names())


class Encoder:
    """Computes the observations of one robot for one spec.

    Args:
        language: instruction of the task.
        robot: segmentation ids of the robot; None: the robot is not distinguished from objects.
    """

    def __init__(
        self, spec: ObservationSpec, profile: RobotProfile, language: str = "", robot: RobotSegments | None = None
    ) -> None:
        self.spec, self._profile, self._language, self._robot = spec, profile, language, robot

    def encode(
        self,
        step: int,
        positions: npt.ArrayLike,
        velocities: npt.ArrayLike,
        command: float,
        views: Sequence[View] = (),
        pictures: Mapping[str, npt.NDArray[np.uint8]] | None = None,
        known: PointCloud | None = None,
    ) -> Observation:
        """Return the observation of one instant.

        Args:
            step: number of control steps since the reset.
            positions, velocities: (n,) positions and velocities of all active joints.
            command: last gripper command, -1 to 1.
            views: images of the cameras, for all modalities except ``rgb``.
            pictures: colour images (H, W, 3) by camera, for ``rgb``.
            known: cloud of keypoints, for specs with the source ``keypoints``.

        Raises:
            EmptyCloudError: the point cloud is empty.
        """
        modalities = self.spec.modalities
        own = Proprioception(self._profile, positions, velocities, command)
        seen: dict[str, Any] = {}
        for view in views:
            name = view.camera.name
            if "depth" in modalities:
                seen[DEPTH + name] = depth_column(view.depth)
            if "segmentation" in modalities:
                if view.segmentation is None:
                    raise GenSim2Error(f"the camera {name!r} provides no segmentation")
                seen[SEGMENTATION + name] = view.segmentation
        if "rgb" in modalities:
            if pictures is None:
                raise GenSim2Error("colour pictures need a renderer, but none was given")
            for name in self.spec.cameras:
                seen[IMAGE + name] = pictures[name]
        cloud = known
        if "pointcloud" in modalities:
            if self.spec.cloud.source == "depth":
                cloud = point_cloud(views, self.spec.cloud, self._robot)
            elif known is None:
                raise GenSim2Error("point clouds of keypoints are available in simulation only")
        return Observation(
            step=step,
            time=step / self._profile.control_hz,
            language=self._language,
            arrays={**own, **seen} if seen else own,
            cloud=cloud,
            cameras={view.camera.name: view.camera for view in views},
        )
