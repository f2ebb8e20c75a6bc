"""Users' controllers: created by name, with observations of a real robot, stopped at the goal, and checked."""

from __future__ import annotations

import pickle
import shutil
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from controllers import Rest
from scripted import OPEN_DRAWER, ScriptedController, ScriptedWorld, glide

from gensim2.cli.main import run as run_command
from gensim2.perception import CloudSettings, EmptyCloudError, Observation, ObservationSpec
from gensim2.robots import robot
from gensim2.rollout import worker
from gensim2.rollout.config import DEFAULT_ROLLOUT, EpisodeConfig
from gensim2.rollout.controller import PROPRIOCEPTIVE, PrivilegedObservation, spec_of
from gensim2.rollout.controller_spec import CHAIN, ControllerError, ControllerSpec, planner_spec
from gensim2.rollout.driving import drive
from gensim2.rollout.guarded import Guarded
from gensim2.rollout.motion import GOAL_SECONDS, MAX_SETTLE_SECONDS
from gensim2.rollout.record import Cause
from gensim2.rollout.run import run
from gensim2.scenes.config import SceneOptions
from gensim2.sim.headless import HeadlessEnv
from gensim2.tasks.library import load_strategies, load_task

FILE = Path(__file__).with_name("controllers.py")
OPENED = glide((0, {"openness": 0.0}), (20, {"openness": 1.0}), (40, {"openness": 1.0}))


class Never:
    """Never reports that it is done."""

    observation_spec = PROPRIOCEPTIVE

    def reset(self, observation: Observation, seed: int) -> None:
        self.seen: list[Observation] = [observation]

    def act(self, observation: Observation) -> Any:
        self.seen.append(observation)
        return robot("panda").rest_action


def test_a_controller_that_never_ends_is_stopped_by_the_goal_and_can_hold() -> None:
    controller = Never()
    cut = run(ScriptedWorld(OPEN_DRAWER, OPENED), controller, seed=0).episode
    assert (cut.held, cut.truncated, cut.cause) == (False, True, Cause.TIME_OVER)
    episode = run(ScriptedWorld(OPEN_DRAWER, OPENED), controller, seed=0, stop="goal").episode
    assert episode.held
    assert not episode.truncated
    assert len(controller.seen) < 20 + 20 * GOAL_SECONDS + 2
    assert [type(each) for each in controller.seen] == [Observation] * len(controller.seen)


def test_a_goal_that_is_lost_while_the_scene_settles_does_not_end_an_episode() -> None:
    falls = (20, {"openness": 1.0}), (31, {"openness": 1.0}), (34, {"openness": 0.3}), (60, {"openness": 0.3})
    controller = Never()
    course = glide((0, {"openness": 0.0}), *falls, (80, {"openness": 1.0}), (100, {"openness": 1.0}))
    episode = run(ScriptedWorld(OPEN_DRAWER, course), controller, seed=0, stop="goal").episode
    assert (episode.held, episode.truncated) == (True, False)
    assert 80 < episode.control_steps < 100 + 20 * MAX_SETTLE_SECONDS
    assert len(controller.seen) < episode.control_steps - 10  # not called while the scene settles
    lost = run(ScriptedWorld(OPEN_DRAWER, course[:61]), Never(), seed=0, stop="goal").episode
    assert (lost.held, lost.truncated, lost.cause) == (False, False, Cause.GOAL_UNDONE)


def test_the_step_limit_is_an_end_that_is_judged_and_leaves_time_to_settle() -> None:
    controller = Never()
    episode = run(ScriptedWorld(OPEN_DRAWER, OPENED[:1]), controller, seed=0, stop="goal").episode
    assert len(controller.seen) - 1 == OPEN_DRAWER.max_episode_steps - 20 * MAX_SETTLE_SECONDS
    assert (episode.held, episode.truncated) == (False, False)
    assert episode.cause is not Cause.TIME_OVER


