"""Interface of heads."""

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
        tokens: (B, S, D) of the trunk, the readout first.
        cloud: (B, N, 3) coordinates of the present cloud in the policy's frame, m.
        points: (B, P, 3) those of the points that have features; all where no head wants them.
        features: (B, P, G) of ``points``; None unless the head wants them.
        sentence: (B, D) of the sentence alone; None where it is not looked at.
        pointed: what the pointer says; None where there is none.
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
        wants_features: whether it looks at features of the points.
        noise: shape, without the batch, of the standard normal numbers that :meth:`act` takes; empty: none.
    """

    wants_features: bool
    noise: tuple[int, ...]

    def fit(self, batch: Mapping[str, torch.Tensor]) -> None:
        """Set the normalization of targets, kept in buffers, from many samples, once before training."""
        ...

    def loss(self, context: Context, batch: Mapping[str, torch.Tensor], generator: torch.Generator) -> torch.Tensor:
        """Return the loss, a scalar.

        Args:
            batch: targets, in the policy's frame.
            generator: of everything that is drawn, on the tensors' device.
        """
        ...

    def act(self, context: Context, noise: torch.Tensor) -> torch.Tensor:
        """Return what the policy does, (B, ...), in SI units.

        Args:
            noise: (B, *self.noise) standard normal numbers.
        """
        ...
