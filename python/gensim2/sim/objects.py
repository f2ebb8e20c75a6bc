"""Build an :class:`~gensim2.objects.types.ArticulatedObject` as an articulation in a ManiSkill scene."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import sapien
from mani_skill.envs.scene import ManiSkillScene
from mani_skill.utils.building.urdf_loader import URDFLoader
from mani_skill.utils.structs import Articulation
from sapien import physx

from gensim2.core.errors import InputError
from gensim2.objects.types import ArticulatedObject
from gensim2.sim.physics import DEFAULT, Physics


class _PhysicsOnlyLoader(URDFLoader):  # type: ignore[misc]
    """URDF loader that omits visual shapes, because their materials need a Vulkan driver."""

    def _build_link(self, link: Any, link_builder: Any) -> None:
        link.visuals = []
        super()._build_link(link, link_builder)


HULL_TOLERANCE = 0.002
"""Distance (m) by which a shape may exceed its hull or fall short of it without a warning. SAPIEN turns flat hulls into
boxes.
"""

HULL_LOSS = 0.25
"""Maximum fraction of a hull's longest side that PhysX's cooking may cut off with a warning.
"""


def load_object(
    scene: ManiSkillScene,
    instance: ArticulatedObject,
    pose: sapien.Pose,
    name: str = "object",
    physics: Physics = DEFAULT,
) -> tuple[Articulation, tuple[str, ...]]:
    """Build an articulated object whose base is fixed at ``pose`` (world frame). Its joint has no friction or damping.

    Returns:
        The articulation, and a warning for each hull that PhysX shrank while preprocessing it ("cooking").

    Raises:
        InputError: SAPIEN dropped or replaced a collision hull, or the joint differs from the instance's joint.
    """
    loader = URDFLoader() if scene.can_render() else _PhysicsOnlyLoader()
    loader.set_scene(scene)
    loader.fix_root_link = True
    loader.name = name
    physics.prepare_loader(loader, instance.asset_class)
    builder = loader.parse(str(instance.urdf))["articulation_builders"][0]
    builder.initial_pose = pose
    articulation = builder.build()
    warnings = check_object(articulation._objs[0], instance)
    return articulation, warnings


def link_name(link: physx.PhysxArticulationLinkComponent) -> str:
    """Return a link's name in its URDF; ManiSkill prefixes it with the names of scene and object."""
    return str(link.entity.name)


def check_object(articulation: physx.PhysxArticulation, instance: ArticulatedObject) -> tuple[str, ...]:
    """Check that the physics engine built ``instance`` correctly.

    Returns:
        One warning for each collision hull that became smaller when PhysX preprocessed it ("cooking").

    Raises:
        InputError: SAPIEN dropped or replaced a collision hull, or the joint differs from the joint of ``instance``.
    """
    warnings: list[str] = []
    where = instance.urdf
    names = [_joint_name(joint) for joint in articulation.active_joints]
    if names != [instance.joint.name]:
        wrong = f"the only movable joint must be {instance.joint.name!r}, but the movable joints are {names}"
        raise InputError(wrong, file=where)
    limits = np.asarray(articulation.qlimits[0], dtype=np.float64)
    expected = np.array([instance.joint.lower, instance.joint.upper])
    if not np.allclose(limits, expected, atol=1e-5):
        wrong = f"the joint limits must be {expected}, but SAPIEN reads {limits}"
        raise InputError(wrong, file=where, field=instance.joint.name)
    for link in articulation.links:
        name, shapes = link_name(link), link.collision_shapes
        promised, present = len(instance.hulls.get(name, ())), len(shapes)
        if present != promised:
            raise InputError(
                f"{promised - present} of {promised} collision hulls were dropped by the physics engine"
                if present < promised
                else f"has {present} collision hulls, {promised} were promised",
                file=where,
                field=name,
                remedy="the hull may be flat or tiny: see `gensim2 assets validate`",
            )
        for index, (hull, shape) in enumerate(zip(instance.hulls.get(name, ()), shapes, strict=True)):
            lost, grown = cooking_misfit(hull, shape)
            if not cooking_is_fair(hull, lost, grown):
                off = 1e3 * max(grown, lost)
                raise InputError(
                    f"the physics engine changed the shape of collision hull {index} by {off:.1f} mm",
                    file=where,
                    field=name,
                    remedy="the hull may be flat or tiny: remove it or make it thicker",
                )
            if lost > HULL_TOLERANCE:
                warnings.append(f"{name}: hull {index} lost {1e3 * lost:.1f} mm when the physics engine processed it")
    unknown = set(instance.hulls) - {link_name(link) for link in articulation.links}
    if unknown:
        wrong = f"the file lacks the links {sorted(unknown)}, for which the object has collision hulls"
        raise InputError(wrong, file=where)
    return tuple(warnings)


def _joint_name(joint: physx.PhysxArticulationJoint) -> str:
    """Return the name of a joint in its URDF file, without the prefix that ManiSkill adds."""
    prefix = joint.child_link.name.removesuffix(link_name(joint.child_link))
    return str(joint.name.removeprefix(prefix))


def _corners(shape: physx.PhysxCollisionShape) -> npt.NDArray[np.float64]:
    """Return the vertices (N, 3) of a collision shape in the link frame."""
    if isinstance(shape, physx.PhysxCollisionShapeBox):
        signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).T.reshape(-1, 3)
        local = signs * shape.half_size
    else:
        local = np.asarray(shape.vertices, dtype=np.float64) * shape.scale
    pose = shape.local_pose.to_transformation_matrix()
    return np.asarray(local @ pose[:3, :3].T + pose[:3, 3], dtype=np.float64)


def cooking_misfit(hull: npt.NDArray[np.float64], shape: physx.PhysxCollisionShape) -> tuple[float, float]:
    """Compare the bounding boxes of a collision shape and of the hull (N, 3) from which PhysX made the shape.

    Returns:
        Two distances (m) between the bounding boxes of shape and hull, each the maximum over the six sides: how far the
        shape falls short of the hull, and how far it exceeds the hull.
    """
    cooked = _corners(shape)
    beyond = np.concatenate([hull.min(axis=0) - cooked.min(axis=0), cooked.max(axis=0) - hull.max(axis=0)])
    return float(-beyond.min()), float(beyond.max())


def cooking_is_fair(hull: npt.NDArray[np.float64], lost: float, grown: float) -> bool:
    """Return whether the engine's shape fits a hull.

    The shape may be larger by a fixed tolerance and smaller by a fraction of its size.

    Args:
        hull: (N, 3) corners of the hull, m.
        lost: largest distance (m) by which the shape's bounding box falls short of the hull's bounding box.
        grown: largest distance (m) by which the shape's bounding box extends beyond the hull's bounding box.
    """
    return grown <= HULL_TOLERANCE and lost <= HULL_LOSS * float(np.ptp(hull, axis=0).max())
