"""PhysX's settings, stated once: ManiSkill's, with the solver written out; the rates are the robot's."""

from __future__ import annotations

from functools import cache

from mani_skill.utils.structs.types import SceneConfig, SimConfig
from sapien import physx

from gensim2.robots import RobotProfile


@cache
def sim_config(physics_hz: int, control_hz: int) -> SimConfig:
    """TGS solver, persistent contact manifold, 15 position iterations and 1 velocity iteration."""
    return SimConfig(
        sim_freq=physics_hz,
        control_freq=control_hz,
        scene_config=SceneConfig(
            enable_tgs=True, enable_pcm=True, solver_position_iterations=15, solver_velocity_iterations=1
        ),
    )


def new_system(robot: RobotProfile) -> physx.PhysxCpuSystem:
    """A PhysX system with these settings at the robot's rates, as ManiSkill makes one."""
    config = sim_config(robot.physics_hz, robot.control_hz)
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
    system.timestep = 1.0 / robot.physics_hz
    return system
