"""Build the MuJoCo model of a scene: bodies, drives, joint friction and collision pairs.

docs/reference/simulation.md explains the constants.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product

import mujoco
import numpy as np

from gensim2.core.arrays import Array
from gensim2.objects import RigidObject
from gensim2.objects.types import ArticulatedObject
from gensim2.robots import JointDrive, RobotProfile
from gensim2.scenes.initial_state import InitialState, PlacedObject
from gensim2.scenes.table import HALF_SIZE
from gensim2.sim.mujoco.description import CollisionShape, Link, links_of, never_touching, rigid_link

PHYSICS_HZ = 500
"""Minimum physics rate, Hz; a robot with a higher ``physics_hz`` uses that rate."""

SOLREF = (0.004, 1.0)
"""Time constant (s) and damping ratio of contacts and joint constraints. Two time steps are the smallest stable
value.
"""

FRICTION_IMPEDANCE = (0.9999, 0.9999, 0.001, 0.5, 2.0)
"""Impedance of joint friction; with MuJoCo's default of 0.95 a lid slowly closes under its own weight."""

IMPRATIO = 10.0
"""Ratio of friction impedance to normal-force impedance; grasped objects slip less with a larger value."""

OTHER_FRICTION = 0.3
"""Friction coefficient of surfaces that specify none, as in ManiSkill."""

TABLE_FRICTION = 0.2
"""Friction coefficient of the table, equal to its dynamic friction in PhysX; MuJoCo has no static friction."""

ROLLING = 0.002
"""Radius (m) of rolling and torsional friction. Balls then roll as far as in PhysX, which stops slow bodies."""


@dataclass(frozen=True)
class Shape:
    """A collision shape in the MuJoCo model.

    Attributes:
        geom: name of the MuJoCo geom.
        owner: ``"table"``, the name of an object, or the agent name of the robot.
        link: name of the link to which the shape belongs.
        is_static: whether the shape never moves.
        friction: friction coefficient.
        slides: whether the shape belongs to a part of an object that slides on a prismatic joint, such as a drawer.
        is_rigid: whether the shape belongs to a rigid object.
    """

    geom: str
    owner: str
    link: str
    is_static: bool
    friction: float
    slides: bool = False
    is_rigid: bool = False


def mixed_name(owner: str, part: str) -> str:
    """Return a name that is unique in the model, made of ``owner`` (robot or object) and ``part`` (link or joint)."""
    return f"{owner}/{part}"


def surface_friction(thing: PlacedObject) -> float:
    """Return the friction coefficient of an object's surface."""
    own = thing.model.friction if isinstance(thing.model, RigidObject) else OTHER_FRICTION
    return own * thing.factors.contact_friction


