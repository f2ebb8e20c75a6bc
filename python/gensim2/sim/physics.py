"""Apply the physics settings of a scene. Each setting has a default value and the value of the original GenSim2.

The module sets PhysX parameters, joint resistance, masses, materials and drives. Both environments use
:class:`Physics`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import replace
from functools import cache
from typing import Any, Protocol

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

RIGID_CONTACT_OFFSET = 0.005
"""Contact offset (m) of all shapes in scenes with rigid objects and the default solver. With ManiSkill's 20 mm, each
finger has speculative contacts with about 60 hulls of a bowl, which move the bowl without touching it.
"""

CREEP_SPEED = 5e-5
"""Speed (rad/s or m/s) at which the joint friction reaches its full torque; a joint at rest creeps slower."""


class JointResistance(Protocol):
    """Interface for a model of joint resistance (friction and damping)."""

    def update(self) -> None:
        """Update the resistance; call it before each physics step."""


class Physics:
    """Physics settings of a scene. :func:`named_physics` returns the settings for a given name.

    Args:
        name: name of the settings (:mod:`gensim2.scenes.physics`).

    Attributes:
        name: name of the settings.
        switches: for each setting, whether it has the default value or the value of the original GenSim2.
        scene_config: PhysX settings in ManiSkill's format.
        material: default contact material.

    Raises:
        InputError: the name is unknown.
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
        """Return ManiSkill's simulation config with these settings and the robot's rates."""
        return SimConfig(
            sim_freq=robot.simulation.physics_hz,
            control_freq=robot.control_hz,
            scene_config=self.scene_config,
            default_materials_config=self.material,
        )

    def new_system(self, robot: RobotProfile) -> physx.PhysxCpuSystem:
        """Return a PhysX system with these settings and the physics rate of the robot, created as ManiSkill does."""
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
        """Set contact offsets and finger drives in a scene with rigid objects. Call this after all bodies are built.

        Args:
            system: PhysX system of the scene.
            robot: robot; None in a scene without a robot.
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
        """Set the contact materials of a built robot's links and the drives of its fingers."""
        if self.switches.materials == "original":
            material = self._material()
            for link in robot.links:
                for shape in link.collision_shapes:
                    shape.set_physical_material(material)
        drive = profile.finger_drive
        if self.switches.gripper == "soft":
            # Soft drives have at most the damping of the profile. The panda_long has the original's, which is zero.
            _drive_fingers(robot, profile, drive.stiffness, min(drive.damping, self._constants.finger_damping))
        elif self.switches.gripper == "original":
            _drive_fingers(robot, profile, **self._constants.fingers)

    def prepare_loader(self, loader: URDFLoader, asset_class: str) -> None:
        """Make a URDF loader compute masses from the densities of classes if ``densities`` is ``"original"``."""
        if self.switches.densities == "default":
            return
        loader.set_density(self._constants.density(asset_class))
        build_link = loader._build_link

        def without_inertial(link: Any, builder: Any) -> None:
            link.inertial = None  # If this entry is None, PhysX computes mass and inertia from the hulls.
            build_link(link, builder)

        loader._build_link = without_inertial

    def resist(
        self, articulation: physx.PhysxArticulation, instance: ArticulatedObject, factors: Factors = AS_IT_IS
    ) -> JointResistance:
        """Set the resistance of a built object's joint."""
        if self.switches.joint_friction == "original":
            coefficient = self._constants.joint_friction(instance.asset_class)
            return CoefficientFriction(articulation, factors.joint_friction * coefficient)
        # Friction holds the joint against gravity, which grows with the mass. Therefore friction gets the factor of the
        # mass.
        factor = factors.mass * factors.joint_friction
        joint = instance.joint
        return CoulombFriction(
            articulation, replace(joint, friction=factor * joint.friction, damping=factor * joint.damping)
        )

    def rigid_material(self, rigid: RigidObject) -> physx.PhysxMaterial:
        if self.switches.materials == "original":
            return self._material()
        return physx.PhysxMaterial(rigid.friction, rigid.friction, 0.0)

    def rigid_density(self, rigid: RigidObject) -> float | None:
        """Return the density of a rigid object's hulls, kg/m3; None if the object's own mass and inertia are used."""
        return self._constants.rigid_density if self.switches.densities == "original" else None

    def _material(self) -> physx.PhysxMaterial:
        return physx.PhysxMaterial(**self._constants.material)


class CoulombFriction:
    """Coulomb friction, ``joint.friction`` in N m (N if sliding), and viscous damping of a joint.

    PhysX's own joint friction is a coefficient times the load, so it does not define a torque up to which a joint
    rests. With coefficient 1, a lid of 0.3 kg with a gravity torque of 0.26 N m moves 0.23 rad in 5 s. SAPIEN's default
    of 0.05 doubles the resistance of a moving lid, so it is set to 0.

    Instead, a velocity drive brakes the joint. Its target is zero and its force limit is the friction, so above
    ``CREEP_SPEED`` it acts as Coulomb friction does. With a limit of 0.5 N m the same lid moves less than 0.0002 rad in
    5 s. It rests at 0.98 times the limit. At 1.1 times the limit, after 0.1 s it has the speed of the excess torque
    within 1 %.

    The damping at the current speed is added to the force limit. A drive only brakes, so it reverses no motion.
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
    """PhysX's own joint friction: a coefficient times the load. The drive and the damping of the joint become zero."""

    def __init__(self, articulation: physx.PhysxArticulation, coefficient: float) -> None:
        for active in articulation.active_joints:
            active.set_friction(coefficient)
            active.set_drive_properties(0.0, 0.0)

    def update(self) -> None:
        """Do nothing."""


def _drive_fingers(robot: physx.PhysxArticulation, profile: RobotProfile, stiffness: float, damping: float) -> None:
    joints, limit = robot_joints(robot, profile), profile.finger_drive.force_limit
    for name in profile.gripper.fingers:
        joints[name].set_drive_properties(stiffness, damping, force_limit=limit, mode="force")


def vary(bodies: Iterable[physx.PhysxRigidBodyComponent], factors: Factors) -> None:
    """Multiply the masses, inertias and surface friction of bodies in a scene by random factors."""
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
    """Return the physics settings with the given name; later calls in the process return the same object.

    Raises:
        InputError: the name is unknown.
    """
    word = physics_name(name)
    return Physics(word) if word == name else named_physics(word)


DEFAULT = named_physics(DEFAULT_PHYSICS)
