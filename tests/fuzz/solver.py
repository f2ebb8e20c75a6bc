"""Hostile arguments for ``gensim2_kpam``, drawn by a seed, and how its calls end.

``python tests/fuzz/solver.py --inputs 5000`` calls the solver with one to three arguments replaced: huge numbers, NaN,
wrong shapes and types, counts below zero, names of a megabyte, and values of other classes. Each call runs in a forked
process with 1 GiB of memory and 5 s of CPU. A call returns a right answer, or raises one error of one line that names
the argument. Arrays that hold the same numbers in another layout give the same answer.
"""

from __future__ import annotations

import math
import sys
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from mutate import HOSTILE_VALUES, LONGEST_MESSAGE, damaged_value
from runner import CANARY, Ended, Round, Say, Tally, in_process, main, tried

sys.path += [str(Path(__file__).parents[1]), str(Path(__file__).parents[1] / "common")]

from kpam.conftest import panda_folder
from kpam.kpam_scenes import Q_START, TOOL, config, problem, table

import gensim2_kpam as kpam

GOAL = Q_START + np.array([0.3, 0.1, 0.0, 0.2, 0.0, 0.0, 0.1, 0.0, 0.0])
QUICK = {"samples": 20, "extra_seeds": 2, "num_seeds": 8, "candidates": 4}
REASONABLE = 10_000.0
"""Largest number of samples and checks: more is work that was asked for."""


@dataclass(frozen=True)
class Call:
    """A call that succeeds, and a check of its answers.

    Attributes:
        run: takes the arguments by name.
        good: arguments.
        check: takes the answer and the arguments; fails where the answer is wrong.
        layouts: whether arrays may have any layout.
    """

    run: Callable[..., Any]
    good: Mapping[str, Any]
    check: Callable[[Any, Mapping[str, Any]], object] = lambda answer, arguments: None
    layouts: bool = True


class Lying:
    """A sequence whose length is not that of its entries."""

    def __len__(self) -> int:
        return 9

    def __getitem__(self, index: int) -> float:
        if index > 3:
            raise RuntimeError("no more")
        return 0.0


class Raising:
    """A value that raises whatever is asked of it."""

    def __array__(self, *_: Any, **__: Any) -> Any:
        raise KeyError("array")

    def __float__(self) -> float:
        raise ValueError("float")

    def __index__(self) -> int:
        raise ZeroDivisionError("index")


def same(array: np.ndarray, generator: np.random.Generator) -> Any:
    """Return the same numbers in another layout."""
    wide = np.repeat(array[..., None], 2, axis=-1)
    read_only = array.copy()
    read_only.flags.writeable = False
    forms = (
        array.tolist(),
        wide[..., 0],
        array[::-1].copy()[::-1],
        np.asfortranarray(array),
        array.astype(">f8"),
        array.astype(np.longdouble),
        array.astype(object),
        read_only,
        tuple(array),
        np.frombuffer(b"\0" + array.tobytes(), dtype=np.uint8)[1:].view(array.dtype).reshape(array.shape),
    )
    return forms[int(generator.integers(len(forms)))]


def other(array: np.ndarray, generator: np.random.Generator) -> Any:
    """Return an array of other numbers, another shape or another type."""
    spoilt = array.astype(np.float64).copy()
    value = generator.choice([np.nan, np.inf, -np.inf, 1e308, -1e308, 5e-324, 1e9, -1.0, 0.0])
    spoilt.flat[int(generator.integers(max(1, spoilt.size))) : None if generator.random() < 0.2 else 1] = value
    if array.size:
        spoilt.flat[int(generator.integers(array.size))] = value
    masked = np.ma.masked_array(array, mask=generator.random(array.shape) < 0.5)
    forms = (
        spoilt,
        spoilt,
        spoilt,
        np.full_like(array, value),
        array[:-1],
        array[:0],
        array[None],
        array.ravel(),
        array.T,
        np.concatenate([array, array]),
        np.zeros((0, *array.shape)),
        np.zeros((*array.shape, 0)),
        np.zeros((2**20, 1)),
        np.broadcast_to(0.0, (2**40,)),
        masked,
        array.astype(np.float16),
        array.astype(complex) + 1j,
        array.astype("m8[s]"),
        array.astype("U32"),
        array.astype("S32"),
        array.astype(np.uint8),
        array.astype(bool),
        np.zeros(array.shape, [("a", "f8")]),
        [Fraction(1, 3)] * len(array),
        [None] * len(array),
        [*array.tolist()[:-1], [1.0]],
        [*array.tolist()[:-1], "1.0"],
        Lying(),
        Raising(),
        memoryview(array.tobytes()),
        array.tolist().__iter__(),
        {0: 1.0},
        math.nan,
    )
    return forms[int(generator.integers(len(forms)))]


