"""Time from a look to the motion of a keypose policy, the planner included."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch

from gensim2.errors import InputError
from gensim2.policy.checkpoint import PolicyCheckpoint
from gensim2.policy.keypose.controller import KeyposeController
from gensim2.progress import NULL_PROGRESS, Progress
from gensim2.seeding import scene_seeds
from gensim2.sim import HeadlessEnv
from gensim2.tasks.library import load_task, task_names

STAGES = ("observation", "decision", "total")


def measure_looks(
    checkpoint: Path,
    *,
    looks: int = 100,
    threads: int = 1,
    assets: str | None = None,
    progress: Progress = NULL_PROGRESS,
) -> dict[str, Any]:
    """Measure the looks of a keypose policy in episodes of the tasks whose sentences it knows, one after the other.

    Args:
        checkpoint: folder of the policy.
        looks: to measure, after two that are not.
        threads: of PyTorch.
        assets: objects of the scenes.

    Returns:
        ``rows``: milliseconds by stage (``observation``: rays, cloud, proprioception; ``decision``: network and
        planner), ``p50``, ``p95`` of wall time and ``cpu`` on median; ``looks``, ``threads``, ``load`` of the machine
        when it began.

    Raises:
        InputError: the checkpoint is none of keyposes, or of no task of the library.
    """
    load = os.getloadavg()[0]
    controller = KeyposeController(str(checkpoint))
    known = PolicyCheckpoint.load(checkpoint).sentences
    tasks = [task for name in task_names() if (task := load_task(name)).description in known]
    if not tasks:
        raise InputError("knows the sentence of no task of the library", file=checkpoint)
    progress.start("looks", looks)
    wall: list[list[float]] = []
    spent: list[list[float]] = []
    number = 0
    while len(wall) < looks + 2:
        task = tasks[number % len(tasks)]
        env = HeadlessEnv(task, assets=assets, instances="all")
        (seed,) = scene_seeds(0, task.name, "latency", 1, start=number)
        number += 1
        env.reset(seed)
        controller.reset(env.observe(controller.observation_spec), seed)
        torch.set_num_threads(threads)
        for _ in range(env.max_episode_steps):
            before, begun = controller.told["looks"], (time.perf_counter(), time.process_time())
            observation = env.observe(controller.observation_spec)
            seen = (time.perf_counter(), time.process_time())
            action = controller.act(observation)
            acted = (time.perf_counter(), time.process_time())
            if controller.told["looks"] > before:
                wall.append([seen[0] - begun[0], acted[0] - seen[0], acted[0] - begun[0]])
                spent.append([seen[1] - begun[1], acted[1] - seen[1], acted[1] - begun[1]])
                progress.advance()
            if action is None or len(wall) == looks + 2:
                break
            env.step(action)

    def told(values: Any) -> dict[str, float]:
        return {name: round(1e3 * float(value), 3) for name, value in zip(STAGES, values, strict=True)}

    row = {
        "tasks": [task.name for task in tasks],
        "p50": told(np.percentile(wall[2:], 50, axis=0)),
        "p95": told(np.percentile(wall[2:], 95, axis=0)),
        "cpu": told(np.percentile(spent[2:], 50, axis=0)),
    }
    return {"schema_version": 1, "rows": [row], "threads": threads, "looks": looks, "load": load}
