r"""Heads that compute a chunk of actions by removing noise: diffusion (Ho et al. 2020) with DDIM sampling (Song et al.
2021), and rectified flow.

For diffusion, a noisy chunk is a mixture :math:`x_t = \sqrt{\bar\alpha_t}\, x_0 + \sqrt{1 - \bar\alpha_t}\,\epsilon` of
the true chunk :math:`x_0` and Gaussian noise :math:`\epsilon`. The fraction :math:`\bar\alpha_t` decreases as the noise
level t grows. The network predicts :math:`x_0`. In imitation learning this works better than predicting
:math:`\epsilon`, and it needs few denoising steps.
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
"""Bound (in standard deviations) to which values of a predicted normalized chunk are clipped."""


class FlowHead(DecodingHead):
    r"""Head that uses rectified flow (Lipman et al. 2023). It predicts the velocity along the straight line from a
    noise sample to the chunk.

    At the time t from 0 to 1, the point on this line is :math:`x_t = (1 - t)\,\epsilon + t\, x_0`, where
    :math:`\epsilon` is the noise and :math:`x_0` the chunk. The velocity along the line is :math:`x_0 - \epsilon`. To
    compute a chunk, Euler's method integrates the predicted velocity from t = 0 to 1.
    """

    def __init__(self, config: PolicyConfig, arm: int, features: int = 0) -> None:
        super().__init__(config, arm)
        self.noise, self.steps = self.size, config.denoise_steps

    def loss(self, context: Context, batch: Mapping[str, torch.Tensor], generator: torch.Generator) -> torch.Tensor:
        """Return the mean squared error of predicted velocities at random times t."""
        chunk = self.scale.normalized(batch[ACTION])
        made = {"generator": generator, "device": chunk.device}
        noise = torch.randn(chunk.shape, **made)
        time = torch.rand(len(chunk), **made)
        t = time[:, None, None]
        velocity = self.decoder((1 - t) * noise + t * chunk, 1 - time, context.tokens)
        return (velocity - (chunk - noise)).square().mean()

    def act(self, context: Context, noise: torch.Tensor) -> torch.Tensor:
        chunk = noise
        for step in range(self.steps):
            level = torch.full((len(chunk),), 1 - step / self.steps, device=chunk.device)
            chunk = chunk + self.decoder(chunk, level, context.tokens) / self.steps
        return self.scale.restored(chunk)


def signal_shares(levels: int) -> torch.Tensor:
    r"""Return the signal fraction :math:`\bar\alpha_t` of each noise level t, as an array (levels,) of float64.

    The fractions follow the cosine schedule of Nichol and Dhariwal (2021), so they decrease as the noise level grows.
    """
    t = torch.linspace(0.0, 1.0, levels + 1, dtype=torch.float64)
    f = torch.cos((t + 0.008) / 1.008 * math.pi / 2).square()
    betas = (1 - f[1:] / f[:-1]).clamp(max=0.999)
    return torch.cumprod(1 - betas, 0)


def ddim_levels(levels: int, steps: int) -> list[int]:
    """Return evenly spaced noise levels for the steps of DDIM, starting at the highest level, ``levels - 1``.

    After the last of these levels, DDIM goes to zero noise.
    """
    return [levels - 1 - levels * step // steps for step in range(steps)]


def ddim_step(noisy: torch.Tensor, clean: torch.Tensor, now: torch.Tensor, then: torch.Tensor) -> torch.Tensor:
    """Return the less noisy chunk after one deterministic DDIM step.

    Args:
        noisy: chunk with the signal fraction ``now``.
        clean: predicted chunk without noise.
        now, then: signal fractions before and after the step, scalars from 0 to 1.
    """
    noise = (noisy - now.sqrt() * clean) / (1 - now).sqrt()
    return then.sqrt() * clean + (1 - then).sqrt() * noise


class DiffusionHead(DecodingHead):
    shares: torch.Tensor

    def __init__(self, config: PolicyConfig, arm: int, features: int = 0) -> None:
        super().__init__(config, arm)
        self.noise, self.levels, self.steps = self.size, config.noise_levels, config.denoise_steps
        self.register_buffer("shares", signal_shares(self.levels).float())

    def loss(self, context: Context, batch: Mapping[str, torch.Tensor], generator: torch.Generator) -> torch.Tensor:
        """Return the mean squared error of chunks predicted from noisy chunks at random noise levels."""
        chunk = self.scale.normalized(batch[ACTION])
        made = {"generator": generator, "device": chunk.device}
        level = torch.randint(0, self.levels, (len(chunk),), **made)
        share = self.shares[level][:, None, None]
        noisy = share.sqrt() * chunk + (1 - share).sqrt() * torch.randn(chunk.shape, **made)
        return (self._clean(noisy, level, context) - chunk).square().mean()

    def act(self, context: Context, noise: torch.Tensor) -> torch.Tensor:
        """Denoise ``noise`` and return chunks (B, H, m + 2)."""
        chunk, levels = noise, ddim_levels(self.levels, self.steps)
        for index, level in enumerate(levels):
            clean = self._clean(chunk, torch.full((len(chunk),), level, device=chunk.device), context)
            clean = clean.clamp(-LARGEST, LARGEST)
            if index == len(levels) - 1:
                return self.scale.restored(clean)
            chunk = ddim_step(chunk, clean, self.shares[level], self.shares[levels[index + 1]])
        raise AssertionError("DDIM needs at least one step")

    def _clean(self, noisy: torch.Tensor, level: torch.Tensor, context: Context) -> torch.Tensor:
        return self.decoder(noisy, (level + 1).to(noisy.dtype) / self.levels, context.tokens)
