"""Configuration of a policy: where its checkpoint is."""

from __future__ import annotations

from dataclasses import dataclass

from lerobot.configs import PreTrainedConfig
from lerobot.utils.constants import OBS_STR

from gensim2.perception.observation import CLOUD, GRIPPER, STATE, TOOL_POSE, VELOCITY

SEEN = tuple(f"{OBS_STR}.{name}" for name in (STATE, VELOCITY, TOOL_POSE, GRIPPER, CLOUD))
"""Names of the features that a policy is made for."""


@PreTrainedConfig.register_subclass("gensim2")
@dataclass
class GenSim2Config(PreTrainedConfig):
    """A checkpoint of ``gensim2 learn`` or ``gensim2 train``, of any head.

    Attributes:
        checkpoint: its folder; in a folder that ``save_pretrained`` wrote it lies beside ``config.json``.
    """

    checkpoint: str = ""
    push_to_hub: bool = False

    @property
    def observation_delta_indices(self) -> None:
        """The policy keeps its history itself."""
        return None

    @property
    def action_delta_indices(self) -> None:
        """It is not trained here."""
        return None

    @property
    def reward_delta_indices(self) -> None:
        """It knows no rewards."""
        return None

    def get_optimizer_preset(self) -> None:
        """None: ``gensim2 learn`` and ``gensim2 train`` train."""
        return None

    def get_scheduler_preset(self) -> None:
        """None, as the optimizer."""
        return None

    def validate_features(self) -> None:
        """Refuse an environment or a data set that does not show what the policy looks at.

        Raises:
            ValueError: names the features that are missing.
        """
        missing = [name for name in SEEN if name not in (self.input_features or {})]
        if missing:
            raise ValueError(f"a gensim2 policy needs {', '.join(missing)}: use --env.type=gensim2")
