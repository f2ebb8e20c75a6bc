"""One plan, executed as the original executes it: hand poses 0.8 s of the plan's clock apart, one every 0.85 s."""

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
"""Of the plan's clock, that one step of the hand goes on."""
STEP_SECONDS = 0.85
"""Of physics, that one step takes; the original's take 0.81 to 0.9."""
MAX_STEPS = 50
"""Steps after which an episode ends."""
STRIDE = 0.1
"""Most rad that a joint goes between two points of a screw motion at which limits and self collision are checked."""
ARRIVED = 1e-4
"""m and rad within which a screw motion has arrived."""

PLAN_OPTIONS: kpam.Options = {
    "timing": "config",
    "frames": "original",
    "avoid_collisions": False,
    "allow_partial": False,
}
"""The original's plans know of no collisions; its motions are in frames of its own (docs/reference/solver.md)."""


class HandStepsController:
    """Plans a config once, at the start, and steps the hand along the plan, fingers open.

    The joints go straight from keyframe to keyframe, which is the original's shortest trajectory. Where one of them
    cannot be had, the hand goes straight to the actuation pose and no further, as there. Each step is a screw motion of
    the hand from where it is; where that leaves the joint limits or the arm would touch itself, the arm stays where it
    is. The episode ends after a step at whose end the goal holds, or after ``MAX_STEPS``.

    Args:
        task: one of one step.
        profile: the robot.
        config: config of the keypoint solver, with the times of its keyframes.
        object_yaw: rad by which list-type motions are turned; None: what the scene drew.
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
        """Plan; nothing is drawn."""
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
        """Rotations, times (N,) and positions (N, 3) of the hand along the plan; None where there is no pose at all."""
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
        """Name of the step whose turn it is."""
        return self._step.name

    @property
    def history(self) -> list[StepRecord]:
        """The one step, with its one plan."""
        plan = PlanRecord("original config", *self._status, 0, START, self._ran)
        return [StepRecord(self._step.name, [plan], paper=False, done=False)]

    @property
    def events(self) -> list[Event]:
        """The hand at the actuation pose."""
        return list(self._events)

    def act(self, observation: PrivilegedObservation) -> Action | None:
        """The next action, (m + 1,); None: done, or there is no plan."""
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
        """(n,) joints with the hand at ``pose`` (4, 4), along its Jacobian; None where it does not come there."""
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
    """Control steps in one step of the hand."""
    return profile.steps(STEP_SECONDS)
