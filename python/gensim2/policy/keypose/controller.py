"""Controller of keypose policies: looks, lets the network say where and how, plans the motion, looks again."""

from __future__ import annotations

from collections import Counter, defaultdict, deque
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import torch

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

Array = npt.NDArray[np.float64]

MAX_LOOKS = 8
"""Number of looks in an episode for every step of its task."""
MAX_TRIES = 2
"""Number of times that a way is tried before the others."""
SURE = 0.8
"""Least probability of "done" at which the episode ends; it is high, as one motion too many does less harm than one too
few."""
SURER = 10.0
"""Least ratio of the odds of "done" to those at the first look at which the episode ends; nothing was done at the first
look, so its odds are the bias of the network on this scene."""
UNEXPECTED = 0.15
"""Factor on a way's probability where its step is neither the one executed last nor the next; the order of steps is
more certain than their classification."""
OVERTRAVEL = 0.03
"""Distance (m) by which a push is continued beyond its program where the step asks for a joint at an end of its range,
which the cloud does not show exactly."""
RELEASES = 0.5
"""Gripper command above which the fingers hold nothing."""
HOLDS = 0.1
"""Force of each finger (N) above which a program grasps an object."""
EMPTY = 0.003
"""Distance of the pads (m) below which closed fingers hold nothing."""


