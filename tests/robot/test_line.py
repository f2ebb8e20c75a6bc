"""The whole control loop on a simulated clock: a plan through limits and physics, faults, and a log that can be
replayed.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gensim2.core.progress import NULL_PROGRESS
from gensim2.robots import robot
from gensim2.rollout.motion import GOAL_SECONDS, MAX_SETTLE_SECONDS, SETTLE_SECONDS
from gensim2_robot.arm import LimitedArm
from gensim2_robot.arm_limits import ArmLimits
from gensim2_robot.clocks import SimulatedClock
from gensim2_robot.devices import ArmState, CameraFrame
from gensim2_robot.faults import Fault
from gensim2_robot.limits import Sent
from gensim2_robot.line import Line
from gensim2_robot.log import Journals
from gensim2_robot.log_messages import SentMessage
from gensim2_robot.log_reader import messages, replay
from gensim2_robot.mind import Begin, ControllerAnswer, Question
from gensim2_robot.run import run
from gensim2_robot.session import Devices, Ended, Layout, Session
from gensim2_robot.simulated import simulated_cameras
from gensim2_robot.watch import State, Watch

SMALL: dict[str, Any] = {"assets": "builtin", "simulated_clock": True, "pixels": (96, 72)}
QUICK: dict[str, Any] = {"assets": "builtin", "simulated_clock": True, "pixels": (160, 120)}


def test_a_plan_closes_boxes_through_the_line_and_the_log_replays(tmp_path: Path) -> None:
    found = run("CloseBox", speed=1.0, seed=1, episodes=3, minutes=5, log=tmp_path, force=400.0, **QUICK)
    assert found["state"] == "idle", found["reason"]
    assert found["episodes"] == 3
    assert found["success"] >= 2 / 3
    assert found["limits_passed"] == 0
    assert found["late_actions"] == 0
    assert found["periods_ms"]["p50"] == pytest.approx(100.0)
    assert found["periods_ms"]["worst"] <= 110.0 + 1e-6
    again = replay(tmp_path)
    assert again.different == ()
    assert again.missing == 0
    assert again.clouds == again.questions > 50
    topics = Counter(topic for topic, _ in messages(tmp_path))
    assert topics["/sent"] > 500
    assert topics["/camera/left"] == topics["/camera/right"] > 50
    assert {"/about", "/arm", "/answer", "/question", "/watch", "/clocks"} <= set(topics)


def test_an_episode_that_is_cut_off_in_motion_comes_to_rest(tmp_path: Path) -> None:
    found = run("CloseBox", speed=0.3, seed=1, episodes=1, minutes=0.1, log=tmp_path, force=400.0, **SMALL)
    assert found["state"] == "idle", found["reason"]
    assert found["limits_passed"] == 0
    sent = [message.q for _, message in messages(tmp_path) if isinstance(message, SentMessage)]
    steps = np.abs(np.diff(sent, axis=0)).max(axis=1)
    assert steps.max() > 1e-4, "it never moved: this tests nothing"
    assert steps[-1] < 1e-6


@pytest.mark.parametrize(
    ("fault", "state", "said"),
    [
        ("camera-frozen", "holding", "frozen"),
        ("camera-late", "holding", "behind the others"),
        ("camera-unplugged", "holding", "camera left"),
        ("camera-torn", "holding", "torn"),
        ("camera-clock", "holding", "clock jumped"),
        ("camera-swapped", "holding", "device 'simulated-right', not 'simulated-left'"),
        ("camera-mislabelled", "holding", "lie behind it"),
        ("policy-killed", "stopped", "process has ended"),
        ("policy-nan", "holding", "NaN"),
        ("policy-slow", "holding", "no action"),
        ("policy-garbage", "holding", "refused"),
        ("arm-reflex", "stopped", "reflex"),
        ("arm-refusing", "stopped", "refuses commands"),
        ("arm-at-limit", "holding", "limit of its own"),
        ("arm-lagging", "holding", "lags"),
        ("arm-silent", "holding", "lags"),
        ("disk-full", "holding", "log cannot be written"),
    ],
)
def test_a_fault_holds_or_stops_within_a_period(tmp_path: Path, fault: str, state: str, said: str) -> None:
    failing = [Fault(fault, 1.2)]  # type: ignore[arg-type]
    found = run("CloseBox", seed=3, episodes=1, minutes=0.2, speed=0.2, faults=failing, log=tmp_path, **SMALL)
    assert found["state"] == state, found["reason"]
    assert said in found["reason"]
    assert found["detected_to_stopped_ms"] <= 100.0 + 1e-6
    assert found["limits_passed"] == 0
    changes = [message for topic, message in messages(tmp_path) if topic == "/watch"]
    assert changes or fault == "disk-full"
    assert replay(tmp_path).different == ()


PANDA = robot("panda")
HOME = np.array(PANDA.reset_qpos)


class Obedient:
    """An arm that is always at its target, and black images of one camera at 10 Hz."""

    profile = PANDA
    cameras = simulated_cameras(PANDA, 8, 6)[:1]
    serials: Mapping[str, str] = {}

    def __init__(self, clock: SimulatedClock) -> None:
        self._clock, self._q, self._frames = clock, HOME.copy(), 0
        self.grippers: list[float] = []

    def poll(self) -> list[ArmState]:
        return [ArmState(self._clock.now(), self._q.copy(), np.zeros(9), 0.0)]

    def send(self, q: np.ndarray, gripper: float, t: float) -> None:
        self._q[:7] = q
        self.grippers.append(gripper)

    def stand(self) -> None:
        pass

    def close(self) -> None:
        pass


class Black(Obedient):
    def poll(self) -> list[Any]:  # type: ignore[override]
        self._frames += 1
        if self._frames % 10:
            return []
        black = np.zeros((6, 8), np.uint16), np.zeros((6, 8, 3), np.uint8)
        return [CameraFrame(self.cameras[0].name, self._frames, self._clock.now(), *black)]


class Sweeping:
    """A controller that turns one joint continuously and answers after 30 ms; ``command`` is the gripper's."""

    is_alive = is_ready = True

    def __init__(self, clock: SimulatedClock, command: Callable[[int], float] = lambda step: 1.0) -> None:
        self._clock, self._command = clock, command
        self.asked: list[tuple[float, Question]] = []
        self.answered: list[float] = []

    def send(self, message: Begin | Question) -> None:
        if isinstance(message, Question):
            self.asked.append((self._clock.now(), message))

    def poll(self) -> Sequence[ControllerAnswer]:
        now = self._clock.now()
        if len(self.answered) == len(self.asked) or now < self.asked[-1][0] + 0.03 - 1e-9:
            return ()
        self.answered.append(now)
        question = self.asked[-1][1]
        steps = question.sight.step + np.arange(question.count)
        actions = np.repeat(np.append(HOME[:7], 1.0)[None], question.count, axis=0).astype(np.float32)
        actions[:, 0] += 0.002 * steps
        actions[:, 7] = [self._command(int(step)) for step in steps]
        return (ControllerAnswer(question.number, actions),)

    def close(self) -> None:
        pass


