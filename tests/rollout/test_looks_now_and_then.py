"""A controller's spec is read before every observation, so clouds are only made when requested."""

from __future__ import annotations

from typing import Any

import numpy as np

from gensim2.perception import Observation, ObservationSpec
from gensim2.robots import robot
from gensim2.rollout.controller import PROPRIOCEPTIVE
from gensim2.rollout.controller_spec import ControllerSpec
from gensim2.rollout.guarded import Guarded
from gensim2.rollout.run import run
from gensim2.sim.headless import HeadlessEnv
from gensim2.tasks.library import load_task

SPEC = ObservationSpec.of({"points": 16, "candidates": 64})


class NowAndThen:
    """Requests a cloud at every second step and keeps its observations."""

    def __init__(self) -> None:
        self.shown: list[bool] = []

    @property
    def observation_spec(self) -> ObservationSpec:
        return PROPRIOCEPTIVE if len(self.shown) % 2 else SPEC

    def reset(self, observation: Observation, seed: int) -> None:
        self.shown = []

    def act(self, observation: Observation) -> Any:
        self.shown.append(observation.cloud is not None)
        return None if len(self.shown) > 3 else robot("panda").rest_action


def test_a_controller_looks_when_it_wants_to() -> None:
    env = HeadlessEnv("CloseBox", assets="builtin")
    inside = NowAndThen()
    guarded = Guarded(inside, ControllerSpec("tests:NowAndThen"), load_task("CloseBox"), robot("panda"), "CloseBox")
    for _ in range(2):  # a truncated episode may end between two observations
        run(env, guarded, seed=1)
        assert inside.shown == [True, False, True, False]
        inside.shown.append(False)
    assert np.isfinite(env.q).all()
