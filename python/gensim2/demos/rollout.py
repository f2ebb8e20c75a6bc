"""Episodes in physics: execute actions, let the object settle, judge; and the same with a still arm."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from gensim2.errors import InputError
from gensim2.sim.robot import GRIPPER_OPEN, RESET_QPOS

if TYPE_CHECKING:
    from gensim2.demos.recording import Recording
    from gensim2.sim.env import GenSim2Env

Actions = npt.NDArray[np.float32]

SETTLE_STEPS = 10
"""Control steps (0.5 s) for which the last command is held in any case before success is judged."""

MAX_SETTLE_STEPS = 40
"""Control steps after which success is judged although the object still moves."""

LARGEST_OVERSHOOT = 0.5
"""Openness by which a joint may stand outside 0..1; the give of its limits is a hundredth of that."""

STILL_STEPS = 40
"""Control steps (2 s) after which an object that has not moved counts as one that stays where it is."""

STILL_CHANGE = 0.002
"""Change of openness in that time below which it has not moved; at that rate an episode of 20 s ends 0.02 away."""

SETTLED_CHANGE = 0.001
"""Change of openness in one control step (0.05 s) below which the object counts as settled."""


@dataclass(frozen=True)
class EpisodeResult:
    """What came of one episode.

    Attributes:
        seed: of the reset.
        instance: id of the object.
        success: the criteria hold after the motion has ended and the object has settled, within the step
            limit.
        success_once: they held after some step.
        stable: physics held together: all that was measured is finite, and the joint is near its range.
        settled: the object's joint was at rest when success was judged.
        truncated: the episode was longer than ``task.max_episode_steps``.
        openness_start, openness_end: of the object's joint.
        steps: control steps executed, settling included.
        recording: states, actions and flags of every step, if they were asked for.
    """

    seed: int
    instance: str
    success: bool
    success_once: bool
    stable: bool
    settled: bool
    truncated: bool
    openness_start: float
    openness_end: float
    steps: int
    recording: Recording | None = field(default=None, repr=False, compare=False)


def run_episode(
    env: GenSim2Env,
    actions: npt.NDArray[np.floating[Any]],
    *,
    seed: int | None = None,
    options: Mapping[str, Any] | None = None,
    record: bool = False,
) -> EpisodeResult:
    """Execute ``actions``, hold the last one until the object has settled, and judge.

    Args:
        env: an environment without wrappers.
        actions: (N, 8) of the control mode ``pd_joint_pos``, N >= 1; rounded to float32, which is what a
            trajectory file keeps. The holding steps are part of the episode, so that a replay ends in the
            same state.
        seed: reset with it first; None goes on from a fresh reset.
        options: of that reset.
        record: keep states and observations of every step.

    Raises:
        InputError: the actions have the wrong shape or are not finite, or the episode has already begun.
    """
    from gensim2.demos.recording import Recorder

    commands = check_actions(actions)
    if seed is not None:
        env.reset(seed=seed, options=dict(options) if options else None)
    elif options:
        raise InputError("reset options need a seed", field="options")
    elif int(env.elapsed_steps[0]) != 0:
        raise InputError("the episode has already begun", field="env", remedy="reset the environment, or give a seed")
    start = env.openness
    recorder = Recorder(env) if record else None
    once = False
    change = 0.0

    def step(command: Actions) -> bool:
        nonlocal change
        before = env.openness
        obs, reward, terminated, truncated, info = env.step(command)
        if recorder is not None:
            recorder.add(command, obs, reward, terminated, truncated, info)
        change = abs(env.openness - before)
        return bool(info["success"][0])

    success = False
    for command in commands:
        success = step(command)
        once |= success
    for held in range(MAX_SETTLE_STEPS):
        if held >= SETTLE_STEPS and change < SETTLED_CHANGE:
            break
        success = step(commands[-1])
        once |= success
    stable = is_stable(env)
    steps = int(env.elapsed_steps[0])
    truncated = steps > env.max_episode_steps
    return EpisodeResult(
        seed=int(env._episode_seed[0]),
        instance=env._require_instance().id,
        success=success and stable and not truncated,
        success_once=once,
        stable=stable,
        settled=change < SETTLED_CHANGE,
        truncated=truncated,
        openness_start=start,
        openness_end=env.openness,
        steps=steps,
        recording=recorder.finish() if recorder is not None else None,
    )


def still_arm(
    env: GenSim2Env, seed: int, steps: int | None = None, *, options: Mapping[str, Any] | None = None
) -> EpisodeResult:
    """The episode of ``seed`` in which the arm holds its initial pose for ``steps`` control steps, then
    settles.

    A success counts only if this one fails: an object that swings by itself must not pass for a solved task.
    An object that has lain still for ``STILL_STEPS`` from the start will not start later, since nothing in
    the scene moves; the episode then ends there.

    Args:
        env: an environment without wrappers.
        seed: of the reset.
        steps: default ``task.max_episode_steps`` less the time to settle.
        options: of the reset.
    """
    count = env.max_episode_steps - MAX_SETTLE_STEPS if steps is None else steps
    command = np.array([*RESET_QPOS[:7], GRIPPER_OPEN], dtype=np.float32)[None]
    first = run_episode(env, np.repeat(command, max(min(count, STILL_STEPS), 1), axis=0), seed=seed, options=options)
    if count <= STILL_STEPS or abs(first.openness_end - first.openness_start) < STILL_CHANGE:
        return first
    return run_episode(env, np.repeat(command, count, axis=0), seed=seed, options=options)


def is_stable(env: GenSim2Env) -> bool:
    """Whether physics holds together; once it has blown up, positions stay NaN or far out."""
    openness = env.openness
    measured = [openness, *env.agent.robot.get_qpos().flatten().tolist(), *env.object.pose.raw_pose.flatten().tolist()]
    return bool(np.isfinite(measured).all()) and -LARGEST_OVERSHOOT <= openness <= 1 + LARGEST_OVERSHOOT


def check_actions(actions: npt.NDArray[np.floating[Any]]) -> Actions:
    """Actions as float32.

    Raises:
        InputError: not (N, 8), empty, or not finite.
    """
    commands = np.asarray(actions, dtype=np.float32)
    if commands.ndim != 2 or commands.shape[1] != 8 or len(commands) == 0:
        raise InputError(f"must be (N, 8) with N >= 1, is {commands.shape}", field="actions")
    if not np.isfinite(commands).all():
        raise InputError("must be finite", field="actions")
    return commands
