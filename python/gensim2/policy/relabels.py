"""Create labels for DAgger: a label is a state that the policy visited, with the planner's actions from this state.

At the start the planner chooses a strategy and a contact pose. While the policy acts, the planner plans again every
``EVERY`` control steps. If the new plan has the same strategy and contact pose, the state and the plan become a label.

Labelling ends at the approach pose or when the object moves. Unlike demonstrations, later plans would move away first.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import torch

from gensim2.perception import EmptyCloudError, Observation
from gensim2.perception.observation import CLOUD, GRIPPER, STATE, TOOL_POSE, VELOCITY
from gensim2.planning import StepPlan, StepPlanner
from gensim2.policy.array_file import Expected, read_arrays, require_shapes, write_arrays
from gensim2.policy.controller import PolicyController
from gensim2.policy.demonstrations import Demonstrations
from gensim2.policy.frames import SEEN
from gensim2.policy.heads.actions import ACTION, EXTRA
from gensim2.policy.keyframes import KEY_POSITIONS, KEY_ROTATIONS
from gensim2.policy.keypose.examples import planned_way
from gensim2.policy.source import SENTENCE
from gensim2.robots import RobotProfile, robot
from gensim2.rollout.chain_state import ChainPlan
from gensim2.rollout.worker import parsed, simulator
from gensim2.scenes.config import SceneConfig
from gensim2.tasks.strategies import Strategies

if TYPE_CHECKING:
    from gensim2.sim.headless import HeadlessEnv

Arrays = dict[str, npt.NDArray[Any]]

EVERY = 8
"""Number of control steps between two labels."""
MOVED = 0.02
"""Change of openness since the start above which the object counts as touched."""
NEAR, TURNED = 0.03, 0.3
"""Maximum distance (m) and angle (rad) between two contact poses of the hand that count as equal."""
LAST = 0.5
"""No labels are made once the distance to the contact pose is below this fraction of the approach length."""
SLOW = 0.02
"""Velocity of a finger (m/s) below which it counts as stopped."""
STILL = 1e-3
"""Largest change of a joint target (rad) or of the gripper command at which the hand counts as still."""
SHARE = 0.3
"""Fraction of DAgger labels in a batch, if there are labels."""

_LANGUAGE: dict[str, Expected] = {"language": (np.str_, ())}
_COLUMNS: dict[str, Expected] = {
    CLOUD: (np.float32, (None, None, None, 6)),
    STATE: (np.float32, (None, None, None)),
    VELOCITY: (np.float32, (None, None, None)),
    TOOL_POSE: (np.float32, (None, None, 7)),
    GRIPPER: (np.float32, (None, None, 2)),
    ACTION: (np.float32, (None, None, None)),
}
"""Data type and shape of the arrays in a file of labels, which have one row for each label."""


def relabel_episode(scene: SceneConfig, strategies: Strategies, checkpoint: str, seed: int) -> Arrays:
    """Roll the policy out in one scene, in a worker process, and return labels for the visited states.

    Returns:
        Arrays of S labels by name; S may be 0. The arrays are the observations ``frames.SEEN`` (S, T, ...) and
        ``action`` (S, H, m + 2).

    Raises:
        InputError: the checkpoint cannot be used.
    """
    env, profile, step = simulator(scene), robot(scene.robot), scene.task.steps[0]
    controller = PolicyController(checkpoint)
    # Read the spec before the first action. During a chunk it may contain only the robot's state.
    spec = controller.observation_spec
    config, ways = controller.config, parsed(strategies)
    env.reset(seed)
    planner = StepPlanner(profile)
    found = planned_way(planner, env.scene_state(), step, {name: ways[name] for name in step.strategies}, ())
    if found is None:
        return {}
    way, _, began = found
    stood = env.measure().openness[step.object]
    past: deque[Arrays] = deque(maxlen=1 + config.stride * (config.history - 1))
    samples: list[Arrays] = []
    for number in range(profile.steps(scene.task.max_seconds)):
        measured = env.measure()
        if abs(measured.openness[step.object] - stood) > MOVED or _is_on_last_way(began, profile, env.q):
            break
        try:
            observation = env.observe(spec)
        except EmptyCloudError:
            break
        if number == 0:
            controller.reset(observation, seed)
        past.append({name: np.asarray(observation[name], dtype=np.float32) for name in SEEN})
        if number and number % EVERY == 0:
            label = _label(env, planner, way, began, ways, profile, observation, config.horizon)
            if label is not None:
                newest = len(past) - 1
                back = range(config.history - 1, -1, -1)
                frames = [past[max(0, newest - config.stride * each)] for each in back]
                samples.append({name: np.stack([frame[name] for frame in frames]) for name in SEEN} | {ACTION: label})
        action = controller.act(observation)
        if action is None:
            break
        env.step(action)
    return {name: np.stack([each[name] for each in samples]) for name in samples[0]} if samples else {}


def _label(
    env: HeadlessEnv,
    planner: StepPlanner,
    way: str,
    began: StepPlan,
    ways: Mapping[str, Any],
    profile: RobotProfile,
    observation: Observation,
    horizon: int,
) -> npt.NDArray[np.float32] | None:
    """Return the actions (H, m + 2) of a new plan, or None if it is partial, touches early, or has another contact."""
    scene = env.scene_state()
    planned = planner.plan(scene, env.task.steps[0], ways[way], warm_start=began.plan)
    if planned.rank > 0 or not same_pose(began, planned):
        return None
    arm = profile.arm_size
    actions = _from_fingers_on(ChainPlan(way, planned, scene, 0, "", profile).actions, observation, profile)
    rows = np.minimum(np.arange(horizon), len(actions) - 1)
    chunk = np.empty((horizon, arm + EXTRA), np.float32)
    chunk[:, :arm] = actions[rows, :arm] - observation.joint_positions[:arm]
    chunk[:, arm] = actions[rows, arm]
    chunk[:, arm + 1] = np.where(np.arange(horizon) >= len(actions), 1.0, -1.0)
    return chunk


def _from_fingers_on(
    actions: npt.NDArray[np.float32], observation: Observation, profile: RobotProfile
) -> npt.NDArray[np.float32]:
    """Return the actions of a plan. The wait for the fingers at its start is left out if they are already there."""
    arm = profile.arm_size
    fingers = observation.joint_velocities[list(profile.gripper_columns)]
    if abs(observation.gripper_command - float(actions[0, arm])) > STILL or np.abs(fingers).max() > SLOW:
        return actions
    moved = np.abs(actions[:, :arm] - actions[0, :arm]).max(axis=1) > STILL
    return actions[int(moved.argmax()) :]


def same_pose(one: StepPlan, other: StepPlan) -> bool:
    """Return whether the hand poses at the contact of two plans are nearly equal."""
    first, second = (_actuation(each) for each in (one, other))
    if first is None or second is None:
        return False
    near = float(np.linalg.norm(first[:3, 3] - second[:3, 3])) <= NEAR
    cosine = 0.5 * (float(np.trace(first[:3, :3].T @ second[:3, :3])) - 1.0)
    return near and float(np.arccos(np.clip(cosine, -1.0, 1.0))) <= TURNED


def _is_on_last_way(began: StepPlan, profile: RobotProfile, q: npt.NDArray[np.float64]) -> bool:
    """Return whether the hand has passed the approach pose. A new plan would first move it away."""
    actuation, approach = _actuation(began), _keyframe(began, "pre_0")
    if actuation is None or approach is None:
        return False
    hand = profile.model.forward_kinematics(q)[:3, 3]
    length = float(np.linalg.norm(approach[:3, 3] - actuation[:3, 3]))
    near = float(np.linalg.norm(hand - actuation[:3, 3])) < LAST * length
    return near or float(np.linalg.norm(hand - approach[:3, 3])) < NEAR


def _actuation(planned: StepPlan) -> npt.NDArray[np.float64] | None:
    return _keyframe(planned, "actuation")


def _keyframe(planned: StepPlan, label: str) -> npt.NDArray[np.float64] | None:
    frames = () if planned.plan is None else planned.plan.keyframes
    return next((np.asarray(each["T_base_hand"]) for each in frames if each["label"] == label), None)


@dataclass(frozen=True)
class Relabels:
    """DAgger training data of one task: visited states with the planner's actions as labels.

    Attributes:
        language: instruction of the task, in natural language.
        arrays: arrays by name, as returned by :func:`relabel_episode`.
    """

    language: str
    arrays: Arrays

    def __len__(self) -> int:
        return len(self.arrays[ACTION]) if self.arrays else 0

    @staticmethod
    def of(language: str, episodes: Sequence[Arrays]) -> Relabels:
        """Join the labels of several episodes."""
        found = [each for each in episodes if each]
        arrays = {name: np.concatenate([each[name] for each in found]) for name in found[0]} if found else {}
        return Relabels(language, arrays)

    def save(self, path: Path) -> None:
        """Write the labels atomically.

        Raises:
            WriteError: the folder cannot be written to.
        """
        write_arrays(path, {"language": np.array(self.language), **self.arrays})

    @staticmethod
    def load(path: Path) -> Relabels:
        """Read a file of labels.

        Raises:
            InputError: the file is damaged.
        """
        arrays = read_arrays(path)
        require_shapes(arrays, _LANGUAGE if arrays.keys() <= _LANGUAGE.keys() else {**_LANGUAGE, **_COLUMNS}, path)
        return Relabels(str(arrays.pop("language")), arrays)


class RelabelledSource:
    """Demonstrations mixed with labels of the same tasks.

    Args:
        demonstrations: the demonstrations.
        relabels: labels of each task and DAgger round. The demonstrations must have the instructions of these tasks.
    """

    def __init__(self, demonstrations: Demonstrations, relabels: Sequence[Relabels]) -> None:
        self._demonstrations = demonstrations
        self._relabels = [each for each in relabels if len(each)]
        self.robot, self.action = demonstrations.robot, demonstrations.action
        self.observation, self.sentences = demonstrations.observation, demonstrations.sentences
        count = sum(len(each) for each in self._relabels)
        self.record = demonstrations.record.model_copy(update={"relabels": count, "digest": self._digest()})

    def draw(self, rng: np.random.Generator, size: int) -> dict[str, torch.Tensor]:
        """Return a batch of demonstrations in which a fraction ``SHARE`` of the samples are labels."""
        few = round(SHARE * size) if self._relabels else 0
        found = self._demonstrations.draw(rng, size - few)
        if not few:
            return found
        which = rng.integers(len(self._relabels), size=few)
        rows = [int(rng.integers(len(self._relabels[task]))) for task in which]
        pairs = list(zip(which, rows, strict=True))
        for name in (*SEEN, ACTION):
            drawn = np.stack([self._relabels[task].arrays[name][row] for task, row in pairs])
            found[name] = torch.cat([found[name], torch.from_numpy(drawn)])
        # Labels of DAgger have no key poses, which NaN marks.
        for name in (KEY_POSITIONS, KEY_ROTATIONS):
            if name in found:
                found[name] = torch.cat([found[name], torch.full((few, *found[name].shape[1:]), torch.nan)])
        sentences = [self.sentences.index(self._relabels[task].language) for task in which]
        found[SENTENCE] = torch.cat([found[SENTENCE], torch.tensor(sentences, dtype=found[SENTENCE].dtype)])
        return found

    def some_clouds(self, max_clouds: int) -> Any:
        return self._demonstrations.some_clouds(max_clouds)

    def _digest(self) -> str:
        import hashlib

        found = hashlib.sha256(self._demonstrations.record.digest.encode())
        for each in self._relabels:
            found.update(each.language.encode())
            for name, values in sorted(each.arrays.items()):
                found.update(name.encode() + np.ascontiguousarray(values).tobytes())
        return found.hexdigest()
