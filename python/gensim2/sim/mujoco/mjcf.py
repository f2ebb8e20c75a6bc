"""Write scenes and objects as MJCF files. The command ``python -m mujoco.viewer`` can open the files."""

from __future__ import annotations

from pathlib import Path
from typing import Unpack

import numpy as np

from gensim2.core.files import write_atomic
from gensim2.objects.types import ArticulatedObject, RigidObject
from gensim2.robots import DEFAULT_ROBOT, RobotProfile
from gensim2.robots import robot as robot_profile
from gensim2.scenes.config import SceneArguments
from gensim2.scenes.default_pose import default_pose
from gensim2.scenes.initial_state import InitialState, PlacedObject
from gensim2.scenes.physics import DEFAULT_PHYSICS
from gensim2.scenes.sampler import SceneSampler
from gensim2.sim.mujoco.model import build_spec
from gensim2.sim.mujoco.scene import MujocoScene
from gensim2.tasks.presets import DEFAULT_PRESET
from gensim2.tasks.spec import TaskSpec

START = "start"
"""Name of the keyframe that holds the initial state and the targets of the drives."""


def write_scene(task: str | TaskSpec, file: Path, seed: int = 0, **scene: Unpack[SceneArguments]) -> None:
    """Write a scene to MJCF as the engine ``mujoco`` simulates it.

    The file has the robot, the table, the objects, the drives and the pairs of shapes that touch.

    Example:
        ```python
        write_scene("OpenDrawer", Path("drawer.xml"), assets="builtin")
        ```

    Args:
        task: name of a library task, or a spec.
        file: file to write. The meshes are written into this file, so no other file is needed.
        seed: seed that determines the scene.
        scene: see :class:`~gensim2.scenes.config.SceneArguments`.

    Raises:
        InputError: an argument cannot be used.
        WriteError: the file cannot be written.
    """
    scene["engine"] = "mujoco"
    sampler = SceneSampler(task, **scene)
    _write(sampler.profile, sampler.sample(seed), file, robot=True)


def write_object(model: ArticulatedObject | RigidObject, file: Path) -> None:
    """Write an object on the table, without a robot.

    Args:
        file: file to write; it contains the meshes.

    Raises:
        InputError: the object's files cannot be used.
        WriteError: the file cannot be written.
    """
    pose = default_pose(model, "default")
    placed = PlacedObject(model, pose.position, pose.quaternion, 0.0, pose.openness)
    # A profile is needed even without a robot in the scene, because it determines the physics rate.
    profile = robot_profile(DEFAULT_ROBOT)
    setup = InitialState({model.asset_class: placed}, 1, profile.reset_qpos, DEFAULT_PRESET)
    _write(profile, setup, file, robot=False)


def _write(profile: RobotProfile, setup: InitialState, file: Path, robot: bool) -> None:
    data = MujocoScene(profile, DEFAULT_PHYSICS, setup, robot).simulation.raw
    spec = build_spec(profile, setup, robot)
    spec.add_key(name=START, qpos=np.array(data.qpos), ctrl=np.array(data.ctrl))
    spec.compile()
    write_atomic(file, spec.to_xml())