def hostile(value: Any, values: list[Any], generator: np.random.Generator) -> Any:
    """Return a value in the place of a good one; ``values`` are those of other arguments."""
    way = generator.random()
    if isinstance(value, np.ndarray) and way < 0.8:
        return other(value, generator)
    if isinstance(value, Mapping) and way < 0.7:
        return damaged_value(_plain(value), generator)
    if isinstance(value, list) and value and way < 0.5:
        odd: tuple[Any, ...] = ([value], value * 3, [], value[0], [*value[:-1], None], tuple(value), set(), "".join)
        return odd[int(generator.integers(len(odd)))]
    if isinstance(value, int | float) and way < 0.6:
        numbers = (-1, -(2**63), 2**63, 2**64, 2**200, -0.0, 0.5, math.nan, math.inf, -math.inf, 1e308, -1e308, 5e-324)
        return numbers[int(generator.integers(len(numbers)))]
    if isinstance(value, str) and way < 0.7:
        words = (
            "",
            "a\0b",
            "x\n" * 500_000,
            "x" * 1_000_000,
            "\ud800",
            "\u202e",
            value + " ",
            b"panda_hand",
            value * 2,
        )
        return words[int(generator.integers(len(words)))]
    if way < 0.9:
        pool: tuple[Any, ...] = (
            *HOSTILE_VALUES,
            Raising(),
            Lying(),
            object(),
            print,
            MappingProxyType({"x": 1}),
            b"",
            1j,
        )
        return pool[int(generator.integers(len(pool)))]
    return values[int(generator.integers(len(values)))]


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    return value.tolist() if isinstance(value, np.ndarray) else value


def finite(*arrays: Any) -> None:
    """Check that numbers are finite."""
    for array in arrays:
        assert np.isfinite(np.asarray(array)).all(), f"not finite: {array}"


def all_finite(answer: Any, _: Any) -> None:
    finite(*answer) if isinstance(answer, tuple) else finite(answer)


def check_trajectory(motion: kpam.Trajectory, velocity: Any = math.inf) -> None:
    """Check that a motion is finite, in order of time, within its velocity limits and at rest at its end."""
    times = motion.times
    finite(times, motion.positions)
    assert (np.diff(times) >= 0.0).all()
    q, v, a = motion.sample(times)
    finite(q, v, a)
    assert (np.abs(v) <= np.asarray(velocity) * (1 + 1e-6) + 1e-9).all(), "faster than its limits"
    np.testing.assert_allclose(motion.sample(times[-1])[1], 0.0, atol=1e-6)


def given(**arguments: Any) -> dict[str, Any]:
    """Return arguments by name."""
    return arguments


def cancelled(scene: kpam.Scene, question: kpam.KeypointProblem, wait: object) -> set[str]:
    """Plan in four threads at once, drop what is planned, cancel after up to 0.2 s, and return the outcomes."""
    cancel, ended = kpam.Cancel(), []

    def ask(each: kpam.Scene, asked: kpam.KeypointProblem, number: int) -> None:
        if number % 2:
            ended.append(str(each.plan_to(Q_START, GOAL, limits="panda", cancel=cancel, seed=number).status))
        else:
            ended.append(str(kpam.plan(asked, cancel=cancel).status))

    threads = [threading.Thread(target=ask, args=(scene, question, number)) for number in range(4)]
    for thread in threads:
        thread.start()
    del scene, question
    threading.Event().wait(len(repr(wait)) % 20 / 100)
    cancel.cancel()
    for thread in threads:
        thread.join()
    assert len(ended) == 4
    return set(ended)


def still_arm(folder: Path) -> kpam.Robot:
    """Return a robot without moving joints."""
    file = folder / "still.urdf"
    file.write_text(
        "<robot name='still'><link name='b'/><link name='h'/><joint name='j' type='fixed'><parent link='b'/>"
        "<child link='h'/></joint></robot>"
    )
    return kpam.Robot.from_urdf(file, hand_link="h")