class Script:
    """A scene whose goal holds as scripted by the loop's time; ``rest``: whether it is at rest then."""

    is_ready = True

    def __init__(
        self, clock: SimulatedClock, goal: Callable[[float], bool], rest: Callable[[float], bool] = lambda now: True
    ) -> None:
        self._clock, self._goal, self._rest, self._begun = clock, goal, rest, 0.0

    def reset(self, seed: int, options: Mapping[str, Any] | None = None) -> None:
        self._begun = self._clock.now()

    @property
    def goal(self) -> bool:
        return self._goal(self._clock.now() - self._begun)

    @property
    def at_rest(self) -> bool:
        return self._rest(self._clock.now() - self._begun)


class Noted(Journals):
    """Keeps the gripper of every command."""

    def __init__(self) -> None:
        super().__init__()
        self.grippers: list[float] = []

    def sent(self, time: float, sent: Sent, gripper: float) -> None:
        self.grippers.append(gripper)


def small_line(command: Callable[[int], float] = lambda step: 1.0) -> Any:
    """Return a control loop with fakes and a simulated clock."""
    clock = SimulatedClock()
    arm, cameras, mind, noted = Obedient(clock), Black(clock), Sweeping(clock, command), Noted()
    guarded = LimitedArm(arm, ArmLimits.of(PANDA, speed=1.0))
    line = Line(guarded, cameras, mind, Watch(), clock, noted, pace=20.0)
    line.commands = []
    return SimpleNamespace(line=line, arm=arm, cameras=cameras, mind=mind, clock=clock, noted=noted)