def test_only_the_privileged_see_the_truth() -> None:
    seen: list[PrivilegedObservation] = []
    run(ScriptedWorld(OPEN_DRAWER, OPENED), ScriptedController(3, see=seen.append), seed=0)
    assert seen[0].measurement.openness == {"drawer": 0.0}
    assert isinstance(seen[0], PrivilegedObservation)
    assert "drawer" in seen[0].scene().objects


def test_what_a_controller_is_shown_is_what_the_world_gives_byte_for_byte() -> None:
    spec = ObservationSpec(cloud=CloudSettings(points=64, candidates=256))

    class Seeing(Never):
        observation_spec = spec  # type: ignore[assignment]

        def act(self, observation: Observation) -> Any:
            super().act(observation)
            return None if observation.step == 4 else robot("panda").rest_action

    controller, lane = Seeing(), HeadlessEnv("OpenDrawer", assets="builtin")
    run(lane, controller, seed=5)
    again = HeadlessEnv("OpenDrawer", assets="builtin")
    again.reset(seed=5)
    for observation in controller.seen[1:]:
        mine = again.observe(spec)
        assert {name: a.tobytes() for name, a in observation.items()} == {n: a.tobytes() for n, a in mine.items()}
        again.step(robot("panda").rest_action)


def test_a_chain_made_by_name_is_the_same_as_any_other_controller() -> None:
    spec = pickle.loads(
        pickle.dumps(planner_spec(load_task("CloseBox"), load_strategies("CloseBox"), DEFAULT_ROLLOUT, "panda"))
    )
    made = spec.make(load_task("CloseBox"), robot("panda"))
    assert spec.target == CHAIN
    assert made.privileged
    assert spec_of(made) == PROPRIOCEPTIVE
    config = EpisodeConfig(SceneOptions("builtin").with_task(load_task("CloseBox")))
    theirs = worker.evaluate(config, spec, 3, "controller", None)
    assert theirs == worker.episode(config, load_strategies("CloseBox"), 3)


def test_files_classes_and_modules_name_controllers() -> None:
    by_file = ControllerSpec.of(f"{FILE}:Rest", {"seconds": 0.5})
    assert by_file.load().__name__ == "Rest"
    assert by_file.make(OPEN_DRAWER, robot("panda"))._seconds == 0.5  # type: ignore[attr-defined]
    assert ControllerSpec.of(Rest).target == "controllers:Rest"
    assert by_file.digest != ControllerSpec.of(f"{FILE}:Rest").digest