def calls(panda: kpam.Robot, still: kpam.Robot) -> dict[str, Call]:
    """Return each call by its name."""
    scene = kpam.Scene(panda, [table()])
    hand = panda.forward_kinematics(Q_START)
    settings = kpam.SolverConfig(config())
    question = problem(panda, config=config(gripper="hold", let_go=0.05), options=QUICK)
    plan = kpam.plan(question)
    motion = scene.plan_to(Q_START, GOAL, limits="panda").trajectory
    assert plan.trajectory is not None
    assert motion is not None
    rows, cloud = np.stack([Q_START, GOAL]), np.random.default_rng(0).uniform(-0.5, 0.5, (50, 3))
    gripper = kpam.ParallelGripper.of_robot(panda, **TOOL)
    box = kpam.Shape.box([0.1, 0.1, 0.1])
    ball = kpam.Body("ball", "rigid", [kpam.Shape.sphere(0.02)], np.eye(4))
    joint = kpam.Joint("revolute", [0.5, 0.3, 0.1], [1.0, 0.0, 0.0], 0.2, 0.0, 1.5)
    limits = {
        "velocity_limits": np.full(3, 1.5),
        "acceleration_limits": np.full(3, 5.0),
        "jerk_limits": np.full(3, 50.0),
    }
    parts = {
        "robot": panda,
        "config": settings,
        "q_start": Q_START,
        "tool_keypoints": {k: np.array(v) for k, v in TOOL.items()},
    }
    parts |= {"object_keypoints": {"edge": np.array([0.5, 0.1, 0.2])}, "T_base_object": np.eye(4), "joint": joint}
    parts |= {"object_axis": "y", "object_yaw": 0.0, "T_base_world": np.eye(4), "bodies": [table()]}
    parts |= {"options": {"limits": "panda", **QUICK, "margin": 0.005, "joint_weights": np.ones(9)}}
    time = 0.4 * motion.duration

    def check_plan(found: kpam.Plan, _: Any) -> None:
        assert (found.trajectory is not None) == (found.status in ("solved", "partial"))
        if found.trajectory is not None:
            check_trajectory(found.trajectory, panda.velocity)
            assert all(each["satisfied"] for each in found.residuals)

    def check_motion(found: kpam.Motion, arguments: Mapping[str, Any]) -> None:
        assert (found.trajectory is not None) == (found.status == "solved")
        if found.trajectory is None:
            return
        check_trajectory(found.trajectory, 1.5 * panda.velocity)
        q, _, _ = found.trajectory.sample(found.trajectory.times[-1])
        goal = np.asarray(arguments["goal"], float)
        if goal.shape == (4, 4):
            np.testing.assert_allclose(panda.forward_kinematics(q, arguments["link"]), goal, atol=1e-3)
        else:
            assert found.goal is not None
            np.testing.assert_allclose(q, goal.reshape(-1, 9)[found.goal], atol=1e-6)

    def check_ik(found: Any, arguments: Mapping[str, Any]) -> None:
        assert found.shape[0] <= (16 if arguments["max_solutions"] is None else arguments["max_solutions"])
        for q in found:
            reached = panda.forward_kinematics(q, arguments["link"])
            np.testing.assert_allclose(reached, np.asarray(arguments["pose"], float), atol=2e-3)

    whole = {"q_start": Q_START, "goal": GOAL, "link": None, "margin": 0.005, "samples": 100, "seed": 0}
    whole |= {"velocity_scale": 0.5, "acceleration_scale": 0.5, "limits": "panda", "start_velocity": np.zeros(9)}
    whole |= {"start_acceleration": np.zeros(9), "start_time": 0.0, "warm_start": None, "max_checks": 10_000}
    whole |= {"deadline_ms": 2000.0, "cancel": kpam.Cancel(), "velocity_limits": np.full(9, 1.0), "path": None}
    arms = {
        "lid": kpam.Scene(panda, [ball], [kpam.SceneJoint("lid", joint, ["ball"])]),
        "ball": kpam.Scene(panda, [ball]),
    }
    asked: dict[str, Any] = {"problem": question, "plan": plan}
    bounded: dict[str, Any] = {"max_checks": 500, "deadline_ms": 2000.0}
    path = np.array([[0.0, 0, 0], [0.5, 0.2, -0.3], [1.0, 0, 0]])
    start = {"start_velocity": np.zeros(3), "start_acceleration": np.zeros(3), "start_time": 0.0}
    grasping = {"samples": 4, "trials": 4, "tilt": np.array([0.0, 1.0])}
    rest, turned = np.zeros(9), panda.forward_kinematics(GOAL)
    return {
        "plan": Call(
            kpam.plan,
            given(problem=question, warm_start=plan, resume="post_0", cancel=kpam.Cancel(), explain=True, **bounded),
            check_plan,
        ),
        "plan_batch": Call(kpam.plan_batch, given(problems=[question, question], threads=2)),
        "plan_to": Call(scene.plan_to, whole, check_motion),
        "plan_to a pose": Call(scene.plan_to, {**whole, "goal": turned, "link": "panda_hand"}, check_motion),
        "ik": Call(kpam.ik, given(problem=question, max_solutions=4)),
        "Scene.ik": Call(scene.ik, given(pose=hand, q_start=Q_START, link=None, max_solutions=4, seed=0), check_ik),
        "problem": Call(kpam.KeypointProblem, parts),
        "problem, planned": Call(lambda **a: kpam.plan(kpam.KeypointProblem(**a), **bounded), parts, check_plan),
        "config": Call(lambda config: kpam.SolverConfig(config).to_dict(), given(config=config(let_go=0.05))),
        "retime": Call(
            kpam.retime,
            given(waypoints=path, **limits, stops=[1], slowest=np.array([0.1, 0.2]), braking=None, **start)
            | {"position_limits": (np.full(3, -2.0), np.full(3, 2.0))},
            lambda answer, arguments: check_trajectory(answer[0], np.asarray(arguments["velocity_limits"], float)),
        ),
        "refine": Call(kpam.refine, given(**asked, times=np.linspace(0.0, 1.0, 4), keep_paths=False)),
        "min_clearance": Call(kpam.min_clearance, given(**asked, step=0.05)),
        "joint_travel": Call(kpam.joint_travel, given(**asked, times=np.linspace(0.0, 1.0, 4)), all_finite),
        "body": Call(
            lambda **a: kpam.Scene(panda, [kpam.Body(**a)]).distance(Q_START),
            given(name="post", role="rigid", shapes=[box], pose=np.eye(4), keypoints={"tip": np.zeros(3)}),
            all_finite,
        ),
        "scene": Call(
            lambda **a: kpam.Scene(**a).in_collision(Q_START), given(robot=panda, bodies=[table(), ball], joints=[])
        ),
        "joint": Call(
            kpam.Joint,
            given(kind="revolute", origin=np.zeros(3), axis=np.array([0.0, 0, 1]), value=0.1, lower=0.0, upper=1.0),
        ),
        "with_joint": Call(arms["lid"].with_joint, given(name="lid", value=0.3)),
        "with_pose": Call(arms["ball"].with_pose, given(body="ball", pose=np.eye(4))),
        "attached": Call(arms["ball"].attached, given(body="ball", q=Q_START)),
        "with_start": Call(question.with_start, given(q=Q_START, velocity=rest, time=0.0, acceleration=rest)),
        "in_collision": Call(scene.in_collision, given(q=rows), all_finite),
        "distance": Call(scene.distance, given(q=rows, max_distance=1.0), all_finite),
        "check": Call(scene.check, given(q=rows, reach=0.1)),
        "own_points": Call(scene.own_points, given(q=Q_START, points=cloud, clearance=0.02)),
        "box": Call(kpam.Shape.box, given(half_extents=np.full(3, 0.1), pose=np.eye(4))),
        "capsule": Call(kpam.Shape.capsule, given(radius=0.1, length=0.2, pose=np.eye(4))),
        "hull": Call(kpam.Shape.convex_hull, given(points=cloud)),
        "mesh": Call(kpam.Shape.mesh, given(vertices=cloud, triangles=np.arange(30).reshape(-1, 3))),
        "cloud": Call(kpam.Shape.point_cloud, given(points=cloud, radius=0.01)),
        "grasps": Call(
            arms["ball"].grasps,
            given(body="ball", gripper=gripper, center_of_mass=np.zeros(3), options=grasping),
        ),
        "gripper": Call(
            kpam.ParallelGripper,
            {name: np.array(at) for name, at in TOOL.items()}
            | given(pad=np.array([0.02, 0.02]), stroke=np.array([0.0, 0.08]), palm=[], fingers=([], [])),
        ),
        "kinematics": Call(panda.forward_kinematics, given(q=rows, link="panda_hand"), all_finite),
        "jacobian": Call(panda.jacobian, given(q=rows, link="panda_hand"), all_finite),
        "dynamics": Call(
            panda.inverse_dynamics,
            given(q=rows, velocity=rows, acceleration=rows, gravity=np.array([0.0, 0.0, -9.81])),
            all_finite,
        ),
        "sample": Call(motion.sample, given(t=np.linspace(0.0, 1.0, 5)), all_finite),
        "sample_into": Call(
            motion.sample_into,
            given(t=0.5, position=rest, velocity=rest.copy(), acceleration=rest.copy()),
            layouts=False,
        ),
        "sample_every": Call(motion.sample_every, given(dt=0.1), all_finite),
        "brake": Call(motion.brake, given(t=time), lambda found, _: check_trajectory(found, 3 * panda.velocity)),
        "splice": Call(motion.splice, given(next=motion, t=0.0), lambda found, _: finite(found.times)),
        "since": Call(motion.since, given(t=time), lambda found, _: finite(found.times)),
        "in threads": Call(
            lambda wait: cancelled(kpam.Scene(panda, [table()]), problem(panda, options=QUICK), wait),
            {"wait": 0.01},
            lambda found, _: _within(found, {"solved", "cancelled", "not_found"}),
        ),
        "a robot without joints": Call(
            kpam.Scene(still).plan_to, given(q_start=np.zeros(0), goal=np.zeros((2, 0)), link=None), layouts=False
        ),
    }


