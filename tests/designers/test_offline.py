"""The offline designer: what it proposes, and that what it writes is a valid solver config."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import pytest

import gensim2_kpam as kpam
from gensim2.designers import Affordance, CandidateResult, OfflineDesigner, StageResult
from gensim2.designers.offline import manipulation_from
from gensim2.designers.proposals import affordance_of, redesigned, spec
from gensim2.errors import InputError
from gensim2.tasks.criteria import ArticulatedOpen, DistanceArticulatedRigid
from gensim2.tasks.spec import ObjectSpec, Step, TaskSpec


def affordance(
    asset_class: str, joint_type: Literal["revolute", "prismatic"] = "revolute", openness: float = 0.5
) -> Affordance:
    return Affordance(
        asset_class=asset_class,
        joint_type=joint_type,
        default_openness=openness,
        keypoints={"articulated_object_head": "the edge", "articulated_object_tail": "the hinge"},
        lever_arms={"articulated_object_head": 0.2, "articulated_object_tail": 0.01},
    )


def acted_on(task: TaskSpec) -> str:
    return task.objects[task.steps[0].object].asset_class


def test_proposals_cover_classes_first_and_repeat_nothing() -> None:
    classes = [affordance(name) for name in ("box_rotate", "oven", "toilet")]
    known = [spec(classes[0], "articulated_open")]
    tasks = list(OfflineDesigner().propose(classes, known, seed=0))
    assert [acted_on(task) for task in tasks[:3]] == ["box_rotate", "oven", "toilet"]
    pairs = [affordance_of(task) for task in [*known, *tasks]]
    assert len(pairs) == len(set(pairs)) == 6


def test_what_starts_closed_affords_opening_only() -> None:
    tasks = list(OfflineDesigner().propose([affordance("bucket_lift", "prismatic", 0.0)], [], seed=0))
    assert [task.name for task in tasks] == ["LiftBucket"]
    assert affordance_of(tasks[0]) == ("bucket_lift", "articulated_open")


def test_a_proposal_is_one_object_under_its_noun_and_one_step_that_a_designer_is_to_write() -> None:
    task = spec(affordance("washing_machine"), "articulated_open")
    assert task.objects == {"washing_machine": ObjectSpec(asset_class="washing_machine")}
    (step,) = task.steps
    assert (step.name, step.object, step.tool, step.strategies) == ("open", "washing_machine", "hand", ("designed",))
    assert task.success == step.done == (ArticulatedOpen(object="washing_machine"),)
    assert list(spec(affordance("stapler_press"), "articulated_closed").objects) == ["stapler"]
    assert list(spec(affordance("table_move"), "articulated_open").objects) == ["the_table"]
    assert list(spec(affordance("3d_printer"), "articulated_open").objects) == ["the_3d_printer"]


def long_task() -> TaskSpec:
    """Put the ball into the drawer: not for a designer of single joints."""
    inside = DistanceArticulatedRigid(articulated="drawer", rigid="ball")
    return TaskSpec(
        name="PutBallIntoDrawer",
        description="put the ball into the drawer",
        objects={"drawer": ObjectSpec(asset_class="drawer"), "ball": ObjectSpec(asset_class="golf_ball")},
        steps=(
            Step(name="grasp", object="ball", strategies=("grasp", "side")),
            Step(name="place", object="drawer", tool="ball", strategies=("place",), done=(inside,)),
        ),
    )


def test_a_long_task_takes_no_affordance_away_and_is_not_designed() -> None:
    what = affordance("drawer", "prismatic")
    assert affordance_of(long_task()) is None
    assert {task.name for task in OfflineDesigner().propose([what], [long_task()], seed=0)} == {
        "OpenDrawer",
        "CloseDrawer",
    }
    with pytest.raises(InputError, match="target_task: PutBallIntoDrawer is not one step that"):
        OfflineDesigner().candidates(long_task(), what, seed=0)


def test_a_task_that_is_designed_anew_keeps_one_name_a_step() -> None:
    task = redesigned(long_task())
    assert [step.strategies for step in task.steps] == [("grasp",), ("place",)]
    assert task.model_copy(update={"steps": long_task().steps}) == long_task()


def test_a_class_without_keypoints_on_its_moving_link_affords_nothing() -> None:
    bare = Affordance("door", "revolute", 0.5, {}, {})
    assert list(OfflineDesigner().propose([bare], [], seed=0)) == []


def test_tasks_are_called_what_people_call_them() -> None:
    task = spec(affordance("stapler_press"), "articulated_closed")
    assert (task.name, task.description, task.steps[0].name) == ("PressStapler", "press the stapler", "press")


def test_what_nobody_asks_for_is_proposed_last() -> None:
    classes = [affordance("stapler_press"), affordance("bag_swing"), affordance("oven")]
    names = [task.name for task in OfflineDesigner().propose(classes, [], seed=0)]
    assert names[:3] == ["PressStapler", "SwingBagStrap", "CloseOven"], "the most useful goal of each class"
    assert names[3:] == ["OpenOven", "SwingBagStrapBack", "ReleaseStapler"]


def test_no_two_proposals_have_one_name() -> None:
    names = [task.name for task in OfflineDesigner().propose([affordance("crate"), affordance("crate_rotate")], [], 0)]
    assert sorted(names) == ["CloseCrate", "OpenCrate"]


@pytest.mark.parametrize("joint_type", ["revolute", "prismatic"])
@pytest.mark.parametrize("goal", ["articulated_open", "articulated_closed"])
def test_every_candidate_is_a_valid_config(
    joint_type: Literal["revolute", "prismatic"], goal: Literal["articulated_open", "articulated_closed"]
) -> None:
    what = affordance("safe_rotate", joint_type)
    task = spec(what, goal)
    candidates = OfflineDesigner().candidates(task, what, seed=3)
    assert len(candidates) > 50
    for candidate in candidates:
        assert list(candidate.steps) == [task.steps[0].name]
        assert list(candidate.strategies) == ["designed"]
        config = candidate.strategies["designed"]
        assert kpam.SolverConfig(config).gripper == config["gripper"]
        assert manipulation_from(candidate.provenance).config(task.name) == config
        assert config["let_go"] == candidate.provenance["let_go"] == 0.06


def test_the_hinge_itself_is_no_place_to_push() -> None:
    what = affordance("safe_rotate")
    candidates = OfflineDesigner().candidates(spec(what, "articulated_open"), what, seed=0)
    assert {c.strategies["designed"]["object_keypoint_name_list"][0] for c in candidates} == {"articulated_object_head"}


def test_candidates_and_refinements_depend_on_the_seed_alone() -> None:
    designer = OfflineDesigner()
    what = replace(
        affordance("box_rotate"), lever_arms={"articulated_object_head": 0.2, "articulated_object_tail": 0.2}
    )
    task = spec(what, "articulated_closed")
    first, second = (designer.candidates(task, what, seed=5) for _ in range(2))
    assert first == second
    assert first != designer.candidates(task, what, seed=6)
    results = [CandidateResult(c, (StageResult("physics", 2, 0.5, {}),)) for c in first[:3]]
    children = designer.refine(task, what, results, 5, 0)
    assert children == designer.refine(task, what, results, 5, 0)
    assert children
    assert not {str(c.strategies) for c in children} & {str(c.strategies) for c in first[:3]}
    assert designer.refine(task, what, results, 5, round=99) == []
