r"""Run a trained action-chunk policy as a controller. For example, this command evaluates a policy:

gensim2 evaluate CloseBox --controller gensim2.policy.controller:PolicyController \
    --controller-args '{"checkpoint": "DIR"}'
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import torch

from gensim2.core.errors import InputError
from gensim2.core.seeding import rng
from gensim2.perception import Observation
from gensim2.perception.observation import GRIPPER, STATE
from gensim2.policy.augment import holds
from gensim2.policy.checkpoint import CONFIG_JSON, CheckpointError, PolicyCheckpoint
from gensim2.policy.control import CLOUDS, Sees, Sight
from gensim2.policy.embodiment import check_robot
from gensim2.policy.frames import SEEN, inputs_of
from gensim2.policy.network import CLOUD as CLOUD_INPUT
from gensim2.policy.network import PROPRIO, TEXT
from gensim2.policy.sentences import embeds, sentence_row, substitutes
from gensim2.robots import RobotProfile, robot
from gensim2.rollout.controller import PROPRIOCEPTIVE

if TYPE_CHECKING:
    from gensim2.perception import ObservationSpec
    from gensim2.policy.config import PolicyConfig

Action = npt.NDArray[np.float32]

ATTEMPTS = 4
"""Default number of attempts in an episode."""
STILL, STILL_SECONDS = 0.02, 1.5
"""The hand counts as stuck after ``STILL_SECONDS`` seconds in which no joint target (rad) and no gripper command
changed by more than ``STILL``. Closing the fingers takes less than half of this time.
"""
RESTS = 6
"""Number of control steps for which the arm waits at the start pose before the next attempt."""


class Attempts:
    """Records the actions of an episode and decides when to start another attempt.

    Args:
        max_attempts: maximum number of attempts in an episode, including the first attempt.
    """

    def __init__(self, profile: RobotProfile, max_attempts: int) -> None:
        self._arm, self._patience, self._max = profile.arm_size, profile.steps(STILL_SECONDS), max_attempts
        self._way: list[Action] = []  # the arm's path in this attempt
        self._last: Action | None = None
        self._begun, self._still, self._backs_off = 1, 0, False

    @staticmethod
    def check(max_attempts: int) -> None:
        """Check the number of attempts.

        Raises:
            InputError: ``max_attempts`` is outside 1..1000.
        """
        if not 1 <= max_attempts <= 1000:
            raise InputError(f"must lie in 1..1000, but is {max_attempts}", field="attempts")

    def is_due(self, observation: Observation) -> bool:
        """Return whether the hand is stuck without a grasped object and another attempt is allowed."""
        width, command = np.asarray(observation[GRIPPER])
        waits = self._still >= self._patience and len(self._way) > RESTS
        return waits and self._begun < self._max and not holds(width, command)

    def again(self) -> list[Action]:
        """Start another attempt, and return the actions (m + 1,) that retrace the hand's path to the start pose.

        On the way back the gripper keeps its last command; at the start pose it gets its initial command.
        """
        assert self._last is not None
        begin = self._way[0]
        back = [np.append(each[: self._arm], self._last[self._arm]).astype(np.float32) for each in self._way[::-1]]
        self._way, self._backs_off = [], True
        self._begun, self._still = self._begun + 1, 0
        return [*back, *[begin] * RESTS]

    def goes_on(self) -> None:
        """Start to record the path of a new attempt. Call this method when the hand has returned to the start pose."""
        self._backs_off = False

    def follow(self, action: Action) -> None:
        """Record an action, and count consecutive steps without motion.

        Motion is judged by the commanded targets, because an arm that presses against an object never reaches them.
        """
        last = self._last
        moves = last is None or bool(np.abs(action[: self._arm] - last[: self._arm]).max() > STILL)
        if not moves and last is not None and abs(float(action[self._arm] - last[self._arm])) <= STILL:
            self._still += 1
            return
        self._still, self._last = 0, action
        if moves and not self._backs_off:
            self._way.append(action)


class PolicyController:
    """Controller that executes the first ``execute`` actions of each predicted chunk and then predicts the next chunk.

    For each action the network also predicts whether the episode has ended by then. The controller ends the episode
    when the first action of a new chunk is predicted to be after the end. If the hand stops earlier without an object,
    it retraces its path to the start, and the policy tries again.

    Args:
        checkpoint: folder of the checkpoint.
        execute: number of actions of each chunk to execute; None: the checkpoint's setting.
        attempts: maximum number of attempts in an episode.
        denoise_steps: number of denoising steps of diffusion and flow heads; None: the checkpoint's setting.
        unknown_sentences: treatment of instructions without training. ``"parse"`` uses the training instruction that
            has the same steps, or refuses the instruction; ``"embed"`` encodes the instruction.
        text_model: folder or Hugging Face name of the text encoder's weights, if they are not gensim2's default.
        sees: cloud that the policy gets. ``"all"``: the observed cloud; ``"nothing"``: zeros; ``"other"``: a cloud of
            another scene.
        says: mapping from the instruction of a task to the instruction that the policy gets instead.
        threads: number of PyTorch threads.

    Raises:
        InputError: the checkpoint cannot be used, or an argument is invalid.
    """

    @staticmethod
    def depends_on(checkpoint: str, sees: Sees = "all", **_: object) -> list[Path]:
        """Return the files that determine the controller. One of them contains the SHA-256 of the weights."""
        return [Path(checkpoint) / CONFIG_JSON, *([Path(checkpoint) / CLOUDS] if sees == "other" else [])]

    def __init__(
        self,
        checkpoint: str,
        execute: int | None = None,
        attempts: int = ATTEMPTS,
        denoise_steps: int | None = None,
        unknown_sentences: str = "parse",
        text_model: str | None = None,
        sees: Sees = "all",
        says: Mapping[str, str] | None = None,
        threads: int = 1,
    ) -> None:
        if threads < 1:
            raise InputError(f"must be at least 1, but is {threads}", field="threads")
        self._threads, self._folder = threads, Path(checkpoint)
        self._policy = PolicyCheckpoint.load(self._folder)
        if self._policy.action.kind != "joint-relative":
            message = f"has actions of kind {self._policy.action.kind}, not joint-relative"
            raise CheckpointError(message, file=self._folder, field="action")
        config = self._policy.config
        self._execute = config.execute if execute is None else execute
        if not 1 <= self._execute <= config.horizon:
            raise InputError(f"must lie in 1..{config.horizon}, but is {self._execute}", field="execute")
        Attempts.check(attempts)
        self._max_attempts = attempts
        if denoise_steps is not None:
            if not hasattr(self._policy.network.head, "steps"):
                wrong = f"applies to the heads diffusion and flow, not to {config.head}"
                raise InputError(wrong, field="denoise_steps")
            if not 1 <= denoise_steps <= config.noise_levels:
                raise InputError(f"must lie in 1..{config.noise_levels}, but is {denoise_steps}", field="denoise_steps")
            self._policy.network.head.steps = denoise_steps
        self._says, self._sight = substitutes(says), Sight.of(sees, self._folder)
        self._embeds, self._text_model = embeds(unknown_sentences), text_model
        self._plan: list[Action] = []

    @property
    def config(self) -> PolicyConfig:
        return self._policy.config

    @property
    def observation_spec(self) -> ObservationSpec:
        """Observations needed at the next step.

        During a chunk only the robot's state is needed. Therefore no cloud is rendered unless the policy uses past
        frames.
        """
        executes = bool(self._plan) and self._policy.config.history == 1
        return PROPRIOCEPTIVE if executes else self._policy.observation

    def reset(self, observation: Observation, seed: int) -> None:
        """Start an episode.

        Raises:
            CheckpointError: the policy was trained for another robot, or not on the steps of the instruction.
        """
        torch.set_num_threads(self._threads)
        check_robot(self._policy.robot, observation, self._folder)
        self._attempts = Attempts(robot(self._policy.robot), self._max_attempts)
        sentence = self._says.get(observation.language, observation.language)
        self._row = sentence_row(self._policy, sentence, self._folder, embed=self._embeds, text_model=self._text_model)
        config = self._policy.config
        self._rng, self._seed = rng(seed, "policy/act"), seed
        self._past: deque[dict[str, torch.Tensor]] = deque(maxlen=1 + config.stride * (config.history - 1))
        self._plan = []
        self._acted = False
        self._step, self._ends = observation.step, False

    def act(self, observation: Observation) -> Action | None:
        """Return the next action (m + 1,), or None at the end of the episode."""
        # The simulation loop executed steps without this controller until the scene had settled.
        if observation.step > self._step + 1:
            self._past.clear()
            self._plan = []
        self._step = observation.step
        looks = observation.cloud is not None
        if not looks and not self._plan and self._acted:
            # Steps were executed without this controller, so a new chunk is due. The present observation was requested
            # during the old chunk and has no cloud. Therefore wait for the next observation.
            arm = np.asarray(observation[STATE], dtype=np.float32)[: self._policy.action.arm]
            return np.append(arm, np.float32(observation.gripper_command))
        if looks or not self._plan:
            shown = self._sight.altered(observation, self._seed)
            seen = {name: torch.from_numpy(np.array(shown[name], dtype=np.float32)) for name in SEEN}
            self._past.append(seen)
        if not self._plan:
            self._plan = self._actions(observation)
            self._attempts.goes_on()
            if not self._ends and self._attempts.is_due(observation):
                self._plan = self._attempts.again()
        if not self._plan:
            return None
        action, self._acted = self._plan.pop(0), True
        self._attempts.follow(action)
        return action

    def _actions(self, observation: Observation) -> list[Action]:
        """Return the actions to execute before the next prediction; an empty list ends the episode."""
        network, arm = self._policy.network, self._policy.action.arm
        with torch.no_grad():
            chunk = network(self._batch(), self._noise())[0].numpy()
        joints = np.asarray(observation[STATE], dtype=np.float32)[:arm]
        over = np.flatnonzero(chunk[:, arm + 1] > 0)
        self._ends = bool(len(over))
        count = min(self._execute, int(over[0]) if len(over) else self._execute)
        actions = np.concatenate([joints + chunk[:count, :arm], np.clip(chunk[:count, arm : arm + 1], -1, 1)], -1)
        return list(actions.astype(np.float32))

    def _batch(self) -> dict[str, torch.Tensor]:
        config = self._policy.config
        newest = len(self._past) - 1
        frames = [self._past[max(0, newest - config.stride * back)] for back in range(config.history - 1, -1, -1)]
        seen = {name: torch.stack([frame[name] for frame in frames])[None] for name in SEEN}
        inputs = inputs_of(seen, config, self._policy.action.arm)
        return {CLOUD_INPUT: inputs.cloud, PROPRIO: inputs.proprio, TEXT: self._row}

    def _noise(self) -> torch.Tensor:
        shape = self._policy.network.head.noise
        return torch.from_numpy(self._rng.standard_normal((1, *shape), dtype=np.float32))
