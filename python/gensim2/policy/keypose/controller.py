"""Run keypose policies: observe, predict a strategy with hand poses, plan the motion, execute it, and repeat."""

from __future__ import annotations

from collections import Counter, defaultdict, deque
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import torch

from gensim2.core.arrays import Array
from gensim2.core.errors import InputError
from gensim2.perception import Observation, ObservationSpec
from gensim2.perception.observation import CLOUD, GRIPPER
from gensim2.planning.actions import grip_on
from gensim2.policy.checkpoint import CONFIG_JSON, PolicyCheckpoint, checkpoint_folder
from gensim2.policy.control import CLOUDS, Sees, Sight
from gensim2.policy.embodiment import check_robot
from gensim2.policy.keypose.answers import Answer, answers
from gensim2.policy.keypose.execution import Executor
from gensim2.policy.keypose.training import WAYS_JSON, read_ways
from gensim2.policy.sentences import embeds, sentence_row, substitutes
from gensim2.robots import OPEN, robot
from gensim2.rollout.controller import PROPRIOCEPTIVE

MAX_LOOKS = 8
"""Maximum number of predictions in an episode for each step of the task."""
MAX_TRIES = 2
"""Number of tries after which a strategy ranks behind strategies with fewer tries."""
SURE = 0.8
"""Minimum probability of "done" at which the network counts as sure. The threshold is high because an unnecessary
motion does less harm than a missing motion.
"""
SURER = 10.0
"""Factor by which the odds of "done" must have grown since the first prediction; otherwise the prediction does not
count as sure. The task is not done at the first prediction, so the odds of "done" there measure the network's bias.
"""
UNEXPECTED = 0.15
"""Factor on the probability of a strategy whose step is neither the last executed step nor the next step. The known
order of steps is more reliable than the predicted class.
"""
OVERTRAVEL = 0.03
"""Distance (m) by which a push is extended if the step moves a joint to an end of its range; the cloud does not show
this end exactly.
"""
RELEASES = 0.5
"""Gripper command above which the open hand is assumed to hold no object."""
HOLDS = 0.1
"""Finger force (N) in a program above which it grasps an object."""
EMPTY = 0.003
"""Finger distance (m) below which the closed fingers are assumed to hold no object."""


