"""Observations: spec, columns of arrays, proprioception, and their encoder."""

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
"""(n,) joint positions, rad and m; (n,) their velocities; (7,) tool in the base frame; (2,) pad distance, m, and the
last command, -1 to 1. All float32."""

PROPRIOCEPTION = (STATE, VELOCITY, TOOL_POSE, GRIPPER)

CLOUD, CLOUD_SEGMENTATION = "point_cloud", "point_segmentation"
"""(N, 6) float32: x, y, z in the base frame, m, then red, green, blue from 0 to 1; (N,) int16 ids."""

ENVIRONMENT_STATE = "environment_state"
"""(3 N,) float32 in exports, where clouds are made of keypoints: x, y, z of each in the base frame, m."""

IMAGE, DEPTH, SEGMENTATION = "image_", "depth_", "segmentation_"
"""Before a camera's name: (H, W, 3) uint8; (H, W) uint16, mm, 0 where nothing is seen; (H, W) int16 ids."""


def cloud_column(xyz: npt.NDArray[Any], rgb: npt.NDArray[np.uint8] | None) -> npt.NDArray[np.float32]:
    """(..., N, 6) float32 coordinates in m and colours from 0 to 1; (..., N, 3) where there are no colours."""
    points = xyz.astype(np.float32)
    return points if rgb is None else np.concatenate([points, rgb.astype(np.float32) / 255], axis=-1)


def depth_column(depth: npt.NDArray[np.float32]) -> npt.NDArray[np.uint16]:
    """Depth (m) in whole millimetres."""
    found: npt.NDArray[np.uint16] = np.rint(1000.0 * depth).astype(np.uint16)
    return found


Row = npt.NDArray[np.float32]


class Proprioception(Mapping[str, Row]):
    """``state``, ``velocity``, ``tool_pose`` and ``gripper`` of one instant (:mod:`gensim2.perception.observation`).

    The last two are worked out on first access: few controllers look at them every step, and a pose of the tool costs
    a tenth of a control step. Pickles as a dict.

    Args:
        profile: of the robot.
        positions, velocities: (n,) of all active joints, rad and m, and a second.
        command: the gripper's last, -1 to 1.
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
    """(7,) of the tool link in the base frame: x, y, z, qw, qx, qy, qz, with qw at least 0.

    Args:
        positions: (n,) all active joints, rad and m; or (N, n), which gives (N, 7), the same numbers at a small part of
            the cost.
    """
    from scipy.spatial.transform import Rotation  # here: who refuses an argument needs it not

    T_base_tool = profile.model.forward_kinematics(positions.astype(np.float64), profile.tool_link)
    rotation = Rotation.from_matrix(T_base_tool[..., :3, :3], assume_valid=True)
    quaternion = rotation.as_quat(canonical=True, scalar_first=True)
    return np.concatenate([T_base_tool[..., :3, 3], quaternion], axis=-1).astype(np.float32)


Modality = Literal["pointcloud", "rgb", "depth", "segmentation"]
MODALITIES: tuple[Modality, ...] = get_args(Modality)
CAMERAS: tuple[str, ...] = tuple(PLACES)
"""The fixed ones; a robot may carry others (:class:`~gensim2.robots.MountedCamera`)."""

_NAME = re.compile(r"[a-z][a-z0-9_]{0,39}")


@dataclass(frozen=True)
class ObservationSpec:
    """Modalities, cameras and cloud settings of an observation, beside what each one holds: time, joints, tool pose,
    gripper, the sentence.

    Attributes:
        modalities: ``pointcloud``, ``depth`` and ``segmentation`` by ray casting, ``rgb`` by the renderer; none of
            them: the robot's own state alone.
        cameras: names of those that are used: the fixed ones in their order, then the robot's own as they were given.
        cloud: how point clouds are made; its noise is on depth pictures, too.
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
                beside = " or names of the robot's own" if name == "cameras" else ""
                said = ", ".join(map(str, given)) or "nothing"
                raise InputError(f"must be some of {', '.join(known)}{beside}, each once, is {said}", field=name)
            # One spelling of one spec, however it was given.
            object.__setattr__(self, name, tuple(word for word in known if word in given))

    @property
    def casts(self) -> bool:
        """Whether any of it comes from rays."""
        rays = {"depth", "segmentation"} if self.is_privileged else {"pointcloud", "depth", "segmentation"}
        return bool(rays & set(self.modalities))

    @property
    def is_privileged(self) -> bool:
        """Whether the cloud is made of what only a simulator knows."""
        return "pointcloud" in self.modalities and self.cloud.source != "depth"

    @property
    def is_proprioceptive(self) -> bool:
        """Whether no camera is looked through."""
        return not self.modalities

    @staticmethod
    def of(values: ObservationSpec | Mapping[str, Any] | None) -> ObservationSpec:
        """A spec from plain data, as :meth:`to_dict` gives it; fields of :class:`CloudSettings` may stand in it
        directly. None: the default.

        Raises:
            InputError: there is no such setting, or it cannot be so.
        """
        try:
            return ObservationSpec._of(values)
        except (TypeError, ValueError, OverflowError) as error:  # a value of another type than its setting's
            raise InputError(f"cannot be so: {error}", field="observation") from error

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
        """Plain data, for JSON."""
        return {"modalities": list(self.modalities), "cameras": list(self.cameras), "cloud": self.cloud.to_dict()}

    def require(self, other: ObservationSpec, what: str, *, of: str) -> None:
        """Refuse to use with one spec what goes by another.

        Args:
            other: the spec that must be this one.
            what: goes by ``other``, for the message.
            of: what goes by this one.

        Raises:
            InputError: names the first field that differs, and both values.
        """
        mine, theirs = _flat(self.to_dict()), _flat(other.to_dict())
        for name in mine:
            if mine[name] != theirs[name]:
                raise InputError(
                    f"{what} has {theirs[name]!r}, {of} has {mine[name]!r}",
                    field=f"observation.{name}",
                    remedy="observe both alike",
                )


