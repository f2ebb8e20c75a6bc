"""An arm of four joints: pose goals allow as much as four joint vectors, and starts may exceed the joint limits."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from constraints import parallel, point_to_point
from tests.kpam.kpam_scenes import problem

import gensim2_kpam as kpam

LINK = """<link name="{0}"><collision><origin xyz="0.15 0 {1}"/><geometry><box size="0.3 0.04 0.04"/></geometry>
</collision></link>"""
TURN = """<joint name="{0}" type="revolute"><origin xyz="{1} 0 0"/><parent link="{2}"/><child link="{3}"/>
<axis xyz="0 0 1"/><limit lower="-2.9" upper="2.9" velocity="2" effort="50"/></joint>"""
SCARA = f"""<robot name="scara"><link name="base"/><link name="lift"/>
<link name="hand"><collision><origin xyz="0 0.05 0"/>
<geometry><box size="0.01 0.01 0.02"/></geometry></collision></link>
{LINK.format("upper", 0.0)}{LINK.format("lower", 0.08)}
{TURN.format("j1", 0.0, "base", "upper")}{TURN.format("j2", 0.3, "upper", "lower")}
<joint name="j3" type="prismatic"><origin xyz="0.3 0 0"/><parent link="lower"/><child link="lift"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="1" effort="50"/></joint>
{TURN.format("j4", 0.0, "lift", "hand")}</robot>"""


@pytest.fixture(scope="module")
def scara(tmp_path_factory: pytest.TempPathFactory) -> kpam.Robot:
    path: Path = tmp_path_factory.mktemp("scara") / "scara.urdf"
    path.write_text(SCARA)
    return kpam.Robot.from_urdf(path, hand_link="hand")


def test_a_rigid_transform_is_a_pose_and_no_four_joint_vectors(scara: kpam.Robot) -> None:
    wanted = [0.9, 0.8, 0.2, -0.5]
    pose = scara.forward_kinematics(wanted)
    motion = kpam.Scene(scara).plan_to([0.0] * 4, pose)
    assert motion.trajectory is not None, motion.reason
    reached = scara.forward_kinematics(motion.trajectory.positions[-1])
    np.testing.assert_allclose(reached, pose, atol=1e-5)
    goals = [[0.5, 0.1, 0.0, 0.0], [0.1, 0.1, 0.0, 0.0], [1.0, 0.0, 0.1, 0.0], [-0.4, 0.0, 0.0, 0.3]]
    motion = kpam.Scene(scara).plan_to([0.0] * 4, goals)
    assert motion.goal is not None
    assert motion.trajectory is not None
    np.testing.assert_allclose(motion.trajectory.positions[-1], goals[motion.goal], atol=1e-9)


def test_joint_vectors_of_a_pose_are_within_the_limits_wherever_it_is_begun(scara: kpam.Robot) -> None:
    beyond = [3.2, 0.2, 0.0, 0.3]  # in simulators, joints may exceed their limits a little
    scene = kpam.Scene(scara)
    for q in (beyond, [2.9004, -0.5, 0.3, 0.1]):
        for found in scene.ik(scara.forward_kinematics(q), q):
            assert (found >= scara.lower - 1e-9).all()
            assert (found <= scara.upper + 1e-9).all()


@pytest.mark.parametrize("seed", [-1, 1_000_001, 2**40])
def test_seeds_that_none_draws_from_are_refused(scara: kpam.Robot, seed: int) -> None:
    scene, pose = kpam.Scene(scara), scara.forward_kinematics([0.9, 0.8, 0.2, -0.5])
    with pytest.raises((kpam.ProblemError, OverflowError)):
        scene.ik(pose, [0.0] * 4, seed=seed)
    with pytest.raises((kpam.ProblemError, OverflowError)):
        scene.plan_to([0.0] * 4, pose, seed=seed)


def test_proving_a_path_ends_with_the_deadline(scara: kpam.Robot) -> None:
    axis = parallel("a", "b", [0, 0, 1], 1e-6)
    motion = kpam.Scene(scara).plan_to(
        [-1.0, 0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0, 0.0],
        path=kpam.SolverConfig({"constraint_list": [axis]}),
        tool_keypoints={"a": [0.0, 0.0, 0.0], "b": [0.0, 0.0, 0.1]},
        deadline_ms=50.0,
    )
    assert motion.status == "late"
    assert motion.cpu_ms < 2000.0  # about ten seconds without the limit


def test_numbers_of_numpy_are_options_and_seeds(panda: kpam.Robot) -> None:
    options = {
        "seed": np.int64(5),
        "num_seeds": np.int32(8),
        "margin": np.float32(0.01),
        "avoid_collisions": np.bool_(True),
    }
    plain = {"seed": 5, "num_seeds": 8, "margin": float(np.float32(0.01)), "avoid_collisions": True}
    plans = [kpam.plan(problem(panda, options=given)) for given in (options, plain)]
    assert plans[0].trajectory is not None
    assert plans[1].trajectory is not None
    np.testing.assert_array_equal(plans[0].trajectory.positions, plans[1].trajectory.positions)


def thing(name: str, place: list[float], half: list[float]) -> kpam.Body:
    pose = np.eye(4)
    pose[:3, 3] = place
    return kpam.Body(name, "rigid", [kpam.Shape.box(half)], pose)


def test_more_of_a_search_never_takes_a_part_back(scara: kpam.Robot) -> None:
    """A post blocks the straight path and a plate ends the lift: each of two margins gives a partial motion."""
    goal = scara.forward_kinematics([0.7, 0.3, 0.1, -0.5])[:3, 3]
    point = point_to_point("tip", "goal", 0.001)
    question = kpam.KeypointProblem(
        scara,
        kpam.SolverConfig({"constraint_list": [point], "post_actuation_motions": [["translate_z", 0.35]]}),
        [-0.9, 0.2, 0.0, 0.3],
        tool_keypoints={"tip": [0.0, 0.0, 0.0]},
        object_keypoints={"goal": goal.tolist()},
        T_base_object=np.eye(4),
        bodies=[
            thing("plate", (goal + np.array([0.0, 0.0, 0.25])).tolist(), [0.06, 0.06, 0.01]),
            thing("post", [0.5, 0.0, 0.0], [0.02, 0.02, 0.4]),
        ],
        options={
            "allow_partial": True,
            "margin": 0.02,
            "least_margin": 0.0,
            "limits": "plain",
            "extra_seeds": 0,
            "candidates": 3,
        },
    )
    plans = [kpam.plan(question, max_checks=checks) for checks in range(100, 12000, 150)]
    found = [plan.trajectory is not None for plan in plans]
    assert not found[0]
    assert found == sorted(found)
    margins = [plan.margin for plan in plans if plan.trajectory is not None]
    assert margins[0] == 0.02
    assert margins[-1] == 0.0
