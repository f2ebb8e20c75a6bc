"""The offline designer: its proposals are valid, and steps of a chain fit together."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import cache
from typing import Literal

import pytest

import gensim2_kpam as kpam
from gensim2.design import (
    Affordance,
    Brief,
    CandidateResult,
    Declined,
    Known,
    OfflineDesigner,
    RobotSummary,
    StageResult,
)
from gensim2.design.drafting import chains, verbs
from gensim2.design.joint_search import manipulation_from
from gensim2.design.offline import wanted_ends
from gensim2.design.proposals import redesigned, spec
from gensim2.objects import open_library
from gensim2.objects.words import Goal, noun
from gensim2.planning.strategies import GraspStrategy, parse_strategy
from gensim2.tasks import load_task, task_names
from gensim2.tasks.criteria import ArticulatedBetween, ArticulatedOpen, DistanceArticulatedRigid, DistanceGripperRigid
from gensim2.tasks.likeness import first_alike, joint_goal, normal_words
from gensim2.tasks.spec import ObjectSpec, Step, TaskSpec

SETTINGS = RobotSummary("panda", (-0.615, 0.0), 0.75, 0.08, {})


def affordance(
    asset_class: str, joint_type: Literal["revolute", "prismatic"] = "revolute", openness: float = 0.5
) -> Affordance:
    return Affordance(
        asset_class=asset_class,
        kind="articulated",
        noun=asset_class.replace("_", " "),
        description="",
        size=(0.3, 0.3, 0.3),
        mass=1.0,
        keypoints={"articulated_object_head": "the edge", "articulated_object_tail": "the hinge"},
        lever_arms={"articulated_object_head": 0.2, "articulated_object_tail": 0.01},
        joint_type=joint_type,
        joint_range=(0.0, 1.5),
        joint_axis="level",
        default_openness=openness,
    )


def brief(*things: Affordance, known: tuple[TaskSpec, ...] = ()) -> Brief:
    return Brief(SETTINGS, {thing.asset_class: thing for thing in things}, [Known(task, {}) for task in known])


def proposed(*things: Affordance, known: tuple[TaskSpec, ...] = ()) -> list[TaskSpec]:
    return list(OfflineDesigner().propose(brief(*things, known=known), seed=0))


@cache
def generated() -> dict[str, Affordance]:
    library = open_library("builtin")
    found = {}
    for name in (*library.classes("articulated"), *library.classes("rigid")):
        found[name] = Affordance.of([library.load(name, library.instances(name)[0])], library.describe(name))
    return found


@cache
def everything() -> tuple[list[TaskSpec], Brief]:
    """Return all proposals for generated objects, if every proposal succeeds."""
    known: list[Known] = []
    familiar = [load_task(name) for name in task_names("paper")]
    told, designer = Brief(SETTINGS, generated(), known, familiar), OfflineDesigner()
    tasks = []
    for task in designer.propose(told, seed=0):
        tasks.append(task)
        best = designer.candidates(task, told, seed=0)[0]
        known.append(Known(best.of(task), best.strategies))
    return tasks, told


def test_proposals_cover_classes_first_and_repeat_nothing() -> None:
    classes = [affordance(name) for name in ("box_rotate", "oven", "toilet")]
    known = spec(classes[0], "articulated_open")
    tasks = proposed(*classes, known=(known,))
    assert [next(iter(task.objects.values())).asset_class for task in tasks[:3]] == ["box_rotate", "oven", "toilet"]
    pairs = [joint_goal(task) for task in [known, *tasks]]
    assert len(pairs) == len(set(pairs))


def test_a_proposal_is_one_object_under_its_noun_and_one_step_that_a_designer_is_to_write() -> None:
    task = spec(affordance("washing_machine"), "articulated_open")
    assert task.objects == {"washing_machine": ObjectSpec(asset_class="washing_machine")}
    (step,) = task.steps
    assert (step.name, step.object, step.tool, step.strategies) == ("open", "washing_machine", "hand", ("designed",))
    assert task.success == step.done == (ArticulatedOpen(object="washing_machine"),)
    assert list(spec(affordance("stapler_press"), "articulated_closed").objects) == ["stapler"]
    assert list(spec(affordance("table_move"), "articulated_open").objects) == ["the_table"]
    assert list(spec(affordance("3d_printer"), "articulated_open").objects) == ["the_3d_printer"]


def test_a_joint_that_is_to_be_left_halfway_starts_at_an_end() -> None:
    for goal, mean in (("half_open", 0.05), ("half_closed", 0.95)):
        task = spec(affordance("door"), goal)  # type: ignore[arg-type]
        assert task.objects["door"].randomization.openness_mean == mean
        assert isinstance(task.success[0], ArticulatedBetween)
        assert joint_goal(task) == ("door", goal)


def test_what_hangs_is_not_asked_to_come_down() -> None:
    hanging = replace(affordance("bucket_lift", "prismatic", 0.0), joint_axis="vertical")
    assert [task.name for task in proposed(hanging)] == ["LiftBucket"]
    sliding = replace(hanging, asset_class="toaster_move", joint_axis="level")
    assert {task.name for task in proposed(sliding)} >= {"PushToaster", "PullToaster"}


def test_what_nobody_asks_for_is_proposed_last() -> None:
    names = [task.name for task in proposed(affordance("stapler_press"), affordance("oven"))]
    assert names[0] == "PressStapler", "the most useful goal of the class"
    assert names[-1] == "ReleaseStapler"


def test_a_class_without_keypoints_on_its_moving_link_affords_nothing() -> None:
    assert proposed(replace(affordance("door"), lever_arms={})) == []


def test_classes_in_any_script_are_proposed_each_under_a_name_of_its_own() -> None:
    names = ("柜子", "衣柜", "kühlschrank", "шкаф", "шкаф2", "стол2")
    tasks = proposed(*(replace(affordance(name), noun=noun(name)) for name in names))
    opened = {task.description: task.name for task in tasks if task.description.startswith("open the")}
    assert set(opened) == {f"open the {name}" for name in names}
    assert len(set(opened.values())) == len(names)
    assert all(name.isascii() for name in opened.values())
    assert opened["open the kühlschrank"] == "OpenKuhlschrank"
    assert not set(normal_words("打开 laptop")) & set(normal_words("关闭 box"))


def test_no_two_proposals_have_one_name() -> None:
    assert sorted(task.name for task in proposed(affordance("crate"), affordance("crate_rotate"))) == [
        "CloseCrate",
        "OpenCrate",
    ]


def test_a_task_that_is_designed_anew_keeps_one_name_a_step() -> None:
    task = put_ball_away()
    again = redesigned(task)
    assert [step.strategies for step in again.steps] == [("grasp",), ("place",)]
    assert again.model_copy(update={"steps": task.steps}) == task


def put_ball_away() -> TaskSpec:
    inside = DistanceArticulatedRigid(articulated="drawer", rigid="ball")
    return TaskSpec(
        name="PutBallIntoDrawer",
        description="put the ball into the drawer",
        objects={"drawer": ObjectSpec(asset_class="drawer"), "ball": ObjectSpec(asset_class="golf_ball")},
        steps=(
            Step(name="grasp", object="ball", strategies=("grasp", "side"), done=(DistanceGripperRigid(rigid="ball"),)),
            Step(name="place", object="drawer", tool="ball", strategies=("place",), done=(inside,)),
        ),
    )


def test_a_task_of_several_steps_gets_ways_for_each() -> None:
    told = Brief(SETTINGS, generated())
    first, *_ = OfflineDesigner().candidates(put_ball_away(), told, seed=0)
    assert list(first.steps) == ["grasp", "place"]
    assert all(isinstance(parse_strategy(data), GraspStrategy) for data in first.steps["grasp"].values())
    assert all(parse_strategy(data).fingers == "release" for data in first.steps["place"].values())
    assert first.of(put_ball_away()).steps[1].strategies == tuple(first.steps["place"])


def test_a_class_whose_objects_share_no_keypoint_of_the_moving_part_is_declined() -> None:
    tasks, told = everything()
    task = next(each for each in tasks if each.is_single_step and each.steps[0].done and "drawer" in str(each.objects))
    classes = {**told.classes, "drawer": replace(told.classes["drawer"], lever_arms={})}
    with pytest.raises(Declined, match="share no keypoint on the moving part"):
        OfflineDesigner().candidates(task, Brief(SETTINGS, classes), seed=0)


def test_a_step_that_it_knows_no_way_for_is_declined() -> None:
    task = put_ball_away()
    odd = task.model_copy(update={"steps": (task.steps[1].model_copy(update={"tool": "hand"}),)})
    with pytest.raises(Declined, match="'place'"):
        OfflineDesigner().candidates(odd, Brief(SETTINGS, generated()), seed=0)


def test_there_are_more_than_a_hundred_proposals_of_many_kinds() -> None:
    tasks, _ = everything()
    single = [task for task in tasks if task.is_single_step]
    long = [task for task in tasks if not task.is_single_step]
    assert len(single) >= 75
    assert len(long) >= 100
    assert len({task.name for task in tasks}) == len(tasks) == len({task.description for task in tasks})
    assert len({thing.asset_class for task in tasks for thing in task.objects.values()}) >= 40
    assert len({verbs(task) for task in long}) >= 12
    assert sum(_joints(task) >= 2 for task in long) >= 20


def test_no_more_than_three_tasks_differ_only_in_the_rigid_object() -> None:
    kinds = generated()

    def shape(task: TaskSpec) -> str:
        names = {
            name: thing.asset_class if kinds[thing.asset_class].kind == "articulated" else "rigid"
            for name, thing in task.objects.items()
        }
        steps = [
            (names[step.object], names.get(step.tool), verb) for step, verb in zip(task.steps, verbs(task), strict=True)
        ]
        begins = [(names[name], names.get(thing.place.on)) for name, thing in task.objects.items()]
        goal = [(c.type, getattr(c, "direction", ""), [names[o] for o in c.objects]) for c in task.success]
        return f"{begins} {steps} {goal}"

    counts = Counter(shape(task) for task in everything()[0] if _joints(task) < len(task.objects))
    assert max(counts.values()) <= 3


def test_what_is_familiar_is_proposed_as_a_piece_alone() -> None:
    tasks, told = everything()
    repeated = [task for task in tasks if first_alike(task, told.familiar) is not None]
    assert len(repeated) >= 10
    assert {joint_goal(task) for task in repeated} <= wanted_ends(told)


def test_a_sentence_says_what_several_things_are_done_for() -> None:
    said = {task.name: task.description for task in everything()[0]}
    assert said["CloseLaptopAndCloseBox"] == "close the laptop and the box to tidy the desk"
    assert (
        said["TurnOffFaucetAndCloseTrashCan"]
        == "turn the faucet off and close the trash can before leaving the kitchen"
    )


def test_every_long_task_holds_together() -> None:
    tasks, told = everything()
    designer = OfflineDesigner()
    for task in tasks:
        if not task.is_single_step:
            assert chains(task) == []
            for candidate in designer.candidates(task, told, seed=0):
                assert set(candidate.steps) == {step.name for step in task.steps}
                assert all(candidate.steps.values())
                candidate.of(task)


def test_a_broken_chain_is_told_of() -> None:
    task = next(task for task in everything()[0] if verbs(task) == ("open", "grasp", "put", "close"))
    first, grasp, put, close = task.steps
    assert chains(task.model_copy(update={"steps": (first, put, grasp, close)})) != []
    assert chains(task.model_copy(update={"steps": (first, close, grasp, put)})) != []
    assert chains(task.model_copy(update={"steps": (first, grasp)})) != []


def _joints(task: TaskSpec) -> int:
    return sum(generated()[thing.asset_class].kind == "articulated" for thing in task.objects.values())


@pytest.mark.parametrize("joint_type", ["revolute", "prismatic"])
@pytest.mark.parametrize("goal", ["articulated_open", "articulated_closed", "half_closed"])
def test_every_candidate_is_a_valid_config(joint_type: Literal["revolute", "prismatic"], goal: Goal) -> None:
    what = affordance("microwave", joint_type)
    task = spec(what, goal)
    told, designer = brief(what), OfflineDesigner()
    first = designer.candidates(task, told, seed=3)
    results = [CandidateResult(c, (StageResult("physics", 4, 0.5, {}),)) for c in first]
    drawn = [*first, *designer.refine(task, told, results, 3, 0)]
    assert len(drawn) > 80
    for candidate in drawn:
        assert list(candidate.steps) == [task.steps[0].name]
        for config in candidate.strategies.values():
            parse_strategy(config)
        if "approach" in candidate.provenance:
            (config,) = candidate.strategies.values()
            assert kpam.SolverConfig(config).gripper == config["gripper"]
            assert manipulation_from(candidate.provenance).config() == config
    assert any("team" in candidate.provenance for candidate in drawn)


def test_the_motion_to_a_range_of_openness_ends_in_its_middle() -> None:
    what = affordance("microwave")
    task = spec(what, "half_closed")
    step = task.steps[0].model_copy(update={"done": (ArticulatedBetween(object="microwave", low=0.75, high=0.9),)})
    candidates = OfflineDesigner().candidates(task.model_copy(update={"steps": (step,)}), brief(what), seed=0)
    ends = {
        motion[1]
        for candidate in candidates
        for config in candidate.strategies.values()
        for motion in config["post_actuation_motions"]
        if isinstance(motion, list) and str(motion[0]).endswith("_joint_to")
    }
    assert list(ends) == [pytest.approx(0.825)]


def test_the_hinge_itself_is_no_place_to_push() -> None:
    what = affordance("safe_rotate")
    candidates = OfflineDesigner().candidates(spec(what, "articulated_open"), brief(what), seed=0)
    keypoints = {
        name
        for c in candidates
        for config in c.strategies.values()
        for name in config.get("object_keypoint_name_list", [])
    }
    assert keypoints == {"articulated_object_head"}


def test_candidates_and_refinements_depend_on_the_seed_alone() -> None:
    designer = OfflineDesigner()
    what = affordance("box_rotate")
    told, task = brief(what), spec(what, "articulated_closed")
    first, second = (designer.candidates(task, told, seed=5) for _ in range(2))
    assert first == second
    assert first != designer.candidates(task, told, seed=6)
    results = [CandidateResult(c, (StageResult("physics", 2, 0.5, {}),)) for c in first]
    children = designer.refine(task, told, results, 5, 0)
    assert children == designer.refine(task, told, results, 5, 0)
    assert children
    assert not {str(c.steps) for c in children} & {str(c.steps) for c in first}
    assert designer.refine(task, told, results, 5, round=99) == []
