"""Execution of programs: correct ones do the task, the controller uses camera data only, and bad ones give an error."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gensim2.cli.main import run as command
from gensim2.core.errors import InputError
from gensim2.perception.observation import GRIPPER, TOOL_POSE
from gensim2.planning import StepPlanner
from gensim2.policy.checkpoint import CheckpointError
from gensim2.policy.keypose.answers import Answer, answers
from gensim2.policy.keypose.controller import EMPTY, KeyposeController
from gensim2.policy.keypose.execution import Executor
from gensim2.policy.keypose.paths import between
from gensim2.policy.keypose.program import KEYPOSES, KeyposeProgram, program_of
from gensim2.policy.keypose.source import PlannedSource
from gensim2.policy.keypose.surroundings import Seen, Surroundings
from gensim2.policy.keypose.training import TRAINING, Way, train_keypose
from gensim2.robots import OPEN, robot
from gensim2.rollout.controller import PROPRIOCEPTIVE, PrivilegedObservation, is_privileged
from gensim2.rollout.inputs import read_task_input
from gensim2.rollout.run import run
from gensim2.rollout.worker import parsed, simulator

from .made_up import SPEC, made_up
from .test_keypose_network import SMALL

PROFILE = robot("panda")
HOME = np.array(PROFILE.reset_qpos)
NOTHING = Seen(np.zeros((0, 3)), np.zeros((0, 3)), HOME, holds=False)


class Oracle:
    """Executes the program of the planner's own plan, like a network without errors."""

    privileged, observation_spec = True, PROPRIOCEPTIVE

    def __init__(self, task: str) -> None:
        self.given = read_task_input(task, assets="builtin", instances="test")
        self.ways = parsed(self.given.strategies)

    def reset(self, observation: PrivilegedObservation, seed: int) -> None:
        step = self.given.spec.steps[0]
        planned = StepPlanner(PROFILE).plan(observation.scene(), step, self.ways[step.strategies[0]])
        program = program_of(planned, PROFILE)
        self.done = Executor(PROFILE).execute(program, observation.q, 1.0, NOTHING)
        assert self.done is not None
        self.rows = list(self.done.actions)

    def act(self, observation: PrivilegedObservation) -> np.ndarray | None:
        return self.rows.pop(0) if self.rows else None


def test_true_programs_do_the_task() -> None:
    controller = Oracle("CloseBox")
    env = simulator(controller.given.scene)
    found = [run(env, controller, seed=seed, stop="goal").episode for seed in (1, 2)]
    assert [each.held for each in found] == [True, True]
    assert controller.done is not None
    assert (controller.done.reached, controller.done.free) == (KEYPOSES, "planned")


def test_actions_keep_the_joints_limits_and_obstacles_are_gone_around() -> None:
    controller = Oracle("CloseBox")
    env = simulator(controller.given.scene)
    env.reset(1)
    controller.reset(PrivilegedObservation.of(env.observe(PROPRIOCEPTIVE), env.measure(), env.scene_state), 0)
    assert controller.done is not None
    arm = controller.done.actions[:, :7].astype(np.float64)
    assert (arm >= PROFILE.model.lower[:7] - 1e-6).all()
    assert (arm <= PROFILE.model.upper[:7] + 1e-6).all()
    speed = np.abs(np.diff(arm, axis=0)) * PROFILE.control_hz
    assert speed.max() <= 0.5 * PROFILE.model.velocity[:7].max() + 1e-3
    q, goal, middle = HOME, HOME.copy(), HOME.copy()
    goal[0], middle[0] = 1.0, 0.5
    wall = PROFILE.model.forward_kinematics(middle)[:3, 3] + np.random.default_rng(0).uniform(-0.03, 0.03, (60, 3))
    around = Executor(PROFILE).rest(q, goal, 1.0, replace(NOTHING, standing=wall))
    assert around.free == "planned"
    hands = PROFILE.model.forward_kinematics(
        np.column_stack([around.actions[:, :7], np.full((len(around.actions), 2), 0.04)])
    )
    assert np.linalg.norm(hands[:, None, :3, 3] - wall, axis=-1).min() > 0.03


def test_what_the_hand_holds_is_taken_along() -> None:
    hand = PROFILE.model.forward_kinematics(HOME)
    fingers = hand[:3, 3] + 0.1034 * hand[:3, 2]
    stick = fingers + np.outer(np.arange(-9, 10), [0.0, 0.015, 0.0])
    beside = fingers + np.array([0.0, 0.0, -0.1]) + 0.02 * np.random.default_rng(0).uniform(-1, 1, (30, 3))
    seen = Surroundings(PROFILE).seen(np.vstack([beside, stick]), HOME, holds=True)
    assert np.array_equal(seen.standing, beside)
    assert np.array_equal(seen.held, stick)
    assert len(Surroundings(PROFILE).seen(np.vstack([beside, stick]), HOME, holds=False).held) == 0


