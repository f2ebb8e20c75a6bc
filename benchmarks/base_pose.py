"""From which base pose does a robot's planner find the whole motion of the single-step tasks?

    python benchmarks/base_pose.py --robot examples/robots/iiwa14.py --x -0.7 -0.65 -0.6 [--z 0.0] [--scenes 8]
                                   [--tasks OpenLaptop] [--seed 7000]

Every base pose gets the same scenes: generated objects that are not listed, placed as for the Panda. Nothing is
simulated, and the arm starts at ``reset_qpos``. Measure success rates with other seeds than those of this choice.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

import gensim2
from gensim2.planning.scene import Scene, SceneBody, SceneObject
from gensim2.planning.steps import StepPlanner
from gensim2.robots import RobotProfile
from gensim2.rollout.worker import parsed
from gensim2.sim.headless import HeadlessEnv
from gensim2.tasks.library import load_strategies, load_task, task_names


def single_step_tasks() -> list[str]:
    """Return the names of the paper's tasks that have one step and one object."""
    tasks = map(load_task, task_names("paper"))
    return [task.name for task in tasks if len(task.steps) == len(task.objects) == 1]


def seen_from(scene: Scene, profile: RobotProfile) -> Scene:
    """Return a scene with another robot at its start pose."""
    move = np.linalg.inv(profile.T_world_base) @ scene.T_world_base
    turn, shift = move[:3, :3], move[:3, 3]

    def body(each: SceneBody) -> SceneBody:
        return replace(each, T_base_body=move @ each.T_base_body)

    def thing(each: SceneObject) -> SceneObject:
        joint = each.joint
        if joint is not None:
            joint = replace(joint, origin=turn @ joint.origin + shift, axis=turn @ joint.axis)
        return replace(
            each,
            bodies=tuple(map(body, each.bodies)),
            T_base_object=move @ each.T_base_object,
            keypoints={name: turn @ at + shift for name, at in each.keypoints.items()},
            joint=joint,
        )

    q = np.array(profile.reset_qpos)
    return replace(
        scene,
        q=q,
        qvel=np.zeros_like(q),
        T_world_base=profile.T_world_base,
        objects={name: thing(each) for name, each in scene.objects.items()},
        fixtures=tuple(map(body, scene.fixtures)),
    )


def is_planned(task: str, scene: Scene, profile: RobotProfile) -> bool:
    """Return whether one of the task's strategies has a whole motion in a scene."""
    planner, step, strategies = StepPlanner(profile), load_task(task).steps[0], parsed(load_strategies(task))
    return any(planner.plan(scene, step, strategies[name]).is_solved for name in step.strategies)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robot", required=True)
    parser.add_argument("--x", type=float, nargs="+", required=True, help="base positions, m")
    parser.add_argument("--z", type=float, nargs="+", help="heights of the base, m; default: the height of the profile")
    parser.add_argument("--tasks", nargs="+", default=single_step_tasks())
    parser.add_argument("--scenes", type=int, default=8, help="scenes of each task")
    parser.add_argument("--seed", type=int, default=7000)
    options = parser.parse_args(arguments)
    name = gensim2.load_robot(options.robot) if options.robot.endswith(".py") else options.robot
    profile = gensim2.robot(name)
    scenes: list[tuple[str, Scene]] = []
    for task in options.tasks:
        env = HeadlessEnv(task, assets="builtin", instances="new", engine="mujoco")
        for number in range(options.scenes):
            env.reset(options.seed + number)
            scenes.append((task, env.scene_state()))
    for z in options.z or [profile.base_position[2]]:
        for x in options.x:
            placed = replace(profile, base_position=(x, profile.base_position[1], z))
            failed = Counter(task for task, scene in scenes if not is_planned(task, seen_from(scene, placed), placed))
            missed = ", ".join(f"{task} {count}" for task, count in failed.most_common())
            print(f"x {x:g} m, z {z:g} m: {len(scenes) - failed.total()} of {len(scenes)} planned; failed: {missed}")


if __name__ == "__main__":
    main()
