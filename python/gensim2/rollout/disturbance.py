"""Disturb an episode at a random, seeded time: push an object, or open the fingers."""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from gensim2.core.seeding import rng
from gensim2.rollout.config import Disturbance
from gensim2.rollout.controller import ACTUATION, Action, Controller, Event, PrivilegedObservation, WrappedController
from gensim2.tasks.spec import TaskSpec

PUSHED = 0.03
"""Distance (m) by which a push moves an object, in a random direction."""
TICKS_HZ = 20
"""Unit of the sampled times: 20 ticks per second at any control rate."""
PUSHED_WITHIN = 25
"""Maximum number of ticks between the start of the grasping step and a push."""
LIFTED = 0.01
"""Height (m) above its initial position at which an object counts as grasped."""
DROPPED_WITHIN = 40
"""Maximum number of ticks between the grasp and the opening of the fingers."""
OPEN_TICKS = 8
"""Number of ticks for which the fingers stay open."""


class Pushable(Protocol):
    """Interface of a world in which objects can be pushed."""

    def nudge(self, name: str, dx: float = 0.0, dy: float = 0.0, dyaw: float = 0.0) -> None: ...


class Disturbed(WrappedController):
    """Controller with one disturbance in each episode, which affects the first rigid object that the task acts on.

    Args:
        controller: controller that gives the actions.
        world: world in which the controller acts.
        task: the task. If no step acts on a rigid object, no disturbance occurs.
        kind: ``"push"`` moves the object by 3 cm before the hand touches it; ``"drop"`` opens the fingers.
        seed: seed of the episode, from which time and direction follow.
    """

    privileged = True  # This controller reads the object's pose from the simulator.

    def __init__(self, controller: Controller, world: Pushable, task: TaskSpec, kind: Disturbance, seed: int) -> None:
        self._controller, self._world, self._task, self._kind = controller, world, task, kind
        random = rng(seed, f"{task.name}/disturbance/{kind}")
        self._push_at = int(random.integers(PUSHED_WITHIN))
        self._drop_after = int(random.integers(DROPPED_WITHIN))
        self._direction = float(random.uniform(-math.pi, math.pi))
        self.happened_at: int | None = None

    def reset(self, observation: PrivilegedObservation, seed: int) -> None:
        self._controller.reset(observation, seed)
        rigid = observation.measurement.poses.keys()
        self._step = next((step for step in self._task.steps if step.object in rigid), None)
        self._since: int | None = None
        self._height: float | None = None
        self._opened = 0
        self.happened_at = None

    def act(self, observation: PrivilegedObservation) -> Action | None:
        """Return the controller's action; override the gripper during a forced drop."""
        given = self._controller.act(observation)
        action = None if given is None else np.asarray(given, dtype=np.float32)
        if action is None or self._step is None:
            return action
        return self._push(observation, action) if self._kind == "push" else self._drop(observation, action)

    def _push(self, observation: PrivilegedObservation, action: Action) -> Action:
        assert self._step is not None
        if self.happened_at is None and self.turn == self._step.name and not self._touched():
            self._since = _tick(observation) if self._since is None else self._since
            if _tick(observation) - self._since >= self._push_at:
                dx, dy = PUSHED * math.cos(self._direction), PUSHED * math.sin(self._direction)
                self._world.nudge(self._step.object, dx, dy)
                self.happened_at = observation.step
        return action

    def _drop(self, observation: PrivilegedObservation, action: Action) -> Action:
        assert self._step is not None
        height = float(observation.measurement.poses[self._step.object][2])
        self._height = height if self._height is None else self._height
        if self._since is None:
            self._since = _tick(observation) if height > self._height + LIFTED else None
        if self._since is None or _tick(observation) < self._since + self._drop_after:
            return action
        if self.happened_at is None:
            self.happened_at, self._opened = observation.step, _tick(observation)
        if _tick(observation) >= self._opened + OPEN_TICKS:
            return action
        return np.append(action[:-1], np.float32(1.0)).astype(np.float32)

    def _touched(self) -> Event | None:
        """Return the event at which the hand first arrives at the grasp pose. Return None before."""
        assert self._step is not None
        return next((e for e in self.events if e.what == ACTUATION and e.step == self._step.name), None)


def _tick(observation: PrivilegedObservation) -> int:
    return round(observation.time * TICKS_HZ)
