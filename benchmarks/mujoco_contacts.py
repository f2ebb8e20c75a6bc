"""Calibrate the rolling friction of the engine ``mujoco`` against PhysX, by rolling balls and success rates of tasks.

    python benchmarks/mujoco_contacts.py [--episodes 10] [--tasks StoreLemonInRefrigerator SecureGoldInSafe]

First, a ball starts to roll without slipping, and the script prints the distance after 5 s in both engines. Then the
script runs each task with several rolling friction coefficients, and with several torsional friction coefficients of
all contacts. In MuJoCo these coefficients are lengths (m).
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from unittest.mock import patch

import numpy as np

from gensim2.core.seeding import scene_seeds
from gensim2.planning.strategies import parse_strategy
from gensim2.rollout.chain import ChainController
from gensim2.rollout.run import run
from gensim2.sim.headless import HeadlessEnv
from gensim2.sim.mujoco import model
from gensim2.sim.mujoco.model import build_model
from gensim2.tasks.library import load_strategies, load_task

BALLS = {"PlaceGolfBallIntoDrawer": "golf_ball", "PlaceSoftBallIntoDrawer": "softball", "PlaceLemonIntoDrawer": "lemon"}
SPEEDS = (0.05, 0.1, 0.2)
ROLLING = (0.0, 5e-4, 1e-3, 2e-3, 4e-3)
TORSION = (0.01, 0.1)


@contextmanager
def friction(rolling: float, torsion: float = 0.0) -> Iterator[None]:
    """Build MuJoCo models with other coefficients (m) of rolling and torsional friction in this context."""

    def build(*given: Any) -> Any:
        found = build_model(*given)
        if torsion:
            found.pair_dim[:] = np.maximum(found.pair_dim, 4)
            found.pair_friction[:, 2] = torsion * found.pair_friction[:, 0]
        return found

    with patch("gensim2.sim.mujoco.scene.build_model", build), patch("gensim2.sim.mujoco.model.ROLLING", rolling):
        yield


def rolled(task: str, asset_class: str, engine: str, speed: float) -> float:
    """Return the distance (m) that a ball rolls along x in 5 s."""
    env = HeadlessEnv(task, assets="builtin", engine=engine)
    env.reset(0, robot=False)
    name = next(name for name, spec in env.task.objects.items() if spec.asset_class == asset_class)
    for _ in range(20):
        env.wait()
    part: Any = env.parts[name]
    radius = part.pose[2]
    linear, angular = np.array([speed, 0.0, 0.0]), np.array([0.0, speed / radius, 0.0])
    if engine == "sapien":
        part.body.linear_velocity, part.body.angular_velocity = linear.astype("f4"), angular.astype("f4")
        part.body.wake_up()
    else:
        data, body, dof = part._simulation.data, part._body, part._v
        data.qvel[dof : dof + 3] = linear
        data.qvel[dof + 3 : dof + 6] = data.xmat[body].reshape(3, 3).T @ angular
    start = env.measure().poses[name][0]
    for _ in range(env.profile.steps(5.0)):
        env.wait()
    return float(env.measure().poses[name][0] - start)


def held(task_name: str, episodes: int) -> str:
    """Return the number of successful episodes of a task, and their CPU time, as text."""
    task = load_task(task_name)
    strategies = {name: parse_strategy(data, name) for name, data in load_strategies(task_name).items()}
    env = HeadlessEnv(task, assets="builtin", engine="mujoco")
    start, count = time.process_time(), 0
    for seed in scene_seeds(0, task.name, "benchmark", episodes):
        count += run(env, ChainController(task, strategies, env.profile), seed=seed).episode.held
    return f"{count}/{episodes} {(time.process_time() - start) / episodes:.2f} s"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=10)
    parser.add_argument("--tasks", nargs="*", default=["StoreLemonInRefrigerator", "SecureGoldInSafe", "TurnOnFaucet"])
    options = parser.parse_args()
    for task, asset_class in BALLS.items():
        for speed in SPEEDS:
            row = [f"sapien {rolled(task, asset_class, 'sapien', speed):.3f}"]
            for value in ROLLING:
                with friction(value):
                    row.append(f"{value:g}: {rolled(task, asset_class, 'mujoco', speed):.3f}")
            print(f"{asset_class} at {speed} m/s rolls", ", ".join(row), flush=True)
    for name in options.tasks:
        for rolling in ROLLING:
            with friction(rolling):
                print(name, f"rolling {rolling:g} m:", held(name, options.episodes), flush=True)
        for torsion in TORSION:
            with friction(model.ROLLING, torsion):
                print(name, f"torsion {torsion:g} m:", held(name, options.episodes), flush=True)


if __name__ == "__main__":
    main()
