"""Strategies as data: valid ones are read, and errors name the field before anything is planned."""

from __future__ import annotations

import pickle
from typing import Any

import pytest
from constraints import point_to_point

from gensim2.core.errors import InputError
from gensim2.planning.config import ObjectNames, check_strategies
from gensim2.planning.strategies import GraspStrategy, KeypointStrategy, PullStrategy, parse_strategy
from gensim2.robots import robot
from gensim2.tasks.spec import TaskSpec

pytest.importorskip("mani_skill")

POINT = point_to_point("tool_head", "articulated_object_head", 0.001)
OPEN = {"constraint_list": [POINT], "post_actuation_motions": [["follow_joint_to", 1.0]], "gripper": "grasp"}
PLACE = {
    "constraint_list": [
        {**POINT, "keypoint_name": "rigidbody_object_head", "target_keypoint_name": "articulated_object_inside"}
    ],
    "gripper": "release",
    "let_go": 0.08,
}
OBJECTS = {
    "drawer": ObjectNames(("articulated_object_head", "articulated_object_inside"), "prismatic"),
    "ball": ObjectNames(("rigidbody_object_head",), None),
}


def task(**changes: Any) -> TaskSpec:
    fields: dict[str, Any] = {
        "name": "Try",
        "description": "",
        "objects": {"drawer": {"class": "drawer"}, "ball": {"class": "golf_ball"}},
        "steps": [
            {"name": "open", "object": "drawer", "strategies": ["open"]},
            {"name": "grasp", "object": "ball", "strategies": ["grasp"]},
            {"name": "place", "object": "drawer", "tool": "ball", "strategies": ["place"]},
        ],
        "goal": [{"type": "articulated_open", "object": "drawer"}],
    }
    return TaskSpec.model_validate({**fields, **changes})


def check(given: TaskSpec, **strategies: Any) -> None:
    data = {"open": OPEN, "grasp": {"grasp": "antipodal"}, "place": PLACE, **strategies}
    files = {name: f"strategies/{name}.yaml" for name in data}
    parsed = {name: parse_strategy(fields, files[name]) for name, fields in data.items()}
    check_strategies(given, parsed, OBJECTS, robot("panda"), files)


def test_what_fits_passes() -> None:
    check(task())


def test_a_strategy_goes_through_data_and_pickles() -> None:
    place, grasp = parse_strategy(PLACE), parse_strategy({"grasp": "antipodal", "lift": 0.2})
    assert isinstance(place, KeypointStrategy)
    assert place.to_dict() == PLACE
    assert (place.fingers, place.let_go) == ("release", 0.08)
    assert pickle.loads(pickle.dumps(place)) == place
    assert isinstance(grasp, GraspStrategy)
    assert parse_strategy(grasp.to_dict()) == grasp
    assert (grasp.fingers, grasp.lift, grasp.let_go) == ("grasp", 0.2, None)


