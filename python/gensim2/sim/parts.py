"""Define the interface of objects in a simulated scene, independently of the engine.

Each engine has a subclass of :class:`ArticulatedPart` and of :class:`RigidPart`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from functools import cached_property
from typing import Generic, Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from gensim2.core.arrays import Array
from gensim2.objects import RigidObject
from gensim2.objects.types import BODY, ArticulatedObject
from gensim2.planning.scene import JointState, SceneBody, SceneObject
from gensim2.scenes.geometry import measured_link
from gensim2.scenes.initial_state import PlacedObject

Row = npt.NDArray[np.float32]


Value = TypeVar("Value")


class LazyMapping(Mapping[str, Value], Generic[Value]):
    """Mapping that computes all its values at the first access. A mapping that is never read costs no time.

    Args:
        work_out: function that computes all values from stored data, because the simulator may have moved on by then.
    """

    def __init__(self, work_out: Callable[[], Mapping[str, Value]]) -> None:
        self._work_out = work_out

    @cached_property
    def _values(self) -> Mapping[str, Value]:
        return self._work_out()

    def __getitem__(self, name: str) -> Value:
        return self._values[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __repr__(self) -> str:
        return repr(dict(self._values))

    def __reduce__(self) -> tuple[type[dict[str, Value]], tuple[Mapping[str, Value]]]:
        return dict, (dict(self._values),)  # pickle this mapping as a plain dict


class Frame(Protocol):
    """Copy of a link's pose in the world frame at the instant at which it was read."""

    def row(self) -> Row:
        """Return the pose (7,): position, quaternion (w, x, y, z)."""

    def matrix(self) -> Array:
        """Return the pose as a matrix (4, 4)."""


class ArticulatedPart(ABC):
    """An articulated object in a scene.

    Args:
        name: name of the object in the task.
        thing: object to build, with its initial pose.
        parents: name of each link's parent, None for the root; parents come before their children.
        warnings: warnings from building the object.
    """

    def __init__(
        self, name: str, thing: PlacedObject, parents: Mapping[str, str | None], warnings: tuple[str, ...] = ()
    ) -> None:
        assert isinstance(thing.model, ArticulatedObject)
        self.name, self.thing, self.model = name, thing, thing.model
        self.warnings = warnings
        self._parents = parents
        self._root = next(link for link, parent in parents.items() if parent is None)

    @abstractmethod
    def put(self) -> None:
        """Set the joint to its initial openness."""

    @abstractmethod
    def nudge(self, dx: float, dy: float, dyaw: float) -> None:
        """Move the object by dx and dy (m, world frame).

        Rotate it by dyaw (rad) about the vertical axis through its root.
        """

    @property
    @abstractmethod
    def qpos(self) -> Row:
        """Joint value (1,), rad or m."""

    @property
    @abstractmethod
    def qvel(self) -> Row:
        """Joint velocity (1,), rad/s or m/s."""

    @abstractmethod
    def frame(self, link: str) -> Frame:
        """Return the pose of a link at this instant."""

    def measured_frame(self) -> Frame:
        """Return the pose of the link with the object's last keypoint, whose position the success criteria measure."""
        return self.frame(measured_link(self.model))

    @abstractmethod
    def state(self) -> Row:
        """Return ManiSkill's state (15,): root pose, root velocities, qpos, qvel."""

    @property
    def openness(self) -> float:
        """Joint position as a share of its range, (q - lower) / (upper - lower).

        The share may lie slightly outside 0..1.
        """
        joint = self.model.joint
        return (float(self.qpos[0]) - joint.lower) / (joint.upper - joint.lower)

    @property
    def joint_speed(self) -> float:
        """Velocity of the joint, in openness per second."""
        joint = self.model.joint
        return float(self.qvel[0]) / (joint.upper - joint.lower)

    @property
    def is_finite(self) -> bool:
        """Return whether root pose and joint value are finite."""
        return bool(np.isfinite(self.frame(self._root).row()).all() and np.isfinite(self.qpos).all())

    def keypoints(self) -> Mapping[str, Array]:
        """Return the keypoints (3,) in the world frame, m."""
        frames = {name: self.frame(name) for name in self._keypoint_links}

        def work_out() -> dict[str, Array]:
            links = {name: frame.matrix() for name, frame in frames.items()}
            return {name: _moved(links[point.link], point.position) for name, point in self.model.keypoints.items()}

        return LazyMapping(work_out)

    @cached_property
    def _keypoint_links(self) -> frozenset[str]:
        return frozenset(point.link for point in self.model.keypoints.values())

    def observed(self) -> dict[str, Row]:
        """Return the state observation: openness (1,), qpos (1,), world poses (7,) of root and moving link."""
        return {
            "openness": np.array([self.openness], dtype=np.float32),
            "qpos": np.asarray(self.qpos, dtype=np.float32),
            "pose": self.frame(self._root).row(),
            "moving_link_pose": self.frame(self.model.joint.child_link).row(),
        }

    def scene_object(self, T_base_world: Array) -> SceneObject:
        poses = {name: T_base_world @ self.frame(name).matrix() for name in self._parents}
        joint = self.model.joint
        T_base_root = poses[self._root]
        bodies = {
            link: SceneBody(f"{self.name}/{link}", hulls, poses[link])
            for link, hulls in self.model.hulls.items()
            if hulls
        }
        axis = T_base_root[:3, :3] @ joint.axis
        return SceneObject(
            name=self.name,
            bodies=tuple(bodies.values()),
            T_base_object=poses[joint.child_link] @ self.model.T_link_object,
            keypoints={n: _moved(poses[point.link], point.position) for n, point in self.model.keypoints.items()},
            joint=JointState(
                type=joint.type,
                origin=_moved(T_base_root, joint.origin),
                axis=np.asarray(axis / np.linalg.norm(axis), dtype=np.float64),
                value=float(self.qpos[0]),
                lower=joint.lower,
                upper=joint.upper,
                moves=tuple(body.name for link, body in bodies.items() if link in self._moving),
            ),
            object_axis=self.model.object_axis,
            yaw=self.thing.yaw,
        )

    @cached_property
    def _moving(self) -> set[str]:
        """Return the names of the links that the joint moves."""
        moved = {self.model.joint.child_link}
        for link, parent in self._parents.items():
            if parent in moved:
                moved.add(link)
        return moved


