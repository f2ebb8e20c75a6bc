"""Joints of two arms and of a torso are planned together; judged by independent kinematics and by coal."""

from __future__ import annotations

import importlib.util
import pickle
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gensim2_kpam as kpam

pytest.importorskip("coal")
pytest.importorskip("pinocchio")

from mechanism import Mechanism
from parts import Moved, least_distance

Array = np.ndarray
HANDS = ("left_panda_hand", "right_panda_hand")
MARGIN = 0.005
#: Rest posture of one arm, with its fingers.
REST = [0.0, -0.32, 0.0, -2.2, 0.0, 1.9, 0.785398, 0.02, 0.02]
LIMITS: dict[str, Any] = {"acceleration_limits": np.full(18, 8.0), "jerk_limits": np.full(18, 400.0)}


def example(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(
        name, Path(__file__).parents[2] / "examples" / "robots" / f"{name}.py"
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def urdf(robots: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("dual") / "dual_panda.urdf"
    path.write_text(example("dual_panda").dual_panda())
    return path


@pytest.fixture(scope="module")
def judge(urdf: Path) -> Mechanism:
    return Mechanism(urdf.read_text(), urdf.parent, HANDS[0])


def load(urdf: Path, *sides: str, **more: Any) -> kpam.Robot:
    return kpam.Robot.from_urdf(urdf, hand_link=HANDS[0], joints=example("dual_panda").arm_joints(*sides), **more)


@pytest.fixture(scope="module")
def both(urdf: Path) -> kpam.Robot:
    return load(urdf, "left", "right")


def posture(left: list[float], right: list[float]) -> Array:
    """Return a joint vector with changes to the rest posture of the first joints of each arm."""
    q = np.array([REST, REST])
    q[0, : len(left)] += left
    q[1, : len(right)] += right
    return q.reshape(-1)


def gap(judge: Mechanism, q: Array, pairs: list[tuple[str, str]] | None = None, cutoff: float = 0.05) -> float:
    """Return the smallest distance (m) of the checked pairs of links over joint vectors (M, 18), by coal."""
    placed = judge.place(q)
    bodies = {name: Moved(name, judge.parts[name], placed[name]) for name in judge.parts}
    least = cutoff
    for one, two in judge.self_pairs if pairs is None else pairs:
        found = least_distance(bodies[one], bodies[two], np.arange(len(q)), least)
        least = least if found is None else min(least, found[0])
    return least


def assert_valid(judge: Mechanism, robot: kpam.Robot, motion: kpam.Motion, q_start: Array) -> Array:
    """Check limits, joints that are not planned, and distances at samples 10 ms apart; return the samples."""
    assert motion.status == "solved", motion.reason
    assert motion.trajectory is not None
    samples = np.asarray(motion.trajectory.sample_every(0.01))
    assert np.abs(samples[0] - q_start).max() < 1e-9
    assert (samples >= judge.lower - 1e-6).all()
    assert (samples <= judge.upper + 1e-6).all()
    assert (np.abs(np.diff(samples, axis=0)) / 0.01 <= judge.velocity + 1e-3).all()
    others = [k for k, name in enumerate(robot.joint_names) if name not in robot.planned_joints]
    assert np.abs(samples[:, others] - q_start[others]).max() < 1e-12
    ends = gap(judge, samples[[0, -1]])
    assert gap(judge, samples) > min(MARGIN, ends) - 2e-4
    return samples


def test_both_arms_pass_each_other(both: kpam.Robot, judge: Mechanism) -> None:
    # Each hand moves to the other side of the other hand: the arms must not collide on the way.
    q_start = posture([-0.6, 1.0], [0.6, 0.3])
    q_goal = posture([-0.6, 0.3], [0.6, 1.0])
    assert judge.disagreement(np.stack([q_start, q_goal])) < 1e-12
    line = q_start + np.linspace(0, 1, 41)[:, None] * (q_goal - q_start)
    assert gap(judge, line[[0, -1]]) > MARGIN
    assert gap(judge, line) < 0.0
    scene = kpam.Scene(both)
    found = scene.plan_to(q_start, q_goal, **LIMITS)
    samples = assert_valid(judge, both, found, q_start)
    assert np.abs(samples[-1] - q_goal).max() < 1e-6
    moved = np.ptp(samples, axis=0) > 1e-3
    assert moved[[0, 1, 9, 10]].all()
    again = kpam.Scene(pickle.loads(pickle.dumps(both))).plan_to(q_start, q_goal, **LIMITS)
    assert again.trajectory is not None
    assert found.trajectory is not None
    assert (again.trajectory.positions == found.trajectory.positions).all()


def pose_error(T: Array, goal: Array) -> float:
    """Return the larger of the distance (m) and the angle (rad) of two poses."""
    turn = Rotation.from_matrix(T[:3, :3].T @ goal[:3, :3]).magnitude()
    return max(float(np.linalg.norm(T[:3, 3] - goal[:3, 3])), float(turn))


def raised(judge: Mechanism, q: Array, *changes: list[float]) -> dict[str, Array]:
    """Return the poses of both hands at a joint vector (18,), moved by ``changes`` (m) in the base frame."""
    placed = judge.place(q[None])
    poses = {}
    for hand, change in zip(HANDS, changes, strict=True):
        poses[hand] = placed[hand][0].copy()
        poses[hand][:3, 3] += change
    return poses


def test_poses_for_both_hands(both: kpam.Robot, judge: Mechanism) -> None:
    q_start = posture([0.1], [-0.2])
    goals = raised(judge, q_start, [0.0, -0.1, -0.2], [0.05, 0.0, 0.1])
    scene = kpam.Scene(both)
    found = scene.ik(goals, q_start, max_solutions=6, margin=MARGIN)
    assert len(found) == 6
    for q in found:
        placed = judge.place(q[None])
        assert max(pose_error(placed[hand][0], goals[hand]) for hand in HANDS) < 1e-6
        assert (q >= judge.lower).all()
        assert (q <= judge.upper).all()
        assert gap(judge, q[None]) > MARGIN - 2e-4
    best = scene.ik(goals, q_start, max_solutions=1, posture=q_start, manipulability=0.1)[0]
    placed = judge.place(best[None])
    assert max(pose_error(placed[hand][0], goals[hand]) for hand in HANDS) < 1e-6
    motion = scene.plan_to(q_start, goals, **LIMITS)
    last = assert_valid(judge, both, motion, q_start)[-1:]
    assert max(pose_error(judge.place(last)[hand][0], goals[hand]) for hand in HANDS) < 1e-5
    for bad, field in (
        ({HANDS[0]: goals[HANDS[0]]}, "two links"),
        ({HANDS[0]: goals[HANDS[0]], "elbow": goals[HANDS[1]]}, "'elbow'|\"elbow\""),
    ):
        with pytest.raises(kpam.ProblemError, match=field):
            scene.plan_to(q_start, bad)
    with pytest.raises(kpam.ProblemError, match="link: must be omitted"):
        scene.ik(goals, q_start, link=HANDS[0])


def test_an_arm_without_a_goal_keeps_its_joints(both: kpam.Robot, judge: Mechanism) -> None:
    q_start = posture([0.1], [-0.2])
    goals = raised(judge, q_start, [0.0, -0.1, -0.2], [0.05, 0.0, 0.1])
    scene = kpam.Scene(both)
    for hand, still in ((HANDS[0], slice(9, 18)), (HANDS[1], slice(0, 9))):
        motion = scene.plan_to(q_start, goals[hand], link=hand, **LIMITS)
        assert motion.trajectory is not None
        last = motion.trajectory.positions[-1]
        assert pose_error(judge.place(last[None])[hand][0], goals[hand]) < 1e-5
        assert np.abs(last[still] - q_start[still]).max() < 1e-9
    # Without obstacles, a motion along lines and a keypoint plan move the joints of the hand only.
    along = scene.plan_along(q_start, [goals[HANDS[0]]], **LIMITS)
    assert along.trajectory is not None, along.reason
    assert np.abs(along.trajectory.positions[:, 9:] - q_start[9:]).max() < 1e-12


def test_a_part_of_an_arm(urdf: Path, judge: Mechanism) -> None:
    names = ["left_panda_joint4", "left_panda_joint2", "right_panda_joint6"]
    robot = kpam.Robot.from_urdf(urdf, hand_link=HANDS[0], joints=names)
    assert robot.planned_joints == names
    q_start, q_goal = posture([], []), posture([0.0, 0.2, 0.0, 0.3], [0.0, 0.0, 0.0, 0.0, 0.0, -0.4])
    assert_valid(judge, robot, kpam.Scene(robot).plan_to(q_start, q_goal, **LIMITS), q_start)
    with pytest.raises(kpam.ProblemError, match=r"goal\[0\]\[0\].*left_panda_joint1 is not planned"):
        kpam.Scene(robot).plan_to(q_start, posture([0.1], []), **LIMITS)


def test_overlaps_that_no_planned_joint_changes_block_no_motion(urdf: Path, both: kpam.Robot) -> None:
    # Two links of the right arm overlap.
    folded = [-0.1, 0.6, -0.5, -0.8, -0.2, -0.6, -0.8]
    q_start, q_goal = posture([], folded), posture([0.3], folded)
    # The right arm also rests inside a box.
    pose = np.eye(4)
    pose[:3, 3] = load(urdf, "left").forward_kinematics(q_start, "right_panda_link4")[:3, 3]
    box = kpam.Body("box", "rigid", [kpam.Shape.box([0.02, 0.02, 0.02])], pose)
    left = kpam.Scene(load(urdf, "left"), [box])
    assert {("right_panda_link4", "box")} < {pair["bodies"] for pair in left.check(q_start)}
    motion = left.plan_to(q_start, q_goal, **LIMITS)
    assert motion.status == "solved", motion.reason
    assert kpam.Scene(both).plan_to(q_start, q_goal, **LIMITS).status == "start_blocked"
    servo = kpam.Servo(left, q_start, acceleration_limits=np.full(18, 8.0), jerk_limits=np.full(18, 400.0))
    assert servo.step(twist=np.zeros(6)).status != "braking"


@pytest.mark.parametrize(
    ("joints", "message"),
    [
        ([], "at least one"),
        (["left_panda_joint1", "left_panda_joint1"], "twice"),
        (["left_panda_joint9"], "is not a moving joint"),
    ],
)
def test_bad_groups(urdf: Path, joints: list[str], message: str) -> None:
    with pytest.raises(kpam.ProblemError, match=f"joints: .*{message}"):
        kpam.Robot.from_urdf(urdf, hand_link=HANDS[0], joints=joints)


def test_mimic_joints_and_too_many_joints_are_refused(tmp_path: Path) -> None:
    text, names = '<link name="l0"/>', [f"j{k}" for k in range(18)]
    for k, name in enumerate(names):
        mimic = '<mimic joint="j0"/>' if k == 17 else ""
        text += (
            f'<link name="l{k + 1}"/><joint name="{name}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/>'
            f'<axis xyz="0 0 1"/>{mimic}<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        )
    (tmp_path / "chain.urdf").write_text(f'<robot name="chain">{text}</robot>')

    def plan(joints: list[str] | None) -> kpam.Motion:
        robot = kpam.Robot.from_urdf(tmp_path / "chain.urdf", hand_link="l18", joints=joints)
        q_goal = np.zeros(18)
        q_goal[3] = 0.5
        return kpam.Scene(robot).plan_to(np.zeros(18), q_goal)

    with pytest.raises(kpam.ProblemError, match="j17 follows j0; name j0 instead"):
        plan(["j17"])
    with pytest.raises(kpam.ProblemError, match="plans 17 independent joints; 1 to 16 can be planned"):
        plan(None)
    assert plan(names[1:17]).status == "solved"


def test_a_second_link_must_not_carry_the_hand(both: kpam.Robot) -> None:
    start = posture([], [])
    ahead = both.forward_kinematics(start)
    with pytest.raises(kpam.ProblemError, match=r"second_link: .*carries the hand"):
        kpam.Scene(both).plan_along(start, [ahead], second_link="left_panda_link3")


def test_two_hands_keep_their_relative_pose(both: kpam.Robot, judge: Mechanism) -> None:
    # The palms face each other 0.4 m apart, as if they held a box, which moves 0.2 m up and sideways and turns.
    def hands(x: float, y: float, z: float, turn: float) -> dict[str, Array]:
        out = {}
        for hand, side in zip(HANDS, (1.0, -1.0), strict=True):
            pose, box = np.eye(4), np.eye(4)
            pose[:3, :3] = np.column_stack([[0, 0, -1], [side, 0, 0], [0, -side, 0]])
            pose[1, 3] = 0.2 * side
            box[:3, :3], box[:3, 3] = Rotation.from_euler("z", turn).as_matrix(), [x, y, z]
            out[hand] = box @ pose
        return out

    scene = kpam.Scene(both)
    first = hands(0.5, 0.0, 0.25, 0.0)
    q_start = scene.ik(first, posture([], []), max_solutions=1, margin=MARGIN)[0]
    poses = [hands(0.5, 0.0, 0.4, 0.0)[HANDS[0]]]
    poses += [hands(0.5, 0.15 * s, 0.4 + 0.05 * s, 0.3 * s)[HANDS[0]] for s in np.linspace(0.1, 1, 10)]
    motion = scene.plan_along(q_start, poses, second_link=HANDS[1], **LIMITS)
    samples = assert_valid(judge, both, motion, q_start)
    assert motion.trajectory is not None
    placed = judge.place(np.asarray(motion.trajectory.sample_every(0.002)))
    relative = np.linalg.inv(placed[HANDS[0]]) @ placed[HANDS[1]]
    off = np.linalg.norm(relative[:, :3, 3] - relative[0, :3, 3], axis=1)
    turns = (Rotation.from_matrix(relative[0, :3, :3]).inv() * Rotation.from_matrix(relative[:, :3, :3])).magnitude()
    assert off.max() < 1e-3
    assert turns.max() < np.radians(0.5)
    last = judge.place(samples[-1:])
    goal = hands(0.5, 0.15, 0.45, 0.3)
    assert all(pose_error(last[hand][0], goal[hand]) < 2e-3 for hand in HANDS)
    # Without the second link, the other hand stays behind.
    alone = scene.plan_along(q_start, poses[:1], **LIMITS)
    assert alone.trajectory is not None
    assert np.abs(alone.trajectory.positions[:, 9:] - q_start[9:]).max() < 1e-12
    # Both hands may touch the box that they hold; one hand alone may not.
    box = kpam.Body("box", "rigid", [kpam.Shape.box([0.05, 0.1, 0.05])], np.eye(4))
    box = kpam.Scene(both, [box]).with_pose(
        "box", np.array([[1, 0, 0, 0.5], [0, 1, 0, 0], [0, 0, 1, 0.25], [0, 0, 0, 1]])
    )
    held = box.attached("box", q_start)
    assert held.plan_along(q_start, poses, second_link=HANDS[1], **LIMITS).status == "solved"
    assert held.plan_along(q_start, poses[:1], **LIMITS).status == "start_blocked"
    with pytest.raises(kpam.ProblemError, match="second_link: no planned joint"):
        scene.plan_along(q_start, poses, second_link="left_panda_leftfinger")
    with pytest.raises(kpam.ProblemError, match='second_link: "third_hand" is not a link'):
        scene.plan_along(q_start, poses, second_link="third_hand")
    with pytest.raises(kpam.ProblemError, match="free_axis: must be omitted"):
        scene.plan_along(q_start, poses, second_link=HANDS[1], free_axis=[0, 0, 1])
