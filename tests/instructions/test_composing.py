"""Tasks that are composed from the steps of an instruction."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gensim2.design.drafting import chains
from gensim2.design.skills import ASIDE, places_in
from gensim2.doing.composing import _affordance, compose
from gensim2.instructions.grammar import parse
from gensim2.instructions.meanings import solved
from gensim2.instructions.steps import Put, Refusal, SentenceError, Step
from gensim2.objects import Library
from gensim2.planning.scene import MEASURED
from gensim2.planning.strategies import parse_strategy
from gensim2.robots import robot
from gensim2.rollout.chain import ChainController
from gensim2.rollout.run import run
from gensim2.scenes.initial_state import sample_initial_state
from gensim2.sim.headless import HeadlessEnv
from gensim2.tasks.library import load_task

ROBOT = "panda"


@pytest.mark.parametrize(
    "name",
    [
        "OpenDrawer",
        "PushToasterForward",
        "PickUpMug",
        "HandCanOfTunaToTheLeft",
        "DropAppleIntoBox",
        "StoreLemonInRefrigerator",
        "PutPlumAwayInRefrigerator",
        "CollectGolfBallAndGoldBarInSafe",
        "FetchBaseballFromBox",
        "MoveRubiksCubeFromBoxToDrawerAndCloseIt",
        "LayTableWithAppleAndPear",
        "TurnOnFaucetAndPutLemonInBowl",
        "LookIntoDrawer",
        "CloseSuitcaseAndCloseSafe",
    ],
)
def test_the_description_of_a_library_task_gives_this_task(library: Library, name: str) -> None:
    found = compose(parse(load_task(name).description), library, ROBOT)
    assert found.is_from_library
    assert found.task == load_task(name)


def test_a_new_combination_has_the_steps_of_the_sentence(library: Library) -> None:
    found = compose(parse("open the safe, put the golf ball into it and close it"), library, ROBOT)
    task = found.task
    assert not found.is_from_library
    assert [(step.object, step.tool) for step in task.steps] == [
        ("safe", "hand"), ("golf_ball", "hand"), ("safe", "golf_ball"), ("safe", "hand"),
    ]  # fmt: skip
    assert [each.type for each in task.success] == ["distance_articulated_rigidbody", "articulated_closed"]
    assert [step.name for step in task.steps] == ["open_safe", "grasp_golf_ball", "put_golf_ball", "close_safe"]
    assert chains(task) == []
    assert {name for step in task.steps for name in step.strategies} == set(found.strategies)
    assert all(parse_strategy(data, name) for name, data in found.strategies.items())
    assert (task.objects["safe"].randomization.openness_mean or 0.0) < 0.2, "a container that is opened starts closed"


def test_a_container_that_is_not_opened_starts_open(library: Library) -> None:
    task = compose(parse("put the marker into the drawer and close it"), library, ROBOT).task
    assert (task.objects["drawer"].randomization.openness_mean or 0.0) > 0.8


def test_the_last_step_of_a_joint_is_the_goal(library: Library) -> None:
    task = compose(parse("open the suitcase and close it"), library, ROBOT).task
    assert [each.type for each in task.success] == ["articulated_closed"]
    assert task.objects["suitcase"].randomization.openness_mean == 0.5, "the goal is not met at the start"


def placements(library: Library, sentence: str) -> dict[str, list[dict[str, Any]]]:
    """Return the first constraints of the strategies that put something somewhere, by the name of the step."""
    found = compose(parse(sentence), library, ROBOT)
    return {
        step.name: [found.strategies[name]["constraint_list"][0] for name in step.strategies]
        for step in found.task.steps
        if step.tool != "hand"
    }


@pytest.mark.parametrize("goal", ["into the microwave", "into the drawer", "into the box"])
def test_the_keypoint_that_success_measures_is_placed(library: Library, goal: str) -> None:
    """A screwdriver is measured at its handle, which is 17 cm away from its first keypoint."""
    (rows,) = placements(library, f"put the screwdriver {goal}").values()
    assert {row["keypoint_name"] for row in rows} == {MEASURED}


@pytest.mark.parametrize("container", ["microwave", "drawer"])
def test_two_objects_in_one_container_lie_side_by_side(library: Library, container: str) -> None:
    first, second = placements(library, f"put the banana and the peach into the {container}").values()
    frames = {row["target_offset_frame"] for row in first}
    assert frames == ({"world"} if container == "microwave" else {"world", "object"})
    for rows, left in ((first, ASIDE), (second, -ASIDE)):
        # In the frame of the drawer, x points to the right.
        assert {
            row["target_offset"][1] if row["target_offset_frame"] == "world" else -row["target_offset"][0]
            for row in rows
        } == {left}


def test_the_height_of_the_measured_keypoint_is_added_upwards(library: Library) -> None:
    """In the frame of a drawer, y points up and z out of the front."""
    container, thing = (_affordance(library, name) for name in ("drawer", "golf_ball"))
    low, high = (places_in(container, replace(thing, measured_at=(0.0, 0.0, height))) for height in (0.0, 0.02))
    for name in low:
        before, after = (each[name]["constraint_list"][0] for each in (low, high))
        change = np.subtract(after["target_offset"], before["target_offset"])
        assert change == pytest.approx([0, 0.02, 0] if after["target_offset_frame"] == "object" else [0, 0, 0.02])


def test_an_object_that_is_taller_than_the_drawer_is_laid_down(library: Library) -> None:
    found = compose(parse("put the bottle of bleach into the drawer"), library, ROBOT)
    assert all(name.startswith("lay_") for name in found.task.steps[-1].strategies)


@pytest.mark.parametrize("sentence", ["put the marker into the microwave", "put the screwdriver into the refrigerator"])
def test_long_objects_are_put_into_containers(library: Library, sentence: str) -> None:
    found = compose(parse(sentence), library, ROBOT)
    env = HeadlessEnv(found.task, assets="builtin", engine="mujoco")
    controller = ChainController(found.task, found.strategies, robot(ROBOT))
    assert sum(run(env, controller, seed=seed).episode.held for seed in range(3)) >= 2


JOINTS = sorted(solved(), key=str)


@settings(max_examples=10)
@given(
    st.lists(
        st.one_of(
            st.sampled_from(JOINTS),
            st.builds(
                Put, st.sampled_from(["apple", "mug"]), st.sampled_from(["bowl", "plate", "drawer", "safe_rotate"])
            ),
        ),
        min_size=1,
        max_size=4,
    )
)
def test_any_steps_give_a_task_or_a_refusal(library: Library, steps: list[Step]) -> None:
    try:
        found = compose(steps, library, ROBOT)
    except SentenceError:
        return
    named = {name for step in found.task.steps for name in step.strategies}
    assert named == set(found.strategies)
    classes = {name for step in steps for name in step.classes}
    assert {each.asset_class for each in found.task.objects.values()} == classes


def test_an_object_that_is_moved_twice_has_its_last_place_as_goal(library: Library) -> None:
    sentence = "put the lemon into the drawer, then take it out of the drawer and put it on the plate"
    task = compose(parse(sentence), library, ROBOT).task
    assert [(each.type, each.objects) for each in task.success] == [("rigidbody_on_rigidbody", ("lemon", "plate"))]
    assert task.objects["lemon"].place.on == "table"
    assert [step.name for step in task.steps] == ["grasp_lemon", "put_lemon", "grasp_lemon_2", "put_lemon_2"]


@pytest.mark.parametrize(
    ("sentence", "reason"),
    [
        ("open the box and push the box away", Refusal.IMPOSSIBLE),
        ("open the drawer and open it", Refusal.ORDER),
        ("close the drawer, then put the apple into it", Refusal.ORDER),
        ("open the box, the drawer and the safe", Refusal.NO_ROOM),
        ("put the apple, the lemon and the pear into the bowl", Refusal.NO_ROOM),
        ("open the microwave and the refrigerator and the oven", Refusal.NO_ROOM),
        ("put the fork into the drawer", Refusal.IMPOSSIBLE),
        ("put the plate in the bowl", Refusal.IMPOSSIBLE),
        (", ".join(["open the box", "close the box"] * 5), Refusal.ORDER),
    ],
)
def test_impossible_combinations_are_refused(library: Library, sentence: str, reason: Refusal) -> None:
    with pytest.raises(SentenceError) as caught:
        compose(parse(sentence), library, ROBOT)
    assert caught.value.reason == reason


@pytest.mark.parametrize("container", ["safe", "microwave", "box"])
def test_an_object_can_start_in_an_open_container_beside_a_plate(library: Library, container: str) -> None:
    task = compose(parse(f"take the lemon out of the {container} and put it on the plate"), library, "panda").task
    instances = {name: library.choose(each.asset_class, "all") for name, each in task.objects.items()}
    at = [
        sample_initial_state(task, library, instances, seed, {key: {} for key in instances}, robot(ROBOT))
        for seed in (0, 1)
    ]
    assert all(set(each.objects) == set(instances) for each in at)


def test_a_container_beside_a_plate_is_turned_towards_the_robot(library: Library) -> None:
    task = compose(parse("take the lemon out of the refrigerator and put it on the plate"), library, ROBOT).task
    place = task.objects["refrigerator"].place
    assert place.at is not None
    front = -np.array([np.cos(place.yaw), np.sin(place.yaw)])
    to_robot = np.array(robot(ROBOT).base_position[:2]) - place.at
    assert front @ to_robot / np.linalg.norm(to_robot) > 0.95


def test_a_bowl_that_is_put_away_is_a_loose_object(library: Library) -> None:
    """The refrigerator stands where it stands for any other object."""
    bowl, apple = (
        compose(parse(f"put the {each} into the refrigerator"), library, ROBOT).task for each in ("bowl", "apple")
    )
    assert bowl.objects["refrigerator"] == apple.objects["refrigerator"]
    assert bowl.objects["bowl"].place == apple.objects["apple"].place
