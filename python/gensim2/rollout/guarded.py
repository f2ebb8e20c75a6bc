"""Check the actions of users' controllers, and report the errors of these controllers in one line."""

from __future__ import annotations

import numpy as np

from gensim2.core.errors import MissingExtraError, described, user_code
from gensim2.perception import Observation
from gensim2.robots import RobotProfile
from gensim2.rollout.controller import Action, Controller, WrappedController, is_privileged
from gensim2.rollout.controller_spec import ControllerError, ControllerSpec
from gensim2.tasks.spec import TaskSpec


class Guarded(WrappedController):
    """Wrapper that raises an error for invalid actions of a controller.

    Args:
        controller: controller to wrap.
        spec: specification of the controller.
        task: task whose steps the controller may report.
        episode: description of the episode, for error messages.
    """

    def __init__(
        self, controller: Controller, spec: ControllerSpec, task: TaskSpec, profile: RobotProfile, episode: str
    ) -> None:
        self._controller, self._target, self._episode = controller, spec.target, episode
        self._steps = [step.name for step in task.steps]
        self._size = profile.action_size
        self.privileged = is_privileged(controller)

    def reset(self, observation: Observation, seed: int) -> None:
        """Start an episode.

        Raises:
            ControllerError: the controller fails.
        """
        with user_code(lambda error: self._error(described(error), "reset"), MissingExtraError):
            self._controller.reset(observation, seed)

    def act(self, observation: Observation) -> Action | None:
        """Return the next action after checking its size and values; None at the end of the episode.

        Raises:
            ControllerError: the controller fails or returns an invalid action.
        """
        where = f"act at step {observation.step}"
        with user_code(lambda error: self._error(described(error), where), MissingExtraError):
            given = self._controller.act(observation)
            action = None if given is None else np.asarray(given, dtype=np.float32)
        if action is None:
            return None
        if action.shape != (self._size,):
            raise self._error(f"an action must have the shape ({self._size},), has {action.shape}", where)
        if not np.isfinite(action).all():
            raise self._error("an action must be finite, but contains NaN or infinity", where)
        return action

    @property
    def turn(self) -> str | None:
        """Name of the controller's current step.

        Raises:
            ControllerError: the task has no such step.
        """
        found = super().turn
        if found is not None and found not in self._steps:
            raise self._error(f"{found!r} is not a step of the task; the steps are: {', '.join(self._steps)}", "turn")
        return found

    def _error(self, message: str, where: str) -> ControllerError:
        return ControllerError(message, file=self._target, field=f"{self._episode}: {where}")
