"""Episodes in physics: execute actions, let the object settle, judge; and the same with a still arm."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from gensim2.errors import InputError

if TYPE_CHECKING:
    from gensim2.demos.recording import Recording
    from gensim2.sim.lane import Lane

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
    lane: Lane,
    actions: npt.NDArray[np.floating[Any]],
    *,
    seed: int | None = None,
    options: Mapping[str, Any] | None = None,
    record: bool = False,
) -> EpisodeResult:
    """Execute ``actions``, hold the last one until the object has settled, and judge.

    Args:
        lane: where they are executed.
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
        lane.reset(seed, options)
    elif options:
        raise InputError("reset options need a seed", field="options")
    elif lane.elapsed_steps != 0:
        raise InputError("the episode has already begun", field="lane", remedy="reset it, or give a seed")
    start = lane.openness
    recorder = Recorder(lane) if record else None
    success = once = False
    change = 0.0
    for index in range(len(commands) + MAX_SETTLE_STEPS):
        if index >= len(commands) + SETTLE_STEPS and change < SETTLED_CHANGE:
            break
        command = commands[min(index, len(commands) - 1)]
        before = lane.openness
        lane.step(command)
        if recorder is not None:
            recorder.add(command)
        change = abs(lane.openness - before)
        success = lane.success
        once |= success
    stable = is_stable(lane)
    steps = lane.elapsed_steps
    truncated = steps > lane.max_episode_steps
    return EpisodeResult(
        seed=lane.seed,
        instance=lane.instance.id,
        success=success and stable and not truncated,
        success_once=once,
        stable=stable,
        settled=change < SETTLED_CHANGE,
        truncated=truncated,
        openness_start=start,
        openness_end=lane.openness,
        steps=steps,
        recording=recorder.finish() if recorder is not None else None,
    )


@dataclass(frozen=True)
class StillResult:
    """What the object did by itself.

    Attributes:
        success: the criteria hold at the end.
        stable: as of an episode.
        openness_start, openness_end: of the object's joint.
    """

    success: bool
    stable: bool
    openness_start: float
    openness_end: float


def still_arm(
    lane: Lane, seed: int, steps: int | None = None, *, options: Mapping[str, Any] | None = None
) -> StillResult:
    """What becomes of the scene of ``seed`` where no arm moves, after ``steps`` control steps and the time to settle.

    A success counts only if this one fails: an object that swings by itself must not pass for a solved task. The scene
    is built without the arm: one that stands still touches nothing, and without it physics is ten times quicker.
    An object that has lain still for ``STILL_STEPS`` from the start will not start later, since nothing in
    the scene moves; it is left there.

    Args:
        lane: is reset.
        seed: of the reset.
        steps: default ``task.max_episode_steps`` less the time to settle.
        options: of the reset.
    """
    count = lane.max_episode_steps - MAX_SETTLE_STEPS if steps is None else steps
    lane.reset(seed, options, robot=False)
    start = lane.openness
    change = 0.0
    for index in range(count + MAX_SETTLE_STEPS):
        lies_still = abs(lane.openness - start) < STILL_CHANGE
        if index == STILL_STEPS + SETTLE_STEPS and lies_still:
            break
        if index >= count + SETTLE_STEPS and change < SETTLED_CHANGE:
            break
        before = lane.openness
        lane.wait()
        change = abs(lane.openness - before)
    return StillResult(lane.success, is_stable(lane), start, lane.openness)


def is_stable(lane: Lane) -> bool:
    """Whether physics holds together; once it has blown up, positions stay NaN or far out."""
    return lane.is_finite and -LARGEST_OVERSHOOT <= lane.openness <= 1 + LARGEST_OVERSHOOT


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
