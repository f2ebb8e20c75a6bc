r"""Flow head: the velocity of a straight line from noise to the chunk (Lipman et al. 2023; rectified flow).

:math:`x_t = (1 - t)\,\epsilon + t\, x_0` moves by :math:`x_0 - \epsilon`; Euler's rule integrates from t = 0 to 1.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import torch
from torch import nn

from gensim2.policy.heads.actions import ACTION, EXTRA, ActionScale
from gensim2.policy.heads.decoder import ActionDecoder

if TYPE_CHECKING:
    from gensim2.policy.config import PolicyConfig
    from gensim2.policy.heads.protocol import Context


class FlowHead(nn.Module):  # type: ignore[misc]
    """Flow matching over chunks.

    Args:
        config: of the policy.
        arm: m, number of the arm's joints.
        features: not looked at.
    """

    wants_features = False

    def __init__(self, config: PolicyConfig, arm: int, features: int = 0) -> None:
        super().__init__()
        self.noise = (config.horizon, arm + EXTRA)
        self.steps = config.denoise_steps
        self.scale = ActionScale(config.horizon, arm)
        self.decoder = ActionDecoder(config, arm)

    def fit(self, batch: Mapping[str, torch.Tensor]) -> None:
        """Set the scale of actions."""
        self.scale.fit(batch)

    def loss(self, context: Context, batch: Mapping[str, torch.Tensor], generator: torch.Generator) -> torch.Tensor:
        """Return the mean squared error of velocities at random times."""
        chunk = self.scale.normalized(batch[ACTION])
        made = {"generator": generator, "device": chunk.device}
        noise = torch.randn(chunk.shape, **made)
        time = torch.rand(len(chunk), **made)
        t = time[:, None, None]
        velocity = self.decoder((1 - t) * noise + t * chunk, 1 - time, context.tokens)
        return (velocity - (chunk - noise)).square().mean()

    def act(self, context: Context, noise: torch.Tensor) -> torch.Tensor:
        """Return chunks (B, H, m + 2)."""
        chunk = noise
        for step in range(self.steps):
            level = torch.full((len(chunk),), 1 - step / self.steps, device=chunk.device)
            chunk = chunk + self.decoder(chunk, level, context.tokens) / self.steps
        return self.scale.restored(chunk)
