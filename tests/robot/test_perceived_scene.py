"""The planner that estimates the scene, in the control loop: it uses only point clouds, and refuses other objects."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gensim2_robot.local
from gensim2.core.errors import InputError
from gensim2.planning.strategies import GraspStrategy, parse_strategy
from gensim2.rollout.config import RolloutOptions
from gensim2.rollout.controller_spec import planner_spec
from gensim2.tasks.library import load_strategies, load_task
from gensim2_robot.config import LineConfig
from gensim2_robot.local import LocalMind
from gensim2_robot.log_messages import AnswerMessage, SentMessage
from gensim2_robot.log_reader import messages, replay
from gensim2_robot.mind import MindSpec
from gensim2_robot.opening import slow_in_contact
from gensim2_robot.run import run

LINE: dict[str, Any] = {
    "assets": "builtin",
    "simulated_clock": True,
    "noise": "deployed",
    "episodes": 1,
    "minutes": 5.0,
}


class Hidden:
    """A fake true scene that raises an error when a controller reads it."""

    def measure(self) -> Any:
        raise AssertionError("the controller read the true measurement")

    def scene_state(self) -> Any:
        raise AssertionError("the controller read the true scene")


@pytest.fixture
def hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    """Controllers get a true scene that raises an error."""

    def blind(spec: MindSpec, truth: object, *rest: Any) -> LocalMind:
        return LocalMind(spec, Hidden(), *rest)

    monkeypatch.setattr(gensim2_robot.local, "LocalMind", blind)


def answers(log: Path) -> list[AnswerMessage]:
    return [message for _, message in messages(log) if isinstance(message, AnswerMessage)]


@pytest.mark.usefixtures("hidden")
def test_a_box_is_closed_by_a_plan_that_knows_only_clouds(tmp_path: Path) -> None:
    found = run("CloseBox", scene_source="perceived", speed=0.5, seed=1, log=tmp_path, **LINE)
    assert (found["state"], found["episodes"], found["success"]) == ("idle", 1, 1.0), found["reason"]
    assert (found["limits_passed"], found["refusals"]) == (0, [])
    said = answers(tmp_path)
    assert said[-1].done, "the controller has ended the episode"
    looks = sum("point_cloud" in each.seen for each in said)
    assert 2 <= looks < 0.3 * len(said), "clouds are computed only between motions"
    again = replay(tmp_path)
    assert (again.different, again.clouds) == ((), looks)


@pytest.mark.usefixtures("hidden")
def test_the_planner_with_the_true_scene_fails_without_it() -> None:
    """The check above can fail: the planner with the true scene reads the true measurement."""
    found = run("CloseBox", speed=0.5, seed=1, pixels=(64, 48), **LINE)
    assert found["state"] == "stopped"
    assert "read the true measurement" in found["reason"]


@pytest.mark.usefixtures("hidden")
def test_another_object_is_refused_without_a_motion_and_named(
    tmp_path: Path,
) -> None:
    name = "CloseLaptop"
    rollout = RolloutOptions(scene_source="perceived", depth_noise="d435")
    laptop = planner_spec(load_task(name), load_strategies(name), rollout, "panda")
    found = run("OpenSafe", policy=laptop, speed=0.5, seed=1, log=tmp_path, **LINE)
    assert (found["state"], found["episodes"], found["success"]) == ("idle", 1, 0.0), found["reason"]
    (refusal,) = found["refusals"]
    assert refusal.startswith("object not seen (class laptop_rotate")
    assert "likeliest safe_rotate" in refusal
    assert answers(tmp_path)[-1].refusal == refusal
    sent = np.array([message.q for _, message in messages(tmp_path) if isinstance(message, SentMessage)])
    assert np.abs(sent - sent[0]).max() < 1e-6, "the arm did not move"


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"arm": "ur:1.2.3.4", "cameras": "realsense:left=1"}, "give --scene perceived"),
        ({"policy": "somewhere", "scene_source": "perceived"}, "cannot be combined with a policy"),
    ],
)
def test_scenes_without_a_source_are_refused(given: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        LineConfig(**given)


def test_a_real_arm_may_be_planned_for_on_an_estimated_scene() -> None:
    config = LineConfig(arm="ur:1.2.3.4", cameras="realsense:left=1", scene_source="perceived")
    assert not config.is_simulated


def test_a_folder_without_an_estimator_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=str(tmp_path)):
        run("CloseBox", scene_source=str(tmp_path), **LINE)


def test_plans_are_slow_in_contact_and_otherwise_unchanged() -> None:
    for name in ("OpenLaptop", "PushDrawerClose", "PlaceGolfBallIntoBox"):
        before = load_strategies(name)
        found = slow_in_contact(before, 0.05)
        for each, data in before.items():
            kind = parse_strategy(data)
            if isinstance(kind, GraspStrategy):
                assert found[each] == data
                continue
            assert parse_strategy(found[each]).contact_speed == 0.05  # type: ignore[union-attr]
            rest = found[each].keys() - {"contact_speed"}
            assert {key: found[each][key] for key in rest} == {key: data[key] for key in rest}
        assert slow_in_contact(found, 1e3) == found, "a slower strategy stays as slow"