def test_one_file_by_two_paths_is_one_controller(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copy(FILE, tmp_path / FILE.name)
    monkeypatch.chdir(tmp_path)
    told = [ControllerSpec.of(f"{place}:Rest", {"seconds": 0.5}).digest for place in (FILE, FILE.name)]
    assert told[0] == told[1]
    assert told[0] != ControllerSpec.of(f"{FILE.name}:Rest", {"seconds": 0.6}).digest


def test_a_class_that_was_edited_and_a_policy_that_was_trained_again_are_others(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    text = FILE.read_text()
    file.write_text(text)
    spec = ControllerSpec.of(f"{file}:Rest")
    before, kind = spec.digest, spec.load()
    assert spec.load() is kind
    file.write_text(text.replace("1.0]", "-1.0]"))
    assert spec.digest != before
    assert spec.load() is not kind


def test_a_policy_in_a_folder_that_was_moved_is_the_same(tmp_path: Path) -> None:
    digests = []
    for name, weights in (("here", "1"), ("there", "1"), ("other", "2")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "config.json").write_text(weights)
        arguments = {"checkpoint": str(tmp_path / name)}
        digests.append(ControllerSpec("gensim2.policy.controller:PolicyController", arguments).digest)
    assert digests[0] == digests[1]
    assert digests[2] != digests[0]
    others = [ControllerSpec(f"{FILE}:Versioned", {"config": str(FILE), "checkpoint": word}) for word in ("v2", "v3")]
    assert others[0].digest != others[1].digest  # others' checkpoints are any text


class Blinded(ScriptedWorld):
    """A world whose cameras see nothing after some steps."""

    blind_from = 5

    def observe(self, spec: ObservationSpec) -> Observation:
        if self.elapsed_steps >= self.blind_from:
            raise EmptyCloudError("the cameras see no point in the workspace")
        return super().observe(spec)


def test_an_episode_ends_where_the_cameras_see_nothing_any_more() -> None:
    seen = run(ScriptedWorld(OPEN_DRAWER, OPENED[:1]), Never(), seed=0, stop="goal").episode
    episode = run(Blinded(OPEN_DRAWER, OPENED[:1]), Never(), seed=0, stop="goal").episode
    assert not episode.held
    assert not episode.truncated
    assert episode.control_steps < 0.5 * seen.control_steps
    world = Blinded(OPEN_DRAWER, OPENED)
    world.blind_from = 0
    with pytest.raises(EmptyCloudError):
        run(world, Never(), seed=0, stop="goal")


@pytest.mark.parametrize(
    ("target", "arguments", "words"),
    [
        ("controllers", {}, "must be the name of a controller"),
        (f"{FILE}:Nothing", {}, "has no class 'Nothing'"),
        (f"{FILE}:NoAct", {}, "has no method 'act'"),
        ("no_such_module:Rest", {}, "cannot be imported: ModuleNotFoundError"),
        ("no_such_file.py:Rest", {}, "there is no such file"),
        (f"{FILE}:Rest", {"minutes": 1}, "cannot be made: TypeError"),
        (f"{FILE}:Rest", {"seconds": {1}}, "must be plain data"),
    ],
)
def test_what_is_no_controller_is_one_line(target: str, arguments: dict[str, Any], words: str) -> None:
    with pytest.raises(ControllerError, match=words) as told:
        ControllerSpec.of(target, arguments).make(OPEN_DRAWER, robot("panda"))
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("Nan", r"Nan: CloseBox, seed 3: act at step 2: an action must be finite"),
        ("Short", r"Short: CloseBox, seed 3: act at step 0: an action must have the shape \(8,\), has \(7,\)"),
        ("Fails", r"Fails: CloseBox, seed 3: act at step 0: KeyError: 'no such"),
    ],
)
def test_what_a_controller_does_wrong_is_one_line_that_names_it(name: str, words: str) -> None:
    config = EpisodeConfig(SceneOptions("builtin").with_task(load_task("CloseBox")))
    with pytest.raises(ControllerError, match=words) as told:
        worker.evaluate(config, ControllerSpec.of(f"{FILE}:{name}"), 3, "goal", None)
    assert "\n" not in str(told.value)
    assert "controllers.py" in str(told.value)
    with pytest.raises(ControllerError, match=f"{name}: CloseBox, episode 7, seed 3: act at step"):
        worker.evaluate(config, ControllerSpec.of(f"{FILE}:{name}"), 3, "goal", None, 7)


EXITS = """
import os, sys
from gensim2.core.errors import GenSim2Error

class Left(BaseException):
    pass

class Leaves:
    def __init__(self, where, error="exit"):
        self.where, self.error = where, error
        self.leave("init")

    @staticmethod
    def depends_on(where, error="exit"):
        return sys.exit(0) if where == "depends_on" else []

    def leave(self, where):
        if where == self.where:
            raise SystemExit(0) if self.error == "exit" else Left()

    def reset(self, observation, seed):
        self.leave("reset")

    def act(self, observation):
        self.leave("act")
        return None

    def close(self):
        self.leave("close")
"""


@pytest.mark.parametrize("where", ["import", "init", "depends_on", "reset", "act"])
@pytest.mark.parametrize("error", ["exit", "own"])
def test_a_controller_that_leaves_the_program_is_an_error(where: str, error: str, tmp_path: Path) -> None:
    file = tmp_path / f"leaving_{where}.py"
    file.write_text(EXITS + ("sys.exit(0)\n" if where == "import" else ""))
    spec = ControllerSpec.of(f"{file}:Leaves", {"where": where, "error": error})
    config = EpisodeConfig(SceneOptions("builtin").with_task(load_task("CloseBox")))
    with pytest.raises(ControllerError, match=r"SystemExit: 0|Left") as told:
        worker.evaluate(config, spec, 3, "goal", None)
    assert file.name in str(told.value)


