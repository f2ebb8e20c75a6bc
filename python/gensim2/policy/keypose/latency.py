"""Measure how long a keypose policy takes from an observation to the start of the motion, including planning."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import torch

from gensim2.core.errors import InputError
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.core.seeding import scene_seeds
from gensim2.policy.checkpoint import checkpoint_folder
from gensim2.policy.evaluating import KEYPOSE
from gensim2.policy.keypose.controller import KeyposeController
from gensim2.policy.latency import Stopwatch
from gensim2.rollout.controller_spec import ControllerSpec
from gensim2.sim import HeadlessEnv
from gensim2.tasks.library import load_task, task_names

WARM_UP = 2
"""Number of predictions before the measurement starts."""


def measure_looks(
    checkpoint: Path | str,
    *,
    looks: int = 100,
    threads: int = 1,
    assets: str | None = None,
    progress: Progress = NULL_PROGRESS,
) -> dict[str, Any]:
    """Measure how long a keypose policy takes for a prediction, in episodes of the tasks that it was trained on.

    Args:
        checkpoint: folder of the policy.
        looks: number of measured predictions. Before them, ``WARM_UP`` predictions run without measurement.
        threads: number of PyTorch threads.
        assets: folder of the scenes' objects, or the name of a built-in set.
        progress: progress display.

    Returns:
        A dictionary with the measured times under ``rows``, the arguments ``looks`` and ``threads``, and the machine's
        load average at the start under ``load``. A row contains the percentiles ``p50`` and ``p95`` of the wall time
        and the median CPU time ``cpu``, all in ms, for each stage. In the stage ``observation`` the cameras are
        simulated and the point cloud is computed; in the stage ``decision`` the network predicts, the goal is judged
        and the motion is planned.

    Raises:
        InputError: the checkpoint is not a keypose policy, or was trained on no task of the library.
    """
    load = os.getloadavg()[0]
    folder = checkpoint_folder(checkpoint).resolve()
    controller = ControllerSpec(KEYPOSE, {"checkpoint": str(folder)}).make()
    assert isinstance(controller, KeyposeController)
    tasks = [task for name in task_names() if (task := load_task(name)).description in controller.sentences]
    if not tasks:
        raise InputError(
            "the task library contains no task on which the policy was trained; the training instructions are "
            f"{', '.join(map(repr, controller.sentences))}",
            file=folder,
            remedy="add a training task with gensim2 tasks add FOLDER, or select another library with --library DIR",
        )
    progress.start("looks", looks + WARM_UP)
    environments = [HeadlessEnv(task, assets=assets, robot=controller.robot) for task in tasks]
    watch = Stopwatch("observation", "decision")
    episode = 0
    while True:
        env = environments[episode % len(environments)]
        (seed,) = scene_seeds(0, env.task.name, "latency", 1, start=episode)
        episode += 1
        env.reset(seed)
        controller.reset(env.observe(controller.observation_spec), seed)
        torch.set_num_threads(threads)
        for _ in range(env.max_episode_steps):
            before = controller.told["looks"]
            watch.begin()
            observation = env.observe(controller.observation_spec)
            watch.mark()
            action = controller.act(observation)
            watch.mark()
            if controller.told["looks"] > before:
                watch.keep()
                progress.advance()
            if len(watch) == looks + WARM_UP:
                row = {"tasks": [task.name for task in tasks], **watch.percentiles(WARM_UP)}
                return {"schema_version": 1, "rows": [row], "threads": threads, "looks": looks, "load": load}
            if action is None:
                break
            env.step(action)
