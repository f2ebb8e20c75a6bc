"""The whole line on a simulated clock: a plan through the limits into physics, faults, and the log that replays."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gensim2.deploy.faults import Fault
from gensim2.deploy.replay import messages, replay
from gensim2.deploy.run import run

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
    topics = Counter(topic for topic, _, _ in messages(tmp_path))
    assert topics["/sent"] > 500
    assert topics["/camera/left"] == topics["/camera/right"] > 50
    assert {"/about", "/arm", "/answer", "/question", "/watch", "/clocks"} <= set(topics)


def test_an_episode_that_is_cut_off_in_motion_comes_to_rest(tmp_path: Path) -> None:
    found = run("CloseBox", speed=0.3, seed=1, episodes=1, minutes=0.1, log=tmp_path, force=400.0, **SMALL)
    assert found["state"] == "idle", found["reason"]
    assert found["limits_passed"] == 0
    sent = [arrays["q"] for topic, _, arrays in messages(tmp_path) if topic == "/sent"]
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
        ("camera-mislabelled", "holding", "goes through it"),
        ("policy-killed", "stopped", "process is gone"),
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
    changes = [plain for topic, plain, _ in messages(tmp_path) if topic == "/watch"]
    assert changes or fault == "disk-full"
    assert replay(tmp_path).different == ()
