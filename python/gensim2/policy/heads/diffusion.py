r"""Heads that denoise a chunk: diffusion (Ho et al. 2020), sampled by DDIM (Song et al. 2021), and rectified flow.

With the share :math:`\bar\alpha_t` of the signal, a noisy chunk is
:math:`x_t = \sqrt{\bar\alpha_t}\, x_0 + \sqrt{1 - \bar\alpha_t}\,\epsilon`. Predicting :math:`x_0` beats predicting
:math:`\epsilon` in imitation, and few steps do what many do.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import torch

from gensim2.policy.heads.actions import ACTION
from gensim2.policy.heads.decoder import DecodingHead

if TYPE_CHECKING:
    from gensim2.policy.config import PolicyConfig
    from gensim2.policy.heads.protocol import Context

LARGEST = 5.0
"""Deviations beyond which a predicted chunk is cut off."""


class FlowHead(DecodingHead):
    r"""The velocity of a straight line from noise to the chunk (Lipman et al. 2023; rectified flow).

    :math:`x_t = (1 - t)\,\epsilon + t\, x_0` moves by :math:`x_0 - \epsilon`; Euler's rule integrates from t = 0 to 1.
    """

    def __init__(self, config: PolicyConfig, arm: int, features: int = 0) -> None:
        super().__init__(config, arm)
        self.noise, self.steps = self.size, config.denoise_steps

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


class DiffusionHead(DecodingHead):
    """Diffusion over chunks."""

    shares: torch.Tensor

    def __init__(self, config: PolicyConfig, arm: int, features: int = 0) -> None:
        super().__init__(config, arm)
        self.noise, self.levels, self.steps = self.size, config.noise_levels, config.denoise_steps
        self.register_buffer("shares", signal_shares(self.levels).float())

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
