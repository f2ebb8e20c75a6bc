"""Run keypose policies that judge from point clouds whether the goal of the task is reached."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.core.arrays import Array
from gensim2.perception import Observation
from gensim2.perception.estimation.estimator import BUILTIN, ESTIMATOR_JSON, SceneEstimator, estimator_folder
from gensim2.perception.estimation.goal import GoalTracker
from gensim2.policy.control import Sees
from gensim2.policy.keypose.controller import MAX_TRIES, KeyposeController
from gensim2.policy.keypose.goals import TaskGoal
from gensim2.policy.keypose.training import read_goals
from gensim2.robots.force import FORCE_LIMIT, Yielding
from gensim2.tasks.criteria import JOINT

LIKELY, LIKELIER = 0.5, 2.0
"""Minimum probability of "done", and minimum factor by which its odds must have grown since the first prediction. An
estimate without a safety margin then ends the episode.
"""
CONTRADICTION = 3.0
"""Number of standard deviations by which the estimated joint must miss the goal to outweigh a network that is sure. The
number is divided by the number of motions, without the latest motions that have not moved the joint."""
MARGIN = 1.0
"""Number of standard deviations by which the estimated joint must exceed the goal if the network does not predict the
end of the task. This number is divided by the number of motions, because each motion adds evidence."""


class PerceivingKeyposeController(KeyposeController):
    """Controller of a keypose policy that stops when the point clouds show that the goal is reached.

    At the first observation the controller estimates the object of the task. At each later observation it measures how
    far the joint has moved since the previous observation, and judges the success criteria of the task
    (:class:`~gensim2.perception.estimation.goal.GoalTracker`). The episode ends in three cases:

    - The joint has moved, and the estimate shows that it is at its goal, with a safety margin.
    - The estimate shows that the joint is at its goal, and the network considers it likely that the task is done.
    - The network is sure that the task is done, and the estimate does not contradict.

    From the force of the arm's drives, the controller tells the tracker whether a sliding part has blocked the arm. If
    the joint stood still during a program, the controller tries the other strategies before it repeats the strategy.

    If the task has several objects, a rigid object, or an object of a class that the estimator does not know, only the
    network decides.

    Args:
        checkpoint: folder of a policy with a keypose head.
        estimator: folder of the estimator, as written by ``gensim2 perceive train``; ``"builtin"`` is the estimator
            of the package.
        policy: further arguments of :class:`~gensim2.policy.keypose.controller.KeyposeController`.

    Raises:
        InputError: the checkpoint or the estimator cannot be used.
    """

    @staticmethod
    def depends_on(checkpoint: str, sees: Sees = "all", **more: object) -> list[Path]:
        """Return the files that determine the controller's behaviour. The files with weights are not listed, because
        the returned files contain their SHA-256.
        """
        estimator = estimator_folder(str(more.get("estimator", BUILTIN)))
        return [*KeyposeController.depends_on(checkpoint, sees), estimator / ESTIMATOR_JSON]

    def __init__(self, checkpoint: str, estimator: str = BUILTIN, **policy: Any) -> None:
        super().__init__(checkpoint, **policy)
        self._estimator = SceneEstimator.load(estimator, self._profile)
        self._goals = read_goals(self._folder)
        self._tracker: GoalTracker | None = None
        self._yielding = Yielding(self._profile, FORCE_LIMIT)

    def reset(self, observation: Observation, seed: int) -> None:
        super().reset(observation, seed)
        self._is_pressed, self._ran = False, 0

    def act(self, observation: Observation) -> npt.NDArray[np.float32] | None:
        is_new = not self._rows
        action = super().act(observation)
        self._ran = 0 if is_new else self._ran + 1
        if action is None or self._ran not in self._touching:
            return action
        q, qvel = (each.astype(np.float64) for each in (observation.joint_positions, observation.joint_velocities))
        asked = action[:-1].astype(np.float64)
        presses = self._yielding.force(q, asked) > FORCE_LIMIT
        self._is_pressed |= presses and self._yielding.is_blocked(q, qvel, asked)
        return action

    def _judged(self, points: Array, q: Array, done: float) -> bool:
        is_first = self.told["looks"] == 1
        if is_first:
            self._tracker = self._tracker_of(self._goals.get(self._heard or ""))
        tracker = self._tracker
        if tracker is None or not len(points):
            return self._is_done(done)
        if not is_first:
            tracker.begin_motion()
        # A hinge also resists on its way, and the clouds show its openness.
        tracks = {name: each.track for name, each in tracker.articulated.items() if each.track is not None}
        slides = [name for name, track in tracks.items() if track.found.joint.type == "prismatic"]
        tracker.take_in(points.astype(np.float32), dict.fromkeys(slides, self._is_pressed))
        self._is_pressed = False
        if not tracker.is_seen:
            return self._is_done(done)
        [followed] = tracker.articulated.values()
        if followed.stands_still:
            self._tried[self._latest] = max(self._tried[self._latest], MAX_TRIES)
        if self._is_done(done):
            return tracker.is_reached(q, -CONTRADICTION)
        if self._is_done(done, LIKELY, LIKELIER):
            return tracker.is_reached(q, 0.0)
        return followed.has_moved and tracker.is_reached(q, MARGIN)

    def _tracker_of(self, goal: TaskGoal | None) -> GoalTracker | None:
        """Return a tracker for a task's goal; None if the estimator cannot judge the goal."""
        known = {each.name for each in self._estimator.classes}
        if goal is None or len(goal.objects) != 1 or not known.issuperset(goal.objects.values()):
            return None
        if not goal.success or not all(isinstance(each, JOINT) for each in goal.success):
            return None
        return GoalTracker(self._estimator, goal.objects, goal.success)
