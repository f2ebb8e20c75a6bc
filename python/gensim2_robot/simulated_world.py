"""The simulated arm and what stands before it: physics at the rate of the wire."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from gensim2.objects import ObjectModel
from gensim2.planning.scene import Scene
from gensim2.robots import OPEN
from gensim2.rollout.motion import is_at_rest, is_stable
from gensim2.scenes.config import SceneConfig
from gensim2.sim.headless import HeadlessEnv
from gensim2.tasks.criteria import all_hold
from gensim2.tasks.measurement import Measurement
from gensim2_robot.arm_limits import CYCLE, Array
from gensim2_robot.devices import ArmMode, ArmState

GOAL_EVERY = 10
"""Cycles from one look at the goal to the next."""
FORCE_CYCLES = 5
"""Over which the force is the mean: contacts of a simulation are impulses."""
LAG = 0.4
"""Seconds by which an arm lags that is told to."""
_MODES: Mapping[str, ArmMode] = {"arm-reflex": "reflex", "arm-refusing": "refusing", "arm-at-limit": "at-limit"}
"""Mode that an arm reports under each fault."""


@dataclass(frozen=True, eq=False)
class Rows:
    """State rows of one instant, for simulated cameras.

    Attributes:
        time: s.
        episode: counts resets.
        states: ManiSkill's ``env_states``, one row an array.
        models: of the objects, by name.
        q: (n,) all active joints.
    """

    time: float
    episode: int
    states: Mapping[str, Any]
    models: Mapping[str, ObjectModel]
    q: Array


class SimulatedWorld:
    """A headless world that goes by the wire's cycle, with an arm that may fail.

    Args:
        scene: what the scenes follow from.
    """

    def __init__(self, scene: SceneConfig) -> None:
        self._env = HeadlessEnv(scene)
        self.profile, self.task = self._env.profile, self._env.task
        if self.profile.simulation.physics_hz != round(1.0 / CYCLE):
            raise ValueError(f"physics at {self.profile.simulation.physics_hz} Hz, the wire at {1 / CYCLE:g}")
        self.faults: set[str] = set()
        self.episode = 0
        self._stopped = False
        self._action = np.zeros(self.profile.action_size)
        self._waiting: deque[tuple[float, np.ndarray]] = deque()
        self._said: deque[ArmState] = deque()
        self._pressed: deque[float] = deque(maxlen=FORCE_CYCLES)
        self._looked: Measurement | None = None

    def reset(self, seed: int, options: Mapping[str, Any] | None = None) -> None:
        """A fresh scene; the arm takes commands again, whatever stopped it, unless its fault lasts.

        Args:
            seed: of what is drawn.
            options: of the reset; they take the place of what the seed would draw.
        """
        self._env.reset(seed, options)
        self.episode += 1
        self._stopped, self._looked = False, None
        for each in (self._waiting, self._said, self._pressed):
            each.clear()
        self._hold_here(OPEN)

    def send(self, q: Array, gripper: float, time: float) -> None:
        """Targets of the arm's joints, (m,), and the gripper."""
        delay = LAG if "arm-lagging" in self.faults else 0.0
        self._waiting.append((time + delay, np.append(q, gripper)))

    def stand(self) -> None:
        """Stop where the arm is; targets are ignored until the next reset."""
        self._stopped = True
        self._hold_here(float(self._action[-1]))

    def advance(self, now: float) -> None:
        """One cycle, until ``now`` (s)."""
        mode: ArmMode = next((said for fault, said in _MODES.items() if fault in self.faults), "ready")
        if mode in ("reflex", "at-limit") and not self._stopped:
            self.stand()
        while self._waiting and self._waiting[0][0] <= now:
            _, action = self._waiting.popleft()
            if not self._stopped and mode != "refusing":
                self._action = action
        self._env.substep(self._action)
        self._pressed.append(self._env.pressing_force())
        force = sum(self._pressed) / len(self._pressed)
        self._said.append(ArmState(now, self._env.q, self._env.qvel, force, mode))

    def said(self, now: float) -> list[ArmState]:
        """States that have come by now."""
        found = []
        delay = LAG if "arm-lagging" in self.faults else 0.0
        while self._said and self._said[0].time <= now - delay:
            found.append(self._said.popleft())
        if "arm-silent" in self.faults:
            return []
        return found

    def rows(self, now: float) -> Rows:
        """This instant for cameras."""
        states = {
            kind: {name: row[None].copy() for name, row in group.items()} for kind, group in self._env.state().items()
        }
        models = {name: thing.model for name, thing in self._env.initial_state.objects.items()}
        return Rows(now, self.episode, states, models, self._env.q)

    def measure(self) -> Measurement:
        """The truth, in plain numbers."""
        found = self._env.measure()
        return Measurement(**{**vars(found), "gripper": {name: np.array(at) for name, at in found.gripper.items()}})

    def scene_state(self) -> Scene:
        """The whole scene as a planner sees it."""
        return self._env.scene_state()

    def look(self) -> tuple[bool, bool]:
        """Whether the task's goal holds in a stable scene, and whether the scene is at rest.

        To be called every ``GOAL_EVERY`` cycles: the scene is at rest where nothing moved since the last look.
        """
        measured = self.measure()
        before, self._looked = self._looked, measured
        rests = before is not None and is_at_rest(before, measured, GOAL_EVERY * CYCLE)
        return self._env.is_finite and is_stable(measured) and all_hold(self.task.success, measured), rests

    def close(self) -> None:
        """Give up what it holds."""
        self._env.close()

    def _hold_here(self, gripper: float) -> None:
        arm = self._env.q[list(self.profile.arm_columns)]
        self._action = np.append(arm, gripper)
