"""Interface of training data: whatever draws batches, from demonstrations or from plans."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
import torch

from gensim2.perception import ObservationSpec
from gensim2.policy.checkpoint import ActionSpec, DataRecord
from gensim2.policy.control import Shuffled

SENTENCE = "sentence"
"""Name of a batch's numbers of sentences, (B,) int64."""


class Source(Protocol):
    """Data that a policy is trained on.

    Attributes:
        robot: name of the profile.
        action: what the targets mean.
        observation: what the clouds were made by.
        sentences: each once.
        record: what it is, for checkpoints.
    """

    robot: str
    action: ActionSpec
    observation: ObservationSpec
    sentences: tuple[str, ...]
    record: DataRecord

    def draw(self, rng: np.random.Generator, size: int) -> Mapping[str, torch.Tensor]:
        """Return a batch: columns as they were seen (``frames.SEEN``, (B, T, ...), base frame), ``sentence``, and the
        head's targets, in the policy's frame.

        Args:
            rng: draws which samples.
        """
        ...

    def some_clouds(self, max_clouds: int) -> Shuffled:
        """Clouds of at most so many scenes, evenly through the data."""
        ...