def _within(found: set[str], known: set[str]) -> None:
    assert found <= known, found


def drawn(call: Call, generator: np.random.Generator) -> tuple[dict[str, Any], bool]:
    """Return arguments of which one to three are damaged, and whether they still are the same numbers."""
    good = call.good
    arguments, values = dict(good), list(good.values())
    arrays = [name for name, value in good.items() if isinstance(value, np.ndarray) and value.ndim]
    if call.layouts and arrays and generator.random() < 0.15:
        for name in arrays:
            arguments[name] = same(good[name], generator)
        return arguments, True
    for name in generator.choice(list(good), size=int(generator.integers(1, min(3, len(good)) + 1)), replace=False):
        value = hostile(good[name], values, generator)
        large = isinstance(value, int) and value > REASONABLE
        arguments[name] = 0 if large and name in ("samples", "max_checks") else value
    return arguments, False


def attempt(call: Call, arguments: dict[str, Any], is_same: bool) -> str:
    """Return whether a call accepted its arguments.

    Raises:
        AssertionError: the answer is wrong, or the error is not one line that names the argument.
        Exception: whatever else was raised.
    """
    try:
        answer = call.run(**arguments)
    except (kpam.KpamError, ArithmeticError, LookupError, RuntimeError, TypeError, ValueError) as error:
        raised = error
    else:
        if is_same:
            assert shown(answer) == shown(call.run(**call.good)), "another layout, another answer"
        call.check(answer, {**call.good, **arguments})
        return "accepted"
    said = " ".join([str(raised), *getattr(raised, "__notes__", ())])
    if str(raised) in ("'array'", "float", "index", "no more"):
        return "refused"  # by the caller's own object
    assert isinstance(raised, kpam.KpamError) or "while processing" in said, f"{type(raised).__name__}: {said[:300]}"
    assert not is_same, f"another layout is refused: {said}"
    assert len(said.splitlines()) == 1, f"lines: {said[:300]!r}"
    assert len(said) <= LONGEST_MESSAGE, f"{len(said)} characters: {said[:200]!r}"
    return "refused"


