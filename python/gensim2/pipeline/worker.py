"""What one simulator worker does: plan on a scene, run an episode, say what went wrong.

Functions here run in worker processes; their arguments and results are plain values that pickle.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

import gensim2_kpam as kpam
from gensim2.pipeline.records import Attempt
from gensim2.planning.actions import plan_actions
from gensim2.planning.problem import SceneProblems
from gensim2.robots import DEFAULT
from gensim2.tasks.spec import TaskSpec

if TYPE_CHECKING:
    from gensim2.demos.recording import Recording
    from gensim2.demos.rollout import StillResult
    from gensim2.sim.lane import Lane

#: What a worker needs and takes seconds to import.
PRELOAD: Sequence[str] = ("gensim2.pipeline.worker", "gensim2.demos.rollout", "gensim2.sim.lane")

#: Planner options of the pipeline: the longest part of a motion that can be done is taken; physics judges it.
PLAN_OPTIONS: kpam.Options = {"allow_partial": True}

#: For screening, where hundreds of candidates are planned and most cannot work: few poses, short searches. Measured on
#: closing real laptops: the same answers as with the planner's defaults, in a 30th of the time.
SCREEN_OPTIONS: kpam.Options = {**PLAN_OPTIONS, "harvest": 0, "candidates": 6, "samples": 200}


#: Cause of an episode in which positions became NaN, infinite or absurd: no word on the task.
UNSTABLE = "physics became unstable"

#: What planning says of a config on one scene: a score from 0 to 1, and what stood in the way of 1.
Screened = tuple[float, str | None]


@dataclass(frozen=True)
class Setting:
    """Which environment a job needs: ``task`` is the spec as JSON, ``assets`` a folder or ``"builtin"``, ``robot`` the
    name of a profile."""

    task: str
    assets: str
    instances: str = "all"
    robot: str = DEFAULT


@lru_cache(maxsize=2)
def simulator(setting: Setting) -> Lane:
    """Return the simulator of a setting; the last two are kept, since jobs come task by task."""
    from gensim2.sim.lane import Lane

    return Lane(
        TaskSpec.model_validate_json(setting.task),
        assets=setting.assets,
        instances=setting.instances,
        robot=setting.robot,
    )


def screen_scene(setting: Setting, seed: int, configs: Sequence[Mapping[str, Any]]) -> list[Screened]:
    """Plan every config on the scene of one seed.

    Returns:
        One (score, cause) a config: 1 and None where the plan is whole, 0.5 where the arm gets past the actuation pose
        but not to the end, 0 where it does not get there or the planner gives up with an error.
    """
    lane = simulator(setting)
    lane.reset(seed)
    problems = SceneProblems(lane.scene_state(), lane.robot, lane.instance.object_axis)
    return [_screen(problems, config) for config in configs]


def _screen(problems: SceneProblems, config: Mapping[str, Any]) -> Screened:
    try:
        plan = kpam.plan(problems.problem(kpam.SolverConfig(config), SCREEN_OPTIONS))
    except MemoryError:
        raise
    except BaseException as error:
        # One candidate in hundreds ends no search, not even by a panic of the solver, which is no Exception.
        if not isinstance(error, Exception) and type(error).__module__ != "pyo3_runtime":
            raise
        return 0.0, f"planner error: {type(error).__name__}: {error}"
    if plan.status == "solved":
        return 1.0, None
    return 0.5 if _reaches_actuation(plan) else 0.0, plan.status


def _reaches_actuation(plan: kpam.Plan) -> bool:
    return plan.trajectory is not None and any(
        frame["label"] == "actuation" and frame["reached"] for frame in plan.keyframes
    )


def plan_episode(lane: Lane, config: Mapping[str, Any]) -> tuple[kpam.Plan, npt.NDArray[np.float32] | None]:
    """Plan on the scene as it stands; the actions are None where there is no trajectory."""
    solver_config = kpam.SolverConfig(config)
    problems = SceneProblems(lane.scene_state(), lane.robot, lane.instance.object_axis)
    plan = kpam.plan(problems.problem(solver_config, PLAN_OPTIONS))
    if plan.trajectory is None:
        return plan, None
    return plan, plan_actions(plan, solver_config.gripper, lane.robot)


def attempt(setting: Setting, config: Mapping[str, Any], seed: int) -> Attempt:
    """Run one episode in physics and, where it seems to succeed, the same seed with a still arm."""
    return _episode(setting, config, seed, record=False)[0]


def demonstrate(setting: Setting, config: Mapping[str, Any], seed: int) -> tuple[Attempt, Recording | None]:
    """Run one episode as ``attempt`` does and keep its states; the recording is None where it did not hold."""
    return _episode(setting, config, seed, record=True)


def _episode(setting: Setting, config: Mapping[str, Any], seed: int, record: bool) -> tuple[Attempt, Recording | None]:
    from gensim2.demos.rollout import run_episode

    lane = simulator(setting)
    lane.reset(seed)
    instance, start = lane.instance, lane.openness
    unplanned = Attempt(
        seed=seed,
        instance=instance.id,
        content_hash=instance.content_hash,
        success=False,
        still_success=None,
        openness_start=_number(start),
        openness_end=_number(start),
        steps=0,
        cause=None,
        plan_status="",
        plan_reason="",
    )
    try:
        plan, actions = plan_episode(lane, config)
    except kpam.KpamError as error:  # the config does not fit this object
        return replace(unplanned, cause="no plan: invalid problem", plan_reason=str(error)), None
    planned = replace(unplanned, plan_status=plan.status, plan_reason=plan.reason)
    if actions is None:
        return replace(planned, cause=f"no plan: {plan.status}"), None
    episode = run_episode(lane, actions, record=record)
    still = still_episode(setting, seed) if episode.success else None
    stable = episode.stable and (still is None or still.stable)
    success = episode.success and stable and still is not None and not still.success
    if not stable:
        cause: str | None = UNSTABLE
    else:
        moved_by_itself = still is not None and still.success
        cause = None if success else _cause(lane.task, plan, start, episode.openness_end, moved_by_itself)
    attempt = replace(
        planned,
        success=success,
        still_success=still.success if still is not None else None,
        openness_end=_number(episode.openness_end),
        steps=episode.steps,
        cause=cause,
    )
    return attempt, episode.recording if success else None


def _number(value: float) -> float | None:
    """None where physics left no number: JSON has neither NaN nor infinity."""
    return value if math.isfinite(value) else None


@lru_cache(maxsize=4096)
def still_episode(setting: Setting, seed: int) -> StillResult:
    """What the object of this seed does by itself."""
    from gensim2.demos.rollout import still_arm

    return still_arm(simulator(setting), seed)


def _cause(task: TaskSpec, plan: kpam.Plan, start: float, end: float, still: bool) -> str:
    """One phrase for why an episode did not count."""
    if still:
        return "the object moves by itself"
    if plan.status != "solved":
        return f"only part of the motion: {plan.status}"
    opening = task.success[0].type == "articulated_open"
    travelled = (end - start) if opening else (start - end)
    if travelled < -0.05:
        return "the object was pushed the wrong way"
    if travelled < 0.05:
        return "the object did not move"
    return "the object stopped short"
