"""Damaged pickles give a solver error or a usable value, and never a panic."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import gensim2_kpam as kpam
from gensim2.core import seeding

from .kpam_scenes import Q_START, TOOL, config, problem, table

ROUNDS = 150


def damaged(data: bytes, draw: np.random.Generator) -> bytes:
    """Return bytes with some of them changed or cut off, or with an invalid number."""
    out = bytearray(data)
    at = int(draw.integers(len(out)))
    match int(draw.integers(4)):
        case 0:
            del out[at:]
        case 1:
            out[at : at + 8] = np.float64(draw.choice([np.nan, np.inf, -1e300])).tobytes()
        case _:
            out[at] = int(draw.integers(256))
    return bytes(out)


def cases(panda: kpam.Robot) -> dict[str, tuple[Any, Callable[[Any], Any]]]:
    """Return values and the functions that use them after reading."""
    question = problem(panda, config=config(gripper="hold", let_go=0.05), options={"samples": 20, "extra_seeds": 2})
    plan = kpam.plan(question)
    scene = kpam.Scene(panda, [table()])
    gripper = kpam.ParallelGripper.of_robot(panda, **TOOL)
    return {
        "robot": (panda, lambda robot: robot.forward_kinematics(np.zeros(len(robot.joint_names)))),
        "shape": (kpam.Shape.box([0.1, 0.1, 0.1]), lambda shape: kpam.Body("box", "rigid", [shape], np.eye(4))),
        "body": (table(), lambda body: kpam.Scene(panda, [body]).distance(Q_START)),
        "joint": (kpam.Joint("revolute", [0, 0, 0], [0, 0, 1], 0.1, 0.0, 1.0), lambda j: problem(panda, joint=j)),
        "scene": (scene, lambda scene: scene.check(Q_START, 0.1)),
        "problem": (question, lambda question: kpam.plan(question, max_checks=100)),
        "plan": (plan, lambda former: kpam.plan(question, warm_start=former, resume="let_go", max_checks=100)),
        "trajectory": (plan.trajectory, lambda trajectory: trajectory.sample(0.5)),
        "motion": (scene.plan_to(Q_START, Q_START), lambda motion: (motion.corners, motion.trajectory, motion.nearer)),
        "gripper": (gripper, lambda gripper: scene.grasps("table", gripper, options={"samples": 4, "trials": 4})),
    }


@pytest.mark.parametrize(
    "name", ["robot", "shape", "body", "joint", "scene", "problem", "plan", "trajectory", "motion", "gripper"]
)
def test_tampered_pickles_are_refused_or_serve(panda: kpam.Robot, name: str) -> None:
    value, use = cases(panda)[name]
    read, (data,) = value.__reduce__()
    use(read(data))
    assert pickle.loads(pickle.dumps(value)).__reduce__()[1] == (data,)
    draw = seeding.rng(0, f"tampered pickles of a {name}")
    refused = 0
    for _ in range(ROUNDS):
        try:
            use(read(damaged(data, draw)))
        except kpam.KpamError:
            refused += 1
    assert refused > ROUNDS // 10