def shown(answer: Any) -> str:
    """Return what an answer holds, without the times that it took."""
    if isinstance(answer, kpam.Plan | kpam.Motion):
        return f"{answer.status} {answer.reason} {shown(answer.trajectory)}"
    if isinstance(answer, kpam.Trajectory):
        return f"{answer.times.tolist()} {answer.positions.tolist()}"
    if isinstance(answer, np.ndarray):
        return f"{answer.tolist()}"
    if isinstance(answer, tuple | list):
        return " ".join(map(shown, answer))
    return repr(answer.__reduce__()[1]) if hasattr(answer, "_thaw") else repr(answer)


def run(known: Mapping[str, Call], numbers: range, seed: int, scratch: Path, say: Say) -> Tally:
    """Try so many calls, kinds in turn; faults are said and counted."""
    names, folder = list(known), scratch / "solver"
    folder.mkdir(parents=True)
    (folder / "canary.py").write_text(CANARY)

    def one(number: int) -> Ended:
        name = names[number % len(names)]
        arguments, is_same = drawn(known[name], np.random.default_rng([seed, number]))
        try:
            outcome, *cost = in_process(partial(attempt, known[name], arguments, is_same), folder)
        except Exception as error:
            changed = {key: repr(value)[:60] for key, value in arguments.items() if value is not known[name].good[key]}
            raise RuntimeError(f"{name} {changed}: {error}") from error
        return Ended(f"{name}: {outcome}", *cost)

    return tried(numbers, one, say)


def prepare(folder: Path) -> dict[str, list[Round]]:
    """Make the good arguments."""
    files = panda_folder() / "panda"
    panda = kpam.Robot.from_urdf(files / "panda_v2.urdf", hand_link="panda_hand", srdf=files / "panda_v2.srdf")
    return {"inputs": [partial(run, calls(panda, still_arm(folder)))]}


if __name__ == "__main__":
    sys.exit(main(str(__doc__), {"inputs": 5000}, prepare))
