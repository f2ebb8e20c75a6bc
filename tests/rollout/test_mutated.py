"""Worlds in which a task is not done, and tasks whose success criteria hold in such worlds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from gensim2.rollout.checker_result import DONE, CheckerResult, Mutation, WorldCount, total
from gensim2.rollout.mutated import _Mutant, _Worlds, judge
from gensim2.rollout.turns import Turn, goal_reached
from gensim2.sim.headless import HeadlessEnv
from gensim2.tasks.library import load_task
from gensim2.tasks.measurement import Measurement
from gensim2.tasks.spec import TaskSpec

SEEDS = (0, 1)


def environment(task: TaskSpec) -> HeadlessEnv:
    return HeadlessEnv(task, assets="builtin")


def check(task: TaskSpec) -> CheckerResult:
    env = environment(task)
    return CheckerResult.of([judge(env, seed) for seed in SEEDS])


def mutants(name: str) -> tuple[_Worlds, Mapping[Mutation, list[_Mutant]]]:
    """Return the worlds of the last step of a task, by mutation."""
    worlds = _Worlds(environment(load_task(name)), 0)
    states = worlds._course(worlds._task.steps)
    assert states is not None
    found: dict[Mutation, list[_Mutant]] = {}
    for step in worlds._final_steps():
        for mutant in worlds._mutants(step, worlds._first, states[-1]):
            found.setdefault(mutant.mutation, []).append(mutant)
    return worlds, found


def lowest(measured: Measurement, name: str) -> float:
    return float(measured.bounds[name][0, 2])


def test_joint_mutations_leave_the_joint_far_from_where_it_should_be() -> None:
    worlds, found = mutants("OpenBox")
    start = worlds._first.objects["box"].openness
    assert start is not None
    opennesses = {mutation: [worlds._of(each).openness["box"] for each in group] for mutation, group in found.items()}
    assert opennesses[Mutation.AT_START] == [pytest.approx(start)]
    assert opennesses[Mutation.A_LITTLE] == [pytest.approx(start + (1 - start) / 4)]
    assert opennesses[Mutation.WRONG_WAY] == [pytest.approx(0.0)]
    assert Mutation.BESIDE not in found


def test_a_half_open_joint_has_two_wrong_ends() -> None:
    worlds, found = mutants("LeaveDoorAjar")
    assert sorted(worlds._of(each).openness["door"] for each in found[Mutation.WRONG_WAY]) == pytest.approx([0.0, 1.0])


def test_mutations_of_an_object_that_is_put_into_a_container() -> None:
    worlds, found = mutants("PlaceGolfBallIntoDrawer")
    start = worlds._first.objects["ball"]
    (left,) = found[Mutation.AT_START][:1]
    assert worlds._of(left).poses["ball"][:3] == pytest.approx(start.position)
    drawer = np.concatenate(left.state.objects["drawer"].hulls_in_world())
    assert found[Mutation.BESIDE]
    for each in found[Mutation.BESIDE]:
        measured = worlds._of(each)
        assert lowest(measured, "ball") == pytest.approx(0.0, abs=0.002), "it stands on the table"
        inside = (drawer[:, :2].min(axis=0) < measured.poses["ball"][:2]) & (
            measured.poses["ball"][:2] < drawer[:, :2].max(axis=0)
        )
        assert not inside.all() or measured.poses["ball"][2] < drawer[:, 2].min() + 0.05
        assert each.state.objects["drawer"].openness == 0.0, "the rest is as in the successful end state"
    (top,) = found[Mutation.ON_TOP]
    assert lowest(worlds._measured(top.state), "ball") == pytest.approx(drawer[:, 2].max(), abs=1e-6)
    (held,) = found[Mutation.IN_THE_AIR]
    over = worlds._of(held)
    assert lowest(over, "ball") == pytest.approx(over.bounds["drawer"][1, 2] + 0.03, abs=1e-6)
    hand = next(iter(over.gripper.values()))
    assert hand == pytest.approx(over.bounds["ball"].mean(axis=0), abs=1e-6), "the hand is at the ball"


def test_mutations_of_an_object_that_is_put_into_a_bowl() -> None:
    worlds, found = mutants("PutAppleAndLemonInBowl")
    for each in found[Mutation.WRONG_OBJECT]:
        measured = worlds._of(each)
        assert measured.poses[each.subject][:3] == pytest.approx(worlds._first.objects[each.subject].position)
    for each in found[Mutation.GOAL_MOVED]:
        measured = worlds._of(each)
        assert lowest(measured, "bowl") >= measured.bounds[each.subject][1, 2] - 1e-6, "the bowl is above the fruit"


def test_mutations_of_an_object_that_is_lifted() -> None:
    worlds, found = mutants("PickUpBanana")
    for each in found[Mutation.ON_THE_TABLE]:
        assert lowest(worlds._of(each), "banana") == pytest.approx(0.0, abs=0.002)
    (slightly,) = found[Mutation.A_LITTLE]
    assert lowest(worlds._of(slightly), "banana") == pytest.approx(0.01, abs=0.002)


def test_mutations_of_an_object_that_is_handed_over() -> None:
    worlds, found = mutants("HandCanOfTunaToTheLeft")
    start = worlds._first.objects["can_of_tuna"].position
    ways = [worlds._of(each).poses["can_of_tuna"][:3] - start for each in found[Mutation.WRONG_WAY]]
    assert all(way[1] < 0.01 for way in ways), "none went to the left, where y grows"
    assert all(way[2] > 0.1 for way in ways), "all are lifted"


def test_a_hand_that_did_not_reach_an_object() -> None:
    task = load_task("PutAppleInBowl")
    worlds = _Worlds(environment(task), 0)
    states = worlds._course(task.steps)
    assert states is not None
    grasp = list(worlds._mutants(task.steps[0], states[0], states[1]))
    assert {each.mutation for each in grasp} == {Mutation.HAND_AWAY}
    for each in grasp:
        measured = worlds._of(each)
        tip = next(iter(measured.gripper.values()))
        assert np.linalg.norm(tip - measured.bounds["apple"].mean(axis=0)) > 0.1


def test_opening_a_box_only_to_close_it_does_not_last() -> None:
    assert load_task("LookIntoBox").transient == {"open_box"}
    assert load_task("FillMugWithWater").transient == {"turn_on"}
    assert load_task("PlaceGolfBallIntoBox").transient == frozenset(), "the box is opened to put the ball in"
    assert load_task("FetchBaseballFromBox").transient == frozenset()


def test_the_goal_is_reached_only_after_a_step_that_does_not_last() -> None:
    task = load_task("LookIntoBox")
    worlds = _Worlds(environment(task), 0)
    closed = worlds._measured(worlds._first.with_openness("box", 0.0))
    opened, shut = task.steps
    for looked in (True, False):
        turns = [Turn(opened, 0, 1, looked, looked), Turn(shut, 1, 2, True, True)]
        assert goal_reached(task, closed, turns) is looked


@pytest.mark.parametrize(
    "name",
    ["OpenBox", "LeaveDoorAjar", "LookIntoBox", "PlaceGolfBallIntoDrawer", "PutAppleInBowl", "HandCanOfTunaToTheLeft"],
)
def test_honest_tasks_pass(name: str) -> None:
    found = check(load_task(name))
    assert found.passes
    assert found.reason == ""
    assert total(found.of_goal)[0] == total(found.of_steps)[0] == 0
    assert found.recognized == (len(SEEDS), len(SEEDS)), "the successful end state is recognized"
    assert total(found.of_goal)[1] >= 3 * len(SEEDS)


BOX: dict[str, Any] = {"box": {"class": "box_rotate"}}
LIES: dict[str, tuple[dict[str, Any], Mutation]] = {
    "a threshold that a little satisfies": (
        {
            "objects": BOX,
            "steps": [{"name": "open", "object": "box"}],
            "goal": [{"type": "articulated_open", "object": "box", "threshold": 0.45}],
        },
        Mutation.A_LITTLE,
    ),
    "a criterion about another object": (
        {
            "objects": {**BOX, "faucet": {"class": "faucet", "place": {"at": [-0.1, 0.45]}}},
            "steps": [
                {
                    "name": "open",
                    "object": "box",
                    "done": [{"type": "articulated_open", "object": "box"}],
                },
                {
                    "name": "turn_on",
                    "object": "faucet",
                    "done": [{"type": "articulated_open", "object": "faucet"}],
                },
            ],
        },
        Mutation.AT_START,
    ),
    "any height counts": (
        {
            "objects": {"banana": {"class": "banana"}},
            "steps": [{"name": "lift", "object": "banana"}],
            "goal": [{"type": "rigidbody_lifted", "rigid": "banana", "height": 0.005}],
        },
        Mutation.A_LITTLE,
    ),
    "beside the faucet counts": (
        {
            "objects": {"faucet": {"class": "faucet"}, "mug": {"class": "mug", "place": {"at": [-0.2, -0.45]}}},
            "steps": [
                {"name": "grasp", "object": "mug"},
                {"name": "put", "object": "faucet", "tool": "mug"},
            ],
            "goal": [
                {"type": "distance_articulated_rigidbody", "articulated": "faucet", "rigid": "mug", "threshold": 0.4}
            ],
        },
        Mutation.BESIDE,
    ),
    "closing without a look counts": (
        {
            "objects": BOX,
            "steps": [
                {
                    "name": "open",
                    "object": "box",
                    "done": [{"type": "articulated_open", "object": "box", "threshold": 0.05}],
                },
                {"name": "close", "object": "box", "done": [{"type": "articulated_closed", "object": "box"}]},
            ],
        },
        Mutation.LEFT_OUT,
    ),
}


@pytest.mark.parametrize("lie", LIES)
def test_lying_criteria_are_refused(lie: str) -> None:
    fields, mutation = LIES[lie]
    found = check(TaskSpec.model_validate({"name": "Lie", "description": "lie", **fields}))
    assert not found.passes
    assert mutation in {each.mutation for each in found.of_goal if each.fooled}
    assert str(mutation) in found.reason


def test_one_world_in_a_hundred_may_be_wrong() -> None:
    def result(fooled: int) -> CheckerResult:
        about = ("articulated_open",)
        wrong = WorldCount(None, str(Mutation.A_LITTLE), "box", about, 50, fooled)
        right = WorldCount(None, str(Mutation.AT_START), "box", about, 50, 0)
        done = WorldCount(None, DONE, "", about, 10, 10)
        return CheckerResult.of([[wrong, right, done]])

    assert result(1).passes
    assert not result(2).passes
    assert result(2).reason == (
        "the success criteria hold in 2 of 100 worlds in which the task is not done (at most 1% may): "
        "box: it was moved only a little (2 of 50; articulated_open)"
    )
    assert result(2).summary() == {
        "scenes": 1, "worlds": 100, "fooled": 2, "error": 0.02, "recognized": 10, "built": 10,
    }  # fmt: skip