def steps_of(profile: RobotProfile) -> int:
    """Return the number of MuJoCo's time steps in a physics step of 1 / ``physics_hz``."""
    return max(1, -(-PHYSICS_HZ // profile.simulation.physics_hz))


def build_spec(profile: RobotProfile, setup: InitialState, robot: bool) -> mujoco.MjSpec:
    """Build the MuJoCo specification of a scene.

    Args:
        setup: initial state of the scene.
        robot: whether the scene has the robot.
    """
    return _Builder(profile, setup, robot).spec


def build_model(profile: RobotProfile, setup: InitialState, robot: bool) -> mujoco.MjModel:
    """Compile the MuJoCo model of a scene; arguments as for :func:`build_spec`."""
    return build_spec(profile, setup, robot).compile()


class _Builder:
    def __init__(self, profile: RobotProfile, setup: InitialState, robot: bool) -> None:
        self._profile = profile
        self.spec = spec = mujoco.MjSpec()
        option = spec.option
        option.timestep = 1.0 / (profile.simulation.physics_hz * steps_of(profile))
        option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        option.impratio = IMPRATIO
        option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        spec.compiler.degree = False
        # MuJoCo rejects the inertias of the Fetch's fingers, which violate the triangle inequality, unless it may
        # adjust them.
        spec.compiler.balanceinertia = True
        self._shapes: list[Shape] = []
        self._meshes = 0
        if robot:
            self._add_robot()
        self._add_table()
        for name, thing in setup.objects.items():
            self._add_object(name, thing)
        self._add_pairs()

    def _add_table(self) -> None:
        half = CollisionShape("box", HALF_SIZE, None, np.eye(4))
        body = self.spec.worldbody.add_body(name="table", pos=[0.0, 0.0, -HALF_SIZE[2]])
        self._add_solid(body, half, Shape("table", "table", "table", True, TABLE_FRICTION))

    def _add_object(self, name: str, thing: PlacedObject) -> None:
        world = self.spec.worldbody
        friction, mass = surface_friction(thing), thing.factors.mass
        if isinstance(thing.model, RigidObject):
            link = rigid_link(thing.model)
            body = world.add_body(name=name, pos=thing.position, quat=thing.quaternion)
            body.add_joint(type=mujoco.mjtJoint.mjJNT_FREE, name=name)
            self._fill(body, link, mass, Shape(name, name, link.name, False, friction, is_rigid=True))
            return
        model, still = thing.model, set[str]()
        for link in links_of(model.urdf, model.content_hash):
            body = self._add_link(name, link, thing.position, thing.quaternion)
            if link.axis is not None:
                joint = self._add_joint(body, name, link, (model.joint.lower, model.joint.upper))
                self._resist(joint, model, thing)
            elif link.parent is None or link.parent in still:
                still.add(link.name)
                # A root link is a mocap body: it can be moved, and its pose is part of MuJoCo's state.
                body.mocap = link.parent is None
            is_static = link.name in still
            slides = not is_static and model.joint.type == "prismatic"
            shape = Shape(mixed_name(name, link.name), name, link.name, is_static, friction, slides=slides)
            self._fill(body, link, mass, shape)

    def _add_robot(self) -> None:
        profile = self._profile
        agent, pads = profile.agent, set(profile.gripper.pads)
        drives, still = self._drives(), set[str]()
        for link in links_of(profile.urdf):
            body = self._add_link(agent, link, profile.base_position, profile.base_quaternion)
            body.gravcomp = 1.0  # gravity does not act on the robot, as in ManiSkill
            if link.axis is not None:
                assert link.joint is not None
                joint = self._add_joint(body, agent, link, link.joint.limits)
                joint.armature = drives[link.joint.name].damping * self.spec.option.timestep
            elif link.parent is None or link.parent in still:
                still.add(link.name)
            friction = profile.gripper.friction if link.name in pads else OTHER_FRICTION
            name = mixed_name(agent, link.name)
            self._fill(body, link, 1.0, Shape(name, agent, link.name, link.name in still, friction))
        for name, drive in drives.items():
            self._add_drive(mixed_name(agent, name), drive)
        if profile.simulation.tendons:
            for link in links_of(profile.urdf):
                if link.joint is not None and link.joint.mimics is not None:
                    self._couple(mixed_name(agent, link.joint.name), mixed_name(agent, link.joint.mimics))

    def _drives(self) -> dict[str, JointDrive]:
        profile = self._profile
        gripper, simulation = profile.gripper, profile.simulation
        return {
            **dict(zip(profile.arm_joints, profile.arm_drives, strict=True)),
            **dict.fromkeys(gripper.driven, simulation.gripper),
            **dict.fromkeys(gripper.mimics, simulation.mimic),
            **dict.fromkeys(gripper.passive, simulation.passive),
        }

    def _add_link(
        self, owner: str, link: Link, position: Sequence[float] | Array, quaternion: Sequence[float] | Array
    ) -> mujoco.MjsBody:
        """Add the body of a link. Position and quaternion are for a root link; the URDF places all other links."""
        name = mixed_name(owner, link.name)
        if link.parent is None:
            return self.spec.worldbody.add_body(name=name, pos=position, quat=quaternion)
        assert link.joint is not None
        above = self.spec.body(mixed_name(owner, link.parent))
        return above.add_body(name=name, pos=link.joint.T[:3, 3], quat=_quaternion(link.joint.T))

    def _add_joint(
        self, body: mujoco.MjsBody, owner: str, link: Link, limits: tuple[float, float] | None
    ) -> mujoco.MjsJoint:
        assert link.joint is not None
        kind = mujoco.mjtJoint
        slides = link.joint.type == "prismatic"
        joint = body.add_joint(
            name=mixed_name(owner, link.joint.name),
            type=kind.mjJNT_SLIDE if slides else kind.mjJNT_HINGE,
            axis=link.axis,
            solref_limit=SOLREF,
        )
        if limits is not None:
            joint.limited, joint.range = mujoco.mjtLimited.mjLIMITED_TRUE, limits
        return joint

    def _resist(self, joint: mujoco.MjsJoint, model: ArticulatedObject, thing: PlacedObject) -> None:
        """Set a joint's Coulomb friction and damping; both are proportional to the object's mass."""
        factor = thing.factors.mass * thing.factors.joint_friction
        joint.frictionloss = factor * model.joint.friction
        joint.damping[0] = factor * model.joint.damping
        joint.solref_friction, joint.solimp_friction = SOLREF, FRICTION_IMPEDANCE

    def _fill(self, body: mujoco.MjsBody, link: Link, mass: float, shape: Shape) -> None:
        body.explicitinertial = True
        if link.inertial is not None:
            values, axes = np.linalg.eigh(link.inertial.inertia)
            body.mass, body.ipos = mass * link.inertial.mass, link.inertial.center
            body.inertia, body.iquat = mass * values, _quaternion(axes * np.linalg.det(axes))
        for number, solid in enumerate(link.solids):
            self._add_solid(body, solid, Shape(**{**vars(shape), "geom": f"{shape.geom}/{number}"}))

    def _add_solid(self, body: mujoco.MjsBody, solid: CollisionShape, shape: Shape) -> None:
        kinds = mujoco.mjtGeom
        kind = {
            "box": kinds.mjGEOM_BOX,
            "sphere": kinds.mjGEOM_SPHERE,
            "cylinder": kinds.mjGEOM_CYLINDER,
            "capsule": kinds.mjGEOM_CAPSULE,
        }
        geom = body.add_geom(
            name=shape.geom,
            type=kind.get(solid.kind, kinds.mjGEOM_MESH),
            pos=solid.T[:3, 3],
            quat=_quaternion(solid.T),
            contype=0,  # zero: only the pairs of shapes from _add_pairs collide
            conaffinity=0,
        )
        if solid.vertices is None:
            geom.size = [*solid.size, *[0.0] * (3 - len(solid.size))]
        else:
            name = f"mesh_{self._meshes}"
            self._meshes += 1
            mesh = self.spec.add_mesh(name=name, uservert=solid.vertices.ravel())
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
            geom.meshname = name
        self._shapes.append(shape)

    def _add_drive(self, joint: str, drive: JointDrive) -> None:
        actuator = self.spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        actuator.set_to_position(kp=drive.stiffness, kv=drive.damping)
        actuator.forcelimited, actuator.forcerange = (
            mujoco.mjtLimited.mjLIMITED_TRUE,
            (-drive.force_limit, drive.force_limit),
        )

    def _couple(self, follower: str, leader: str) -> None:
        equality = self.spec.add_equality(
            type=mujoco.mjtEq.mjEQ_JOINT, objtype=mujoco.mjtObj.mjOBJ_JOINT, name1=follower, name2=leader, solref=SOLREF
        )
        # Position of ``follower`` = 0 + 1 * position of ``leader``.
        equality.data[:2] = 0.0, 1.0

    def _add_pairs(self) -> None:
        """Add the pairs of shapes that may touch. The friction of a pair is the mean of its shapes, as in PhysX."""
        apart = never_touching(self._profile.srdf)
        links = {link.name: link for link in links_of(self._profile.urdf)}
        groups: dict[tuple[str, str], list[Shape]] = {}
        for shape in self._shapes:
            groups.setdefault((shape.owner, shape.link), []).append(shape)
        for one, other in combinations(groups.values(), 2):
            if self._may_touch(one[0], other[0], apart, links):
                for first, second in product(one, other):
                    self._add_pair(first, second)

    def _may_touch(self, one: Shape, other: Shape, apart: frozenset[frozenset[str]], links: dict[str, Link]) -> bool:
        if one.is_static and other.is_static:
            return False
        if one.owner == other.owner:
            # Links of one object never collide with each other. For the robot, the SRDF excludes pairs.
            if one.owner != self._profile.agent:
                return False
            joined = links[one.link].parent == other.link or links[other.link].parent == one.link
            return not joined and frozenset((one.link, other.link)) not in apart
        # The table has no contacts with sliding links. A drawer slides on its rail, and MuJoCo's friction would lift
        # and jam it.
        table = {one.owner, other.owner} & {"table"}
        return not (table and (one.slides or other.slides))

    def _add_pair(self, one: Shape, other: Shape) -> None:
        friction = 0.5 * (one.friction + other.friction)
        rolls = one.is_rigid or other.is_rigid
        self.spec.add_pair(
            geomname1=one.geom,
            geomname2=other.geom,
            condim=6 if rolls else 3,
            friction=[friction, friction, *[ROLLING * friction] * 3],
            solref=SOLREF,
        )


def _quaternion(matrix: Array) -> Array:
    """Return the unit quaternion (w, x, y, z) of a rotation matrix (3, 3) or (4, 4)."""
    found = np.empty(4)
    mujoco.mju_mat2Quat(found, np.ascontiguousarray(matrix[:3, :3]).ravel())
    return found
