"""PhysX's settings, stated once: ManiSkill's, with the solver and the rates written out."""

from __future__ import annotations

from functools import cache

from mani_skill.utils.structs.types import SceneConfig, SimConfig
from sapien import physx

PHYSICS_HZ, CONTROL_HZ = 100, 20
RIGID_CONTACT_OFFSET = 0.005
"""Metres, of every shape in a scene with rigid objects. With ManiSkill's 20 mm each finger is in speculative contact
with some 60 hulls of a bowl at once, and PhysX throws the bowl although nothing touches it."""


@cache
def sim_config() -> SimConfig:
    """TGS solver, persistent contact manifold, 15 position iterations and 1 velocity iteration."""
    return SimConfig(
        sim_freq=PHYSICS_HZ,
        control_freq=CONTROL_HZ,
        scene_config=SceneConfig(
            enable_tgs=True, enable_pcm=True, solver_position_iterations=15, solver_velocity_iterations=1
        ),
    )


def new_system() -> physx.PhysxCpuSystem:
    """A PhysX system with these settings, as ManiSkill makes one."""
    config = sim_config()
    scene = config.scene_config
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
    physx.set_default_material(**config.default_materials_config.dict())
    system = physx.PhysxCpuSystem()
    system.timestep = 1.0 / PHYSICS_HZ
    return system


def set_contact_offset(system: physx.PhysxCpuSystem, offset: float) -> None:
    """Give every collision shape that is in a system this contact offset (m)."""
    for body in (
        *system.articulation_link_components,
        *system.rigid_dynamic_components,
        *system.rigid_static_components,
    ):
        for shape in body.collision_shapes:
            shape.contact_offset = offset
