"""The bare loop of a body and a controller, and how a controller is asked where the body does not wait."""

from __future__ import annotations

import time
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures import TimeoutError as NotYet
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.perception import Observation
from gensim2.rollout.controller import Action, Controller, spec_of
from gensim2.rollout.world import Body

THINKING_SHARE = 0.8
"""Of a control step that a controller is given where the body does not wait; the rest is for the body."""


class Asked:
    """Asks a controller for actions, no longer than the body can wait.

    A body that waits (a simulation) stands still while the controller thinks. One that does not gets an action within a
    control step: as long as the controller still thinks, the arm holds what it was commanded last, or where it stands.
    What the controller then says is of the state that it was asked about, where the arm was held.

    Args:
        controller: decides.
        body: acts.
    """

    def __init__(self, controller: Controller, body: Body) -> None:
        self._controller, self._profile = controller, body.profile
        self._threads = None if body.waits else ThreadPoolExecutor(1, "controller")
        self._thinking: Future[Any] | None = None
        self._last: Action | None = None

    def reset(self, observation: Observation, seed: int) -> None:
        """Begin an episode; nothing moves yet, so this may take its time."""
        self._last = None
        self._controller.reset(observation, seed)

    def act(self, observation: Observation) -> Action | None:
        """The next action; None: done."""
        if self._threads is None:
            found = self._controller.act(observation)
        else:
            if self._thinking is None:
                self._thinking = self._threads.submit(self._controller.act, observation)
            try:
                found = self._thinking.result(THINKING_SHARE / self._profile.control_hz)
            except NotYet:
                return self._hold(observation)
            self._thinking = None
        self._last = None if found is None else np.asarray(found, dtype=np.float32)
        return self._last

    def close(self) -> None:
        """Wait for what is still being thought, and forget it."""
        if self._threads is not None:
            self._threads.shutdown(cancel_futures=True)

    def _hold(self, observation: Observation) -> npt.NDArray[np.float32]:
        if self._last is None:
            arm = observation.joint_positions[: self._profile.arm_size]
            self._last = np.append(arm, observation.gripper_command).astype(np.float32)
        return self._last


def drive(body: Body, controller: Controller, steps: int, *, seed: int = 0) -> int:
    """Let a controller drive a body until it is done; return the control steps that were made. Nothing is judged.

    Args:
        body: is reset. One that does not wait is stepped once a control step.
        controller: decides; must not be privileged.
        steps: at most.
        seed: of the reset, and of what the controller draws.
    """
    asked = Asked(controller, body)
    try:
        body.reset(seed)
        asked.reset(body.observe(spec_of(controller)), seed)
        due = time.monotonic()
        for step in range(steps):
            action = asked.act(body.observe(spec_of(controller)))
            if action is None:
                return step
            body.step(action)
            if not body.waits:
                # What came late is caught up by half a step at most: the next commands would follow too fast.
                period = 1.0 / body.profile.control_hz
                due = max(due, time.monotonic() - 0.5 * period) + period
                time.sleep(max(0.0, due - time.monotonic()))
        return steps
    finally:
        asked.close()
