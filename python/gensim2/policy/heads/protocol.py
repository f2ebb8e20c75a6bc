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
        tokens: (B, S, D) tokens of the trunk; the first is the readout token.
        cloud: (B, N, 3) present point cloud in the policy's frame, m.
        points: (B, P, 3) points that have features; all points of the cloud if the head does not need features.
        features: (B, P, G) features of ``points``; None if the head does not need them.
        sentence: (B, D) encoding of the instruction; None if the policy ignores it.
        pointed: predictions of the keyframe pointer; None without a pointer.
    """

    tokens: torch.Tensor
    cloud: torch.Tensor
    points: torch.Tensor
    features: torch.Tensor | None
    sentence: torch.Tensor | None = None
    pointed: Pointed | None = None


class Head(Protocol):
    """Head of a policy, a ``torch.nn.Module``.

    Attributes:
        wants_features: whether the head needs features of the points.
        noise: shape, without the batch axis, of the standard normal noise that :meth:`act` takes; may be empty.
    """

    wants_features: bool
    noise: tuple[int, ...]

    def fit(self, batch: Mapping[str, torch.Tensor]) -> None:
        """Compute the normalization of the targets from a large batch, once before training, and store it in
        buffers.
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
