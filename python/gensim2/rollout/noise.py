"""Add noise to joint targets, so that demonstrations show recoveries; noise-free actions are recorded as correct."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from gensim2.core.seeding import rng
from gensim2.rollout.controller import Action, Controller, Reference, WrappedController, is_privileged

PERIOD = 0.6
"""Duration (s) of one disturbance of the arm."""
SHARE = 0.5
"""Fraction of the periods with noise."""


class Noisy(WrappedController):
    """Controller that sometimes adds noise to the joint targets of another controller.

    The other controller does not know of the noise. Time is divided into equal periods, random ones with noise: each
    joint target gets an offset like half a sine wave of random amplitude. The noise-free action is
    ``reference/action``.

    Args:
        controller: controller whose actions get noise.
        control_hz: control rate, Hz.
        arm: number of the arm's joints.
        noise: standard deviation of the random amplitudes, rad.
        seed: seed of the episode.
    """

    def __init__(self, controller: Controller, control_hz: int, arm: int, noise: float, seed: int) -> None:
        self._controller, self._noise, self._arm, self._seed = controller, noise, arm, seed
        self.privileged = is_privileged(controller)
        self._steps = max(2, round(PERIOD * control_hz))

    def reset(self, observation: object, seed: int) -> None:
        self._rng = rng(self._seed, "noise")
        self._at, self._angles = 0, np.zeros(self._arm)
        self._meant: Action | None = None
        self._controller.reset(observation, seed)

    def act(self, observation: object) -> Action | None:
        """Return the controller's action with noise on the arm's joints."""
        given = self._controller.act(observation)
        self._meant = None if given is None else np.asarray(given, dtype=np.float32)
        if self._meant is None:
            return None
        phase = self._at % self._steps
        if phase == 0:
            drawn: npt.NDArray[np.float64] = self._rng.normal(0.0, self._noise, self._arm)
            self._angles = drawn * float(self._rng.random() < SHARE)
        self._at += 1
        sent = self._meant.copy()
        sent[: self._arm] += (np.sin(np.pi * phase / self._steps) * self._angles).astype(np.float32)
        return sent

    @property
    def reference(self) -> Reference | None:
        """Return the controller's reference, with the noise-free action in the field ``action``."""
        told = super().reference
        if told is None and self._meant is not None:
            nothing = np.full(self._arm, np.nan, np.float32)
            told = Reference(nothing, nothing, np.full(2, np.nan, np.float32))
        return None if told is None else replace(told, action=self._meant)