@pytest.mark.parametrize(
    ("data", "field", "words"),
    [
        ({"grasp": "antipodal", "approch": 0.1}, "approch", "did you mean 'approach'"),
        ({"grasp": "suction"}, "grasp", "antipodal"),
        ({"grasp": "antipodal", "lift": -1.0}, "lift", "greater than 0"),
        ({"grasp": "antipodal", "candidates": "many"}, "candidates", "integer"),
        ({"grasp": "antipodal", "least_tilt": 1.3}, "least_tilt", "must be at most the value of the field 'tilt'"),
        ({**OPEN, "gripper": "bite"}, "gripper", "bite"),
        ({"constraint_list": [{**POINT, "tolerance": -1}]}, "constraint_list[0].tolerance", "toleran"),
        ({**OPEN, "let_go": 7.0}, "let_go", "0.3"),
        ({**OPEN, "contact_speed": 0.0}, "contact_speed", "0.001"),
        ({**OPEN, "contact_speed": "slow"}, "contact_speed", "number"),
        ({**OPEN, "opening": 7}, "opening", "0.5"),
        ({**OPEN, "makes_room": 7}, "makes_room", "name"),
    ],
)
def test_what_cannot_be_read_is_refused_by_field(data: dict[str, Any], field: str, words: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_strategy(data, "strategies/one.yaml")
    assert str(caught.value.file) == "strategies/one.yaml"
    assert caught.value.field == field
    assert words in str(caught.value)


def test_keypoints_that_nothing_has_are_refused_by_file_and_field() -> None:
    lost = {**PLACE, "constraint_list": [{**PLACE["constraint_list"][0], "keypoint_name": "rigidbody_object_tail"}]}
    with pytest.raises(InputError, match="rigidbody_object_tail") as caught:
        check(task(), place=lost)
    assert str(caught.value.file) == "strategies/place.yaml"


def test_another_objects_keypoints_have_its_name_before_them() -> None:
    other = {"constraint_list": [{**POINT, "target_keypoint_name": "drawer/articulated_object_inside"}]}
    steps = [{"name": "reach", "object": "ball", "strategies": ["reach"]}]
    check(task(steps=steps), reach=other)
    wrong = {"constraint_list": [{**POINT, "target_keypoint_name": "articulated_object_inside"}]}
    with pytest.raises(InputError, match="articulated_object_inside"):
        check(task(steps=steps), reach=wrong)


@pytest.mark.parametrize(
    ("steps", "field", "words"),
    [
        ([{"name": "place", "object": "drawer", "tool": "ball", "strategies": ["place"]}], "steps.place.tool", "ball"),
        ([{"name": "open", "object": "drawer", "strategies": ["opne"]}], "steps.open.strategies", "opne"),
        ([{"name": "open", "object": "drawer", "strategies": ["grasp"]}], "grasp", "has a joint"),
    ],
)
def test_steps_that_cannot_be_are_refused(steps: list[Any], field: str, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        check(task(steps=steps))
    assert caught.value.field == field


PUSH = {**OPEN, "gripper": "closed", "makes_room": "drawer"}


def grasping(*ways: str, of: str = "ball") -> list[Any]:
    return [{"name": "grasp", "object": of, "strategies": list(ways)}]


def test_a_strategy_that_makes_room_moves_another_object_than_the_steps() -> None:
    check(task(steps=grasping("grasp", "push")), push=PUSH)
    push = parse_strategy(PUSH)
    assert isinstance(push, KeypointStrategy)
    assert push.makes_room == "drawer"
    assert push.to_dict() == PUSH
    assert push.as_step().to_dict() == {**OPEN, "gripper": "closed"}
    assert parse_strategy({"grasp": "antipodal"}).makes_room is None


@pytest.mark.parametrize(
    ("steps", "moved", "field", "words"),
    [
        (grasping("push"), "drawer", "steps.grasp.strategies", "only moves another object out of the way"),
        (grasping("grasp", "push"), "ball", "makes_room", "no other object"),
        (grasping("grasp", "push"), "dog", "makes_room", "no other object"),
        (grasping("open", "push", of="drawer"), "drawer", "makes_room", "no other object"),
        (
            [*grasping("grasp"), {"name": "in", "object": "drawer", "tool": "ball", "strategies": ["place", "push"]}],
            "drawer",
            "makes_room",
            "holds something",
        ),
    ],
)
def test_what_makes_no_room_is_refused(steps: list[Any], moved: str, field: str, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        check(task(steps=steps), push={**PUSH, "makes_room": moved})
    assert caught.value.field == field


def test_a_pull_is_a_grasp_that_follows_the_joint() -> None:
    pull = parse_strategy({"grasp": "antipodal", "follow_joint_to": 0.97})
    assert pull == PullStrategy(grasp="antipodal", follow_joint_to=0.97)
    assert parse_strategy(pull.to_dict()) == pull
    check(task(), open=pull.to_dict())
    with pytest.raises(InputError, match=r"ball has no joint to follow.*remove follow_joint_to") as refused:
        check(task(), grasp=pull.to_dict())
    assert refused.value.field == "follow_joint_to"
    with pytest.raises(InputError, match="did you mean 'follow_joint_to'"):
        parse_strategy({"grasp": "antipodal", "follow_joint_to": 0.97, "follow_joint": 1.0})
