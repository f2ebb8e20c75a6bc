"""Physics by switches: each the default, or as the original GenSim2 has it.

All that differs in a simulator is here: PhysX's settings, joint resistance, masses, contact materials and the fingers'
drives. Both environments ask the same :class:`Physics` for it, so they stay the same.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import replace
from functools import cache
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
from mani_skill.utils.structs.types import DefaultMaterialsConfig, SceneConfig, SimConfig
from sapien import physx
from sapien.wrapper.urdf_loader import URDFLoader

from gensim2.objects import RigidObject
from gensim2.objects.types import ArticulatedObject, MovingJoint
from gensim2.robots import RobotProfile
from gensim2.scenes.physics import DEFAULT_PHYSICS, physics_name, physics_switches
from gensim2.scenes.randomize import AS_IT_IS, Factors
from gensim2.sim import original
from gensim2.sim.gripper import robot_joints

Array = npt.NDArray[np.float64]

RIGID_CONTACT_OFFSET = 0.005
"""Metres, of every shape in a scene with rigid objects and our solver. With ManiSkill's 20 mm each finger is in
speculative contact with some 60 hulls of a bowl at once, and PhysX throws the bowl although nothing touches it."""

CREEP_SPEED = 5e-5
"""Speed, rad/s or m/s, at which our friction gives its full torque: an object left alone creeps slower."""


class JointResistance(Protocol):
    """Resistance of an object's joint."""

    def update(self) -> None:
        """To be called before each physics step."""


class Physics:
    """Physics by its switches; :func:`named_physics` gives it by name.

    Args:
        name: the word for its switches (:mod:`gensim2.scenes.physics`).

    Attributes:
        name: the same.
        switches: what it is made of.
        scene_config: PhysX's settings, as ManiSkill takes them.
        material: of what says nothing of its own.

    Raises:
        InputError: there is no such physics.
    """

    def __init__(self, name: str) -> None:
        self.name, self.switches = name, physics_switches(name)
        self._constants = constants = original.constants()
        self.scene_config = (
            SceneConfig(**constants.scene)
            if self.switches.solver == "original"
            else SceneConfig(
                enable_tgs=True, enable_pcm=True, solver_position_iterations=15, solver_velocity_iterations=1
            )
        )
        self.material = (
            DefaultMaterialsConfig(**constants.material)
            if self.switches.materials == "original"
            else DefaultMaterialsConfig()
        )

    def sim_config(self, robot: RobotProfile) -> SimConfig:
        """Return ManiSkill's settings: these, and the robot's rates."""
        return SimConfig(
            sim_freq=robot.simulation.physics_hz,
            control_freq=robot.control_hz,
            scene_config=self.scene_config,
            default_materials_config=self.material,
        )

    def new_system(self, robot: RobotProfile) -> physx.PhysxCpuSystem:
        """A PhysX system with these settings at the robot's rate, as ManiSkill makes one."""
        scene = self.scene_config
        physx.set_shape_config(contact_offset=scene.contact_offset, rest_offset=scene.rest_offset)
        physx.set_body_config(
            solver_position_iterations=scene.solver_position_iterations,
            solver_velocity_iterations=scene.solver_velocity_iterations,
            sleep_threshold=scene.sleep_threshold,
        )
        physx.set_scene_config(
            gravity=scene.gravity,
            bounce_threshold=scene.bounce_threshold,
            enable_pcm=scene.enable_pcm,
            enable_tgs=scene.enable_tgs,
            enable_ccd=scene.enable_ccd,
            enable_enhanced_determinism=scene.enable_enhanced_determinism,
            enable_friction_every_iteration=scene.enable_friction_every_iteration,
            cpu_workers=scene.cpu_workers,
        )
        physx.set_default_material(**self.material.dict())
        system = physx.PhysxCpuSystem()
        system.timestep = 1.0 / robot.simulation.physics_hz
        return system

    def prepare_for_rigid_objects(
        self,
        system: physx.PhysxCpuSystem,
        robot: physx.PhysxArticulation | None,
        profile: RobotProfile,
        classes: Collection[str] = (),
    ) -> None:
        """Prepare a scene with rigid objects, once it is built.

        Args:
            system: of the scene.
            robot: None in a scene without one.
            profile: of the robot.
            classes: of the rigid objects.
        """
        if self.switches.solver == "default":
            for body in (
                *system.articulation_link_components,
                *system.rigid_dynamic_components,
                *system.rigid_static_components,
            ):
                for shape in body.collision_shapes:
                    shape.contact_offset = RIGID_CONTACT_OFFSET
        if robot is None:
            return
        constants = self._constants
        if self.switches.gripper == "soft":
            _drive_fingers(robot, profile, **constants.picking_fingers)
        elif self.switches.gripper == "original":
            stiff = next((constants.fingers_for[name] for name in classes if name in constants.fingers_for), None)
            if stiff is not None:
                _drive_fingers(robot, profile, **stiff)

    def prepare_robot(self, robot: physx.PhysxArticulation, profile: RobotProfile) -> None:
        """Give a robot's links their contact materials and its fingers their drives, once it is built."""
        if self.switches.materials == "original":
            material = self._material()
            for link in robot.links:
                for shape in link.collision_shapes:
                    shape.set_physical_material(material)
        drive = profile.finger_drive
        if self.switches.gripper == "soft":
            # No more damping than the drive has: profiles with the original's own fingers have none.
            _drive_fingers(robot, profile, drive.stiffness, min(drive.damping, self._constants.finger_damping))
        elif self.switches.gripper == "original":
            _drive_fingers(robot, profile, **self._constants.fingers)

    def prepare_loader(self, loader: URDFLoader, asset_class: str) -> None:
        """Say what the links of an articulated object weigh, before its URDF is parsed."""
        if self.switches.densities == "default":
            return
        loader.set_density(self._constants.density(asset_class))
        build_link = loader._build_link

        def without_inertial(link: Any, builder: Any) -> None:
            link.inertial = None  # PhysX then makes mass and inertia of the hulls
            build_link(link, builder)

        loader._build_link = without_inertial

    def resist(
        self, articulation: physx.PhysxArticulation, instance: ArticulatedObject, factors: Factors = AS_IT_IS
    ) -> JointResistance:
        """Give the joint of an articulated object, as it was built, its resistance."""
        if self.switches.joint_friction == "original":
            coefficient = self._constants.joint_friction(instance.asset_class)
            return CoefficientFriction(articulation, factors.joint_friction * coefficient)
        # It is made to hold the joint against gravity, so it goes with the mass.
        factor = factors.mass * factors.joint_friction
        joint = instance.joint
        return CoulombFriction(
            articulation, replace(joint, friction=factor * joint.friction, damping=factor * joint.damping)
        )

    def rigid_material(self, rigid: RigidObject) -> physx.PhysxMaterial:
        """Contact material of a rigid object."""
        if self.switches.materials == "original":
            return self._material()
        return physx.PhysxMaterial(rigid.friction, rigid.friction, 0.0)

    def rigid_density(self, rigid: RigidObject) -> float | None:
        """Of a rigid object's hulls, kg/m3; None: mass and inertia are its own."""
        return self._constants.rigid_density if self.switches.densities == "original" else None

    def _material(self) -> physx.PhysxMaterial:
        return physx.PhysxMaterial(**self._constants.material)