def test_a_command_whose_controller_leaves_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "leaving.py"
    file.write_text(EXITS)
    how = ["--assets", "builtin", "--out", str(tmp_path / "out"), "--json"]
    controller = ["--controller", f"{file}:Leaves", "--controller-args", '{"where": "init"}']
    assert run_command(["evaluate", "CloseBox", *controller, *how]) == 2
    assert "cannot be made: SystemExit: 0" in capsys.readouterr().err
    controller[-1], how[3] = '{"where": "close"}', str(tmp_path / "closed")
    assert run_command(["evaluate", "CloseBox", *controller, *how]) == 2
    assert "leaving_" in (told := capsys.readouterr().err)
    assert "Leaves: close: SystemExit: 0" in told


def test_a_turn_that_is_no_step_of_the_task_is_one_line_that_names_the_steps() -> None:
    made = ScriptedController(5, [("open", 0), ("shut", 3)])
    guarded = Guarded(made, ControllerSpec("mine:Doer"), OPEN_DRAWER, robot("panda"), "ScriptedOpen, seed 3")
    with pytest.raises(ControllerError, match=r"mine:Doer: ScriptedOpen, seed 3: turn: 'shut' is not a step .*: open$"):
        run(ScriptedWorld(OPEN_DRAWER, OPENED), guarded, seed=3)
    with pytest.raises(ControllerError, match="turn: 'shut' is not a step of the task; the steps are: open"):
        run(ScriptedWorld(OPEN_DRAWER, OPENED), made, seed=3)


def test_a_controller_that_looks_is_shown_clouds_and_its_actions_are_taken() -> None:
    config = EpisodeConfig(SceneOptions("builtin").with_task(load_task("CloseBox")))
    episode = worker.evaluate(config, ControllerSpec.of(f"{FILE}:Looks"), 3, "goal", None)
    assert episode.steps[0].plans == []
    assert episode.control_steps >= 3


class Restless:
    """A body that does not wait, of a made-up robot: it keeps the time of each step."""

    waits = False
    profile = robot("panda")

    def reset(self, seed: int, options: Any = None) -> None:
        self.steps = 0
        self.at: list[float] = []
        self.actions: list[Any] = []

    def step(self, action: Any) -> None:
        self.steps += 1
        self.at.append(time.monotonic())
        self.actions.append(np.asarray(action))

    def observe(self, spec: ObservationSpec) -> Observation:
        from gensim2.perception import Encoder

        return Encoder(spec, self.profile).encode(self.steps, self.profile.reset_qpos, np.zeros(9), 1.0)

    def close(self) -> None: ...


class Slow(Never):
    """Takes half a second for its first action."""

    def act(self, observation: Observation) -> Any:
        super().act(observation)
        if len(self.seen) == 2:
            time.sleep(0.5)
        return robot("panda").rest_action + np.float32(0.1)


class Stalls(Restless):
    """Its cameras stall once."""

    def observe(self, spec: ObservationSpec) -> Observation:
        if self.steps == 3:
            time.sleep(0.4)
        return super().observe(spec)


def test_what_came_late_is_not_caught_up() -> None:
    body = Stalls()
    assert drive(body, Never(), 12) == 12
    assert min(np.diff(body.at)) > 0.4 / body.profile.control_hz


def test_a_body_that_does_not_wait_gets_an_action_every_control_step() -> None:
    body = Restless()
    assert drive(body, Slow(), 20) == 20
    assert max(np.diff(body.at)) < 3.0 / body.profile.control_hz, "held while the controller thought"
    held = [np.allclose(action[:7], body.profile.reset_qpos[:7]) for action in body.actions]
    assert held[0]
    assert not held[-1]
    assert 4 <= sum(held) < 16
