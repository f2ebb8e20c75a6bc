"""What one simulator worker does: plan on a scene, run an episode, say what went wrong.

Functions here run in worker processes; their arguments and results are plain values that pickle.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

import gensim2_kpam as kpam
from gensim2.assets.types import Instance
from gensim2.errors import GenSim2Error
from gensim2.pipeline.records import Attempt
from gensim2.planning.actions import plan_actions
from gensim2.planning.problem import SceneProblems
from gensim2.tasks.spec import TaskSpec

if TYPE_CHECKING:
    from gensim2.demos.recording import Recording
    from gensim2.sim.env import GenSim2Env

#: Planner options of the pipeline: the longest part of a motion that can be done is taken; physics judges it.
PLAN_OPTIONS: Mapping[str, Any] = {"allow_partial": True}

#: For screening, where hundreds of candidates are planned and most cannot work: few poses, short searches. Measured on
#: closing real laptops: the same answers as with the planner's defaults, in a 30th of the time.
SCREEN_OPTIONS: Mapping[str, Any] = {**PLAN_OPTIONS, "harvest": 0, "candidates": 6, "samples": 200}


#: What planning says of a config on one scene: a score from 0 to 1, and what stood in the way of 1.
Screened = tuple[float, str | None]


@dataclass(frozen=True)
class Setting:
    """Which environment a job needs; ``task`` is the spec as JSON, ``assets`` a folder or ``"builtin"``."""

    task: str
    assets: str
    instances: str = "all"
    obs_mode: str = "none"


@lru_cache(maxsize=2)
def environment(setting: Setting) -> GenSim2Env:
    """Return the environment of a setting; the last two stay open, since jobs come task by task."""
    from gensim2.sim.env import make_env

    return make_env(
        TaskSpec.model_validate_json(setting.task),
        assets=setting.assets,
        instances=setting.instances,
        obs_mode=setting.obs_mode,
    )


def screen_scene(setting: Setting, seed: int, configs: Sequence[Mapping[str, Any]]) -> list[Screened]:
    """Plan every config on the scene of one seed.

    Returns:
        One (score, cause) a config: 1 and None where the plan is whole, 0.5 where the arm gets past the actuation pose
        but not to the end, 0 where it does not get there.
    """
    env = environment(setting)
    env.reset(seed=seed)
    problems = SceneProblems(env.scene_state(), _instance(env).object_axis)
    screened: list[Screened] = []
    for config in configs:
        plan = kpam.plan(problems.problem(kpam.SolverConfig(config), SCREEN_OPTIONS))
        if plan.status == "solved":
            screened.append((1.0, None))
        else:
            screened.append((0.5 if _reaches_actuation(plan) else 0.0, plan.status))
    return screened


def _reaches_actuation(plan: kpam.Plan) -> bool:
    return plan.trajectory is not None and any(
        frame["label"] == "actuation" and frame["reached"] for frame in plan.keyframes
    )


def plan_episode(env: GenSim2Env, config: Mapping[str, Any]) -> tuple[kpam.Plan, npt.NDArray[np.float32] | None]:
    """Plan on the scene as it stands; the actions are None where there is no trajectory."""
    solver_config = kpam.SolverConfig(config)
    problems = SceneProblems(env.scene_state(), _instance(env).object_axis)
    plan = kpam.plan(problems.problem(solver_config, PLAN_OPTIONS))
    if plan.trajectory is None:
        return plan, None
    return plan, plan_actions(plan, solver_config.gripper)


def attempt(setting: Setting, config: Mapping[str, Any], seed: int) -> Attempt:
    """Run one episode in physics and, where it seems to succeed, the same seed with a still arm."""
    return _episode(setting, config, seed, record=False)[0]


def demonstrate(setting: Setting, config: Mapping[str, Any], seed: int) -> tuple[Attempt, Recording | None]:
    """Run one episode as ``attempt`` does and keep its states; the recording is None where it did not hold."""
    return _episode(replace(setting, obs_mode="state"), config, seed, record=True)


def _episode(setting: Setting, config: Mapping[str, Any], seed: int, record: bool) -> tuple[Attempt, Recording | None]:
    from gensim2.demos.rollout import run_episode

    env = environment(setting)
    env.reset(seed=seed)
    instance, start = _instance(env).id, env.openness
    plan, actions = plan_episode(env, config)
    if actions is None:
        attempt = Attempt(
            seed=seed,
            instance=instance,
            success=False,
            still_success=None,
            openness_start=start,
            openness_end=start,
            steps=0,
            cause=f"no plan: {plan.status}",
            plan_status=plan.status,
            plan_reason=plan.reason,
        )
        return attempt, None
    episode = run_episode(env, actions, record=record)
    still = still_success(setting, seed) if episode.success else None
    success = episode.success and not still
    attempt = Attempt(
        seed=seed,
        instance=instance,
        success=success,
        still_success=still,
        openness_start=start,
        openness_end=episode.openness_end,
        steps=episode.steps,
        cause=None if success else _cause(env.task, plan, start, episode.openness_end, bool(still)),
        plan_status=plan.status,
        plan_reason=plan.reason,
    )
    return attempt, episode.recording if success else None


def failed(seed: int, error: Exception) -> Attempt:
    """The record of an episode that could not be run at all."""
    return Attempt(
        seed=seed,
        instance="",
        success=False,
        still_success=None,
        openness_start=0.0,
        openness_end=0.0,
        steps=0,
        cause=f"not run: {error}",
        plan_status="",
        plan_reason="",
    )


def _instance(env: GenSim2Env) -> Instance:
    if env.instance is None:
        raise GenSim2Error("the environment has not been reset yet")
    return env.instance


@lru_cache(maxsize=4096)
def still_success(setting: Setting, seed: int) -> bool:
    """Whether the task comes true on this seed although the arm stays still for a whole episode."""
    from gensim2.demos.rollout import still_arm

    env = environment(setting)
    return still_arm(env, seed).success


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