class CoulombFriction:
    """Coulomb friction of ``joint.friction`` N m (or N), plus viscous damping.

    PhysX's own articulation friction is a coefficient on the load that the joint carries: it has no threshold
    in N m, and creeps (measured on a 0.3 kg lid, 0.26 N m of gravity torque: 0.23 rad in 5 s at coefficient
    1). SAPIEN sets it to 0.05 by default, which is enough to double the resistance of a
    moving lid; here it is 0.

    Instead a velocity drive with target zero and a force limit is Coulomb friction, regularized below
    ``CREEP_SPEED``: with a limit of 0.5 N m the same lid creeps under 0.0002 rad in 5 s, holds at 0.98 of the
    torque that should move it, and at 1.1 of it is as fast after 0.1 s as the excess torque makes it, to 1 %.

    The damping, at the joint's present speed, is added to the limit, so that it never reverses the motion however
    light the link is.
    """

    def __init__(self, articulation: physx.PhysxArticulation, joint: MovingJoint) -> None:
        self._articulation = articulation
        self._joints = articulation.active_joints
        self._friction, self._damping = joint.friction, joint.damping
        self._speed = 0.0
        for active in self._joints:
            active.set_friction(0.0)
        self._brake(0.0)

    def update(self) -> None:
        if self._damping > 0:
            speed = abs(float(self._articulation.qvel[0]))
            if speed != self._speed:
                self._speed = speed
                self._brake(speed)

    def _brake(self, speed: float) -> None:
        limit = self._friction + self._damping * speed
        for active in self._joints:
            active.set_drive_properties(0.0, limit / CREEP_SPEED, limit, "force")


class CoefficientFriction:
    """PhysX's articulation friction, a coefficient on the load that the joint carries; no drive, no damping."""

    def __init__(self, articulation: physx.PhysxArticulation, coefficient: float) -> None:
        for active in articulation.active_joints:
            active.set_friction(coefficient)
            active.set_drive_properties(0.0, 0.0)

    def update(self) -> None:
        """Nothing changes."""


def _drive_fingers(robot: physx.PhysxArticulation, profile: RobotProfile, stiffness: float, damping: float) -> None:
    joints, limit = robot_joints(robot, profile), profile.finger_drive.force_limit
    for name in profile.gripper.fingers:
        joints[name].set_drive_properties(stiffness, damping, force_limit=limit, mode="force")


def vary(bodies: Iterable[physx.PhysxRigidBodyComponent], factors: Factors) -> None:
    """Multiply masses, inertias and surface friction of bodies as they were built; nothing changes where they are 1."""
    if factors == AS_IT_IS:
        return
    for body in bodies:
        body.mass *= factors.mass
        body.inertia = factors.mass * body.inertia
        for shape in body.collision_shapes:
            was, factor = shape.physical_material, factors.contact_friction
            shape.physical_material = physx.PhysxMaterial(
                factor * was.static_friction, factor * was.dynamic_friction, was.restitution
            )


@cache
def named_physics(name: str) -> Physics:
    """Return the physics of that name, one value a process.

    Raises:
        InputError: there is none.
    """
    word = physics_name(name)
    return Physics(word) if word == name else named_physics(word)


DEFAULT = named_physics(DEFAULT_PHYSICS)
