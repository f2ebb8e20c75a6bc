"""Objects to learn from and to be measured on: those that a training sees are none of the others."""

from __future__ import annotations

import pytest

from gensim2.errors import InputError
from gensim2.policy.objects import unseen_instances
from gensim2.rollout.counted_objects import with_objects
from gensim2.rollout.inputs import only_strategies, read_task_input
from gensim2.scenes.sampler import SceneSampler


def test_unseen_objects_are_of_the_test_split_where_every_class_has_one() -> None:
    many, few = (read_task_input(name, assets="builtin") for name in ("OpenDrawer", "CloseSuitcaseLid"))
    assert unseen_instances([many]) == "test"
    assert unseen_instances([many, few]) == "new"


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
    drawn = SceneSampler(given.spec, **given.scene.arguments).instances
    assert len(drawn["drawer"]) == 4
    assert drawn["ball"] == ("0",)
    with pytest.raises(InputError, match="generated articulated objects"):
        with_objects(read_task_input("LayTableWithAppleAndPear", assets="builtin"), 4, seed=0)


def test_only_named_strategies_are_left_to_a_step_that_has_them() -> None:
    given = read_task_input("OpenDrawer", assets="builtin")
    first, *others = given.spec.steps[0].strategies
    assert others
    (one,) = only_strategies([given], [first])
    assert one.spec.steps[0].strategies == (first,)
    assert tuple(one.strategies) == (first,)
    assert only_strategies([given], []) == [given]
    with pytest.raises(InputError, match="no step has 'pray'") as caught:
        only_strategies([given], ["pray"])
    assert first in str(caught.value)
