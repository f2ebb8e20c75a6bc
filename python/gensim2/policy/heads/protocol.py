"""Define the interface of heads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import torch

if TYPE_CHECKING:
    from gensim2.policy.pointer import Pointed


@dataclass(frozen=True)
class Context:
    """Inputs of a head.

    Attributes:
        tokens: (B, S, D) tokens of the trunk. The first one, the readout token, summarizes the inputs.
        cloud: (B, N, 3) present point cloud in the policy's frame, m.
        points: (B, P, 3) points for which the trunk has features. If ``features`` is None, they are the whole cloud.
        features: (B, P, G) features of ``points``; None if the head needs no features.
        sentence: (B, D) encoding of the instruction; None if the policy ignores it.
        pointed: predicted hand poses at the next keyframes (:mod:`gensim2.policy.pointer`), or None.
    """

    tokens: torch.Tensor
    cloud: torch.Tensor
    points: torch.Tensor
    features: torch.Tensor | None
    sentence: torch.Tensor | None = None
    pointed: Pointed | None = None


class Head(Protocol):
    """Head of a policy: the part of the network that computes actions. A head is a ``torch.nn.Module``.

    Attributes:
        wants_features: whether the head needs features of the points.
        noise: shape of the standard normal noise of :meth:`act` for one sample. Empty if the head needs no noise.
    """

    wants_features: bool
    noise: tuple[int, ...]

    def fit(self, batch: Mapping[str, torch.Tensor]) -> None:
        """Compute the normalization of the targets from a large batch and store it in buffers.

        Call this once before training.
        """
        ...

    def loss(self, context: Context, batch: Mapping[str, torch.Tensor], generator: torch.Generator) -> torch.Tensor:
        """Return the loss, a scalar.

        Args:
            batch: targets, in the policy's frame.
            generator: random generator on the tensors' device.
        """
        ...

    def act(self, context: Context, noise: torch.Tensor) -> torch.Tensor:
        """Return the policy's output (B, ...) in SI units.

        Args:
            noise: (B, *self.noise) standard normal numbers.
        """
        ...
