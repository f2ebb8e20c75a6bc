"""Grasps of what may slip: those that have to press least come first."""

from __future__ import annotations

from math import hypot, tan
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from table_scenes import resting, table_scene

from gensim2.objects import open_library
from gensim2.planning.actions import CARRIED_WEIGHTS, GRAVITY, PAD_ARM, carrying_weights, grip_force
from gensim2.planning.grasping import grasps_of, lever_of, margin_of
from gensim2.planning.strategies import GraspStrategy
from gensim2.robots import robot

PANDA = robot()


class Found:
    """Stands for the solver's scene: gives the grasps that it was made with, in their order."""

    def __init__(self, *grasps: Any) -> None:
        self._grasps = grasps

    def grasps(self, *_: Any, **__: Any) -> list[Any]:
        return list(self._grasps)


def grasp(margin: float, lever: float) -> Any:
    """At the friction 1 of strategies; the pads ``lever`` (m) beside the centre of mass."""
    at = np.eye(4)
    at[:3, 3] = -PANDA.tool_keypoints["tool_head"] + [lever, 0.0, 0.0]
    return SimpleNamespace(quality={"tilt": 0.0, "friction_margin": margin}, T_object_hand=at)


@pytest.mark.parametrize("friction", [0.3, None])
def test_what_a_scene_barely_holds_is_ranked_by_how_hard_it_is_pressed(friction: float | None) -> None:
    """Flat faces far beside the centre of mass once came before round ones next to it, and the thing turned away."""
    scene = table_scene({"cup": resting(open_library("builtin").load_rigid("cup"), 0.0, 0.0)})
    thing = scene.objects["cup"]
    object.__setattr__(thing, "center_of_mass", np.zeros(3))
    object.__setattr__(thing, "friction", friction)
    object.__setattr__(scene, "finger_friction", 0.3)
    strategy = GraspStrategy(grasp="antipodal")
    far, near, lost = grasp(0.76, 0.036), grasp(0.70, 0.014), grasp(0.49, 0.0)
    found = grasps_of(Found(lost, far, near), scene, "cup", None, PANDA, strategy)  # type: ignore[arg-type]
    assert found == ([near, far, lost] if friction else [lost, far, near])
    if friction:
        needed = [
            carrying_weights(margin_of(each, scene, "cup", strategy), lever_of(each, thing, PANDA))
            for each in found[:2]
        ]
        assert needed == sorted(needed)


def test_the_force_carries_weight_and_torque_three_times() -> None:
    """Two fingers carry the weight by friction along the pads, and its torque on the arm of a pad."""
    margin, lever, mass = 0.2, 0.01, 0.3
    per_finger = mass * GRAVITY * hypot(1.0, lever / PAD_ARM) / (2 * tan(margin))
    assert carrying_weights(margin, lever) * mass * GRAVITY == pytest.approx(per_finger)
    assert grip_force(mass, margin, lever) == pytest.approx(CARRIED_WEIGHTS * per_finger)
