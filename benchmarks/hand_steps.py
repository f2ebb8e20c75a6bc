"""Execute a plan as the original GenSim2 does: step by step, with one hand pose of the plan for each step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation, Slerp

import gensim2_kpam as kpam
from gensim2.planning.scene import Scene
from gensim2.planning.step_problems import StepProblems
from gensim2.planning.world import PlanningWorld
from gensim2.robots import OPEN, RobotProfile
from gensim2.rollout.controller import ACTUATION, PROPRIOCEPTIVE, Action, Event, PrivilegedObservation
from gensim2.rollout.record import START, PlanRecord, StepRecord
from gensim2.tasks.criteria import all_hold
from gensim2.tasks.spec import TaskSpec

Array = npt.NDArray[np.float64]

PLAN_SECONDS = 0.8
"""Time between the hand poses of two consecutive steps in the plan, s."""
STEP_SECONDS = 0.85
"""Simulated duration of one step, s; in the original, a step takes 0.81 to 0.9 s."""
MAX_STEPS = 50
"""Maximum number of hand steps in an episode."""
STRIDE = 0.1
"""Maximum joint motion (rad) between two points of a screw motion at which limits and collisions are checked."""
ARRIVED = 1e-4
"""Tolerance of the hand pose at the end of a screw motion, m and rad."""

PLAN_OPTIONS: kpam.Options = {
    "timing": "config",
    "frames": "original",
    "avoid_collisions": False,
    "allow_partial": False,
}
"""The original's planner ignores collisions, and uses other frames for motions (docs/reference/solver.md)."""


