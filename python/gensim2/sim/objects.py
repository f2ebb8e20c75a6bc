"""An :class:`~gensim2.assets.types.Instance` as an articulation in a ManiSkill scene."""

from __future__ import annotations

from typing import Any

import numpy as np
import sapien
from mani_skill.envs.scene import ManiSkillScene
from mani_skill.utils.building.urdf_loader import URDFLoader
from mani_skill.utils.structs import Articulation

from gensim2.assets.types import Instance
from gensim2.errors import InputError

CREEP_SPEED = 5e-5
"""Speed, rad/s or m/s, at which the friction gives its full torque: an object left alone creeps slower."""


class _PhysicsOnlyLoader(URDFLoader):  # type: ignore[misc]
    """Leaves the visuals out, whose materials could not be built without a Vulkan driver."""

    def _build_link(self, link: Any, link_builder: Any) -> None:
        link.visuals = []
        super()._build_link(link, link_builder)


def load_object(scene: ManiSkillScene, instance: Instance, pose: sapien.Pose, name: str = "object") -> Articulation:
    """Build ``instance`` with its root fixed at ``pose`` (root to world).

    Raises:
        InputError: SAPIEN dropped a collision hull, or the joint is not the one that the instance promises.
    """
    loader = URDFLoader() if scene.can_render() else _PhysicsOnlyLoader()
    loader.set_scene(scene)
    loader.fix_root_link = True
    loader.name = name
    builder = loader.parse(str(instance.urdf))["articulation_builders"][0]
    builder.initial_pose = pose
    articulation = builder.build()
    _check(articulation, instance)
    apply_friction(articulation, instance)
    return articulation


def apply_friction(articulation: Articulation, instance: Instance, speed: float = 0.0) -> None:
    """Give the joint Coulomb friction of ``instance.joint.friction`` N m (or N), plus viscous damping at
    ``speed``.

    PhysX's own articulation friction is a coefficient on the load that the joint carries: it has no threshold
    in N m, and creeps (measured on a 0.3 kg lid, 0.26 N m of gravity torque: 0.23 rad in 5 s at coefficient
    1). A velocity drive with target zero and a force limit is Coulomb friction, regularized below
    ``CREEP_SPEED``: with a limit of 0.5 N m the same lid creeps under 0.001 rad in 5 s, holds at a push of
    0.77 N m and yields at 0.80 (0.76 is exact). This holds for the TGS solver; PGS lets a drive exceed its
    limit (no yielding at 0.90).

    ``speed`` (rad/s or m/s) is the joint's present speed: the damping is added to the limit, so that it never
    reverses the motion however light the link is.
    """
    joint = instance.joint
    limit = joint.friction + joint.damping * abs(speed)
    for active in articulation._objs[0].active_joints:  # SAPIEN's own joints: ManiSkill's batching costs 10 us
        active.set_drive_properties(0.0, limit / CREEP_SPEED, limit, "force")


def _check(articulation: Articulation, instance: Instance) -> None:
    where = instance.urdf
    names = [joint.name for joint in articulation.active_joints]
    if names != [instance.joint.name]:
        raise InputError(f"must move at {instance.joint.name!r} only, moves at {names}", file=where)
    limits = np.asarray(articulation.get_qlimits()[0, 0], dtype=np.float64)
    expected = np.array([instance.joint.lower, instance.joint.upper])
    if not np.allclose(limits, expected, atol=1e-5):
        raise InputError(f"limits are {limits}, not {expected}", file=where, field=instance.joint.name)
    for link in articulation.links:
        promised = len(instance.hulls.get(link.name, ()))
        present = len(link._bodies[0].get_collision_shapes())
        if present != promised:
            raise InputError(
                f"{promised - present} of {promised} collision hulls were dropped by the physics engine"
                if present < promised
                else f"has {present} collision hulls, {promised} were promised",
                file=where,
                field=link.name,
                remedy="the hull may be flat or tiny: see `gensim2 assets list`",
            )
    unknown = set(instance.hulls) - {link.name for link in articulation.links}
    if unknown:
        raise InputError(f"has no links {sorted(unknown)}", file=where)
