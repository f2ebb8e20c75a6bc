"""Test in simulation whether the best-ranked grasp of each rigid object lifts and holds the object.

    python benchmarks/grasps.py [--robot panda] [--objects mug bowl] [--poses 20] [--seed 0] [--workers 2] [--json OUT]

Each object rests on the table at random positions and yaws within the robot's reach. The best-ranked grasp that can be
planned is executed: approach, close, lift by 15 cm. The grasp succeeds if the object's centre of mass stays at least 10
cm above its start for the next 2 s, and both fingers touch the object at the end.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import numpy.typing as npt
import sapien
from mani_skill.envs.sapien_env import BaseEnv
from mani_skill.utils.structs.types import SceneConfig, SimConfig
from scipy.stats import binomtest

import gensim2_kpam as kpam
from gensim2.core.processes import WorkerPool, enumerated
from gensim2.core.processes import results as run
from gensim2.core.seeding import rng
from gensim2.objects import RigidObject, open_library
from gensim2.objects.placement import STANDARD_REGION
from gensim2.robots import DEFAULT_ROBOT, RobotProfile, SlidingGripper, robot, robot_names
from gensim2.scenes.table import HALF_SIZE, corners
from gensim2.sim import agents
from gensim2.sim.arm import base_pose
from gensim2.sim.physics import RIGID_CONTACT_OFFSET
from gensim2.sim.rigid import build_table, load_rigid, resting_pose

Array = npt.NDArray[np.float64]

#: Ranges of random object positions: distance from the robot's base minus the comfortable distance (m), angle (rad).
DISTANCE, ANGLE = (-0.15, 0.1), (-0.6, 0.6)
LIFT, RAISED, HOLD_SECONDS = 0.15, 0.10, 2.0
SETTLE_STEPS = 4
#: Number of control steps to wait at the end of a motion, because the drives lag behind their targets.
ARRIVE_STEPS = 4
#: Speed of a closing finger, m/s.
FINGER_SPEED = 0.06


class LiftEnv(BaseEnv):  # type: ignore[misc]
    """A robot at the table with one rigid object; physics and control as in GenSim2Env."""

    SUPPORTED_REWARD_MODES = ("none",)

    def __init__(self, profile: RobotProfile, rigid: RigidObject, pose: sapien.Pose, **kwargs: Any) -> None:
        self.robot, self.rigid, self.start = profile, rigid, pose
        agents.register(profile)
        super().__init__(
            robot_uids=profile.agent,
            control_mode="pd_joint_pos",
            num_envs=1,
            sim_backend="physx_cpu",
            obs_mode="none",
            reward_mode="none",
            **kwargs,
        )

    @property
    def _default_sim_config(self) -> SimConfig:
        return SimConfig(
            sim_freq=self.robot.simulation.physics_hz,
            control_freq=self.robot.control_hz,
            scene_config=SceneConfig(
                enable_tgs=True,
                enable_pcm=True,
                solver_position_iterations=15,
                solver_velocity_iterations=1,
                contact_offset=RIGID_CONTACT_OFFSET,
            ),
        )

    def _load_agent(self, options: dict[str, Any], *args: Any, **kwargs: Any) -> None:
        super()._load_agent(options, base_pose(self.robot))

    def _load_scene(self, options: dict[str, Any]) -> None:
        build_table(self.scene, visible=False)
        self.object = load_rigid(self.scene, self.rigid, self.start)

    def _load_lighting(self, options: dict[str, Any]) -> None:
        pass

    def _initialize_episode(self, env_idx: Any, options: dict[str, Any]) -> None:
        self.agent.reset(np.array(self.robot.reset_qpos, dtype=np.float32))
        self.agent.robot.set_pose(base_pose(self.robot))

    def evaluate(self) -> dict[str, Any]:
        return {}

    @property
    def object_pose(self) -> Array:
        """Return the pose (4, 4) of the object in the world frame."""
        return np.asarray(self.object.pose.sp.to_transformation_matrix(), dtype=np.float64)

    def touching(self) -> tuple[bool, bool]:
        """Return, for each finger, whether it touches the object."""
        forces = [
            self.scene.get_pairwise_contact_forces(self.agent.robot.links_map[name], self.object).norm()
            for name in self.robot.gripper.pads
        ]
        return bool(forces[0] > 0), bool(forces[1] > 0)


@dataclass(frozen=True)
class Lift:
    """Result of lifting an object from one pose; ``cause`` is "held", or the cause of the failure."""

    name: str
    pose: int
    cause: str
    rank: int
    raised: float
    score: float
    quality: kpam.GraspQuality | None
    grasps: int
    search_ms: float
    plan_ms: float


def draw_pose(profile: RobotProfile, name: str, seed: int, episode: int) -> tuple[float, float, float]:
    """Sample the position x, y (world frame, m) and the yaw (rad) of an object."""
    random = rng(seed, f"grasps/{name}", episode)
    distance = STANDARD_REGION.comfortable + random.uniform(*DISTANCE)
    angle = random.uniform(*ANGLE)
    yaw = random.uniform(-np.pi, np.pi)
    return profile.base_position[0] + distance * np.cos(angle), distance * np.sin(angle), yaw


def lift(robot_name: str, name: str, seed: int, episode: int) -> dict[str, Any]:
    """Plan and execute a grasp of an object in its random pose number ``episode``."""
    return asdict(_lift(robot(robot_name), open_library("builtin").load_rigid(name), seed, episode))


def _lift(profile: RobotProfile, rigid: RigidObject, seed: int, episode: int) -> Lift:
    pose = resting_pose(rigid, *draw_pose(profile, rigid.asset_class, seed, episode))
    env = LiftEnv(profile, rigid, pose, render_backend="none")
    try:
        env.reset(seed=0)
        for _ in range(SETTLE_STEPS):
            env.step(profile.rest_action)
        T_base_world = np.linalg.inv(profile.T_world_base)
        gripper = kpam.ParallelGripper.of_robot(profile.model, **profile.tool_keypoints)
        shapes = [kpam.Shape.convex_hull(np.ascontiguousarray(hull)) for hull in rigid.hulls["body"]]
        body = kpam.Body(rigid.asset_class, "target", shapes, T_base_world @ env.object_pose)
        T_world_table = np.eye(4)
        T_world_table[2, 3] = -HALF_SIZE[2]
        table = kpam.Body("table", "table", [kpam.Shape.convex_hull(corners())], T_base_world @ T_world_table)
        # PhysX uses the mean of both friction coefficients.
        options: kpam.GraspOptions = {"friction": (profile.gripper.friction + rigid.friction) / 2}
        scene = kpam.Scene(profile.model, [table, body])
        began = time.process_time()
        grasps = scene.grasps(rigid.asset_class, gripper, center_of_mass=rigid.center_of_mass, options=options)
        searched = time.process_time()
        q = np.asarray(env.agent.robot.get_qpos()[0], dtype=np.float64).clip(profile.model.lower, profile.model.upper)
        found = scene.plan_grasp(rigid.asset_class, gripper, q, grasps, lift=[0, 0, LIFT])
        planned = time.process_time()
        times = {"search_ms": 1e3 * (searched - began), "plan_ms": 1e3 * (planned - searched)}
        if found is None:
            cause = "no motion to any grasp" if grasps else "no grasp"
            return Lift(rigid.asset_class, episode, cause, -1, 0.0, 0.0, None, len(grasps), **times)
        grasp = grasps[found.index]
        cause, raised = execute(env, found.pick, grasp.opening)
        return Lift(
            rigid.asset_class, episode, cause, found.index, raised, grasp.score, grasp.quality, len(grasps), **times
        )
    finally:
        env.close()


def press(profile: RobotProfile) -> float:
    """Return the position target (m) of a finger joint that makes the closed fingers press on the object."""
    assert isinstance(profile.gripper, SlidingGripper)
    return profile.gripper.closed


def execute(env: LiftEnv, plan: kpam.Plan, opening: float, watch: Any = None) -> tuple[str, float]:
    """Execute a grasp; return its result, and the minimum height (m) of the centre of mass while holding."""
    trajectory = plan.trajectory
    assert trajectory is not None
    profile, pressed = env.robot, press(env.robot)
    arm = trajectory.sample_every(1.0 / profile.control_hz)[:, : profile.arm_size]
    arrive = max(profile.lag_steps) + ARRIVE_STEPS
    time_of = {frame["label"]: frame["time"] for frame in plan.keyframes}
    grip = min(round((time_of["actuation"] or 0.0) * profile.control_hz), len(arm) - 1)
    center = env.rigid.center_of_mass

    def height() -> float:
        pose = env.object_pose
        return float(pose[2, :3] @ center + pose[2, 3])

    def go(targets: Array, fingers: float) -> None:
        for target in targets:
            env.step(np.array([*target, profile.gripper.command(2.0 * fingers)], dtype=np.float32))
            if watch is not None:
                watch()

    begin, before = height(), env.object_pose
    at_grasp, wide = arm[grip : grip + 1], opening / 2
    go(arm[: grip + 1], wide)
    go(np.repeat(at_grasp, arrive, axis=0), wide)
    moved = float(np.linalg.norm(env.object_pose[:3, 3] - before[:3, 3]))
    steps = int(np.ceil((wide - pressed) * profile.control_hz / FINGER_SPEED))
    for fingers in np.linspace(wide, pressed, steps):
        go(at_grasp, float(fingers))
    go(np.repeat(at_grasp, arrive, axis=0), pressed)
    gripped = all(env.touching())
    go(arm[grip:], pressed)
    go(np.repeat(arm[-1:], arrive, axis=0), pressed)
    raised = height() - begin
    lifted = raised >= RAISED
    for _ in range(round(HOLD_SECONDS * profile.control_hz)):
        go(arm[-1:], pressed)
        raised = min(raised, height() - begin)
    if raised >= RAISED and all(env.touching()):
        return "held", raised
    if moved > 0.005:
        return "pushed on the way", raised
    if not gripped:
        return "missed", raised
    return ("lost while held" if lifted else "not lifted"), raised


def interval(count: int, total: int) -> str:
    """Return a rate with its 95 % Wilson interval, as text."""
    low, high = binomtest(count, total).proportion_ci(method="wilson")
    return f"{count / total:.3f} ({low:.3f} to {high:.3f})"


def report(results: list[dict[str, Any]]) -> None:
    """Print the table of results."""
    print("| object | held | what went wrong | grasps | rank taken |\n|---|---|---|---|---|")
    for name in dict.fromkeys(r["name"] for r in results):
        mine = [r for r in results if r["name"] == name]
        causes = Counter(r["cause"] for r in mine if r["cause"] != "held")
        wrong = ", ".join(f"{n} {cause}" for cause, n in causes.most_common())
        held = sum(r["cause"] == "held" for r in mine)
        grasps, rank = median(r["grasps"] for r in mine), median(r["rank"] for r in mine)
        print(f"| {name} | {held}/{len(mine)} | {wrong} | {grasps:.0f} | {rank:.0f} |")
    held = sum(r["cause"] == "held" for r in results)
    print(f"\nheld: {held} of {len(results)}, {interval(held, len(results))}")
    causes = Counter(r["cause"] for r in results if r["cause"] != "held")
    print("causes:", ", ".join(f"{n} {cause}" for cause, n in causes.most_common()) or "none")
    search, plan = (sorted(r[key] for r in results) for key in ("search_ms", "plan_ms"))
    count = sum(r["grasps"] for r in results)
    print(
        f"search: median {median(search):.1f} ms, 95th percentile {search[int(0.95 * len(search))]:.1f} ms, "
        f"{count / sum(search):.1f} grasps a ms; plan: median {median(plan):.1f} ms"
    )


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return 1 if the success rate is below 0.9."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robot", choices=robot_names(), default=DEFAULT_ROBOT)
    parser.add_argument("--objects", nargs="*", default=list(open_library("builtin").classes("rigid")))
    parser.add_argument("--poses", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args(arguments)
    jobs = [(options.robot, name, options.seed, pose) for pose in range(options.poses) for name in options.objects]
    with WorkerPool(options.workers) as pool:
        found = {}
        for index, result in run(pool.map_unordered(lift, enumerated(jobs)), "episodes"):
            found[index] = result
            print(f"{len(found)} of {len(jobs)}: {result['name']} {result['cause']}", file=sys.stderr)
    results = [found[index] for index in sorted(found)]
    report(results)
    if options.json:
        options.json.write_text(json.dumps(results, indent=1))
    return 0 if sum(r["cause"] == "held" for r in results) >= 0.9 * len(results) else 1


if __name__ == "__main__":
    sys.exit(main())
