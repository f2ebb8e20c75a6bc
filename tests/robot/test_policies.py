"""Policies in the control loop: chunks of a network for clouds of the loop's cameras."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from gensim2.perception import CloudSettings, Observation, ObservationSpec
from gensim2.policy.checkpoint import CheckpointError
from gensim2.policy.no_op import NoOpPolicy
from gensim2.policy.train import train_policy
from gensim2.rollout.controller import PROPRIOCEPTIVE
from gensim2.rollout.controller_spec import ControllerSpec
from gensim2.tasks.library import load_task
from gensim2_robot.faults import Fault
from gensim2_robot.log_messages import AnswerMessage
from gensim2_robot.log_reader import messages, replay
from gensim2_robot.run import run

sys.path.insert(0, str(Path(__file__).parents[1] / "policy"))

import made_up


@pytest.fixture
def checkpoint(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A network of a few thousand weights after almost no training."""
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", None)
    config = made_up.policy(head="flow")
    source = made_up.MadeUpSource(config, sentences=(load_task("CloseBox").description, "open the drawer"))
    train_policy(source, config, made_up.training(steps=1), tmp_path / "policy")
    return tmp_path / "policy"


def test_a_task_that_a_policy_was_not_taught_is_refused_before_the_arm_is_asked(
    checkpoint: Path, tmp_path: Path
) -> None:
    with pytest.raises(CheckpointError, match="was not trained on the sentence 'open the box'"):
        run("OpenBox", policy=checkpoint, minutes=0.1, assets="builtin", simulated_clock=True, log=tmp_path / "log")
    assert not (tmp_path / "log").exists()


def test_a_policy_drives_the_arm_within_its_limits(checkpoint: Path, tmp_path: Path) -> None:
    found = run(
        "CloseBox",
        policy=checkpoint,
        speed=0.5,
        minutes=0.1,
        assets="builtin",
        pixels=(160, 120),
        simulated_clock=True,
        jump=1.0,
        log=tmp_path / "log",
    )
    # Its actions make no sense, so they may be refused, and they are limited.
    assert found["state"] == "idle" or "refused" in found["reason"] or "force" in found["reason"], found["reason"]
    assert found["limits_passed"] == 0
    asked = [message for _, message in messages(tmp_path / "log") if isinstance(message, AnswerMessage)]
    assert len(asked) >= 2, (found["state"], found["reason"], found["episodes"], found["seconds"])
    assert asked[0].seen["point_cloud"].shape == (made_up.POINTS, 6)
    assert np.isfinite(asked[0].actions).all()
    assert asked[0].actions.shape[1] == 8
    again = replay(tmp_path / "log")
    assert again.different == ()
    assert again.clouds == again.questions == len(asked)


class Glances(NoOpPolicy):
    """Observes the scene only at the start of the episode, like a policy that predicts keyposes."""

    def __init__(self) -> None:
        super().__init__(7)
        self.observation_spec = ObservationSpec(cameras=("left", "front"), cloud=CloudSettings(points=64))

    def reset(self, observation: Observation, seed: int) -> None:
        super().reset(observation, seed)
        self.observation_spec = PROPRIOCEPTIVE


def test_a_cloud_that_was_seen_once_is_logged_and_replayed(tmp_path: Path) -> None:
    found = run(
        "CloseBox",
        policy=ControllerSpec(f"{__file__}:Glances"),
        speed=0.5,
        minutes=0.1,
        episodes=1,
        assets="builtin",
        pixels=(96, 72),
        simulated_clock=True,
        log=tmp_path,
    )
    assert found["episodes"] == 1, found["reason"]
    again = replay(tmp_path)
    assert again.different == ()
    assert again.clouds == 1
    assert again.questions > again.clouds, "afterwards the arm alone was looked at"


def test_pictures_that_nobody_looked_at_are_not_looked_at_in_a_replay(tmp_path: Path) -> None:
    """A camera moves after the only observation, so that its later images could not give a cloud."""
    found = run(
        "CloseBox",
        policy=ControllerSpec(f"{__file__}:Glances"),
        faults=(Fault("camera-mislabelled", 0.3),),
        speed=0.5,
        minutes=0.1,
        episodes=1,
        assets="builtin",
        pixels=(96, 72),
        simulated_clock=True,
        log=tmp_path,
    )
    assert found["episodes"] == 1, found["reason"]
    again = replay(tmp_path)
    assert (again.different, again.clouds) == ((), 1)
