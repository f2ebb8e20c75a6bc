"""Objects as they stand in a simulated scene, whoever built it: what is read of them, and what moves them."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import numpy as np
import numpy.typing as npt
import sapien
from sapien import physx

from gensim2.objects import RigidObject
from gensim2.objects.rigid import BODY
from gensim2.objects.types import ArticulatedObject
from gensim2.planning.scene import JointState, SceneBody, SceneObject
from gensim2.scenes.initial_state import PlacedObject
from gensim2.scenes.randomize import placed
from gensim2.sim.lazy_mapping import LazyMapping
from gensim2.sim.objects import link_name
from gensim2.sim.physics import JointResistance

Array = npt.NDArray[np.float64]
Row = npt.NDArray[np.float32]


class ArticulatedPart:
    """An articulated object in a scene.

    Args:
        name: its role in the task.
        thing: the object and where it was put.
        articulation: as it was built.
        resistance: of its joint.
        warnings: of building it.
    """

    def __init__(
        self,
        name: str,
        thing: PlacedObject,
        articulation: physx.PhysxArticulation,
        resistance: JointResistance,
        warnings: tuple[str, ...] = (),
    ) -> None:
        assert isinstance(thing.model, ArticulatedObject)
        self.name, self.thing, self.model = name, thing, thing.model
        self.articulation, self.warnings = articulation, warnings
        self.before_substep = resistance.update
        self._links = {link_name(link): link for link in articulation.links}

    # ------------------------------------------------------------------- time

    def put(self) -> None:
        """Open it as far as it was drawn."""
        self.articulation.qpos = np.array([self.thing.joint_value], dtype=np.float32)

    def nudge(self, dx: float, dy: float, dyaw: float) -> None:
        """Shift it by metres in the world, and turn it by rad about the vertical through its root."""
        self.articulation.pose = _shifted(self.articulation.pose, dx, dy, dyaw)

    # ------------------------------------------------------------ measurement

    @property
    def openness(self) -> float:
        """(q - lower) / (upper - lower); may leave 0..1 by the joint's give."""
        joint = self.model.joint
        return (float(self.articulation.qpos[0]) - joint.lower) / (joint.upper - joint.lower)

    @property
    def joint_speed(self) -> float:
        """Openness per second."""
        joint = self.model.joint
        return float(self.articulation.qvel[0]) / (joint.upper - joint.lower)

    @property
    def is_finite(self) -> bool:
        """Whether physics still gives numbers for its root."""
        return bool(np.isfinite(pose_row(self.articulation.root.entity)).all())

    def keypoints(self) -> Mapping[str, Array]:
        """(3,) each, in the world, m."""
        poses = {name: self._links[name].entity.pose for name in self._keypoint_links}

        def work_out() -> dict[str, Array]:
            links = {name: as_matrix(pose) for name, pose in poses.items()}
            return {name: _moved(links[point.link], point.position) for name, point in self.model.keypoints.items()}

        return LazyMapping(work_out)

    @cached_property
    def _keypoint_links(self) -> frozenset[str]:
        return frozenset(point.link for point in self.model.keypoints.values())

    def state(self) -> Row:
        """(15,) ManiSkill's: root pose, root velocities, qpos, qvel."""
        return articulation_state(self.articulation)

    def observed(self) -> dict[str, Row]:
        """Return its part of state observations: openness (1,), qpos (1,), poses of root and moving link (7,), in the
        world."""
        return {
            "openness": np.array([self.openness], dtype=np.float32),
            "qpos": np.asarray(self.articulation.qpos, dtype=np.float32),
            "pose": pose_row(self.articulation.root.entity),
            "moving_link_pose": pose_row(self._links[self.model.joint.child_link].entity),
        }

    def scene_object(self, T_base_world: Array) -> SceneObject:
        """It as the planner sees it."""
        poses = {name: T_base_world @ matrix(link.entity) for name, link in self._links.items()}
        joint = self.model.joint
        T_base_root = poses[link_name(self.articulation.root)]
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
                value=float(self.articulation.qpos[0]),
                lower=joint.lower,
                upper=joint.upper,
                moves=tuple(body.name for link, body in bodies.items() if link in self._moving),
            ),
            object_axis=self.model.object_axis,
            yaw=self.thing.yaw,
        )

    @cached_property
    def _moving(self) -> set[str]:
        """Names of the joint's link and of everything fixed beneath it."""
        moved = {self.model.joint.child_link}
        for name, link in self._links.items():  # parents come before their children
            if link.parent is not None and link_name(link.parent) in moved:
                moved.add(name)
        return moved


