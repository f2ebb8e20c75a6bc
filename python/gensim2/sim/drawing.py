"""Draw recorded states with the renderer that works on this machine."""

from __future__ import annotations

from collections.abc import Mapping

from gensim2.objects import ObjectModel
from gensim2.perception.raycast.state_drawing import StateDrawing
from gensim2.robots import RobotProfile
from gensim2.scenes.physics import Engine
from gensim2.sim.driver import renderer


def state_drawing(engine: Engine, profile: RobotProfile, objects: Mapping[str, ObjectModel]) -> StateDrawing:
    """Return an object that draws recorded states.

    The object is MuJoCo's renderer if MuJoCo is the engine and its renderer works, and the ray caster otherwise.

    Args:
        objects: objects by name, in the task's order.

    Raises:
        InputError: a file of the robot or of an object cannot be used.
    """
    if renderer(engine).name != "mujoco":
        return StateDrawing(profile, objects)
    from gensim2.sim.mujoco.drawing import MujocoDrawing

    return MujocoDrawing(profile, objects)
