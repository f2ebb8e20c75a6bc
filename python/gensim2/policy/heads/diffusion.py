r"""Diffusion head: predicts the chunk itself from a noisy one (Ho et al. 2020), and samples by DDIM (Song et al. 2021).

With the share :math:`\bar\alpha_t` of the signal, a noisy chunk is
:math:`x_t = \sqrt{\bar\alpha_t}\, x_0 + \sqrt{1 - \bar\alpha_t}\,\epsilon`. Predicting :math:`x_0` beats predicting
:math:`\epsilon` in imitation, and few steps do what many do.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import torch
from torch import nn

from gensim2.policy.heads.actions import ACTION, EXTRA, ActionScale
from gensim2.policy.heads.decoder import ActionDecoder

if TYPE_CHECKING:
    from gensim2.policy.config import PolicyConfig
    from gensim2.policy.heads.protocol import Context

LARGEST = 5.0
"""Deviations beyond which a predicted chunk is cut off."""


def signal_shares(levels: int) -> torch.Tensor:
    r"""(levels,) float64 :math:`\bar\alpha_t` of the cosine schedule (Nichol and Dhariwal 2021), falling."""
    t = torch.linspace(0.0, 1.0, levels + 1, dtype=torch.float64)
    f = torch.cos((t + 0.008) / 1.008 * math.pi / 2).square()
    betas = (1 - f[1:] / f[:-1]).clamp(max=0.999)
    return torch.cumprod(1 - betas, 0)


def ddim_levels(levels: int, steps: int) -> list[int]:
    """Levels of DDIM's steps, from the noisiest, ``levels - 1``, evenly down; the last step leads to no noise."""
    return [levels - 1 - levels * step // steps for step in range(steps)]


def ddim_step(noisy: torch.Tensor, clean: torch.Tensor, now: torch.Tensor, then: torch.Tensor) -> torch.Tensor:
    """Return the chunk of signal share ``then`` of one of share ``now``, deterministically.

    Args:
        noisy: of share ``now``.
        clean: the predicted one.
        now, then: scalars, 0 to 1.
    """
    noise = (noisy - now.sqrt() * clean) / (1 - now).sqrt()
    return then.sqrt() * clean + (1 - then).sqrt() * noise


class DiffusionHead(nn.Module):  # type: ignore[misc]
    """Diffusion over chunks.

    Args:
        config: of the policy.
        arm: m, number of the arm's joints.
        features: not looked at.
    """

    wants_features = False
    shares: torch.Tensor

    def __init__(self, config: PolicyConfig, arm: int, features: int = 0) -> None:
        super().__init__()
        self.noise = (config.horizon, arm + EXTRA)
        self.levels, self.steps = config.noise_levels, config.denoise_steps
        self.scale = ActionScale(config.horizon, arm)
        self.decoder = ActionDecoder(config, arm)
        self.register_buffer("shares", signal_shares(self.levels).float())

    def fit(self, batch: Mapping[str, torch.Tensor]) -> None:
        """Set the scale of actions."""
        self.scale.fit(batch)

    def loss(self, context: Context, batch: Mapping[str, torch.Tensor], generator: torch.Generator) -> torch.Tensor:
        """Return the mean squared error of chunks predicted from noisy ones of random levels."""
        chunk = self.scale.normalized(batch[ACTION])
        made = {"generator": generator, "device": chunk.device}
        level = torch.randint(0, self.levels, (len(chunk),), **made)
        share = self.shares[level][:, None, None]
        noisy = share.sqrt() * chunk + (1 - share).sqrt() * torch.randn(chunk.shape, **made)
        return (self._clean(noisy, level, context) - chunk).square().mean()

    def act(self, context: Context, noise: torch.Tensor) -> torch.Tensor:
        """Return chunks (B, H, m + 2)."""
        chunk, levels = noise, ddim_levels(self.levels, self.steps)
        for index, level in enumerate(levels):
            clean = self._clean(chunk, torch.full((len(chunk),), level, device=chunk.device), context)
            clean = clean.clamp(-LARGEST, LARGEST)
            if index == len(levels) - 1:
                return self.scale.restored(clean)
            chunk = ddim_step(chunk, clean, self.shares[level], self.shares[levels[index + 1]])
        raise AssertionError("there is at least one step")

    def _clean(self, noisy: torch.Tensor, level: torch.Tensor, context: Context) -> torch.Tensor:
        return self.decoder(noisy, (level + 1).to(noisy.dtype) / self.levels, context.tokens)
