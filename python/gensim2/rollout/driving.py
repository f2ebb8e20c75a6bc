"""Run controllers in a control loop. The loop also runs real robots, which do not wait for the controller."""

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
"""Fraction of a control step for which the loop waits for the controller's action on a robot that cannot wait."""


class Asked:
    """Gets actions from a controller without making the robot wait too long.

    A simulated robot waits for the controller. A real robot needs an action in every control step: until the controller
    answers, it repeats its last command, or stays before the first one. The robot moves only a little meanwhile, so the
    late action still fits.

    Args:
        controller: controller that computes the actions.
        body: robot that executes the actions.
    """

    def __init__(self, controller: Controller, body: Body) -> None:
        self._controller, self._profile = controller, body.profile
        self._threads = None if body.waits else ThreadPoolExecutor(1, "controller")
        self._thinking: Future[Any] | None = None
        self._last: Action | None = None

    def reset(self, observation: Observation, seed: int) -> None:
        """Start an episode. This may take long, because the robot does not move yet."""
        self._last = None
        self._controller.reset(observation, seed)

    def act(self, observation: Observation) -> Action | None:
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
        """Wait for a pending action, and discard the action."""
        if self._threads is not None:
            self._threads.shutdown(cancel_futures=True)

    def _hold(self, observation: Observation) -> npt.NDArray[np.float32]:
        if self._last is None:
            arm = observation.joint_positions[: self._profile.arm_size]
            self._last = np.append(arm, observation.gripper_command).astype(np.float32)
        return self._last


def drive(body: Body, controller: Controller, steps: int, *, seed: int = 0) -> int:
    """Run a controller on a robot until the controller is done, without evaluation; return the number of control steps.

    Args:
        body: robot, which is reset first. A robot that cannot wait is stepped at the control rate.
        controller: controller that is not privileged.
        steps: maximum number of control steps.
        seed: seed of the reset and of the controller.

    Example:
        ```python
        steps = drive(body, controller, 200, seed=0)    # your own Body and Controller
        ```
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
                # After a delay, the next steps are shorter, in total by at most half a step.
                period = 1.0 / body.profile.control_hz
                due = max(due, time.monotonic() - 0.5 * period) + period
                time.sleep(max(0.0, due - time.monotonic()))
        return steps
    finally:
        asked.close()