def _flat(values: Mapping[str, Any]) -> dict[str, Any]:
    cloud = {f"cloud.{name}": value for name, value in values["cloud"].items()}
    return {name: value for name, value in values.items() if name != "cloud"} | {"cloud.source": "depth"} | cloud


Array = npt.NDArray[Any]


@dataclass(frozen=True, eq=False)
class Observation(Mapping[str, Array]):
    """Observation of one instant; as a mapping, arrays by the names that they have in exports.

    Attributes:
        step: control steps since the reset.
        time: seconds since the reset.
        language: what is to be done, a sentence.
        arrays: by name (:mod:`gensim2.perception.observation`), but for the point cloud.
        cloud: the point cloud; None where none was asked for.
        cameras: those that were looked through, by name: intrinsics, and poses in the base frame.
    """

    step: int
    time: float
    language: str
    arrays: Mapping[str, Array]
    cloud: PointCloud | None
    cameras: Mapping[str, Camera]

    @property
    def joint_positions(self) -> npt.NDArray[np.float32]:
        """(n,) of all active joints, rad and m."""
        return self.arrays[STATE]

    @property
    def joint_velocities(self) -> npt.NDArray[np.float32]:
        """(n,) rad/s and m/s."""
        return self.arrays[VELOCITY]

    @property
    def T_base_tool(self) -> npt.NDArray[np.float64]:
        """(4, 4) tool in the robot's base frame."""
        pose = self.arrays[TOOL_POSE].astype(np.float64)
        found = np.eye(4)
        from scipy.spatial.transform import Rotation  # here: who refuses an argument needs it not

        found[:3, :3] = Rotation.from_quat(pose[3:], scalar_first=True).as_matrix()
        found[:3, 3] = pose[:3]
        return found

    @property
    def gripper_width(self) -> float:
        """Distance of the pads, m."""
        return float(self.arrays[GRIPPER][0])

    @property
    def gripper_command(self) -> float:
        """The last command, from -1 (closed) to 1 (open)."""
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
    """Observations of one robot by one spec, whoever drives it.

    Args:
        spec: what is seen.
        profile: of the robot.
        language: what is to be done.
        robot: ids by which segmentation knows the robot; None: it is kept as anything else is.
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
        """The observation of one instant.

        Args:
            step: control steps since the reset.
            positions, velocities: (n,) of all active joints.
            command: the gripper's last, -1 to 1.
            views: the cameras' pictures, for all that is not ``rgb``.
            pictures: (H, W, 3) by camera, for ``rgb``.
            known: cloud that is not made of the cameras' pictures, of a spec that says so.

        Raises:
            EmptyCloudError: the cameras see nothing that a point cloud keeps.
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
                    raise GenSim2Error(f"the camera {name!r} gives no segmentation")
                seen[SEGMENTATION + name] = view.segmentation
        if "rgb" in modalities:
            if pictures is None:
                raise GenSim2Error("there are no colour pictures: no renderer was given")
            for name in self.spec.cameras:
                seen[IMAGE + name] = pictures[name]
        cloud = known
        if "pointcloud" in modalities:
            if self.spec.cloud.source == "depth":
                cloud = point_cloud(views, self.spec.cloud, self._robot)
            elif known is None:
                raise GenSim2Error("only a simulator knows the keypoints that the point cloud is to be made of")
        return Observation(
            step=step,
            time=step / self._profile.control_hz,
            language=self._language,
            arrays={**own, **seen} if seen else own,
            cloud=cloud,
            cameras={view.camera.name: view.camera for view in views},
        )
