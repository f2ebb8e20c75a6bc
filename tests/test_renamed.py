"""Names of the release before load in this one, and one line says today's."""

from __future__ import annotations

import json
from dataclasses import asdict

import gensim2_kpam as kpam
import pytest
from pydantic import TypeAdapter

from gensim2 import renamed
from gensim2.rollout.record import AttemptRecord, Cause
from gensim2.scenes.physics import physics_name


@pytest.fixture(autouse=True)
def _untold() -> None:
    renamed._tell.cache_clear()


def test_a_former_name_is_told_once(capsys: pytest.CaptureFixture[str]) -> None:
    assert physics_name("default") == "default"
    assert capsys.readouterr().err == ""
    assert (physics_name("ours"), renamed.current("ours", {"ours": "default"}, "physics")) == ("default", "default")
    told = "physics 'ours' is called 'default'; the old name goes with the next release\n"
    assert capsys.readouterr().err.count(told) <= 1  # physics are remembered by their word


def test_a_record_with_a_former_cause_loads(capsys: pytest.CaptureFixture[str]) -> None:
    record = AttemptRecord(0, {}, paper=True, held=False, strict=False, cause=Cause.HAPPENS_BY_ITSELF)
    today = json.dumps(asdict(record))
    former = today.replace("happens in the no-op baseline", "happens with a still arm")
    assert former != today
    assert TypeAdapter(AttemptRecord).validate_json(former) == record
    assert "'happens in the no-op baseline'" in capsys.readouterr().err
    with pytest.raises(ValueError, match="cause"):
        TypeAdapter(AttemptRecord).validate_json(today.replace("no-op baseline", "end"))


def test_options_of_the_solver_load_by_their_former_names() -> None:
    robot = kpam.Robot.from_urdf_string(
        "<robot name='r'><link name='b'/><link name='h'/><joint name='j' type='prismatic'><parent link='b'/>"
        "<child link='h'/><axis xyz='1 0 0'/><limit lower='0' upper='1' effort='1' velocity='1'/></joint></robot>",
        hand_link="h",
    )
    config = kpam.SolverConfig({"constraint_list": []})

    def problem(**options: object) -> kpam.KeypointProblem:
        return kpam.KeypointProblem(robot, config, q_start=[0.0], options=options)

    with pytest.warns(FutureWarning, match=r"options\.starts is called options\.num_seeds"):
        assert problem(starts=3) == problem(num_seeds=3)
    with pytest.raises(kpam.ProblemError, match=r"options\.harvest: is called extra_seeds"):
        problem(harvest=3, extra_seeds=3)
    with pytest.warns(FutureWarning), pytest.raises(kpam.ProblemError, match="extra_seeds"):
        problem(harvest=-1)


def test_keywords_of_the_solver_work_by_their_former_names() -> None:
    robot = kpam.Robot.from_urdf_string(
        "<robot name='r'><link name='b'/><link name='h'/><joint name='j' type='prismatic'><parent link='b'/>"
        "<child link='h'/><axis xyz='1 0 0'/><limit lower='0' upper='1' effort='1' velocity='1'/></joint></robot>",
        hand_link="h",
    )
    problem = kpam.KeypointProblem(robot, kpam.SolverConfig({"constraint_list": []}), q_start=[0.0])
    first = kpam.plan(problem)
    ways = (
        (lambda **given: kpam.plan(problem, **given).status, {"former": first}, {"warm_start": first}),
        (lambda **given: len(kpam.ik(problem, **given)), {"most": 1}, {"max_solutions": 1}),
        (lambda **given: kpam.Scene(robot).distance([0.0], **given), {"most": 0.5}, {"max_distance": 0.5}),
    )
    for call, before, today in ways:
        with pytest.warns(FutureWarning, match=f"{next(iter(before))} is called {next(iter(today))}"):
            assert call(**before) == call(**today)  # type: ignore[no-untyped-call]
        with pytest.raises(TypeError, match="which is given too"):
            call(**before, **today)  # type: ignore[no-untyped-call]
        with pytest.raises(TypeError, match="unexpected keyword argument 'other'"):
            call(other=1)  # type: ignore[no-untyped-call]
