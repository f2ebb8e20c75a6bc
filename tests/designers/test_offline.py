"""The offline designer: what it proposes, and that what it writes is a valid solver config."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import pytest

import gensim2_kpam as kpam
from gensim2.designers import Affordance, CandidateResult, OfflineDesigner, StageResult
from gensim2.designers.offline import strategy_from
from gensim2.designers.proposals import goal_of, spec, task_name


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


def test_proposals_cover_classes_first_and_repeat_nothing() -> None:
    classes = [affordance(name) for name in ("box_rotate", "oven", "toilet")]
    known = [spec(classes[0], "articulated_open")]
    tasks = list(OfflineDesigner().propose(classes, known, seed=0))
    assert [task.asset_class for task in tasks[:3]] == ["box_rotate", "oven", "toilet"]
    pairs = [(task.asset_class, goal_of(task)) for task in [*known, *tasks]]
    assert len(pairs) == len(set(pairs)) == 6


def test_what_starts_closed_affords_opening_only() -> None:
    tasks = list(OfflineDesigner().propose([affordance("bucket_lift", "prismatic", 0.0)], [], seed=0))
    assert [task.name for task in tasks] == ["LiftBucket"]
    assert goal_of(tasks[0]) == "articulated_open"


def test_a_class_without_keypoints_on_its_moving_link_affords_nothing() -> None:
    bare = Affordance("door", "revolute", 0.5, {}, {})
    assert list(OfflineDesigner().propose([bare], [], seed=0)) == []


@pytest.mark.parametrize(
    ("asset_class", "name"), [("washing_machine", "OpenWashingMachine"), ("stapler_press", "PressStapler")]
)
def test_names_follow_the_class(asset_class: str, name: str) -> None:
    assert task_name(asset_class, "articulated_open") == name


@pytest.mark.parametrize("joint_type", ["revolute", "prismatic"])
@pytest.mark.parametrize("goal", ["articulated_open", "articulated_closed"])
def test_every_candidate_is_a_valid_config(
    joint_type: Literal["revolute", "prismatic"], goal: Literal["articulated_open", "articulated_closed"]
) -> None:
    what = affordance("safe_rotate", joint_type)
    candidates = OfflineDesigner().candidates(spec(what, goal), what, seed=3)
    assert len(candidates) > 50
    for candidate in candidates:
        assert kpam.SolverConfig(candidate.config).gripper == candidate.config["gripper"]
        assert strategy_from(candidate.provenance).config(candidate.config["task_name"]) == candidate.config


def test_the_hinge_itself_is_no_place_to_push() -> None:
    what = affordance("safe_rotate")
    candidates = OfflineDesigner().candidates(spec(what, "articulated_open"), what, seed=0)
    assert {c.config["object_keypoint_name_list"][0] for c in candidates} == {"articulated_object_head"}


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
    assert not {str(c.config) for c in children} & {str(c.config) for c in first[:3]}
    assert designer.refine(task, what, results, 5, round=99) == []
