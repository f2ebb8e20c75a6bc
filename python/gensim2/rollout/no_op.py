"""Run the no-op baseline, which is the same scene with a still arm.

If the goal is reached in the baseline, it is no success of the robot.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from gensim2.perception import Observation
from gensim2.robots import RobotProfile
from gensim2.rollout.controller import PROPRIOCEPTIVE, Action
from gensim2.rollout.motion import MAX_SETTLE_SECONDS, SETTLE_SECONDS, changes, is_at_rest, is_stable, may_judge
from gensim2.rollout.world import World
from gensim2.tasks.criteria import all_hold
from gensim2.tasks.measurement import Measurement

UNMOVED_SECONDS = 2.0
"""Time (s) after which objects that have not moved are assumed to stay."""

UNMOVED_CHANGE = 0.002
"""Openness change within ``UNMOVED_SECONDS`` below which a joint counts as unmoved; this rate gives 0.02 in 20 s."""

UNMOVED_DISTANCE = 0.001
"""Displacement (m) within ``UNMOVED_SECONDS`` below which an object counts as unmoved; this rate gives 1 cm in 20 s."""


class NoOpController:
    """Controller that keeps the arm in place.

    Args:
        robot: robot profile.
        steps: number of control steps.
        gripper: gripper command, from -1 (closed) to 1 (open).
    """

    observation_spec = PROPRIOCEPTIVE

    def __init__(self, robot: RobotProfile, steps: int, gripper: float = 1.0) -> None:
        self._arm = [robot.model.joint_names.index(name) for name in robot.arm_joints]
        self._steps, self._gripper = steps, gripper
        self._action: Action | None = None

    def reset(self, observation: Observation, seed: int = 0) -> None:
        self._action = None

    def act(self, observation: Observation) -> Action | None:
        if observation.step >= self._steps:
            return None
        if self._action is None:
            self._action = np.append(observation.joint_positions[self._arm], self._gripper).astype(np.float32)
        return self._action


@dataclass(frozen=True)
class NoOpResult:
    """Result of the no-op baseline.

    Attributes:
        success: whether the goal is reached at the end.
        stable: whether the simulation was stable.
        start, end: measurements at the start and at the end.
    """

    success: bool
    stable: bool
    start: Measurement
    end: Measurement


def no_op_baseline(
    world: World, seed: int, *, options: Mapping[str, Any] | None = None, steps: int | None = None
) -> NoOpResult:
    """Simulate the scene of a seed without the arm, and return whether the goal is reached without any action.

    The arm is left out: at rest it touches nothing, and the simulation is ten times faster without it. After ``steps``,
    the simulation continues until the scene is at rest. The simulation ends early if nothing moves in the first
    ``UNMOVED_SECONDS``.

    Args:
        world: simulated world, which is reset first.
        seed: seed of the reset.
        options: options of the reset.
        steps: number of control steps. By default it is the task's step limit minus the maximum time to come to rest.
    """
    steps_in, period = world.profile.steps, 1.0 / world.profile.control_hz
    longest, settle = steps_in(MAX_SETTLE_SECONDS), steps_in(SETTLE_SECONDS)
    count = steps_in(world.task.max_seconds) - longest if steps is None else steps
    world.reset(seed, options, robot=False)
    start = before = now = world.measure()
    for index in range(count + longest):
        if index == steps_in(UNMOVED_SECONDS) + settle and _lie_still(start, now):
            break
        if index >= count and may_judge(index - count, is_at_rest(before, now, period), steps_in):
            break
        world.wait()
        before, now = now, world.measure()
    return NoOpResult(all_hold(world.task.success, now), world.is_finite and is_stable(now), start, now)


def _lie_still(start: Measurement, now: Measurement) -> bool:
    return not any(moved.exceeds(UNMOVED_CHANGE, UNMOVED_DISTANCE) for moved in changes(start, now).values())