class KeyposeController:
    """Controller of a keypose policy.

    The network predicts strategies, each with a program of hand poses. The controller selects the most probable
    strategy, but skips a strategy that it has already tried too often. It first moves the arm to the object on a
    planned collision-free path, and then executes the hand poses of the program. During these motions it does not
    observe the scene. Afterwards the arm returns to its rest pose, unless the hand holds an object. The controller
    repeats this cycle until the network predicts that the task is done. The inputs of the network are the point cloud,
    the robot state, the instruction and the table height.

    The first prediction selects the task of the episode: the task whose strategies have the largest total probability.

    Args:
        checkpoint: folder of a policy with a keypose head.
        sees: point cloud that the policy gets: ``"all"`` for the observed cloud, ``"nothing"`` for a cloud of zeros,
            ``"other"`` for the cloud of another scene.
        says: instructions to replace: a mapping from a task's instruction to the instruction that the policy gets
            instead.
        unknown_sentences: treatment of instructions that were not in the training data: ``"parse"`` replaces an
            instruction by the training instruction with the same steps and refuses it if there is none, ``"embed"``
            encodes the instruction with the text encoder.
        text_model: folder or Hugging Face name of the text encoder's weights; required for weights that are not a
            default of gensim2.

    Raises:
        InputError: the checkpoint cannot be used.
    """

    privileged = False

    @staticmethod
    def depends_on(checkpoint: str, sees: Sees = "all", **_: object) -> list[Path]:
        """Return the files that determine the controller's behaviour. The weights file is not listed, because one of
        the returned files contains its SHA-256.
        """
        names = [CONFIG_JSON, WAYS_JSON, *([CLOUDS] if sees == "other" else [])]
        return [checkpoint_folder(checkpoint) / name for name in names]

    def __init__(
        self,
        checkpoint: str,
        sees: Sees = "all",
        says: Mapping[str, str] | None = None,
        unknown_sentences: str = "parse",
        text_model: str | None = None,
    ) -> None:
        folder = checkpoint_folder(checkpoint)
        self._says, self._embeds, self._text_model = substitutes(says), embeds(unknown_sentences), text_model
        self._folder, self._sight = folder, Sight.of(sees, folder)
        self._policy = PolicyCheckpoint.load(folder)
        if self._policy.action.kind != "keypose":
            message = f"is a policy with the head {self._policy.config.head!r}, not a keypose policy"
            raise InputError(message, file=folder, remedy="give a keypose policy")
        self._ways = read_ways(folder, self._policy)
        self._profile = robot(self._policy.robot)
        self._executor = Executor(self._profile)
        self._arm = list(self._profile.arm_columns)
        self._rows: deque[npt.NDArray[np.float32]] = deque()
        #: Number of events of each kind in the episode. An event is a prediction, a program that the arm cannot execute
        #: or executes only partly, a lost object, or a collision-free motion to the object or to the rest pose. Motions
        #: that avoid different obstacles are counted as different kinds.
        self.told: Counter[str] = Counter()

    @property
    def robot(self) -> str:
        """Name of the robot that the policy was trained for."""
        return self._policy.robot

    @property
    def sentences(self) -> Collection[str]:
        """Instructions that the policy was trained on."""
        return self._policy.sentences

    @property
    def observation_spec(self) -> ObservationSpec:
        """Observations needed at the next step: the policy's inputs, or only the robot's state while the arm moves."""
        return PROPRIOCEPTIVE if self._rows else self._policy.observation

    def reset(self, observation: Observation, seed: int) -> None:
        """Start an episode.

        Raises:
            CheckpointError: the policy was trained for another robot, or not on the steps of the instruction.
        """
        torch.set_num_threads(1)
        check_robot(self._policy.robot, observation, self._folder)
        sentence = self._says.get(observation.language, observation.language)
        self._row = sentence_row(self._policy, sentence, self._folder, embed=self._embeds, text_model=self._text_model)
        self._mine: frozenset[int] | None = None
        self._heard: str | None = None
        self._steps, self._done_at_first = 1, 0.0
        self._expected, self._taking, self._latest = {0}, 0, 0
        self._tried, self.told = Counter[int](), Counter()
        self._rows.clear()
        self._seed, self._force, self._holds = seed, 0.0, False
        self._until_gripped: int | None = None
        # Control steps of the latest program in which it may touch the object.
        self._touching = range(0)
        self._home, self._empty = observation.joint_positions.astype(np.float64), observation[GRIPPER]
        self._seen = self._executor.around.seen(np.zeros((0, 3)), self._home, holds=False)

    def act(self, observation: Observation) -> npt.NDArray[np.float32] | None:
        """Return the next action, or None if the task is done or no strategy is left."""
        if self._holds and observation.gripper_width < EMPTY:
            self._lost(observation)
        if not self._rows and (self.told["looks"] >= MAX_LOOKS * self._steps or not self._look(observation)):
            return None
        action = self._rows.popleft()
        if self._until_gripped is not None:
            self._until_gripped -= 1
            if self._until_gripped < 0:
                self._until_gripped, self._holds = None, True
        if action[-1] > RELEASES:
            self._holds = False
        if not self._holds:
            return action
        # Once the fingers have closed on an object, they press with the program's force.
        command = grip_on(observation.gripper_width, self._force, self._profile)
        return np.append(action[:-1], command).astype(np.float32)

    def _look(self, observation: Observation) -> bool:
        """Predict strategies and plan the next motion; return False if no motion is left to execute."""
        self.told["looks"] += 1
        seen = self._sight.altered(observation, self._seed)
        # The finger distance of an empty hand has no meaning for the task. The network therefore gets the finger
        # distance at the start of the episode in place of the measured distance.
        if not self._holds:
            seen = replace(seen, arrays={**seen.arrays, GRIPPER: self._empty})
        points = seen[CLOUD][:, :3].astype(np.float64) if self._sight.sees != "nothing" else np.zeros((0, 3))
        q = observation.joint_positions.astype(np.float64)
        self._seen = self._executor.around.seen(points, q, self._holds)
        found = answers(self._policy, seen, self._row)
        done = sum(each.chance for each in found if each.way == len(self._ways))
        if self._mine is None:
            self._mine = self._hear(found)
            self._done_at_first = done
        # The episode ends only after the last step was executed.
        if self._judged(points, q, done) and self._steps in self._expected:
            return False
        for answer in sorted(found, key=self._turn, reverse=True):
            if answer.way == len(self._ways):
                continue
            if answer.way in self._mine and self._begin(answer, q, observation.gripper_command):
                return True
        return False

    def _hear(self, found: Sequence[Answer]) -> frozenset[int]:
        """Select the task with the largest total probability, and return the predicted strategies of this task."""
        chances: dict[str, float] = defaultdict(float)
        for answer in found:
            if answer.way < len(self._ways):
                chances[self._ways[answer.way].language] += answer.chance
        if not chances:
            return frozenset()
        self._heard = max(chances, key=chances.__getitem__)
        mine = frozenset(number for number, way in enumerate(self._ways) if way.language == self._heard)
        self._steps = 1 + max(self._ways[number].step for number in mine)
        return mine

    def _judged(self, points: Array, q: Array, done: float) -> bool:
        """Return whether the task is done. The method is called once at every observation.

        Args:
            points: (N, 3) point cloud in the base frame, m; empty if the policy sees nothing.
            q: (n,) joint values of the robot.
            done: predicted probability that the task is done.
        """
        return self._is_done(done)

    def _is_done(self, chance: float, least: float = SURE, growth: float = SURER) -> bool:
        """Return whether the predicted probability ``chance`` that the task is done is at least ``least``, and its odds
        have grown by the factor ``growth`` since the first prediction of the episode.
        """
        first = self._done_at_first
        return chance >= least and chance * (1.0 - first) >= growth * first * (1.0 - chance)

    def _step(self, answer: Answer) -> int:
        """Return the index of the task step to which a predicted strategy belongs; for "done", the number of steps."""
        return self._steps if answer.way == len(self._ways) else self._ways[answer.way].step

    def _weight(self, answer: Answer) -> float:
        """Return the probability of a predicted strategy. If the task step of the strategy is not expected next, the
        probability is multiplied by ``UNEXPECTED``.
        """
        return answer.chance * (1.0 if self._step(answer) in self._expected else UNEXPECTED)

    def _turn(self, answer: Answer) -> tuple[int, float]:
        """Return the key by which predicted strategies are sorted; the controller tries the largest key first.

        The first number of the key decreases by 1 after every ``MAX_TRIES`` tries of the strategy. If two strategies
        have the same first number, the second number decides, which is the weighted probability.
        """
        return -(self._tried[answer.way] // MAX_TRIES), self._weight(answer)

    def _begin(self, answer: Answer, q: Array, command: float) -> bool:
        self._tried[answer.way] += 1
        self._latest = answer.way
        program = answer.program
        further = OVERTRAVEL if self._ways[answer.way].to_end and not self._holds else 0.0
        found = self._executor.execute(program, q, command, self._seen, further=further)
        if found is None:
            self.told["out of reach"] += 1
            return False
        self.told[found.free] += 1
        if not found.is_whole:
            self.told["cut short"] += 1
        self._rows = deque(found.actions)
        self._touching = range(found.contact, len(found.actions))
        step, takes = self._step(answer), program.force > HOLDS
        # The next prediction may repeat this step or begin the next one. After the last step, "done" is expected.
        self._expected = {step, step + 1}
        if takes:
            self._taking = step
            self._force, self._until_gripped = program.force, found.gripped
        if not takes and (not self._holds or float(found.actions[:, -1].max()) > RELEASES):
            end = q.copy()
            end[self._arm] = found.actions[-1, :-1]
            back = self._executor.rest(end, self._home, float(found.actions[-1, -1]), self._seen.without_held)
            self.told[f"home {back.free}"] += 1
            self._rows.extend(back.actions)
        return True

    def _lost(self, observation: Observation) -> None:
        """React to a lost object: move to the rest pose with open fingers. The next predicted strategy should belong to
        the step that grasps the object.
        """
        self.told["lost"] += 1
        self._holds, self._expected, self._touching = False, {self._taking}, range(0)
        now = observation.joint_positions.astype(np.float64)
        back = self._executor.rest(now, self._home, OPEN, self._seen.without_held)
        self.told[f"home {back.free}"] += 1
        self._rows = deque(back.actions)
