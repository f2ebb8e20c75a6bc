"""Objects in the simulator: friction that holds and yields, and complete hulls."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import trimesh

from gensim2.core.errors import InputError
from gensim2.sim.env import GenSim2Env

LID_MASS, LID_ARM, GRAVITY = 0.3, 0.1, 9.81  # of the crate's lid


def _lid(env: GenSim2Env, seconds: float, torque: float = 0.0) -> list[float]:
    """Return joint values of the lid while a torque acts on it, with no robot near."""
    values = []
    crate = env.parts["crate"]
    joint_force = np.array([torque], dtype=np.float32)
    for _ in range(round(seconds * env.sim_freq)):
        crate.articulation.set_qf(joint_force)
        env._before_simulation_step()
        env.scene.step()
        values.append(float(crate.articulation.qpos[0]))
    return values


def test_friction_holds_a_lid_that_gravity_pulls_for_five_seconds(crates: Callable[..., Any], crate_task: Any) -> None:
    env = GenSim2Env(crate_task, assets=crates(friction=0.35))
    env.reset(seed=0, options={"openness": 0.2})
    before = env.measure().openness["crate"]
    _lid(env, 5.0)
    assert abs(env.measure().openness["crate"] - before) < 0.002


def test_a_lid_without_enough_friction_falls_shut(crates: Callable[..., Any], crate_task: Any) -> None:
    env = GenSim2Env(crate_task, assets=crates(friction=0.15))
    env.reset(seed=0, options={"openness": 0.3})
    _lid(env, 5.0)
    assert env.measure().openness["crate"] < 0.01


@pytest.mark.parametrize(("joint_type", "friction"), [("revolute", 0.5), ("prismatic", 4.0)])
def test_the_joint_yields_at_load_plus_friction_and_not_before(
    crates: Callable[..., Any], crate_task: Any, joint_type: str, friction: float
) -> None:
    env = GenSim2Env(crate_task, assets=crates(friction=friction, joint_type=joint_type))
    openness = 0.3
    angle = openness * 1.5
    weight = LID_MASS * GRAVITY
    load = weight * LID_ARM * np.cos(angle) if joint_type == "revolute" else weight
    for share, moves in [(0.95, False), (1.1, True)]:
        env.reset(seed=0, options={"openness": openness})
        before = env.measure().openness["crate"]
        _lid(env, 1.0, torque=share * (load + friction))
        assert (env.measure().openness["crate"] - before > 0.02) == moves, share


def test_damping_sets_the_speed_under_a_constant_push(crates: Callable[..., Any], crate_task: Any) -> None:
    friction, damping, push = 1.0, 8.0, 6.0
    env = GenSim2Env(crate_task, assets=crates(friction=friction, damping=damping, joint_type="prismatic"))
    env.reset(seed=0, options={"openness": 0.1})
    values = _lid(env, 0.25, torque=push + LID_MASS * GRAVITY)  # below the upper limit
    speed = (values[-1] - values[-6]) / 0.05
    # Terminal speed: push = friction + damping * v.
    assert speed == pytest.approx((push - friction) / damping, rel=0.1)


def test_a_moving_joint_is_slowed_by_its_friction_and_nothing_else(crates: Callable[..., Any], crate_task: Any) -> None:
    """The prismatic lid rises as fast as the force beyond weight and friction allows."""
    friction, excess = 2.0, 1.0
    env = GenSim2Env(crate_task, assets=crates(friction=friction, joint_type="prismatic"))
    env.reset(seed=0, options={"openness": 0.1})
    values = _lid(env, 0.2, torque=LID_MASS * GRAVITY + friction + excess)
    assert values[-1] - 0.02 == pytest.approx(0.5 * excess / LID_MASS * 0.2**2, rel=0.1)


@pytest.mark.parametrize(
    ("vertices", "words"),
    [
        ([[0, 0, 0], [0.1, 0, 0], [0.2, 0, 0], [0.3, 0, 0]], "changed the shape of collision hull 1"),
        ([[0.1, 0.1, 0], [0.2, 0.1, 0], [0.1, 0.2, 0], [0.1, 0.1, 0.1]], "changed the shape of collision hull 1"),
    ],
)
def test_a_hull_that_is_not_what_was_promised_is_an_error(
    crates: Callable[..., Any], crate_task: Any, vertices: list[list[float]], words: str
) -> None:
    """SAPIEN silently replaces a flat hull by a box, and files may have been changed."""
    library = crates()
    mesh = trimesh.Trimesh(vertices, [[0, 1, 2], [1, 2, 3], [0, 1, 3], [0, 2, 3]], process=False)
    mesh.export(library.load("crate", "0").urdf.parent / "left.obj")
    with pytest.raises(InputError, match=f"body: .*{words}"):
        GenSim2Env(crate_task, assets=library)


def test_a_hull_that_lost_a_part_is_a_warning(crates: Callable[..., Any], crate_task: Any) -> None:
    library = crates()
    mesh = trimesh.creation.box((0.18, 0.01, 0.09))  # 2 cm shorter than the described wall
    mesh.apply_translation((-0.01, 0.095, 0.055))
    mesh.export(library.load("crate", "0").urdf.parent / "left.obj")
    env = GenSim2Env(crate_task, assets=library)
    assert env.object_warnings == ("crate: body: hull 1 lost 20.0 mm when the physics engine processed it",)


def test_a_missing_hull_is_an_error(crates: Callable[..., Any], crate_task: Any) -> None:
    library = crates()
    crate = library.load("crate", "0")
    lines = crate.urdf.read_text()
    crate.urdf.write_text(re.sub(r'<collision><geometry><mesh filename="left.obj"/></geometry></collision>', "", lines))
    with pytest.raises(InputError, match="body: 1 of 5 collision hulls were dropped"):
        GenSim2Env(crate_task, assets=library)


def test_an_instance_whose_joint_differs_from_its_urdf_is_refused(crates: Callable[..., Any], crate_task: Any) -> None:
    library = crates()
    crate = library.load("crate", "0")
    library._crates["0"] = dataclasses.replace(crate, joint=dataclasses.replace(crate.joint, upper=1.0))
    with pytest.raises(InputError, match="hinge: the joint limits must be"):
        GenSim2Env(crate_task, assets=library)
