"""Disturbances happen once per episode, at a moment that depends on the seed, and are visible in physics."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import gensim2
from gensim2.core.errors import InputError
from gensim2.robots import robot
from gensim2.rollout.chain import ChainController
from gensim2.rollout.config import Disturbance
from gensim2.rollout.disturbance import PUSHED, Disturbed
from gensim2.rollout.run import run
from gensim2.sim.headless import HeadlessEnv
from gensim2.tasks.library import load_strategies, load_task

TASK = "PutCrackerBoxInBox"


def disturbed(lane: HeadlessEnv, kind: Disturbance, seed: int) -> Disturbed:
    task = load_task(TASK)
    chain = ChainController(task, load_strategies(TASK), profile=robot("panda"), open_loop=True)
    return Disturbed(chain, lane, task, kind, seed)


def test_a_grasp_is_opened_while_it_holds() -> None:
    lane = HeadlessEnv(TASK, assets="builtin")
    controller = disturbed(lane, "drop", 4)
    episode = run(lane, controller, seed=4).episode
    assert controller.happened_at is not None
    assert not episode.held, "nobody looked, so what was dropped stays where it fell"


def test_an_object_is_pushed_three_centimetres_before_it_is_touched() -> None:
    lane = HeadlessEnv(TASK, assets="builtin")
    pushes: list[tuple[float, float]] = []
    nudge = lane.nudge

    def noted(name: str, dx: float = 0.0, dy: float = 0.0, dyaw: float = 0.0) -> None:
        pushes.append((dx, dy))
        nudge(name, dx, dy, dyaw)

    lane.nudge = noted  # type: ignore[method-assign]
    controller = disturbed(lane, "push", 3)
    run(lane, controller, seed=3)
    assert len(pushes) == 1
    assert np.hypot(*pushes[0]) == pytest.approx(PUSHED)


@pytest.mark.parametrize("kind", ["push", "drop"])
def test_the_moment_follows_from_the_seed(kind: Disturbance) -> None:
    lane = HeadlessEnv(TASK, assets="builtin")
    moments = []
    for seed in (3, 3, 4):
        controller = disturbed(lane, kind, seed)
        run(lane, controller, seed=seed)
        moments.append(controller.happened_at)
    assert moments[0] is not None
    assert moments[0] == moments[1]


def test_a_benchmark_says_how_often_it_disturbed_and_leaves_out_what_it_cannot(tmp_path: Path) -> None:
    result = gensim2.benchmark(
        ["CloseBox", "DropAppleIntoBox"],
        runs=1,
        episodes=1,
        disturbance="push",
        assets="builtin",
        out=tmp_path / "run",
        workers=0,
    )
    assert [row.task.name for row in result.rows] == ["DropAppleIntoBox"]
    assert "nothing can be pushed or dropped" in result.skipped["CloseBox"]
    found = result.to_dict()["tasks"][0]
    assert found["disturbed"] == 1
    assert found["records"][0]["disturbed_at"] > 0
    with pytest.raises(InputError, match="nothing can be pushed or dropped"):
        gensim2.benchmark(["CloseBox"], runs=1, episodes=1, disturbance="drop", out=tmp_path / "none", workers=0)
    assert not (tmp_path / "none").exists()
