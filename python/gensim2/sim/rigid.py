"""Build a :class:`~gensim2.objects.RigidObject`, and the table, as actors in a scene."""

from __future__ import annotations

from typing import Any

import numpy as np
import sapien
from mani_skill.envs.scene import ManiSkillScene
from mani_skill.utils.structs import Actor
from sapien import physx
from scipy.spatial.transform import Rotation

from gensim2.core.errors import InputError
from gensim2.objects import RigidObject
from gensim2.objects.types import BODY
from gensim2.scenes.randomize import placed
from gensim2.scenes.table import HALF_SIZE, visible_boxes
from gensim2.sim.objects import cooking_is_fair, cooking_misfit
from gensim2.sim.physics import DEFAULT, Physics


def load_rigid(
    scene: ManiSkillScene,
    rigid: RigidObject,
    pose: sapien.Pose | None = None,
    name: str | None = None,
    physics: Physics = DEFAULT,
) -> Actor:
    """Build a rigid object in a ManiSkill scene.

    Args:
        pose: pose in the world frame. By default the object rests on the table at x = y = 0.
        name: name of the object, unique in the scene. By default it is the name of the object's class.

    Raises:
        InputError: the physics engine dropped or replaced a collision hull.
    """
    builder = scene.create_actor_builder()
    fill(builder, rigid, visual=scene.can_render(), physics=physics)
    builder.initial_pose = resting_pose(rigid) if pose is None else pose
    actor = builder.build(name=name or rigid.asset_class)
    check_shapes(actor._bodies[0].get_collision_shapes(), rigid)
    return actor


def build_rigid(
    scene: sapien.Scene, rigid: RigidObject, pose: sapien.Pose, name: str, physics: Physics
) -> sapien.Entity:
    """Build a rigid object without visuals in a SAPIEN scene.

    Raises:
        InputError: the physics engine dropped or replaced a collision hull.
    """
    builder = scene.create_actor_builder()
    fill(builder, rigid, visual=False, physics=physics)
    builder.set_initial_pose(pose)
    entity = builder.build(name=name)
    check_shapes(entity.find_component_by_type(physx.PhysxRigidDynamicComponent).collision_shapes, rigid)
    return entity


def fill(builder: sapien.ActorBuilder, rigid: RigidObject, visual: bool, physics: Physics = DEFAULT) -> None:
    """Add the object's collision shapes and inertia to a builder. If ``visual`` is true, also add its visual shapes."""
    material, density = physics.rigid_material(rigid), physics.rigid_density(rigid)
    weight = {} if density is None else {"density": density}
    for index in range(len(rigid.hulls[BODY])):
        builder.add_convex_collision_from_file(str(rigid.hull_file(index)), material=material, **weight)
    if visual and rigid.visual is not None:
        builder.add_visual_from_file(str(rigid.visual))
    if density is not None:
        return  # without explicit inertia PhysX computes mass and inertia from the hulls
    values, axes = np.linalg.eigh(rigid.inertia)
    # eigh may return left-handed axes. Their determinant is then -1, and multiplying by it makes them right-handed.
    turn = Rotation.from_matrix(axes * np.linalg.det(axes)).as_quat(scalar_first=True)
    builder.set_mass_and_inertia(rigid.mass, sapien.Pose(rigid.center_of_mass, turn), values)


def resting_pose(rigid: RigidObject, x: float = 0.0, y: float = 0.0, yaw: float = 0.0) -> sapien.Pose:
    """Return the pose (object to world) of an object at rest on the table at (x, y), m, with the given yaw, rad."""
    return sapien.Pose(*placed(rigid.placement.position, rigid.placement.quaternion, x, y, yaw))


def check_shapes(shapes: list[Any], rigid: RigidObject) -> None:
    """Check that the physics engine uses every collision hull of the object, without a change beyond a small tolerance.

    Raises:
        InputError: the engine dropped a hull or changed it too much.
    """
    if len(shapes) != len(rigid.hulls[BODY]):
        lost = len(rigid.hulls[BODY]) - len(shapes)
        wrong = f"{lost} of {len(rigid.hulls[BODY])} collision hulls were dropped by the physics engine"
        raise InputError(wrong, file=rigid.folder, remedy="a hull may be flat or tiny: remove it or make it thicker")
    for index, (hull, shape) in enumerate(zip(rigid.hulls[BODY], shapes, strict=True)):
        lost_m, grown = cooking_misfit(hull, shape)
        if not cooking_is_fair(hull, lost_m, grown):
            raise InputError(
                f"the physics engine changed the shape of the collision hull by {1e3 * max(lost_m, grown):.1f} mm",
                file=rigid.hull_file(index),
                remedy="the hull may be flat or tiny: remove it or make it thicker",
            )


def build_table(scene: ManiSkillScene | sapien.Scene, visible: bool) -> Any:
    """Build the table: one static box with static friction 1.0, dynamic friction 0.2, restitution 0.01.

    The table legs and the floor have no collision shapes, so objects that slide off fall without end.

    Args:
        scene: ManiSkill's or SAPIEN's scene.
        visible: whether to add the visible parts, such as the legs.

    Returns:
        The ``Actor`` or ``Entity`` that the scene's builder returns.
    """
    builder = scene.create_actor_builder()
    material = sapien.physx.PhysxMaterial(static_friction=1.0, dynamic_friction=0.2, restitution=0.01)
    builder.add_box_collision(half_size=HALF_SIZE, material=material)
    if visible:
        _add_visuals(builder)
    builder.initial_pose = sapien.Pose(p=[0.0, 0.0, -HALF_SIZE[2]])
    return builder.build_static(name="table")


def _add_visuals(builder: sapien.ActorBuilder) -> None:
    for box in visible_boxes():
        material = sapien.render.RenderMaterial(
            base_color=list(box.color), roughness=box.roughness, metallic=box.metallic, specular=0.3
        )
        builder.add_box_visual(sapien.Pose(p=box.center), box.half_size, material=material)