class RigidPart:
    """A rigid object in a scene.

    Args:
        name: its role in the task.
        thing: the object and where it was put.
        entity: as it was built.
    """

    warnings: tuple[str, ...] = ()

    def __init__(self, name: str, thing: PlacedObject, entity: sapien.Entity) -> None:
        assert isinstance(thing.model, RigidObject)
        self.name, self.thing, self.model, self.entity = name, thing, thing.model, entity
        self.body: physx.PhysxRigidDynamicComponent = entity.find_component_by_type(physx.PhysxRigidDynamicComponent)

    # ------------------------------------------------------------------- time

    def put(self) -> None:
        """It stands where it was built."""

    def before_substep(self) -> None:
        """Nothing acts on it but contacts and gravity."""

    def nudge(self, dx: float, dy: float, dyaw: float) -> None:
        """Shift it by metres in the world, and turn it by rad about the vertical through its origin; it is at rest."""
        self.entity.pose = _shifted(self.entity.pose, dx, dy, dyaw)
        self.body.linear_velocity = self.body.angular_velocity = np.zeros(3, dtype=np.float32)
        self.body.wake_up()

    # ------------------------------------------------------------ measurement

    @property
    def pose(self) -> Array:
        """(7,) in the world: x, y, z, qw, qx, qy, qz."""
        return pose_row(self.entity).astype(np.float64)

    @property
    def speeds(self) -> Array:
        """(2,) m/s of its centre of mass, and rad/s."""
        velocities = (self.body.linear_velocity, self.body.angular_velocity)
        return np.array([np.linalg.norm(np.asarray(velocity, dtype=np.float64)) for velocity in velocities])

    @property
    def is_finite(self) -> bool:
        """Whether physics still gives numbers for it."""
        return bool(np.isfinite(pose_row(self.entity)).all())

    def keypoints(self) -> Mapping[str, Array]:
        """(3,) each, in the world, m."""
        pose = self.entity.pose

        def work_out() -> dict[str, Array]:
            body = as_matrix(pose)
            return {name: _moved(body, point.position) for name, point in self.model.keypoints.items()}

        return LazyMapping(work_out)

    def state(self) -> Row:
        """(13,) ManiSkill's: pose and velocities."""
        velocity = [self.body.linear_velocity, self.body.angular_velocity]
        return np.concatenate([pose_row(self.entity), *velocity]).astype(np.float32)

    def observed(self) -> dict[str, Row]:
        """Return its part of state observations: its pose (7,) in the world."""
        return {"pose": pose_row(self.entity)}

    def scene_object(self, T_base_world: Array) -> SceneObject:
        """It as the planner sees it."""
        pose = T_base_world @ matrix(self.entity)
        return SceneObject(
            name=self.name,
            bodies=(SceneBody(self.name, self.model.hulls[BODY], pose),),
            T_base_object=pose,
            keypoints={name: _moved(pose, point.position) for name, point in self.model.keypoints.items()},
            yaw=self.thing.yaw,
            center_of_mass=self.model.center_of_mass,
            mass=float(self.body.mass),
            friction=float(self.body.collision_shapes[0].physical_material.dynamic_friction),
        )


Part = ArticulatedPart | RigidPart
Parts = Mapping[str, Part]


def pose_row(entity: sapien.Entity) -> Row:
    """(7,) pose in the world as ManiSkill writes it: position, quaternion (w, x, y, z)."""
    pose = entity.pose
    return np.concatenate([pose.p, pose.q])


def matrix(entity: sapien.Entity) -> Array:
    """(4, 4) pose in the world."""
    return as_matrix(entity.pose)


def as_matrix(pose: sapien.Pose) -> Array:
    """(4, 4) of a pose."""
    return np.asarray(pose.to_transformation_matrix(), dtype=np.float64)


def articulation_state(articulation: physx.PhysxArticulation) -> Row:
    """(13 + 2 n,) ManiSkill's: root pose, root velocities, qpos, qvel."""
    root = articulation.root
    velocity = [root.linear_velocity, root.angular_velocity]
    return np.concatenate([pose_row(root.entity), *velocity, articulation.qpos, articulation.qvel]).astype(np.float32)


def _moved(pose: Array, point: Array) -> Array:
    return np.asarray(pose[:3, :3] @ point + pose[:3, 3], dtype=np.float64)


def _shifted(pose: sapien.Pose, dx: float, dy: float, dyaw: float) -> sapien.Pose:
    return sapien.Pose(*placed(np.asarray(pose.p, np.float64), np.asarray(pose.q, np.float64), dx, dy, dyaw))
