"""Record an episode as an object that can be pickled. The arrays have the form of ManiSkill's trajectory files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.perception.observation import tool_pose
from gensim2.robots import RobotProfile
from gensim2.rollout.controller import Reference
from gensim2.rollout.record import Episode
from gensim2.rollout.world import Tree, World
from gensim2.tasks.criteria import all_hold
from gensim2.tasks.measurement import Measurement


@dataclass(frozen=True)
class Recording:
    """Data that ManiSkill's tools need to replay an episode of T steps.

    Attributes:
        seed: seed of the reset.
        reset_options: options with which the reset reproduces the scene, even if other instances are available later.
        instances: id of each object's instance.
        control_mode: control mode of the actions, as in ManiSkill.
        actions: (T, m + 1) float32 actions.
        obs: (T + 1, D) float32 state observations.
        env_states: float32 states (T + 1, ...) of the bodies. ``actors`` and ``articulations`` have them by name.
        rewards: (T,) float32 rewards.
        terminated, truncated, success: (T,) bool flags.
        reference: planned motion as float32 arrays (T, ...), if the controller reports it. ``joint_positions`` and
            ``joint_velocities`` have m values in a row, ``tool_pose`` 7 (base frame), and ``gripper`` 2: the distance
            of the pads, m, and the force of each finger, N. With noise there also is ``action`` without noise, m + 1
            values. Unknown values are NaN.
    """

    seed: int
    reset_options: dict[str, Any]
    instances: dict[str, str]
    control_mode: str
    actions: npt.NDArray[np.float32]
    obs: npt.NDArray[np.float32]
    env_states: Tree
    rewards: npt.NDArray[np.float32]
    terminated: npt.NDArray[np.bool_]
    truncated: npt.NDArray[np.bool_]
    success: npt.NDArray[np.bool_]
    reference: Tree = field(default_factory=dict)

    @property
    def steps(self) -> int:
        return len(self.actions)

    @property
    def meant(self) -> npt.NDArray[np.float32]:
        """Return the actions (T, m + 1) without added noise. Steps without a new action repeat the last one."""
        if "action" not in self.reference:
            return self.actions
        given = self.reference["action"]
        said = np.isfinite(given).all(axis=1)
        newest = np.maximum.accumulate(np.where(said, np.arange(len(given)), -1))
        return np.where((newest >= 0)[:, None], given[newest], self.actions)


@dataclass(frozen=True)
class EpisodeResult:
    """A finished episode, from the loop or from its file.

    Attributes:
        episode: record of the episode.
        recording: states, actions and flags of every control step; None if not requested or not stored.
    """

    episode: Episode
    recording: Recording | None = field(default=None, repr=False, compare=False)


class Recorder:
    """Collects the recording of an episode.

    Args:
        world: simulated world, just after its reset.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._obs = [world.observation(tool=False)]
        self._states: list[Tree] = [world.state()]
        self._actions: list[npt.NDArray[np.float32]] = []
        self._references: list[Reference | None] = []
        self._success: list[bool] = []
        self._truncated: list[bool] = []

    def add(self, action: npt.NDArray[np.float32], measured: Measurement, reference: Reference | None = None) -> None:
        """Add the result of one step, and the reference of its action."""
        world = self._world
        self._actions.append(action)
        self._references.append(reference)
        self._obs.append(world.observation(tool=False))
        self._states.append(world.state())
        self._success.append(all_hold(world.task.success, measured))
        self._truncated.append(world.elapsed_steps >= world.profile.steps(world.task.max_seconds))

    def finish(self) -> Recording:
        success = np.array(self._success, dtype=bool)
        instances = {name: placed.model.id for name, placed in self._world.initial_state.objects.items()}
        return Recording(
            seed=self._world.seed,
            reset_options=_plain({**self._world.reset_options, "instance": instances}),
            instances=instances,
            control_mode=self._world.control_mode,
            actions=np.stack(self._actions),
            obs=self._observed(),
            env_states=_stack(self._states),
            rewards=success.astype(np.float32),
            terminated=success,
            truncated=np.array(self._truncated, dtype=bool),
            success=success,
            reference=_reference(self._references, self._world.profile),
        )

    def _observed(self) -> npt.NDArray[np.float32]:
        """Return the observations (T + 1, D). One call computes the tool poses of all steps, which saves time."""
        obs = np.stack(self._obs)
        joints = len(self._world.profile.reset_qpos)
        obs[:, 2 * joints : 2 * joints + 7] = tool_pose(self._world.profile, obs[:, :joints])
        return obs


def _reference(given: list[Reference | None], profile: RobotProfile) -> Tree:
    if all(meant is None for meant in given):
        return {}
    size = profile.arm_size
    found = {
        "joint_positions": np.full((len(given), size), np.nan, np.float32),
        "joint_velocities": np.full((len(given), size), np.nan, np.float32),
        "tool_pose": np.full((len(given), 7), np.nan, np.float32),
        "gripper": np.full((len(given), 2), np.nan, np.float32),
    }
    steps = [step for step, meant in enumerate(given) if meant is not None]
    joints = np.tile(np.array(profile.reset_qpos, dtype=np.float32), (len(steps), 1))
    for row, step in enumerate(steps):
        meant = given[step]
        assert meant is not None
        joints[row, :size] = meant.joint_positions
        found["joint_velocities"][step], found["gripper"][step] = meant.joint_velocities, meant.gripper
        if meant.action is not None:
            found.setdefault("action", np.full((len(given), size + 1), np.nan, np.float32))[step] = meant.action
    found["joint_positions"][steps] = joints[:, :size]
    # A row of ``joints`` is NaN if no joint positions were planned. Such a row gets no tool pose.
    known = np.isfinite(joints).all(axis=1)
    if known.any():
        found["tool_pose"][np.array(steps)[known]] = tool_pose(profile, joints[known])
    return found


def _plain(value: Any) -> Any:
    """Return reset options as plain data; arrays and numbers become lists and floats."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    return value if value is None or isinstance(value, str) else np.asarray(value, dtype=np.float64).tolist()


def _stack(trees: list[Any]) -> Any:
    if isinstance(trees[0], dict):
        return {key: _stack([tree[key] for tree in trees]) for key in trees[0]}
    return np.stack(trees)