def test_a_push_goes_on_beyond_its_end_where_the_arm_can_follow() -> None:
    controller = Oracle("CloseBox")
    env = simulator(controller.given.scene)
    env.reset(1)
    scene = PrivilegedObservation.of(env.observe(PROPRIOCEPTIVE), env.measure(), env.scene_state).scene()
    step = controller.given.spec.steps[0]
    program = program_of(StepPlanner(PROFILE).plan(scene, step, controller.ways[step.strategies[0]]), PROFILE)
    assert program.is_push
    closing = np.where(np.arange(KEYPOSES + 1) < 4, 1.0, -1.0).astype(np.float32)
    assert not replace(program, gripper=closing).is_push
    executor = Executor(PROFILE)
    ends = []
    for further in (0.0, 0.03, 0.5):  # 0.5 m: blocked by the table, so the end stays
        found = executor.execute(program, scene.q, 1.0, NOTHING, further=further)
        assert found is not None
        hands = np.column_stack([found.actions[:, :7], np.full((len(found.actions), 2), 0.04)])
        ends.append(PROFILE.model.forward_kinematics(hands.astype(np.float64))[:, 2, 3].min())
    assert ends[1] < ends[0] - 0.005
    assert ends[2] == ends[0]


@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (0.6, 0.0, 0.8)])
def test_the_further_end_of_a_push_about_a_hinge_is_on_the_same_circle(axis: tuple[float, float, float]) -> None:
    angles = np.linspace(0.0, 0.8, KEYPOSES - 1)
    turns = Rotation.from_rotvec(np.outer(angles, axis)).as_matrix()
    center, start = np.array([0.5, 0.1, 0.2]), np.array([0.0, 0.24, 0.0])
    positions = center + turns @ start
    program = KeyposeProgram(
        positions=np.vstack([positions, positions[-1] + np.array([0.0, 0.0, 0.1])]).astype(np.float32),
        rotations=np.concatenate([turns, turns[-1:]]).astype(np.float32),
        gripper=np.ones(KEYPOSES + 1, np.float32),
        seconds=np.full(KEYPOSES, 0.2, np.float32),
    )
    found, end = program.longer(0.03), KEYPOSES - 2
    chord = np.linalg.norm(positions[end] - positions[end - 2])
    further = Rotation.from_rotvec((0.8 + (angles[2] - angles[0]) * 0.03 / chord) * np.array(axis)).as_matrix()
    assert np.allclose(found.positions[end], center + further @ start, atol=1e-5)
    assert np.allclose(found.rotations[end], further, atol=1e-5)
    back = [np.linalg.solve(each.poses[end], each.poses[end + 1]) for each in (program, found)]
    assert np.allclose(*back, atol=1e-5)
    assert np.array_equal(found.positions[:end], program.positions[:end])
    still = replace(program, positions=np.repeat(program.positions[:1], KEYPOSES, 0))
    assert still.longer(0.03) is still


def test_poses_between_two_are_near_to_each_other() -> None:
    end = np.eye(4)
    end[:3, 3] = [0.1, 0.0, 0.0]
    found = between(np.eye(4), end)
    assert np.allclose(found[-1], end)
    assert np.linalg.norm(np.diff(found[:, :3, 3], axis=0), axis=1).max() <= 0.015 + 1e-9
    assert len(between(end, end)) == 0


