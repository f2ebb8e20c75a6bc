"""Valid and faulty controllers of users, for workers, by FILE.py:Class."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np

from gensim2.perception import Observation


class Rest:
    """Keeps the arm in place and never ends."""

    observation_spec = {"modalities": ()}  # noqa: RUF012

    def __init__(self, seconds: float = 0.0) -> None:
        self._seconds = seconds
        self.seeds: list[int] = []

    def reset(self, observation: Observation, seed: int) -> None:
        self._arm = observation["state"][:7]
        self.seeds.append(seed)

    def act(self, observation: Observation) -> Any:
        time.sleep(self._seconds)
        return [*self._arm, 1.0]


class Looks(Rest):
    """Observes the point cloud and returns its actions as float64."""

    observation_spec = {"points": 64, "candidates": 256}  # noqa: RUF012

    def act(self, observation: Observation) -> Any:
        assert observation["point_cloud"].shape == (64, 6)
        assert not hasattr(observation, "measurement")
        return None if observation.step == 3 else np.append(self._arm, 1.0).astype(np.float64)


class Nan(Rest):
    """Returns NaN at its third step."""

    def act(self, observation: Observation) -> Any:
        return np.full(8, np.nan) if observation.step == 2 else super().act(observation)


class Short(Rest):
    """Returns actions without the gripper."""

    def act(self, observation: Observation) -> Any:
        return super().act(observation)[:7]


class Fails(Rest):
    """Raises an error with a message of two lines."""

    def act(self, observation: Observation) -> Any:
        raise KeyError("no such\nweight")


class NoAct:
    """Has no ``act`` method."""

    def reset(self, observation: Observation, seed: int) -> None: ...


class Versioned(Rest):
    """Depends on a file whose version it gives as its checkpoint."""

    def __init__(self, config: str, checkpoint: str) -> None:
        super().__init__()
        self._config, self._version = config, checkpoint

    @staticmethod
    def depends_on(config: str, **_: Any) -> list[Path]:
        return [Path(config)]
