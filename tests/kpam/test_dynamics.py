"""Limits that depend on the state: Franka's velocity limits by position, and torques by inverse dynamics."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

import gensim2_kpam as kpam

Array = npt.NDArray[np.float64]
UR5E = Path(__file__).parents[2] / "examples" / "robots" / "ur5e.urdf"
#: From Franka's documentation of the Research 3: largest velocity, factor under the root, offset, and both limits
#: (rad).
FR3 = (
    np.array([2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26]),
    np.array([12.0, 5.17, 7.0, 8.0, 34.0, 11.0, 34.0]),
    np.array([0.3, 0.2, 0.2, 0.3, 0.35, 0.35, 0.35]),
    np.array([2.7501, 1.7918, 2.9065, -0.1458, 2.8101, 4.5205, 3.0196]),
    np.array([-2.7501, -1.7918, -2.9065, -3.0481, -2.8101, 0.54092, -3.0196]),
)


def allowed(q: Array) -> tuple[Array, Array]:
    """Return the velocity limits of the Research 3 at (N, 7) positions: upwards and downwards, both positive."""
    greatest, gain, offset, upper, lower = FR3
    up = np.minimum(greatest, np.maximum(0.0, -offset + np.sqrt(np.maximum(0.0, gain * (upper - q)))))
    down = np.minimum(greatest, np.maximum(0.0, -offset + np.sqrt(np.maximum(0.0, gain * (q - lower)))))
    return up, down


@pytest.fixture(scope="module")
def ur5e() -> kpam.Robot:
    return kpam.Robot.from_urdf(str(UR5E), hand_link="flange")


def test_torques_are_pinocchios(ur5e: kpam.Robot, panda: kpam.Robot) -> None:
    pin = pytest.importorskip("pinocchio")
    from gensim2.robots import robot

    draw = np.random.default_rng(5)
    for ours, urdf in ((ur5e, UR5E), (panda, robot("panda").urdf)):
        model = pin.buildModelFromUrdf(str(urdf))
        data = model.createData()
        names = [str(name) for name in model.names[1:]]
        order = [names.index(name) for name in ours.joint_names]
        n = len(names)
        assert ours.mass == pytest.approx(pin.computeTotalMass(model) + rooted(pin, model), rel=1e-9)
        for _ in range(50):
            q, v, a = draw.uniform(-2, 2, n), draw.normal(0, 2, n), draw.normal(0, 5, n)
            theirs = pin.rnea(model, data, q, v, a)
            found = ours.inverse_dynamics(q[order], v[order], a[order])
            np.testing.assert_allclose(found, theirs[order], rtol=1e-9, atol=1e-9)


def rooted(pin: object, model: object) -> float:
    """Return the mass that no joint carries, which Pinocchio assigns to the universe."""
    return float(model.inertias[0].mass)  # type: ignore[attr-defined]


def test_torques_of_many_states_come_together(ur5e: kpam.Robot) -> None:
    draw = np.random.default_rng(6)
    q, v, a = draw.uniform(-1, 1, (3, 4, 6))
    together = ur5e.inverse_dynamics(q, v, a)
    assert together.shape == (4, 6)
    np.testing.assert_array_equal(together[2], ur5e.inverse_dynamics(q[2], v[2], a[2]))
    weightless = ur5e.inverse_dynamics(q[0], 0 * v[0], 0 * a[0], gravity=(0.0, 0.0, 0.0))
    np.testing.assert_allclose(weightless, 0.0, atol=1e-12)
    with pytest.raises(kpam.ProblemError, match="shape of q"):
        ur5e.inverse_dynamics(q, v[0], a)


def test_plans_keep_torque_limits_by_pinocchio(ur5e: kpam.Robot) -> None:
    pin = pytest.importorskip("pinocchio")
    model = pin.buildModelFromUrdf(str(UR5E))
    data = model.createData()
    draw = np.random.default_rng(7)
    scene = kpam.Scene(ur5e)
    slower = 0
    for _ in range(12):
        a, b = draw.uniform(-1, 1, (2, 6)) + np.array([0, -1.2, 1.2, 0, 0, 0])
        held = np.max([np.abs(pin.rnea(model, data, q, np.zeros(6), np.zeros(6))) for q in (a, b)], axis=0)
        limits = np.maximum(1.35 * held, [20, 20, 20, 2, 2, 2])
        free = scene.plan_to(a, b, velocity_limits=[3.0] * 6)
        bound = scene.plan_to(a, b, velocity_limits=[3.0] * 6, torque_limits=list(limits))
        if bound.trajectory is None or free.trajectory is None:
            assert bound.status in (kpam.MotionStatus.UNTIMED, free.status)
            continue
        slower += bound.trajectory.duration > 1.02 * free.trajectory.duration
        times = np.linspace(0.0, bound.trajectory.duration, 20_000)
        for q, v, gain in zip(*bound.trajectory.sample(times), strict=True):
            assert (np.abs(pin.rnea(model, data, q, v, gain)) <= limits * (1 + 1e-6)).all()
    assert slower >= 3


def test_what_cannot_be_held_has_no_motion(ur5e: kpam.Robot) -> None:
    stretched, up = np.zeros(6), np.array([0, -np.pi / 2, 0, 0, 0, 0])
    load = np.abs(ur5e.inverse_dynamics(stretched, np.zeros(6), np.zeros(6)))
    motion = kpam.Scene(ur5e).plan_to(up, stretched, torque_limits=list(0.9 * load + 1.0), samples=2000)
    assert motion.status == "overloaded"
    assert motion.trajectory is None


def test_torque_limits_need_masses(panda: kpam.Robot) -> None:
    text = '<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="prismatic"><parent link="a"/>'
    text += '<child link="b"/><axis xyz="1 0 0"/><limit lower="0" upper="1" velocity="1" effort="7"/></joint></robot>'
    light = robot_of(text)
    assert list(light.effort) == [7.0]
    with pytest.raises(kpam.ProblemError, match=r"torque_limits.*masses"):
        kpam.Scene(light).plan_to([0.1], [0.9], torque_limits=[5.0])


def robot_of(text: str) -> kpam.Robot:
    import tempfile

    with tempfile.NamedTemporaryFile("w", suffix=".urdf") as file:
        file.write(text)
        file.flush()
        return kpam.Robot.from_urdf(file.name, hand_link="b")


def test_the_research_3_keeps_its_limits_by_position() -> None:
    greatest, gain, offset, upper, lower = FR3
    draw = np.random.default_rng(8)
    braking = list(zip(upper, lower, gain, offset, strict=True))
    bound = 0
    for _ in range(60):
        near = offset**2 / gain + 0.02
        ends = draw.uniform(lower + near, upper - near, (2, 7))
        middle = 0.5 * (ends[0] + ends[1]) + draw.normal(0, 0.05, 7)
        motion, _ = kpam.retime([ends[0], middle, ends[1]], greatest, [10.0] * 7, [5000.0] * 7, braking=braking)
        plain, _ = kpam.retime([ends[0], middle, ends[1]], greatest, [10.0] * 7, [5000.0] * 7)
        bound += motion.duration > 1.005 * plain.duration
        q, v, a = motion.sample(np.linspace(0.0, motion.duration, 20_000))
        up, down = allowed(q)
        assert (v <= up * (1 + 1e-6) + 1e-8).all()
        assert (-v <= down * (1 + 1e-6) + 1e-8).all()
        assert (np.abs(a) <= 10.0 * (1 + 1e-6)).all()
    assert bound >= 10


def test_motions_of_an_arm_of_seven_joints_keep_the_research_3s_limits(panda: kpam.Robot) -> None:
    draw = np.random.default_rng(9)
    scene = kpam.Scene(panda)
    low, high = np.maximum(panda.lower[:7], FR3[4]) + 0.05, np.minimum(panda.upper[:7], FR3[3]) - 0.05
    seen = 0
    for _ in range(10):
        a, b = (np.append(draw.uniform(low, high), [0.04, 0.04]) for _ in range(2))
        motion = scene.plan_to(a, b, limits="fr3", samples=2000, velocity_limits=[10.0] * 9)
        if motion.trajectory is None:
            continue
        seen += 1
        q, v, _ = motion.trajectory.sample(np.linspace(0.0, motion.trajectory.duration, 10_000))
        up, down = allowed(q[:, :7])
        assert (v[:, :7] <= up * (1 + 1e-6) + 1e-8).all()
        assert (-v[:, :7] <= down * (1 + 1e-6) + 1e-8).all()
    assert seen >= 3


def test_torques_with_a_payload_are_those_of_an_added_body(ur5e: kpam.Robot) -> None:
    pin = pytest.importorskip("pinocchio")
    draw = np.random.default_rng(8)
    for _ in range(10):
        mass, center = draw.uniform(0.1, 5.0), draw.uniform(-0.2, 0.2, 3)
        root = draw.normal(0, 0.1, (3, 3))
        inertia = root @ root.T
        model = pin.buildModelFromUrdf(str(UR5E))
        flange = model.frames[model.getFrameId("flange")]
        model.appendBodyToJoint(flange.parentJoint, pin.Inertia(mass, center, inertia), flange.placement)
        data = model.createData()
        loaded = kpam.Scene(ur5e).with_payload(mass, center, inertia).robot
        assert loaded.mass == pytest.approx(ur5e.mass + mass)
        for _ in range(10):
            q, v, a = draw.uniform(-2, 2, 6), draw.normal(0, 2, 6), draw.normal(0, 5, 6)
            np.testing.assert_allclose(loaded.inverse_dynamics(q, v, a), pin.rnea(model, data, q, v, a), atol=1e-9)


def test_a_payload_slows_motions_down_or_is_refused(ur5e: kpam.Robot) -> None:
    pin = pytest.importorskip("pinocchio")
    scene = kpam.Scene(ur5e)
    start, goal = [0.8, -1.2, 1.5, -1.9, -1.6, 0.0], [-0.8, -0.6, 1.0, -1.9, -1.6, 0.0]
    center = [0.02, 0.0, 0.08]
    limits = np.array([60.0, 110.0, 60.0, 20.0, 20.0, 20.0])
    empty = scene.plan_to(start, goal, torque_limits=limits, acceleration_limits=[30.0] * 6).trajectory
    assert empty is not None
    last = empty.duration
    for mass in (2.0, 5.0):
        loaded = scene.with_payload(1.0).with_payload(mass, center)  # the second payload replaces the first
        motion = loaded.plan_to(start, goal, torque_limits=limits, acceleration_limits=[30.0] * 6).trajectory
        assert motion is not None
        assert motion.duration > last
        last = motion.duration
        model = pin.buildModelFromUrdf(str(UR5E))
        flange = model.frames[model.getFrameId("flange")]
        added = pin.Inertia(mass, np.array(center), np.zeros((3, 3)))
        model.appendBodyToJoint(flange.parentJoint, added, flange.placement)
        data = model.createData()
        for q, v, a in zip(*motion.sample(np.linspace(0, motion.duration, 1000)), strict=True):
            assert (np.abs(pin.rnea(model, data, q, v, a)) <= limits * (1 + 1e-6)).all()
    refused = scene.with_payload(30.0, center).plan_to(start, goal, torque_limits=limits)
    assert (refused.status, refused.trajectory) == ("overloaded", None)
    torque = scene.with_payload(30.0, center).robot.inverse_dynamics(start, np.zeros(6), np.zeros(6))
    worst = int(np.argmax(np.abs(torque) / limits))
    for part in ("at the start", ur5e.joint_names[worst], f"{abs(torque[worst]):.2f}", f"{limits[worst]:.2f}"):
        assert part in refused.reason
    # Without a payload, the plan is the one of the scene.
    again = (
        scene.with_payload(5.0)
        .with_payload(0.0)
        .plan_to(start, goal, torque_limits=limits, acceleration_limits=[30.0] * 6)
    )
    assert again.trajectory is not None
    np.testing.assert_array_equal(again.trajectory.positions, empty.positions)
    with pytest.raises(kpam.ProblemError, match="mass"):
        scene.with_payload(-1.0)
    with pytest.raises(kpam.ProblemError, match="inertia"):
        scene.with_payload(1.0, inertia=-np.eye(3))


def test_a_goal_that_cannot_be_held_leaves_the_other_goals(ur5e: kpam.Robot) -> None:
    start = np.array([0.0, -1.57, 0.3, -1.57, 0.0, 0.0])
    stretched, bent = np.array([-0.4, -0.2, 0.1, -1.57, 0.0, 0.0]), np.array([1.6, -1.3, 0.9, -1.0, 0.3, 0.2])
    place = np.eye(4)
    place[:3, 3] = [0.12, 0.42, 1.03]
    wall = kpam.Body("wall", "rigid", [kpam.Shape.box([0.15, 0.02, 0.25])], place)
    scene = kpam.Scene(ur5e, [wall]).with_payload(5.0, [0.0, 0.0, 0.1])
    needed = [np.abs(scene.robot.inverse_dynamics(q, np.zeros(6), np.zeros(6))) for q in (start, bent)]
    limits = np.maximum(1.4 * np.max(needed, axis=0) + 8.0, 10.0)
    limits[1] = 90.0
    assert scene.plan_to(start, stretched, torque_limits=limits).status == "overloaded"
    motion = scene.plan_to(start, [stretched, bent], torque_limits=limits, samples=5000)
    assert (motion.status, motion.goal) == ("solved", 1)