def episode(
    there: Any, goal: Callable[[float], bool], rest: Callable[[float], bool] = lambda now: True, seconds: float = 20.0
) -> Ended:
    """Run one episode with fakes."""
    stage = Script(there.clock, goal, rest)
    devices = Devices(there.arm, there.cameras, there.mind, there.clock, stage)
    given: Any = SimpleNamespace(spec=SimpleNamespace(max_seconds=seconds))
    session = Session(there.line, devices, given, (), None, [], None, NULL_PROGRESS)
    found: list[Ended] = []
    session.run(60.0, [Layout(0)], goal_ends=True, ended=found.append)
    assert len(found) == 1, there.line.watch.reason
    return found[0]


def test_an_answer_that_arrives_after_the_goal_has_lasted_moves_nothing_and_none_follows() -> None:
    there = small_line()
    # The goal holds just after a request: its answer arrives 30 ms later, while the scene settles.
    first: list[float] = []

    def goal(now: float) -> bool:
        if not first and len(there.mind.asked) == 15:
            first.append(now + 0.1 - GOAL_SECONDS)
        return bool(first) and now >= first[0]

    found = episode(there, goal)
    assert found.held is True
    assert found.over is False
    assert len(there.mind.asked) == len(there.mind.answered)
    lasted = found.seconds - SETTLE_SECONDS
    begun = there.line.watch.changes[1].time
    late = [at for at, _ in there.mind.asked if at > begun + lasted + 0.02]
    assert late == [], "nothing is asked while the scene settles"


def test_an_answer_to_a_question_from_before_a_pause_is_dropped() -> None:
    there = small_line()
    line, mind = there.line, there.mind
    for _ in range(20):
        line.cycle()
    line.begin(0)
    while len(mind.asked) < 8 or len(mind.answered) == len(mind.asked):
        line.cycle()
    asked, sight = len(mind.asked), mind.asked[-1][1].sight
    before = len(mind.answered)
    line.pause()
    paused = there.clock.now()
    for _ in range(80):
        line.cycle()
    assert len(mind.answered) == before + 1, "the answer came"
    assert not line.done
    assert len(mind.asked) == asked
    q = [each[0] for each in line.commands]
    assert q[-1] == pytest.approx(q[-30]), "the arm rests"
    line.go_on()
    gone = there.clock.now() - paused
    for _ in range(20):
        line.cycle()
    assert mind.asked[asked][1].sight.step == sight.step + round(20 * gone), "steps that went by count"
    assert line.watch.state is State.RUNNING, line.watch.reason


def test_a_goal_that_is_lost_while_the_scene_settles_does_not_end_an_episode() -> None:
    there = small_line()
    found = episode(there, lambda now: 2.0 <= now < 2.0 + GOAL_SECONDS + 0.2 or now > 6.0)
    assert found.held is True
    assert found.lost is True
    steps = [question.sight.step for _, question in there.mind.asked]
    gaps = np.diff(steps)
    assert gaps.max() >= round(20 * SETTLE_SECONDS), "the controller is told that time went by"
    assert len(steps) > 40
    assert found.seconds > 4.0


def test_what_was_lost_or_moves_still_is_not_held_and_says_so() -> None:
    lost = episode(small_line(), lambda now: 2.0 <= now < 2.0 + GOAL_SECONDS + 0.2, seconds=6.0)
    assert lost.held is False
    assert lost.lacking == "the goal was reached, and lost again"
    assert lost.seconds == pytest.approx(6.0 - MAX_SETTLE_SECONDS + SETTLE_SECONDS, abs=0.1), "there is time to settle"
    rolls = episode(small_line(), lambda now: now > 2.0, lambda now: False)
    assert rolls.goal is True
    assert rolls.held is False
    assert "rest" in rolls.lacking
    never = episode(small_line(), lambda now: False, seconds=4.0)
    assert never.lacking == "its time was over"


def test_a_change_of_the_gripper_that_was_dropped_in_a_hold_is_not_made_when_it_is_resumed() -> None:
    there = small_line(lambda step: 1.0 if step < 10 else -1.0)
    line = there.line
    for _ in range(20):
        line.cycle()
    line.begin(0)
    while not any(command < 0.0 for _, command in line._grips):
        line.cycle()
    assert there.arm.grippers[-1] == 1.0
    line.watch.hold(there.clock.now(), "a person")
    for _ in range(100):
        line.cycle()
    assert set(there.arm.grippers) == {1.0}
    assert there.noted.grippers == there.arm.grippers, "what is logged is what was sent"
    line.resume("Ada")
    for _ in range(5):
        line.cycle()
    assert set(there.arm.grippers) == {1.0}, "no action says so yet"
    assert there.noted.grippers == there.arm.grippers