class HandStepsController:
    """Controller that plans a config once, at the start, and moves the hand along the plan in steps, with open fingers.

    The plan interpolates the joints linearly between keyframes, like the shortest trajectory of the original. If a
    keyframe cannot be reached, the hand moves directly to the actuation pose and stops there, as in the original. Each
    step is a screw motion of the hand from its current pose. If this motion would leave the joint limits or make the
    arm collide with itself, the arm does not move in this step. The episode ends when the goal is met at the end of a
    step, or after ``MAX_STEPS``.

    Args:
        task: single-step task.
        profile: profile of the robot.
        config: config of the keypoint solver, with the times of its keyframes.
        object_yaw: angle (rad) by which motions given as lists are rotated; None: the object's random yaw in the scene.
    """

    privileged = True
    observation_spec = PROPRIOCEPTIVE

    def __init__(
        self, task: TaskSpec, profile: RobotProfile, *, config: Mapping[str, Any], object_yaw: float | None = None
    ) -> None:
        self._task, self._profile, self._config, self._yaw = task, profile, dict(config), object_yaw
        self._step = task.steps[0]
        self._columns = list(profile.arm_columns)
        self._length = control_steps(profile)
        self._alone = kpam.Scene(profile.model)

    def reset(self, observation: PrivilegedObservation, seed: int = 0) -> None:
        """Plan the motion in the scene of ``observation``; ``seed`` is not used."""
        scene = observation.scene()
        plan = self._plan(scene)
        self._hand = None if plan is None else self._poses(scene.q, plan)
        self._status = ("invalid", self._reason) if plan is None else (plan.status, plan.reason)
        self._ran = 0
        self._events: list[Event] = []
        self._target = scene.q[self._columns]
        self._before = self._target

    def _plan(self, scene: Scene) -> kpam.Plan | None:
        self._reason = ""
        thing = scene.objects[self._step.object]
        if self._yaw is not None:
            thing = replace(thing, yaw=self._yaw)
            scene = replace(scene, objects={**scene.objects, thing.name: thing})
        limit = np.full(len(self._profile.model.joint_names), 100.0)
        options: kpam.Options = {
            **PLAN_OPTIONS,
            "velocity_limits": limit,
            "acceleration_limits": 10.0 * limit,
            "jerk_limits": 1000.0 * limit,
        }
        problems = StepProblems(self._profile, options, PlanningWorld(self._profile))
        try:
            config = kpam.SolverConfig(self._config)
            return kpam.plan(problems.posed(scene, self._step, config, "open", thing.name, {}))
        except kpam.ProblemError as error:
            self._reason = str(error)
            return None

    def _poses(self, q: Array, plan: kpam.Plan) -> tuple[Slerp, Array, Array] | None:
        """Return rotations, times (N,) and positions (N, 3) of the hand on the plan; None without an actuation pose."""
        model = self._profile.model
        if plan.trajectory is None:
            if plan.q_actuation is None:
                return None
            joints, times = np.array([q, plan.q_actuation]), np.array([0.0, self._config["actuation_time"]])
            hand = model.forward_kinematics(joints)
        else:
            corners = np.array([0.0, *(frame["time"] for frame in plan.keyframes)])
            positions = plan.trajectory.sample(corners)[0]
            before = np.arange(0.0, self._config["actuation_time"])
            after = np.arange(self._config["actuation_time"], corners[-1], 0.5)
            times = np.array([*before, *after, corners[-1]])
            hand = model.forward_kinematics(
                np.column_stack([np.interp(times, corners, column) for column in positions.T])
            )
        return Slerp(times, Rotation.from_matrix(hand[:, :3, :3])), times, hand[:, :3, 3]

    @property
    def turn(self) -> str:
        """Name of the task step that is executed now."""
        return self._step.name

    @property
    def history(self) -> list[StepRecord]:
        """Record of the task's only step, with its only plan."""
        plan = PlanRecord("original config", *self._status, 0, START, self._ran)
        return [StepRecord(self._step.name, [plan], paper=False, done=False)]

    @property
    def events(self) -> list[Event]:
        """Events so far: the hand has reached the actuation pose."""
        return list(self._events)

    def act(self, observation: PrivilegedObservation) -> Action | None:
        """Return the next action (m + 1,); None at the end of the episode, or without a plan."""
        if self._hand is None:
            return None
        count, within = divmod(self._ran, self._length)
        if within == 0:
            if count == MAX_STEPS or (count and all_hold(self._step.done, observation.measurement)):
                return None
            self._begin(observation, PLAN_SECONDS * (count + 1))
        self._ran += 1
        arm = 0.5 * (self._before + self._target) if within == 0 else self._target
        return np.append(arm, OPEN).astype(np.float32)

    def _begin(self, observation: PrivilegedObservation, time: float) -> None:
        assert self._hand is not None
        rotations, times, positions = self._hand
        if time > self._config["actuation_time"] + PLAN_SECONDS and not self._events:
            self._events.append(Event(observation.step, self._step.name, ACTUATION))
        at = min(time, float(times[-1]))
        pose = np.eye(4)
        pose[:3, :3] = rotations(at).as_matrix()
        pose[:3, 3] = [np.interp(at, times, column) for column in positions.T]
        q = observation.q
        found = self._screw(q, pose)
        self._before, self._target = q[self._columns], (q if found is None else found)[self._columns]

    def _screw(self, q: Array, pose: Array) -> Array | None:
        """Return joint positions (n,) with the hand at ``pose`` (4, 4), by following the Jacobian from ``q``.

        None if the motion leaves the joint limits, collides, or does not reach the pose.
        """
        model, columns = self._profile.model, self._columns
        q = q.copy()
        low, high = model.lower[columns], model.upper[columns]
        for _ in range(200):
            now = model.forward_kinematics(q)
            turn = Rotation.from_matrix(pose[:3, :3] @ now[:3, :3].T).as_rotvec()
            twist = np.concatenate([pose[:3, 3] - now[:3, 3], turn])
            if np.abs(twist).max() < ARRIVED:
                return q
            change = np.linalg.pinv(model.jacobian(q)[:, columns]) @ twist
            q[columns] += change * min(1.0, STRIDE / max(float(np.abs(change).max()), 1e-12))
            if (q[columns] < low).any() or (q[columns] > high).any() or self._alone.in_collision(q):
                return None
        return None


def control_steps(profile: RobotProfile) -> int:
    """Return the number of control steps in one step of the hand."""
    return profile.steps(STEP_SECONDS)
