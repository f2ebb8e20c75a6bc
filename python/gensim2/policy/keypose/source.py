"""Sample training batches from planned scenes: observations, and the programs that the planner found."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import torch

from gensim2.core.errors import InputError
from gensim2.perception import ObservationSpec
from gensim2.perception.cloud import from_steps
from gensim2.perception.observation import CLOUD, GRIPPER, STATE, TOOL_POSE, VELOCITY, tool_pose
from gensim2.policy.checkpoint import ActionSpec, DataRecord
from gensim2.policy.control import Shuffled
from gensim2.policy.frames import turn_matrix
from gensim2.policy.heads.keypose import FORCE, POSITIONS, ROTATIONS, SECONDS, WAY
from gensim2.policy.heads.keypose import GRIPPER as FINGERS
from gensim2.policy.keypose.data import Planned, PlannedRecord
from gensim2.policy.source import SENTENCE
from gensim2.policy.starting import check_sentences
from gensim2.robots import OPEN, robot

YAW = 0.2
"""Maximum yaw (rad) by which an example is rotated about the base. Larger rotations would be inaccurate, because the
arm starts at the same pose in every scene and plans of a rotated scene differ slightly.
"""
NEW = 5.0
"""Sampling rate of a new task divided by the sampling rate of a task that the policy already knows."""
WIDTH, COMMAND = 0.004, 0.1
"""Standard deviations of the noise on finger distance (m) and gripper command in examples with a grasped object. The
noise represents the difference between planned and executed grasps.
"""


@dataclass(frozen=True)
class Ways:
    """Classes of the keypose head: every strategy of every step of every task, and "done" last.

    Attributes:
        tasks: instruction of the task, index of the step and name of the strategy for each class except the last.
        to_end: instruction of the task and index of the step for each step that opens or closes a joint completely.
    """

    tasks: tuple[tuple[str, int, str], ...]
    to_end: frozenset[tuple[str, int]] = frozenset()

    @staticmethod
    def of(records: Sequence[PlannedRecord]) -> Ways:
        return Ways(
            tuple(
                dict.fromkeys(
                    (record.language, step, name)
                    for record in records
                    for step, names in enumerate(record.ways)
                    for name in names
                )
            ),
            frozenset((record.language, step) for record in records for step in record.to_end),
        )

    @property
    def done(self) -> int:
        """Index of the class "done"."""
        return len(self.tasks)

    def __len__(self) -> int:
        return len(self.tasks) + 1


class PlannedSource:
    """Training data from planned scenes of one or several tasks.

    Args:
        planned: folders of planned scenes. A task may have two folders: one with objects of the library, and one with
            generated objects. All folders must have the same robot and observation spec.
        known: number of folders at the start of ``planned`` whose tasks the policy already knows. New tasks, in the
            remaining folders, are sampled ``NEW`` times as often.

    Raises:
        InputError: the folders differ in the robot or the observation spec, or two folders of a task differ in the
            task's settings.
    """

    def __init__(self, planned: Sequence[Planned], known: int = 0) -> None:
        first = planned[0].record
        tasks = {each.record.task: each.record for each in reversed(planned)}
        check_sentences([record.language for record in tasks.values()])
        for each in planned:
            for name in ("language", "steps", "ways", "to_end"):
                if getattr(each.record, name) != getattr(tasks[each.record.task], name):
                    wrong = f"the two folders of plans for {each.record.task} have different values of this setting"
                    raise InputError(wrong, field=name)
        for other in planned[1:]:
            for name in ("robot", "observation"):
                if getattr(other.record, name) != getattr(first, name):
                    wrong = f"the plans for {other.record.task} and {first.task} have different values of this setting"
                    raise InputError(wrong, field=name)
        self.planned, self._shares = tuple(planned), _shares(planned, known)
        self.robot = first.robot
        profile = robot(first.robot)
        self.action = ActionSpec(kind="keypose", arm=profile.arm_size, control_hz=profile.control_hz)
        self.observation = ObservationSpec.of(first.observation)
        self.sentences = tuple(dict.fromkeys(each.record.language for each in planned))
        self.ways = Ways.of([each.record for each in planned])
        self.goals = {each.record.language: each.record.goal for each in planned if each.record.goal is not None}
        self._starts = np.cumsum([0, *(len(each.arrays["way"]) for each in planned)])
        self._way = np.concatenate([self._classes(each) for each in planned])
        self._arrays = {
            name: np.concatenate([each.arrays[name] for each in planned]) for name in planned[0].arrays if name != "way"
        }
        self._tools = np.stack([tool_pose(profile, joints) for joints in self._arrays["joints"]])
        names = tuple(dict.fromkeys(each.record.task for each in planned))
        self.record = DataRecord(
            digest=self._digest(),
            tasks=names,
            episodes=sum(each.demonstrations for each in planned),
            frames=int(self._starts[-1]),
            folders=names,
        )

    def draw(self, rng: np.random.Generator, size: int) -> Mapping[str, torch.Tensor]:
        """Return a random batch, with the points of each cloud in random order."""
        task = self._tasks(rng, size)
        rows = rng.integers(self._starts[task], self._starts[task + 1])
        found = {name: values[rows] for name, values in self._arrays.items()}
        count = found["points"].shape[1]
        points = from_steps(found["points"][:, rng.permutation(count)])
        joints = torch.from_numpy(found["joints"])
        yaw = torch.from_numpy(rng.uniform(-YAW, YAW, size).astype(np.float32))
        turn, into = turn_matrix(yaw), turn_matrix(yaw - joints[:, 0])
        cloud = torch.einsum("bij,bnj->bni", turn, torch.from_numpy(points))
        colour = torch.zeros_like(cloud)
        return {
            CLOUD: torch.cat([cloud, colour], -1)[:, None],
            STATE: joints[:, None],
            VELOCITY: torch.zeros_like(joints)[:, None],
            TOOL_POSE: torch.from_numpy(_either_way_round(self._tools[rows], rng))[:, None],
            GRIPPER: torch.from_numpy(_as_held(found["fingers"], rng))[:, None],
            SENTENCE: torch.from_numpy(np.array([self._sentence(number) for number in task])),
            WAY: torch.from_numpy(self._way[rows]),
            POSITIONS: torch.einsum("bij,bkj->bki", into, torch.from_numpy(found["positions"])),
            ROTATIONS: torch.einsum("bij,bkjl->bkil", into, torch.from_numpy(found["rotations"])),
            FINGERS: torch.from_numpy(found["gripper"]),
            SECONDS: torch.from_numpy(found["seconds"]),
            FORCE: torch.from_numpy(found["force"]),
        }

    def _tasks(self, rng: np.random.Generator, size: int) -> npt.NDArray[np.int64]:
        """Return random folder indices (B,)."""
        if self._shares is None:
            return rng.integers(len(self.planned), size=size)
        return rng.choice(len(self.planned), size=size, p=self._shares)

    def some_clouds(self, max_clouds: int) -> Shuffled:
        """Return uncoloured clouds of at most ``max_clouds`` scenes, evenly spaced through the data."""
        points = self._arrays["points"]
        rows = np.unique(np.linspace(0, len(points) - 1, max_clouds).astype(np.int64))
        found = from_steps(points[rows])
        return Shuffled(found, np.zeros(found.shape, np.uint8))

    def _sentence(self, task: int) -> int:
        return self.sentences.index(self.planned[task].record.language)

    def _classes(self, planned: Planned) -> np.ndarray:
        record = planned.record
        numbers = {each: number for number, each in enumerate(self.ways.tasks)}
        found = np.full(len(planned.arrays["way"]), self.ways.done, dtype=np.int64)
        for row, (step, way) in enumerate(zip(planned.arrays["step"], planned.arrays["way"], strict=True)):
            if way >= 0:
                found[row] = numbers[record.language, int(step), record.ways[step][way]]
        return found

    def _digest(self) -> str:
        found = hashlib.sha256()
        for each in self.planned:
            # The identity in the record already covers the goal.
            found.update(each.record.model_dump_json(exclude={"goal"}).encode())
            for name, values in sorted(each.arrays.items()):
                found.update(name.encode() + np.ascontiguousarray(values).tobytes())
        return found.hexdigest()


def _shares(planned: Sequence[Planned], known: int) -> npt.NDArray[np.float64] | None:
    """Return each folder's share of a batch; None if all shares are equal."""
    examples = [len(each.arrays["way"]) for each in planned]
    of_task = Counter[str]()
    for each, count in zip(planned, examples, strict=True):
        of_task[each.record.task] += count
    if not known and len(of_task) == len(planned):
        return None
    shares = np.where(np.arange(len(planned)) < known, 1.0, NEW)
    shares *= [count / of_task[each.record.task] for each, count in zip(planned, examples, strict=True)]
    return np.asarray(shares / shares.sum())


def _either_way_round(poses: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Turn about half of the tool poses (B, 7) by 180 degrees about the approach axis, which exchanges the two fingers.
    During execution the arm may use either orientation.
    """
    x, y, z, w, x_q, y_q, z_q = poses.T
    swapped = np.column_stack([x, y, z, -z_q, y_q, -x_q, w])
    return np.where(rng.random((len(poses), 1)) < 0.5, swapped, poses).astype(np.float32)


def _as_held(fingers: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Add noise to the finger distance and the gripper command of each sample in which the hand holds an object.

    Executed grasps differ a little from planned grasps, and the noise represents this difference. ``fingers`` is an
    array (B, 2).
    """
    noise = rng.normal(size=fingers.shape) * (WIDTH, COMMAND)
    holds = fingers[:, 1:] < OPEN - 0.5
    return (fingers + np.where(holds, noise, 0.0)).astype(np.float32)