class RigidPart(ABC):
    """A rigid object in a scene.

    Args:
        name: name of the object in the task.
        thing: the object and its initial pose.
    """

    warnings: tuple[str, ...] = ()

    def __init__(self, name: str, thing: PlacedObject) -> None:
        assert isinstance(thing.model, RigidObject)
        self.name, self.thing, self.model = name, thing, thing.model

    @abstractmethod
    def put(self) -> None:
        """Move the object to its initial pose."""

    @abstractmethod
    def nudge(self, dx: float, dy: float, dyaw: float) -> None:
        """Move the object by dx and dy (m, world frame), rotate it by dyaw (rad) about the vertical, and stop it."""

    @abstractmethod
    def frame(self) -> Frame:
        """Return the pose of the body at this instant."""

    def measured_frame(self) -> Frame:
        """Return the pose of the frame of the keypoints, which is the only body of a rigid object."""
        return self.frame()

    @abstractmethod
    def velocities(self) -> tuple[npt.NDArray[np.floating], npt.NDArray[np.floating]]:
        """Return the velocity (3,) of the centre of mass and the angular velocity (3,), m/s and rad/s, world frame."""

    @property
    @abstractmethod
    def mass(self) -> float:
        """Mass in the simulation, kg."""

    @property
    @abstractmethod
    def friction(self) -> float:
        """Friction coefficient in the simulation."""

    @property
    def pose(self) -> Array:
        """Pose (7,) in the world frame: x, y, z, qw, qx, qy, qz."""
        return self.frame().row().astype(np.float64)

    @property
    def speeds(self) -> Array:
        """Array (2,) with the speed of the centre of mass (m/s) and the angular speed (rad/s)."""
        return np.array([np.linalg.norm(np.asarray(velocity, dtype=np.float64)) for velocity in self.velocities()])

    @property
    def is_finite(self) -> bool:
        return bool(np.isfinite(self.frame().row()).all())

    def keypoints(self) -> Mapping[str, Array]:
        frame = self.frame()

        def work_out() -> dict[str, Array]:
            body = frame.matrix()
            return {name: _moved(body, point.position) for name, point in self.model.keypoints.items()}

        return LazyMapping(work_out)

    def state(self) -> Row:
        """Return ManiSkill's state (13,): pose and velocities."""
        return np.concatenate([self.frame().row(), *self.velocities()]).astype(np.float32)

    def observed(self) -> dict[str, Row]:
        """Return the state observation: the pose (7,) in the world frame."""
        return {"pose": self.frame().row()}

    def scene_object(self, T_base_world: Array) -> SceneObject:
        pose = T_base_world @ self.frame().matrix()
        return SceneObject(
            name=self.name,
            bodies=(SceneBody(self.name, self.model.hulls[BODY], pose),),
            T_base_object=pose,
            keypoints={name: _moved(pose, point.position) for name, point in self.model.keypoints.items()},
            yaw=self.thing.yaw,
            center_of_mass=self.model.center_of_mass,
            mass=self.mass,
            friction=self.friction,
        )


Part = ArticulatedPart | RigidPart
Parts = Mapping[str, Part]


def _moved(pose: Array, point: Array) -> Array:
    return np.asarray(pose[:3, :3] @ point + pose[:3, 3], dtype=np.float64)