def test_the_controller_is_not_privileged_and_misfits_are_one_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "policy"
    short = TRAINING.of({**TRAINING.to_dict(), "steps": 2, "batch": 4})
    train_keypose(PlannedSource([made_up(4)]), folder, policy=SMALL, training=short)
    controller = KeyposeController(str(folder))
    assert not is_privileged(controller)
    assert controller.observation_spec == SPEC
    common = ["evaluate", "CloseBox", "--assets", "builtin", "--episodes", "1", "--workers", "1"]
    for words, said in (
        (["--checkpoint", str(folder)], "was not trained on the sentence 'close the box'"),
        (["--checkpoint", str(folder), "--robot", "fetch"], "is for the robot 'panda'"),
        (["--checkpoint", str(tmp_path / "none")], "config.json"),
        (["--checkpoint", str(folder), "--controls", "deaf"], "no control 'deaf'"),
    ):
        assert command([*common, *words]) == 2
        (line,) = [each for each in capfd.readouterr().err.splitlines() if each.startswith("gensim2:")]
        assert said in line
    env = simulator(read_task_input("CloseBox", assets="builtin", instances="test").scene)
    env.reset(1)
    seen = replace(env.observe(SPEC), language="push the bar")
    controller.reset(seen, 0)
    controller._holds, controller._taking, controller._expected = True, 1, {2, 3}
    assert seen.gripper_width > EMPTY
    empty = replace(seen, arrays={**seen.arrays, GRIPPER: np.array([0.0, -1.0], dtype=np.float32)})
    action = controller.act(empty)  # the grasp failed: open, return, predict again
    assert controller.told["lost"] == 1
    assert controller._expected == {1}  # the step that grasped it
    assert action is not None
    assert action[-1] == OPEN
    other = seen[TOOL_POSE].copy()
    other[0] += 0.1
    with pytest.raises(CheckpointError, match="the tool of this one stands"):
        controller.reset(replace(seen, arrays={**seen.arrays, TOOL_POSE: other}), 0)
    # Of two steps the first is expected first if its probability is plausible; "done" is not expected yet.
    controller._ways = [Way(language="push the bar", step=step, name="one") for step in (0, 1)]
    controller.reset(seen, 0)
    program = answers(controller._policy, seen, controller._row)[0].program
    first, second, done = (Answer(way, chance, program) for way, chance in ((0, 0.18), (1, 0.82), (2, 0.95)))
    assert controller._weight(first) > max(controller._weight(second), controller._weight(done))
    assert controller._weight(replace(first, chance=0.1)) < controller._weight(second)
    # Every strategy gets its turn before one is tried for the third time.
    controller._tried.update({1: 2})
    assert controller._turn(first) > controller._turn(second)
    controller._tried.update({0: 2})
    assert controller._turn(first) < controller._turn(replace(second, chance=6.0))
    # "Done" is accepted only if it is likely, and more likely than at the first prediction, when nothing had been done.
    for at_first, now, believed in ((0.05, 0.82, True), (0.05, 0.78, False), (0.6, 0.89, False), (0.6, 0.95, True)):
        controller._done_at_first = at_first
        assert controller._is_done(now) is believed
    # The first prediction's most likely class tells the task of the instruction.
    words = [("open", 0), ("open", 1), ("close", 0)]
    controller._ways = [Way(language=language, step=step, name="one") for language, step in words]
    looked = [Answer(way, chance, program) for way, chance in ((2, 0.35), (0, 0.3), (1, 0.2), (3, 0.15))]
    assert controller._hear(looked) == {0, 1}
    assert controller._steps == 2
    told = KeyposeController(str(folder), says={"push the bar": "shove it"}, unknown_sentences="embed")
    told.reset(seen, 0)
    with pytest.raises(CheckpointError, match="was not trained on the sentence 'shove it'"):
        KeyposeController(str(folder), says={"push the bar": "shove it"}).reset(seen, 0)
    KeyposeController(str(folder), says={"shove it": "push the bar"}).reset(replace(seen, language="shove it"), 0)
    with pytest.raises(InputError, match="must be one of parse, embed"):
        KeyposeController(str(folder), unknown_sentences="guess")
    ways = json.loads((folder / "keypose.json").read_text())
    (folder / "keypose.json").write_text(json.dumps({**ways, "ways": ways["ways"][:1]}))
    with pytest.raises(CheckpointError, match="has 1 ways and done, the network 3 classes"):
        KeyposeController(str(folder))
    (folder / "keypose.json").write_text("{}")
    with pytest.raises(Exception, match=r"keypose\.json"):
        KeyposeController(str(folder))


def test_looks_are_timed_in_episodes_of_the_tasks_that_the_policy_knows(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    planned = made_up(4)
    short = TRAINING.of({**TRAINING.to_dict(), "steps": 2, "batch": 4})
    for language, folder in (("close the box", tmp_path / "known"), ("push the bar", tmp_path / "unknown")):
        taught = replace(planned, record=planned.record.model_copy(update={"language": language}))
        train_keypose(PlannedSource([taught]), folder, policy=SMALL, training=short)
    common = ["bench", "policy", "--decisions", "3", "--assets", "builtin", "--json"]
    assert command([*common, "--checkpoint", str(tmp_path / "known")]) == 0
    found = json.loads(capfd.readouterr().out)
    (row,) = found["rows"]
    assert (row["tasks"], found["looks"]) == (["CloseBox"], 3)
    assert 0 < row["p50"]["observation"] < row["p50"]["total"] <= row["p95"]["total"]
    assert command([*common, "--checkpoint", str(tmp_path / "unknown")]) == 2
    told = capfd.readouterr().err
    assert "no task on which the policy was trained; the training instructions are 'push the bar'" in told
    assert "--library" in told
    assert command([*common, "--checkpoint", str(tmp_path / "unknown"), "--library", "none"]) == 2
    assert "the task library contains no task on which the policy was trained" in capfd.readouterr().err
    assert command([*common, "--checkpoint", str(tmp_path / "known"), "--head", "chunk"]) == 2
    assert "Give --head without --checkpoint" in capfd.readouterr().err
