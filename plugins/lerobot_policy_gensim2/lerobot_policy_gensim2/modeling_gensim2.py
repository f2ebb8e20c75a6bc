"""A policy of gensim2 behind LeRobot's interface: one controller for each environment of a batch."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import torch
from lerobot.policies import PreTrainedPolicy
from lerobot.utils.constants import OBS_STR
from torch import Tensor

from gensim2.perception import Observation, PointCloud
from gensim2.perception.observation import CLOUD, GRIPPER, STATE, TOOL_POSE, VELOCITY
from gensim2.policy.checkpoint import PolicyCheckpoint
from gensim2.policy.evaluating import policy_controller
from gensim2.robots import robot
from lerobot_policy_gensim2.configuration_gensim2 import GenSim2Config

INSIDE = "gensim2"
"""Folder of the checkpoint in one of LeRobot's."""


class GenSim2Policy(PreTrainedPolicy):
    """Gives the joint targets that ``gensim2 evaluate --checkpoint`` would.

    Args:
        config: says where the checkpoint is.
    """

    config_class = GenSim2Config
    name = "gensim2"

    def __init__(self, config: GenSim2Config, **_: Any) -> None:
        super().__init__(config)
        config.validate_features()
        self._folder = Path(config.checkpoint)
        self._checkpoint = PolicyCheckpoint.load(self._folder)
        self._profile = robot(self._checkpoint.robot)
        self._spec = policy_controller(self._folder)
        self.network = self._checkpoint.network  # the weights that LeRobot may count and move
        self._controllers: list[Any] = []
        self._last: list[np.ndarray | None] = []
        self._done: list[bool] = []
        self._step = 0

    @classmethod
    def from_pretrained(
        cls, pretrained_name_or_path: str | Path, *, config: GenSim2Config | None = None, **kwargs: Any
    ) -> GenSim2Policy:
        """Load what ``save_pretrained`` wrote; the folder holds the checkpoint as it is."""
        folder = Path(pretrained_name_or_path)
        config = GenSim2Config.from_pretrained(folder) if config is None else config
        config.checkpoint = str(folder / INSIDE)
        return cls(config).eval()

    def _save_pretrained(self, save_directory: Path, state_dict: dict[str, Tensor] | None = None) -> None:
        from lerobot_policy_gensim2.processor_gensim2 import make_gensim2_pre_post_processors

        self.config._save_pretrained(save_directory)
        for pipeline in make_gensim2_pre_post_processors(self.config):
            pipeline.save_pretrained(save_directory)
        leave = shutil.ignore_patterns("data", "training", "evaluation", "report.html", ".lock")
        shutil.copytree(self._folder, save_directory / INSIDE, ignore=leave, dirs_exist_ok=True)

    def reset(self) -> None:
        """Begin an episode in every environment of the next batch."""
        self._controllers, self._last, self._done, self._step = [], [], [], 0

    def select_action(self, batch: dict[str, Tensor], **_: Any) -> Tensor:
        """Return (B, m + 1) targets of the arm's joints in rad and the gripper from -1 to 1.

        A policy that says that it is done is asked no more, and stays where it is until :meth:`reset`.
        """
        count = len(batch[f"{OBS_STR}.{STATE}"])
        if not self._controllers:
            self._controllers = [self._spec.make() for _ in range(count)]
            self._last, self._done = [None] * count, [False] * count
        found = []
        for row in range(count):
            seen = self._observation(batch, row)
            if self._step == 0:
                self._controllers[row].reset(seen, row)
            action = None if self._done[row] else self._controllers[row].act(seen)
            if action is None:
                self._done[row], action = True, self._last[row]
            if action is None:  # done before it began
                arm = seen.joint_positions[list(self._profile.arm_columns)]
                action = np.append(arm, seen.gripper_command)
            self._last[row] = action
            found.append(torch.from_numpy(np.asarray(action, dtype=np.float32)))
        self._step += 1
        return torch.stack(found)

    def _observation(self, batch: dict[str, Tensor], row: int) -> Observation:
        arrays = {name: batch[f"{OBS_STR}.{name}"][row].cpu().numpy() for name in (STATE, VELOCITY, TOOL_POSE, GRIPPER)}
        cloud = batch[f"{OBS_STR}.{CLOUD}"][row].cpu().numpy()
        points = PointCloud(cloud[:, :3], np.rint(255 * cloud[:, 3:6]).astype(np.uint8), None)
        time = self._step / self._profile.control_hz
        return Observation(self._step, time, batch["task"][row], arrays, points, {})

    def predict_action_chunk(self, batch: dict[str, Tensor], **_: Any) -> Tensor:
        """Return the next action as a chunk of one: how far a policy acts without a look is its own affair."""
        return self.select_action(batch)[:, None]

    def get_optim_params(self) -> dict[str, Any]:
        """Refuse: see :meth:`forward`."""
        raise NotImplementedError("a policy of gensim2 is trained by `gensim2 learn` or `gensim2 train`")

    def forward(self, batch: dict[str, Tensor]) -> tuple[Tensor, dict[str, Any] | None]:
        """Refuse: ``gensim2 learn`` and ``gensim2 train`` train, with data that LeRobot's sets do not hold."""
        raise NotImplementedError("a policy of gensim2 is trained by `gensim2 learn` or `gensim2 train`")
