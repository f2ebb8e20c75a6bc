"""Control a robot with a planner that does not know the true scene: the scene is estimated from point clouds and the
robot's state.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from gensim2.perception import Observation, ObservationSpec
from gensim2.perception.estimation.estimator import (
    BUILTIN,
    ESTIMATOR_JSON,
    SceneEstimate,
    SceneEstimator,
    estimator_folder,
)
from gensim2.perception.estimation.examples import SETTINGS
from gensim2.perception.estimation.goal import DENSE, GoalTracker
from gensim2.perception.noise import read_noise
from gensim2.planning.scene import Scene
from gensim2.planning.strategies import Strategy, centered
from gensim2.robots import DEFAULT_ROBOT, robot
from gensim2.robots.force import BEHIND, PRESSING, Yielding
from gensim2.rollout.chain import NOT_DONE, WAIT_SECONDS, ChainController
from gensim2.rollout.chain_state import ChainPlan
from gensim2.rollout.controller import PROPRIOCEPTIVE, Action, Event, PrivilegedObservation, Reference
from gensim2.rollout.record import Cause, StepRecord
from gensim2.rollout.retreat import Retreat
from gensim2.rollout.watch import Held
from gensim2.scenes.arguments import as_task
from gensim2.tasks.library import load_strategies
from gensim2.tasks.measurement import Measurement
from gensim2.tasks.spec import Step, TaskSpec

SLACK = 0.03
"""Maximum excess (m) of the distance of an object from its goal if the controller leaves the object there."""
BLOCKED_SECONDS = 0.25
"""Time (s) for which an obstacle must block the arm on its way to the object before the motion ends."""
PRESSED_SECONDS = 0.25
"""Time (s) for which an object that moves as a whole must block the arm before the motion ends. If the arm went on, the
hand would slip over the object."""
MAX_CHECKS = 2
"""Maximum number of times that the controller continues after it has observed the scene from the retreated posture."""
MAX_FRESH_STARTS = 2
"""Maximum number of times that the controller looks again if no strategy has brought the hand to the object."""


class _Chain(ChainController):
    """Controller that plans the steps of a task on an estimated scene. It observes the scene only between motions, so
    it cannot detect during a motion that the object deviates from the plan.
    """

    is_pressed: bool
    """Whether the object has blocked the arm in the latest motion, although the arm pressed on it with the largest
    permitted force."""
    slides_on_table: bool
    """Whether the object of the current step moves along the table as a whole."""

    @property
    def waited(self) -> int:
        """Number of control steps since the last motion ended."""
        return self._waited

    @property
    def motions(self) -> int:
        """Number of motions of which at least a part was executed."""
        return sum(plan.ran > 0 for turn in self._turns for plan in turn.plans)

    @property
    def has_touched(self) -> bool:
        """Whether a motion of the current step has brought the hand to the object."""
        plans = [(plan.ran, plan.planned.schedule) for plan in self._turns[-1].plans] if self._turns else []
        return any(schedule is not None and ran > schedule.contact for ran, schedule in plans)

    @property
    def is_moving(self) -> bool:
        """Whether a motion is under way."""
        run = self._running
        return self._retreat is not None or (run is not None and not run.is_over)

    def reset(self, observation: PrivilegedObservation, seed: int = 0) -> None:
        super().reset(observation, seed)
        self.is_finished = False
        self.is_pressed = self.slides_on_table = False
        self.left: set[str] = set()
        self._grasped: set[str] = set()
        self._blocked = 0
        self._force = Yielding(self._profile, PRESSING)

    def resume(self, last: Action, *, from_start: bool = False) -> None:
        """Plan again after the controller has already ended the episode. Call this method if a new estimate of the
        scene shows that the goal is not reached.

        Args:
            last: latest action of the controller. The controller repeats this action until the new motion begins.
            from_start: whether to repeat all steps of the task instead of the last step.
        """
        self.is_finished, self._retreat, self._trigger, self._last = False, None, NOT_DONE, last
        if self._turns:
            self._turns[-1].tries.clear()
        if from_start:
            self._at, self._running, self._waited = 0, None, 0

    @property
    def grasped(self) -> Held | None:
        """Object in the hand, with its pose in the hand frame; None if the hand is empty."""
        return self._held

    @property
    def step(self) -> Step:
        """Current step."""
        return self._step

    def _begin(self, observation: PrivilegedObservation) -> bool:
        self._blocked = 0
        return super()._begin(observation)

    def _variants(self, strategy: Strategy, scene: Scene) -> Sequence[Strategy]:
        """A grasped object is placed near the middle of the strategy's tolerance if possible, because the estimated
        goal has an error.
        """
        middle = strategy if scene.held is None else centered(strategy)
        return (strategy,) if middle is strategy else (middle, strategy)

    def _leave(self, observation: PrivilegedObservation, run: ChainPlan) -> Action | None:
        self.is_finished, self._blocked = True, 0
        return super()._leave(observation, run)

    def _leaves_placed(self, measured: Measurement) -> bool:
        """Leave an object that the hand has put into a container and cannot grasp again, if its goal is within the
        error of the estimates. For example, the lid can be closed over it.
        """
        name = self._step.object
        is_inside = any(name in contents for contents in measured.contents.values())
        if name not in self._grasped or not is_inside or not self._skip_placement(measured, SLACK):
            return False
        self.left.add(name)
        return True

    def _check_grasp(self, observation: PrivilegedObservation, run: ChainPlan) -> Cause | None:
        found = super()._check_grasp(observation, run)
        if self._held is not None:
            self._grasped.add(self._held.name)
        return found

    def _follow(self, run: ChainPlan, observation: PrivilegedObservation) -> Action:
        schedule = run.planned.schedule
        assert schedule is not None
        is_free = run.ran < schedule.contact
        targets, is_behind = self._yielding(observation, run.actions[run.ran][:-1], is_free)
        is_blocked = is_behind and self._is_blocked(observation, targets)
        self.is_pressed = self.is_pressed or (is_blocked and not is_free)
        if is_blocked and is_free and self._blocked >= self._profile.steps(BLOCKED_SECONDS):
            run.is_stopped, self._blocked = True, 0
            self._notice(observation, Cause.FORCE_LIMIT)
            return self._with_last_command(observation.q[list(self._profile.arm_columns)])
        if is_blocked and self.slides_on_table and self._blocked >= self._profile.steps(PRESSED_SECONDS):
            run.is_stopped, self._blocked = True, 0
            return self._with_last_command(observation.q[list(self._profile.arm_columns)])
        if is_behind and (is_free or not is_blocked):
            # The arm still moves towards the targets of this control step.
            return self._with_last_command(targets)
        # If the arm is blocked at the object, the joint is at the end of its range, or the object resists. The plan
        # goes on, and leads away from the object.
        return np.append(targets, super()._follow(run, observation)[-1]).astype(np.float32)

    def _follow_retreat(self, observation: PrivilegedObservation, retreat: Retreat) -> Action | None:
        if retreat.is_over or self._last is None:
            return None
        targets, is_behind = self._yielding(observation, retreat.targets[retreat.ran], is_free=True)
        if not is_behind:
            super()._follow_retreat(observation, retreat)
        elif self._is_blocked(observation, targets) and self._blocked >= self._profile.steps(BLOCKED_SECONDS):
            retreat.ran = len(retreat.targets)
        return self._with_last_command(targets)

    def _yielding(
        self, observation: PrivilegedObservation, asked: npt.NDArray[np.float32], is_free: bool
    ) -> tuple[npt.NDArray[np.float64], bool]:
        """Return arm targets (m,) that keep the force limit, and whether the tool is too far behind the requested
        targets (m,) for the plan to go on.
        """
        targets, short = self._force.targets(observation.q, observation.qvel, asked.astype(np.float64), is_free=is_free)
        if short <= BEHIND:
            self._blocked = 0
        return targets, short > BEHIND

    def _with_last_command(self, targets: npt.NDArray[np.float64]) -> Action:
        return np.append(targets, 1.0 if self._last is None else self._last[-1]).astype(np.float32)

    def _is_blocked(self, observation: PrivilegedObservation, targets: npt.NDArray[np.float64]) -> bool:
        """Return whether an obstacle stops the arm although it presses with the largest permitted force."""
        if not self._force.is_blocked(observation.q, observation.qvel, targets):
            self._blocked = 0
            return False
        self._blocked += 1
        return True

    def _look(self, observation: PrivilegedObservation, run: ChainPlan) -> Cause | None:
        # Only the fingers are observed during a motion, and only they show whether a grasped object is lost.
        return self._check_grasp(observation, run) if observation.measurement.poses else None


class PerceivingChain:
    """Controller that estimates the scene from a point cloud, plans each step of a task in the estimated scene, and
    estimates the scene again after each motion.

    A step counts as done when the estimate shows that its goal is reached. The openness is tracked over the motions of
    an episode (:mod:`~gensim2.perception.estimation.tracking`). After the last step the hand retreats, and the
    controller estimates the scene once more. If the goal is not reached, the controller repeats the last step, or all
    steps if an object is not at its goal that the last step does not move. If the first point cloud does not show all
    objects of the task, the episode ends without an action, and the controller reports an event with
    :attr:`Cause.OBJECT_NOT_SEEN`.

    The arm presses with a limited force (:mod:`~gensim2.robots.force`). If an obstacle blocks the arm on its way to the
    object, the motion ends, the controller reports an event with :attr:`Cause.FORCE_LIMIT`, estimates the scene again,
    and plans again.

    A grasped object moves with the hand. The joint positions of the fingers show whether the hand has missed or lost
    the object. After the release, the next point cloud shows where the object lies.

    Args:
        task: the task, the name of a library task, or the fields of a task.
        estimator: folder of the estimator, as written by ``gensim2 perceive train``; ``"builtin"`` is the estimator
            of the package.
        strategies: strategies by name, as plain data; None: the strategies that the task library has for a task of this
            name.
        robot_name: name of the robot.
        noise: noise that is added to simulated depth images: a name or file that
            :func:`~gensim2.perception.noise.read_noise` accepts. None: exact images.
        threads: number of PyTorch threads.

    Raises:
        InputError: the estimator cannot be read or does not know a class of the task.
    """

    @staticmethod
    def depends_on(estimator: str = BUILTIN, noise: str | None = None, **_: object) -> list[Path]:
        """Return the files on which the controller's behaviour depends: the estimator's file, which contains the
        SHA-256 of the weights, and the file with the noise settings if ``noise`` names one.
        """
        files = [estimator_folder(estimator) / ESTIMATOR_JSON]
        return files if noise is None or not Path(noise).is_file() else [*files, Path(noise)]

    def __init__(
        self,
        task: str | Mapping[str, Any] | TaskSpec,
        estimator: str = BUILTIN,
        strategies: Mapping[str, Mapping[str, Any]] | None = None,
        robot_name: str = DEFAULT_ROBOT,
        noise: str | None = None,
        threads: int = 1,
    ) -> None:
        self._task = as_task(task)
        self._profile, self._threads = robot(robot_name), threads
        classes = {name: each.asset_class for name, each in self._task.objects.items()}
        places = {name: each.place.on for name, each in self._task.objects.items()}
        self._goal = GoalTracker(SceneEstimator.load(estimator, self._profile), classes, self._task.success, places)
        ways = load_strategies(self._task.name) if strategies is None else strategies
        self._chain = _Chain(self._task, ways, self._profile)
        settings = DENSE
        if noise is not None:
            # Only noise causes stray points and lifts points of the table. Without noise, the filter of outliers would
            # only drop small objects.
            low = (*settings.low[:2], SETTINGS.low[2])
            settings = replace(settings, noise=read_noise(noise), outliers=SETTINGS.outliers, low=low)
        self._spec = ObservationSpec(cloud=settings)
        self._checks_goal, self._checked, self._fresh_starts = False, 0, 0
        self._step = self._task.steps[0]
        self._last: Action | None = None
        self._refusal: Event | None = None

    @property
    def looks(self) -> list[SceneEstimate]:
        """Estimates of the scene in the episode so far, oldest first."""
        return self._goal.looks

    @property
    def observation_spec(self) -> ObservationSpec:
        """Contents that the controller needs in the next observation. Before the controller plans a step, and after
        each motion, it needs a point cloud from the cameras. At other times it needs only the robot's state.
        """
        if self._checks_goal or not self._goal.is_seen:
            return self._spec
        waits = 0 < self._chain.waited < self._profile.steps(WAIT_SECONDS)
        return PROPRIOCEPTIVE if self._chain.is_moving or waits else self._spec

    @property
    def reference(self) -> Reference | None:
        """Planned state of the joints and the gripper after the latest action; None until a point cloud has shown the
        objects of the task.
        """
        return self._chain.reference if self._goal.is_seen else None

    @property
    def turn(self) -> str | None:
        """Name of the current step."""
        return self._chain.turn if self._goal.is_seen else None

    @property
    def history(self) -> list[StepRecord]:
        """Records of the steps that the controller has begun. If the first point cloud does not show the object, the
        list contains only one record without plans.
        """
        if self._refusal is not None:
            return [StepRecord(self._refusal.step, [], paper=False, done=False)]
        return self._chain.history if self._goal.is_seen else []

    @property
    def events(self) -> Sequence[Event]:
        """Events of the episode so far, oldest first."""
        if self._refusal is not None:
            return [self._refusal]
        return self._chain.events if self._goal.is_seen else []

    @property
    def plans(self) -> list[Any]:
        """All plans so far, each with the scene for which the plan was made."""
        return self._chain.plans if self._goal.is_seen else []

    def reset(self, observation: Observation, seed: int = 0) -> None:
        """Start an episode."""
        torch.set_num_threads(self._threads)
        self._goal.reset()
        self._checks_goal, self._checked, self._fresh_starts = False, 0, 0
        self._last, self._refusal = None, None
        self._seed = seed
        # The first observation has no cloud if its contents were requested during the previous episode. In this case
        # ``act`` makes the first estimate from the next observation.
        if observation.cloud is not None:
            self._begin(observation)

    def act(self, observation: Observation) -> Action | None:
        """Return the next action; None if the task is done, if all plans have failed, or if the first point cloud does
        not show the object.
        """
        if not self.looks:
            self._begin(observation)
        elif self._goal.is_seen:
            self._follow_hand(observation)
            if observation.step > 0 and observation.cloud is not None:
                self._take_in(observation)
        if not self._goal.is_seen:
            return None
        if self._checks_goal:
            assert self._last is not None
            self._checks_goal = False
            q = observation.joint_positions.astype(np.float64)
            if self._goal.is_reached(q, distrust=0.0):
                return None
            self._chain.resume(self._last, from_start=self._goal.is_displaced(q))
        self._chain.slides_on_table = self._goal.slides_on_table(self._step.object)
        action = self._chain.act(self._with_belief(observation))
        if self._step is not self._chain.step:
            self._begin_step(observation)
        if self._chain.motions > self._goal.motions:
            self._goal.begin_motion()
            self._chain.is_pressed = False
        if action is None and self._chain.is_finished and self._last is not None:
            if self._checked == MAX_CHECKS:
                return None
            self._checks_goal, self._checked = True, self._checked + 1
            return self._last
        has_failed = action is None and not self._chain.is_finished
        if has_failed and not self._chain.has_touched and self._fresh_starts < MAX_FRESH_STARTS:
            # The next point cloud has other errors, with which a plan may exist.
            self._fresh_starts += 1
            arm = observation.joint_positions[list(self._profile.arm_columns)]
            action = np.append(arm, 1.0).astype(np.float32) if self._last is None else self._last
            self._chain.resume(action)
        self._last = action
        return action

    def _begin(self, observation: Observation) -> None:
        """Estimate the scene for the first time in an episode."""
        self._take_in(observation)
        if self._goal.is_seen:
            self._chain.reset(self._with_belief(observation), self._seed)
            self._begin_step(observation)

    def _begin_step(self, observation: Observation) -> None:
        self._step = self._chain.step
        if len(self._task.steps) > 1:
            q = observation.joint_positions.astype(np.float64)
            self._goal.begin_step(self._step.done, q, self._chain.left)
            self._chain.left.clear()

    def _take_in(self, observation: Observation) -> None:
        """Estimate the scene from an observation. If the first cloud does not show the task's object, record an event
        which reports this.
        """
        assert observation.cloud is not None, "the cameras were asked for"
        pressed = {self._step.object: self._chain.is_pressed} if self.looks else {}
        self._goal.take_in(observation.cloud.xyz, pressed)
        if self._goal.mismatch is not None:
            name = self._task.steps[0].name
            self._refusal = Event(observation.step, name, Cause.OBJECT_NOT_SEEN, self._goal.mismatch)

    def _follow_hand(self, observation: Observation) -> None:
        """Move the grasped object with the hand."""
        held = self._chain.grasped
        if held is None:
            self._goal.hold(None)
            return
        q = observation.joint_positions.astype(np.float64)
        T_world_hand = self._profile.T_world_base @ self._profile.model.forward_kinematics(q)
        self._goal.hold(held.name, T_world_hand @ held.T_hand_object)

    def _with_belief(self, observation: Observation) -> PrivilegedObservation:
        goal, q = self._goal, observation.joint_positions.astype(np.float64)
        return PrivilegedObservation.of(observation, goal.measurement(q), lambda: goal.scene(q))
