"""Training objects and test objects of experiments do not overlap."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from gensim2.core.errors import InputError
from gensim2.policy.learning import shared_objects, unseen_instances, words
from gensim2.rollout.counted_objects import all_with_objects, number_of_objects, with_objects
from gensim2.rollout.inputs import only_strategies, read_task_input, read_task_inputs
from gensim2.scenes.sampler import SceneSampler
from gensim2.tasks.library import task_folder


def test_unseen_objects_are_of_the_test_split_where_every_class_has_one() -> None:
    drawers = ("OpenDrawer", "PlaceGolfBallIntoDrawer")
    many, ball, few = (
        read_task_input(name, assets="builtin", instances="train") for name in (*drawers, "CloseSuitcaseLid")
    )
    assert unseen_instances([many, ball]) == "test"
    assert unseen_instances([many, few]) == "new"
    assert shared_objects([many, ball, few], "new") == []
    # A policy that was trained on all objects, or on the test split, has seen these.
    for word in ("all", "test"):
        taught = read_task_input("PlaceGolfBallIntoDrawer", assets="builtin", instances=word)
        assert unseen_instances([taught]) == "new"
        test = taught.library.choose("drawer", "test")
        assert shared_objects([taught], "test") == [f"drawer/{each}" for each in test]
    third = read_task_input("OpenDrawer", assets="builtin", instances="train-3")
    assert unseen_instances([third]) == "test-3"
    assert unseen_instances([third, many]) == "new"
    taught = read_task_input("OpenDrawer", assets="builtin", instances="new")
    with pytest.raises(InputError, match="--test-instances"):
        unseen_instances([taught, few])


def test_the_words_of_tasks_are_by_their_own_names(tmp_path: Path) -> None:
    folder = tmp_path / "my box"
    shutil.copytree(task_folder("CloseBox"), folder)
    given, _ = read_task_inputs([str(folder), "OpenBox"], seed=0, assets="builtin")
    assert words(given, [str(folder), "OpenBox"]) == {"CloseBox": str(folder), "OpenBox": "OpenBox"}


def test_counted_objects_are_neither_listed_nor_new() -> None:
    given = read_task_input("OpenDrawer", assets="builtin")
    chosen = with_objects(given, 40, seed=1).scene.instances
    ((name, ids),) = chosen
    assert name == "drawer"
    assert isinstance(ids, tuple)
    assert len(set(ids)) == 40
    library = given.library
    assert not set(ids) & {*library.choose("drawer", "all"), *library.choose("drawer", "new")}
    assert chosen == with_objects(given, 40, seed=1).scene.instances
    assert chosen != with_objects(given, 40, seed=2).scene.instances


def test_counted_objects_are_those_with_a_joint() -> None:
    given = with_objects(read_task_input("PlaceGolfBallIntoDrawer", assets="builtin"), 4, seed=0)
    drawn = SceneSampler(given.scene).instances
    assert len(drawn["drawer"]) == 4
    assert drawn["ball"] == ("0",)
    with pytest.raises(InputError, match="generated articulated objects"):
        with_objects(read_task_input("LayTableWithAppleAndPear", assets="builtin"), 4, seed=0)


def test_tasks_of_rigid_objects_alone_take_no_number_from_others() -> None:
    given = [read_task_input(name, assets="builtin") for name in ("CloseBox", "LayTableWithAppleAndPear")]
    boxes, table = all_with_objects(given, 4, seed=0)
    assert boxes.scene.instances == with_objects(given[0], 4, seed=0).scene.instances
    assert table is given[1]
    with pytest.raises(InputError, match=r"generated articulated objects.*\(leave it out\)"):
        all_with_objects(given[1:], 4, seed=0)


def test_only_named_strategies_are_left_to_a_step_that_has_them() -> None:
    given = read_task_input("OpenDrawer", assets="builtin")
    first, *others = given.spec.steps[0].strategies
    assert others
    (one,) = only_strategies([given], [first])
    assert one.spec.steps[0].strategies == (first,)
    assert tuple(one.strategies) == (first,)
    assert only_strategies([given], []) == [given]
    with pytest.raises(InputError, match="no step has the strategy 'pray'") as caught:
        only_strategies([given], ["pray"])
    assert first in str(caught.value)


@pytest.mark.parametrize("task", ["CloseBox", "PlaceGolfBallIntoDrawer"])
def test_objects_of_a_task_are_counted_once_and_of_those_with_a_joint(task: str) -> None:
    given = {word: read_task_input(task, assets="builtin", instances=word) for word in ("all", "train", "test")}
    counts = {word: number_of_objects(each) for word, each in given.items()}
    joined = next(thing for thing in given["all"].spec.objects.values() if thing.asset_class != "golf_ball")
    assert counts["all"] == len(given["all"].library.instances(joined.asset_class)) > 9
    assert counts["train"] + counts["test"] == counts["all"]
    assert counts["test"] == len(given["all"].library.split(joined.asset_class, "test"))
    assert number_of_objects(with_objects(given["all"], 40, seed=1)) == 40
