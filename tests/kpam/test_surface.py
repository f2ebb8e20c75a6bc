"""The solver's Python interface: stubs agree with the module, options with the solver, and values are printable."""

from __future__ import annotations

import ast
import inspect
import json
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np
import pytest
from constraints import point_to_point

import gensim2_kpam as kpam

STUB = Path(kpam.__file__).with_suffix(".pyi")

PENDULUM = """<robot name="pendulum"><link name="base"/><link name="bob"/>
  <joint name="hinge" type="revolute"><parent link="base"/><child link="bob"/><origin xyz="0.3 0 0.3"/>
  <axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="1" velocity="2"/></joint></robot>"""

CONSTRAINTS = [point_to_point("tip", "goal", 0.001)]


def stubbed() -> dict[str, ast.stmt]:
    """Return the public names of the stub with their definitions."""
    out: dict[str, ast.stmt] = {}
    for node in ast.parse(STUB.read_text()).body:
        match node:
            case ast.ClassDef() | ast.FunctionDef():
                out[node.name] = node
            case ast.AnnAssign(target=ast.Name(id=name)):
                out[name] = node
            case ast.ImportFrom(level=1):
                out.update({alias.asname: node for alias in node.names if alias.asname})
            case _:
                pass
    return out


def test_the_stub_names_what_is_there() -> None:
    assert sorted(stubbed()) == sorted(kpam.__all__)


@pytest.mark.parametrize("name", [n for n, node in stubbed().items() if isinstance(node, ast.ClassDef)])
def test_classes_have_what_the_stub_says(name: str) -> None:
    node, real = stubbed()[name], getattr(kpam, name)
    assert isinstance(node, ast.ClassDef)
    members = {n.name for n in node.body if isinstance(n, ast.FunctionDef)} - {"__init__"}
    if issubclass(real, BaseException):
        return
    assert members == {n for n in vars(real) if not n.startswith("_")} | {n for n in members if n.startswith("__")}


@pytest.mark.parametrize("name", [n for n, node in stubbed().items() if isinstance(node, ast.FunctionDef)])
def test_functions_take_what_the_stub_says(name: str) -> None:
    node = stubbed()[name]
    assert isinstance(node, ast.FunctionDef)
    stub = [a.arg for a in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
    assert list(inspect.signature(getattr(kpam, name)).parameters) == stub


@pytest.fixture(scope="module")
def pendulum(tmp_path_factory: pytest.TempPathFactory) -> kpam.Robot:
    path = tmp_path_factory.mktemp("robot") / "pendulum.urdf"
    path.write_text(PENDULUM)
    return kpam.Robot.from_urdf(path, hand_link="bob")


def problem(robot: kpam.Robot, options: Any = None) -> kpam.KeypointProblem:
    return kpam.KeypointProblem(
        robot,
        kpam.SolverConfig({"constraint_list": CONSTRAINTS}),
        [0.0],
        tool_keypoints={"tip": [0.2, 0.0, 0.0]},
        object_keypoints={"goal": [0.3, 0.0, 0.1]},
        T_base_object=np.eye(4),
        bodies=[kpam.Body("post", "rigid", [kpam.Shape.sphere(0.02)], np.eye(4))],
        options=options,
    )


def test_typed_options_are_those_of_the_solver(pendulum: kpam.Robot) -> None:
    with pytest.raises(kpam.ProblemError) as refused:
        problem(pendulum, {"no_such_option": 1})
    known = {word.strip(" `.,") for word in str(refused.value).split("expected one of")[1].split(",")}
    assert known == set(get_type_hints(kpam.Options))


def test_a_status_is_a_string_of_an_enumeration(pendulum: kpam.Robot) -> None:
    plan = kpam.plan(problem(pendulum))
    assert plan.status is kpam.Status.SOLVED
    assert plan.status == "solved"
    assert f"{plan.status}" == json.loads(json.dumps(plan.status)) == "solved"
    far = np.eye(4)
    far[0, 3] = 5.0
    motion = kpam.Scene(pendulum).plan_to([0.0], far)
    assert motion.status is kpam.MotionStatus.UNREACHABLE
    assert motion.status == "unreachable"
    assert motion.trajectory is None


@pytest.mark.parametrize("name", ["keyframes", "residuals", "cpu_ms"])
def test_results_have_the_keys_of_their_types(pendulum: kpam.Robot, name: str) -> None:
    plan = kpam.plan(problem(pendulum))
    (kind,) = {"keyframes": [kpam.Keyframe], "residuals": [kpam.Residual], "cpu_ms": [kpam.CpuTimes]}[name]
    found = getattr(plan, name)
    for value in found if isinstance(found, list) else [found]:
        assert set(value) == set(get_type_hints(kind))
    assert found


def test_values_are_readable(pendulum: kpam.Robot) -> None:
    asked = problem(pendulum)
    plan = kpam.plan(asked)
    assert plan.status == "solved", plan.reason
    for value, parts in (
        (asked, ("pendulum", "point2point_constraint(tip, goal)", "no joint", "post (rigid)")),
        (asked.scene, ("pendulum", "post (rigid)", "joints: none")),
        (plan, ("solved", "actuation", " s by ")),
        (kpam.SolverConfig({"constraint_list": CONSTRAINTS}), ("point2point_constraint(tip, goal)", "gripper open")),
        (plan.trajectory, ("1 joints", " s)")),
    ):
        text = repr(value)
        assert all(part in text for part in parts), text
        assert len(text) < 400, text


def test_a_trajectory_is_sampled_at_many_times_at_once(pendulum: kpam.Robot) -> None:
    trajectory = kpam.plan(problem(pendulum)).trajectory
    assert trajectory is not None
    times = np.linspace(-0.1, trajectory.duration + 0.1, 50)
    together = trajectory.sample(times)
    alone = [trajectory.sample(t) for t in times]
    for part in range(3):
        assert together[part].shape == (50, 1)
        assert np.array_equal(together[part], np.stack([a[part] for a in alone]))
