"""Planned scenes as data: the same for any number of workers, complete or absent, and correct about their plans."""

from __future__ import annotations

import copy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gensim2_kpam as kpam
from gensim2.core.errors import InputError
from gensim2.core.processes import WorkerPool
from gensim2.core.progress import Progress
from gensim2.perception import ObservationSpec
from gensim2.planning import Scene, StepPlanner
from gensim2.planning.strategies import CENTERED
from gensim2.policy.keypose import data, examples
from gensim2.policy.keypose.data import plan_scenes, read_planned
from gensim2.policy.keypose.examples import _left_anywhere, draw, other_openness, planned_way
from gensim2.policy.keypose.program import ACTUATION, APPROACH, KEYPOSES, RETREAT, program_of
from gensim2.policy.keypose.teaching import pulls_last
from gensim2.robots import robot
from gensim2.rollout.inputs import TaskInput, read_task_input
from gensim2.rollout.worker import parsed, simulator
from gensim2.tasks.criteria import CLOSED
from gensim2.tasks.spec import Step

SPEC = ObservationSpec.of({"points": 64, "candidates": 256, "robot": "none"})


@pytest.fixture(scope="module")
def given() -> TaskInput:
    return read_task_input("CloseBox", assets="builtin", instances="train")


def test_a_program_goes_through_the_poses_of_its_plan(given: TaskInput) -> None:
    env, profile = simulator(given.scene), robot("panda")
    env.reset(3)
    step = given.spec.steps[0]
    ways = parsed(given.strategies)
    planned = StepPlanner(profile).plan(env.scene_state(), step, ways[step.strategies[0]])
    assert planned.plan is not None
    poses = {frame["label"]: frame["T_base_hand"] for frame in planned.plan.keyframes}
    program = program_of(planned, profile)
    for number, label in ((APPROACH, "pre_0"), (ACTUATION, "actuation"), (RETREAT - 1, "post_0"), (RETREAT, "let_go")):
        assert np.abs(program.poses[number] - poses[label]).max() < 2e-3, label
    ways_gone = np.linalg.norm(np.diff(program.positions[ACTUATION:RETREAT], axis=0), axis=1)
    assert np.ptp(ways_gone) < 0.35 * ways_gone.mean()
    assert (program.gripper == -1.0).all()  # it pushes with closed fingers
    assert len(program.positions) == KEYPOSES


def test_scenes_are_the_same_again_and_of_other_seeds_others(given: TaskInput) -> None:
    one, again, other = (draw(given.scene, given.strategies, SPEC, seed) for seed in (1, 1, 2))
    assert one.failed == again.failed
    assert one.failed is None or not one.examples
    assert one.examples or other.examples
    for mine, its in zip(one.examples, again.examples, strict=True):
        for name, value in mine.items():
            assert np.array_equal(value, its[name]), name
    for mine, its in zip(one.examples, other.examples, strict=False):
        assert not np.array_equal(mine["points"], its["points"])


def test_the_end_looks_otherwise_than_the_beginning(given: TaskInput) -> None:
    examples = next(
        d.examples for d in (draw(given.scene, given.strategies, SPEC, s) for s in range(9)) if d.examples[1:]
    )
    assert [int(each["way"]) for each in examples] == [0, -1]
    assert [int(each["step"]) for each in examples] == [0, 1]
    assert not np.array_equal(examples[0]["points"], examples[1]["points"])  # the lid has closed
    assert np.array_equal(examples[0]["joints"], examples[1]["joints"])  # the arm is at the same pose


def test_joints_of_later_steps_stand_anywhere_but_where_the_step_is_done(given: TaskInput) -> None:
    env = simulator(given.scene)
    env.reset(3)
    now, step, measured = env.scene_state(), given.spec.steps[0], env.measure()
    joints = []
    for seed in range(200):
        joint = _left_anywhere(now, step, measured, np.random.default_rng(seed)).objects[step.object].joint
        assert joint is not None
        joints.append(joint.openness)
    before = now.objects[step.object].joint
    assert before is not None
    others = [each for each in joints if each != before.openness]
    assert 0.15 < len(others) / 200 < 0.3  # of 0.3, one fifth would be closed
    assert min(others) >= CLOSED
    assert max(others) > 0.9


def test_what_is_held_is_put_down_near_the_middle_of_the_tolerance(monkeypatch: pytest.MonkeyPatch) -> None:
    golf = read_task_input("PlaceGolfBallIntoDrawer", assets="builtin", instances="train")
    profile = robot("panda")
    off: list[float] = []

    def watched(planner: StepPlanner, scene: Scene, step: Step, *args: Any) -> Any:
        found = planned_way(planner, scene, step, *args)
        if step.name == "place" and found is not None and found[0] == "drop_into_drawer_from_above":
            hand = program_of(found[2], profile).poses[ACTUATION]
            T_hand_ball = np.linalg.inv(profile.model.forward_kinematics(scene.q)) @ scene.objects["ball"].T_base_object
            target = scene.objects["drawer"].points["articulated_object_inside"]
            off.append(float(np.abs((hand @ T_hand_ball)[:2, 3] - target[:2]).max()))
        return found

    monkeypatch.setattr(examples, "planned_way", watched)
    seeds = (0, 3, 4)
    for seed in seeds:
        draw(golf.scene, golf.strategies, SPEC, seed)
    tolerance = golf.strategies["drop_into_drawer_from_above"]["constraint_list"][0]["tolerance"]
    assert len(off) == len(seeds)
    assert max(off) < CENTERED * tolerance + 1e-3
    off.clear()
    monkeypatch.setattr(examples, "centered", lambda strategy: strategy)
    for seed in seeds:
        draw(golf.scene, golf.strategies, SPEC, seed)
    assert max(off) > 0.9 * tolerance, "the plans of least motion lie in the middle: this tests nothing"


