"""Keypose policies use the point clouds and the network's prediction to decide when to stop."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gensim2.core.errors import InputError
from gensim2.core.seeding import rng
from gensim2.perception import Observation
from gensim2.perception.estimation import keypose
from gensim2.perception.estimation.estimator import ESTIMATOR_JSON
from gensim2.perception.estimation.examples import Cameras
from gensim2.perception.estimation.keypose import PerceivingKeyposeController
from gensim2.perception.raycast.observer import Observer
from gensim2.policy.checkpoint import PolicyCheckpoint, checkpoint_folder
from gensim2.policy.evaluating import policy_controller
from gensim2.policy.keypose import controller as policy_module
from gensim2.policy.keypose.controller import MAX_TRIES, KeyposeController
from gensim2.policy.keypose.goals import TaskGoal
from gensim2.policy.keypose.training import WAYS_JSON, read_goals
from gensim2.tasks.library import load_task

from .test_estimation import PANDA, model_of, put


def box(openness: float, asset_class: str = "box_rotate", sentence: str = "close the box") -> Observation:
    """Return an observation of an object with the inputs of the packaged policy."""
    model, spec = model_of(asset_class), PolicyCheckpoint.load("builtin").observation
    states = Cameras(PANDA, model)._states(put(model, openness), np.array(PANDA.reset_qpos), rng(0, "test"))
    return replace(Observer(PANDA, {"object": model}, spec, 0).observe(states, 0), language=sentence)


def predict(monkeypatch: pytest.MonkeyPatch, done: float) -> None:
    """Set the predicted probability of "done" in all later predictions."""
    real = policy_module_answers

    def answers(policy: Any, seen: Any, row: Any) -> Any:
        last = policy.config.ways - 1
        others = [replace(each, chance=0.5 * each.chance) for each in real(policy, seen, row) if each.way != last]
        return [*others, replace(others[0], way=last, chance=done)]

    monkeypatch.setattr(policy_module, "answers", answers)


policy_module_answers = policy_module.answers


def begin(monkeypatch: pytest.MonkeyPatch, openness: float, *of: str) -> PerceivingKeyposeController:
    """Return a controller that has finished its first program. The network did not expect "done" at the start."""
    controller = PerceivingKeyposeController("builtin")
    predict(monkeypatch, 0.1)
    controller.reset(box(openness, *of), 0)
    assert controller.act(box(openness, *of)) is not None
    controller._rows.clear()
    return controller


@pytest.mark.parametrize(
    ("before", "now", "done", "stops"),
    [
        (0.6, 0.0, 0.1, True),  # the lid is closed, and the network does not see it
        (0.6, 0.5, 0.1, False),
        (0.6, 0.5, 0.99, False),  # the network is sure, and the lid is wide open
        (0.6, 0.1, 0.99, True),
        (0.15, 0.15, 0.1, False),  # the lid has not moved, so a doubtful estimate proves nothing
    ],
)
def test_the_lid_and_the_network_decide_together(
    monkeypatch: pytest.MonkeyPatch, before: float, now: float, done: float, stops: bool
) -> None:
    controller = begin(monkeypatch, before)
    predict(monkeypatch, done)
    assert (controller.act(box(now)) is None) == stops


def test_the_network_alone_does_not_stop_where_the_clouds_do(monkeypatch: pytest.MonkeyPatch) -> None:
    predict(monkeypatch, 0.1)
    controller = KeyposeController("builtin")
    controller.reset(box(0.6), 0)
    assert controller.act(box(0.6)) is not None
    controller._rows.clear()
    assert controller.act(box(0.0)) is not None


def test_a_strategy_that_did_not_move_the_object_comes_after_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    for now, tried in ((0.6, MAX_TRIES), (0.4, 1)):
        controller = begin(monkeypatch, 0.6)
        first = controller._latest
        assert controller.act(box(now)) is not None
        assert controller._tried[first] >= tried
        assert (controller._latest != first) == (tried == MAX_TRIES)


def test_resistance_is_noticed_while_the_program_touches_the_object(monkeypatch: pytest.MonkeyPatch) -> None:
    """An obstacle holds the arm: the observed joints do not change."""
    predict(monkeypatch, 0.1)
    controller, held = PerceivingKeyposeController("builtin"), box(0.6)
    controller.reset(held, 0)
    noticed = []
    for _ in range(400):
        assert controller.act(held) is not None
        noticed.append(controller._is_pressed)
        if controller._ran == controller._touching.stop - 1:
            break
    assert noticed[-1]
    assert not any(noticed[: controller._touching.start])


@pytest.mark.parametrize(
    ("pressed", "of", "ends"),
    [
        (True, ("drawer", "push the drawer closed"), True),
        (False, ("drawer", "push the drawer closed"), False),
        (True, ("box_rotate", "close the box"), False),  # the cloud shows that the lid is open
    ],
)
def test_a_sliding_part_that_resists_twice_is_at_the_end(
    monkeypatch: pytest.MonkeyPatch, pressed: bool, of: tuple[str, str], ends: bool
) -> None:
    controller = begin(monkeypatch, 0.8, *of)
    for stops in (False, ends):
        controller._rows.clear()
        controller._is_pressed = pressed
        assert (controller.act(box(0.5, *of)) is None) == stops
        assert not controller._is_pressed


@pytest.mark.parametrize("change", ["no goal", "several objects", "unknown class"])
def test_without_evidence_the_network_decides(monkeypatch: pytest.MonkeyPatch, change: str) -> None:
    goal = TaskGoal.of(load_task("CloseBox"))
    changed = {
        "no goal": None,
        "several objects": goal.model_copy(update={"objects": {**goal.objects, "other": "drawer"}}),
        "unknown class": goal.model_copy(update={"objects": {"box": "spaceship"}}),
    }
    monkeypatch.setattr(keypose, "read_goals", lambda _: {"close the box": changed[change]} if changed[change] else {})
    for done, stops in ((0.1, False), (0.99, True)):
        controller = begin(monkeypatch, 0.6)
        predict(monkeypatch, done)
        assert (controller.act(box(0.0)) is None) == stops


def test_checkpoints_know_their_goals(tmp_path: Path) -> None:
    folder = checkpoint_folder("builtin")
    tasks = [load_task(name) for name in PolicyCheckpoint.load(folder).data.tasks]
    assert read_goals(folder) == {task.description: TaskGoal.of(task) for task in tasks}
    spec = policy_controller("builtin")
    assert spec.load() is PerceivingKeyposeController
    files = PerceivingKeyposeController.depends_on(**spec.arguments)
    assert {WAYS_JSON, ESTIMATOR_JSON} <= {file.name for file in files}
    shutil.copytree(folder, tmp_path / "old")
    record = json.loads((folder / WAYS_JSON).read_bytes())
    del record["goals"]
    (tmp_path / "old" / WAYS_JSON).write_text(json.dumps(record))
    assert read_goals(tmp_path / "old") == {}
    goal = {"objects": {"box": "box_rotate"}, "success": [{"type": "articulated_closed", "object": "lid"}]}
    (tmp_path / "old" / WAYS_JSON).write_text(json.dumps({**record, "goals": {"close the box": goal}}))
    with pytest.raises(InputError, match=r"names the object 'lid', which is not listed under 'objects'"):
        PerceivingKeyposeController(str(tmp_path / "old"))