class KeyposeController:
    """Sees the point cloud, the robot's own state and the sentence; the table is where the robot's profile says.

    Each look gives ways and programs. The most probable way that was not tried too often is planned and executed open
    loop: a free motion clear of the cloud, then the hand along its poses. Then the arm goes back to where it looks
    from, unless the hand holds something, and looks again, until the network says that nothing is left to do.

    Which task the sentence asks for is what the network makes of it: the task whose ways have most of the probability
    at the first look. Nothing else knows the sentence.

    Args:
        checkpoint: folder of a policy with a keypose head.
        sees: a control, where it is not ``"all"``.
        says: by a task's sentence what the policy is told in its place.
        unknown_sentences: ``refuse`` those that were not trained on, or ``embed`` them by the text encoder.
        text_model: folder or hub name of that encoder's weights, where gensim2 does not name them itself.

    Raises:
        InputError: the checkpoint cannot be used.
    """

    privileged = False

    @staticmethod
    def depends_on(checkpoint: str, sees: Sees = "all", **_: object) -> list[Path]:
        """Files that say what it does beside its source: they name the weights by their digest."""
        names = [CONFIG_JSON, WAYS_JSON, *([CLOUDS] if sees == "other" else [])]
        return [checkpoint_folder(checkpoint) / name for name in names]

    def __init__(
        self,
        checkpoint: str,
        sees: Sees = "all",
        says: Mapping[str, str] | None = None,
        unknown_sentences: str = "refuse",
        text_model: str | None = None,
    ) -> None:
        folder = checkpoint_folder(checkpoint)
        self._says, self._embeds, self._text_model = substitutes(says), embeds(unknown_sentences), text_model
        self._folder, self._sight = folder, Sight.of(sees, folder)
        self._policy = PolicyCheckpoint.load(folder)
        if self._policy.action.kind != "keypose":
            raise InputError(f"has a {self._policy.config.head} head", file=folder, remedy="give one with keyposes")
        self._ways = read_ways(folder, self._policy)
        self._profile = robot(self._policy.robot)
        self._executor = Executor(self._profile)
        self._arm = list(self._profile.arm_columns)
        self._rows: deque[npt.NDArray[np.float32]] = deque()
        #: Counts over the episode: looks, free motions (there, and home) by how they were found, programs cut short,
        #: things lost.
        self.told: Counter[str] = Counter()

    @property
    def robot(self) -> str:
        """Name of the robot that it is for."""
        return self._policy.robot

    @property
    def sentences(self) -> Collection[str]:
        """Those that it was trained on."""
        return self._policy.sentences

    @property
    def observation_spec(self) -> ObservationSpec:
        """Spec of its next observation: that of its training, or at the robot alone while it moves."""
        return PROPRIOCEPTIVE if self._rows else self._policy.observation

    def reset(self, observation: Observation, seed: int) -> None:
        """Begin an episode.

        Raises:
            CheckpointError: the robot is another one, or the sentence was not trained on.
        """
        torch.set_num_threads(1)
        check_robot(self._policy.robot, observation, self._folder)
        sentence = self._says.get(observation.language, observation.language)
        self._row = sentence_row(self._policy, sentence, self._folder, embed=self._embeds, text_model=self._text_model)
        self._mine: frozenset[int] | None = None
        self._steps, self._done_at_first = 1, 0.0
        self._expected, self._taking = {0}, 0
        self._tried, self.told = Counter[int](), Counter()
        self._rows.clear()
        self._seed, self._force, self._holds = seed, 0.0, False
        self._until_gripped: int | None = None
        self._home, self._empty = observation.joint_positions.astype(np.float64), observation[GRIPPER]
        self._seen = self._executor.around.seen(np.zeros((0, 3)), self._home, holds=False)

    def act(self, observation: Observation) -> npt.NDArray[np.float32] | None:
        """The next action; None: done, or no way is left."""
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
        # Fingers that have closed on something press as hard as the program says, however far apart it keeps them.
        command = grip_on(observation.gripper_width, self._force, self._profile)
        return np.append(action[:-1], command).astype(np.float32)

    def _look(self, observation: Observation) -> bool:
        """Plan what comes next; whether there is anything."""
        self.told["looks"] += 1
        seen = self._sight.altered(observation, self._seed)
        if not self._holds:  # what the fingers of an empty hand have done last means nothing
            seen = replace(seen, arrays={**seen.arrays, GRIPPER: self._empty})
        points = seen[CLOUD][:, :3].astype(np.float64) if self._sight.sees != "nothing" else np.zeros((0, 3))
        q = observation.joint_positions.astype(np.float64)
        self._seen = self._executor.around.seen(points, q, self._holds)
        found = answers(self._policy, seen, self._row)
        if self._mine is None:
            self._mine = self._hear(found)
            self._done_at_first = sum(each.chance for each in found if each.way == len(self._ways))
        for answer in sorted(found, key=self._turn, reverse=True):
            if answer.way == len(self._ways):
                # Whoever is asked to do something is asked before it is done.
                if self._steps in self._expected and self._is_done(answer.chance):
                    return False
                continue
            if answer.way in self._mine and self._begin(answer, q, observation.gripper_command):
                return True
        return False

    def _hear(self, found: Sequence[Answer]) -> frozenset[int]:
        """Take the task that the answers to the first look are of most; returns its ways."""
        chances: dict[str, float] = defaultdict(float)
        for answer in found:
            if answer.way < len(self._ways):
                chances[self._ways[answer.way].language] += answer.chance
        if not chances:
            return frozenset()
        heard = max(chances, key=chances.__getitem__)
        mine = frozenset(number for number, way in enumerate(self._ways) if way.language == heard)
        self._steps = 1 + max(self._ways[number].step for number in mine)
        return mine

    def _is_done(self, chance: float) -> bool:
        """Whether nothing is left to do, where that has the probability ``chance``."""
        first = self._done_at_first
        return chance >= SURE and chance * (1.0 - first) >= SURER * first * (1.0 - chance)

    def _step(self, answer: Answer) -> int:
        """Number of the step that an answer is of; how many there are of "done"."""
        return self._steps if answer.way == len(self._ways) else self._ways[answer.way].step

    def _weight(self, answer: Answer) -> float:
        """Probability of an answer, less where its step is not the one that is expected."""
        return answer.chance * (1.0 if self._step(answer) in self._expected else UNEXPECTED)

    def _turn(self, answer: Answer) -> tuple[int, float]:
        """Key by which answers are taken, the greatest first: those tried less often, then the more probable."""
        return -(self._tried[answer.way] // MAX_TRIES), self._weight(answer)

    def _begin(self, answer: Answer, q: Array, command: float) -> bool:
        self._tried[answer.way] += 1
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
        step, takes = self._step(answer), program.force > HOLDS
        self._expected = {step, step + 1}  # once more, or what follows: the next step, or nothing
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
        """Go back to where the arm looks from, with open fingers: they have closed on nothing, or it has slipped.

        What took it up is expected next.
        """
        self.told["lost"] += 1
        self._holds, self._expected = False, {self._taking}
        now = observation.joint_positions.astype(np.float64)
        back = self._executor.rest(now, self._home, OPEN, self._seen.without_held)
        self.told[f"home {back.free}"] += 1
        self._rows = deque(back.actions)