def test_a_scene_is_left_out_where_physics_refutes_its_plans(given: TaskInput) -> None:
    seed = next(s for s in range(9) if draw(given.scene, given.strategies, SPEC, s).examples[1:])
    verified = draw(given.scene, given.strategies, SPEC, seed, verify=True)
    assert verified.failed is None
    assert len(verified.examples) == 2
    # Each motion after contact is cut to a tenth, so it can be planned but leaves the lid open.
    short = copy.deepcopy(given.strategies)
    for strategy in short.values():
        for motion in strategy["post_actuation_motions"]:
            if motion[0].endswith("_joint_to"):
                motion[:] = [motion[0].removesuffix("_to"), -0.1]
    planned = draw(given.scene, short, SPEC, seed)
    assert planned.examples[1:]
    refuted = draw(given.scene, short, SPEC, seed, verify=True)
    assert refuted.examples == ()
    assert refuted.failed is not None
    assert refuted.failed.startswith("refuted: ")


def test_steps_that_are_done_at_the_start_are_none_that_physics_is_asked_about() -> None:
    lemon = read_task_input("PlaceLemonIntoDrawer", assets="builtin", instances="train")
    for seed in range(400):
        opened = other_openness(lemon.scene, seed)
        if opened is not None and opened["openness"]["drawer"] > 0.9:
            break
    drawn = draw(lemon.scene, lemon.strategies, SPEC, seed, verify=True)
    steps = [int(each["step"]) for each in draw(lemon.scene, lemon.strategies, SPEC, seed).examples]
    assert steps[0] == 1, "the drawer is not open at the start: this tests nothing"
    assert drawn.failed is None or drawn.failed.startswith("refuted: ")


class Stages(Progress):
    """Progress listener that keeps the number of finished steps and the total after each change."""

    def __init__(self) -> None:
        self.done = 0
        self.seen: list[tuple[int, int | None]] = []

    def start(self, description: str, total: int | None = None) -> None:
        self.done, self.total = 0, total

    def advance(self, steps: int = 1) -> None:
        self.done += steps
        self.seen.append((self.done, self.total))

    def resize(self, total: int) -> None:
        self.total = total
        self.seen.append((self.done, self.total))


def test_progress_counts_scenes_and_follows_the_limit_of_the_time(
    given: TaskInput, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each shard takes 10 s of CPU time, so a limit of 25 s ends the planning after three of 20 shards."""
    monkeypatch.setattr(data, "SHARD", 2)
    real = data.make_shard

    def slow(*arguments: Any) -> float:
        real(*arguments)
        return 10.0

    monkeypatch.setattr(data, "make_shard", slow)
    stages = Stages()
    with WorkerPool(0) as pool:
        planned = plan_scenes(given, SPEC, tmp_path, pool, seed=0, scenes=40, cpu_limit=25.0, progress=stages)
    assert planned.scenes == 6
    assert stages.seen[0] == (0, 40)
    assert stages.seen[1:] == [(0, 6), (2, 6), (2, 6), (4, 6), (4, 6), (6, 6), (6, 6)]


def test_a_folder_goes_on_and_refuses_what_is_not_its_own(
    given: TaskInput, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(data, "SHARD", 2)
    with WorkerPool(0) as pool:
        first = plan_scenes(given, SPEC, tmp_path, pool, seed=0, scenes=4)
        assert first.scenes == 4
        assert first.demonstrations > 0
        (tmp_path / "shard_00001.npz").unlink()
        stopped = plan_scenes(given, SPEC, tmp_path, pool, seed=0, scenes=4, cpu_limit=1e-6)
        assert stopped.scenes == 2
        again = plan_scenes(given, SPEC, tmp_path, pool, seed=0, scenes=4)
        for name, values in first.arrays.items():
            assert np.array_equal(values, again.arrays[name]), name
        with pytest.raises(InputError, match="seed"):
            plan_scenes(given, SPEC, tmp_path, pool, seed=1, scenes=4)
    (tmp_path / "shard_00001.npz").write_bytes(b"PK nothing")
    with pytest.raises(InputError, match="shard_00001"):
        read_planned(tmp_path)


def test_a_strategy_that_does_not_fit_the_objects_is_left_out(given: TaskInput) -> None:
    env, step = simulator(given.scene), given.spec.steps[0]
    env.reset(3)
    ways = parsed(given.strategies)
    good = step.strategies[0]

    class Planner(StepPlanner):
        def problem(self, scene: Any, step: Any, strategy: Any, *more: Any) -> Any:
            if strategy is not ways[good]:
                raise kpam.ProblemError("unknown keypoint")
            return super().problem(scene, step, strategy, *more)

    planner = Planner(robot("panda"))
    other = replace(ways[good])
    found = planned_way(planner, env.scene_state(), step, {"other": other, good: ways[good]}, ())
    assert found is not None
    assert found[0] == good
    assert planned_way(planner, env.scene_state(), step, {"other": other}, ()) is None


def test_a_grasp_that_is_searched_for_on_a_part_teaches_last() -> None:
    given = read_task_input("OpenDrawer", assets="builtin")
    (step,), (taught,) = given.spec.steps, pulls_last(given).spec.steps
    assert step.strategies[-1] != "pull_drawer_by_a_grasp"
    others = [name for name in step.strategies if name != "pull_drawer_by_a_grasp"]
    assert list(taught.strategies) == [*others, "pull_drawer_by_a_grasp"]
    box = read_task_input("CloseBox", assets="builtin")
    assert pulls_last(box).spec.steps == box.spec.steps
