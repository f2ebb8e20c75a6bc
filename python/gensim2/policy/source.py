"""Define the interface of training data, such as demonstrations or plans."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
import torch

from gensim2.perception import ObservationSpec
from gensim2.policy.checkpoint import ActionSpec, DataRecord
from gensim2.policy.control import Shuffled

SENTENCE = "sentence"
"""Name of a batch's column of instruction indices, (B,) int64."""


class Source(Protocol):
    """Training data of a policy.

    Attributes:
        action: format of the targets that the policy learns to predict.
        observation: spec of the observations, which include point clouds.
        sentences: instructions of the tasks, without repetitions.
        record: description of the data, which is stored in checkpoints.
    """

    robot: str
    action: ActionSpec
    observation: ObservationSpec
    sentences: tuple[str, ...]
    record: DataRecord

    def draw(self, rng: np.random.Generator, size: int) -> Mapping[str, torch.Tensor]:
        """Return a batch.

        Args:
            rng: random generator that selects the samples.
            size: B, number of samples.

        Returns:
            Tensors by name: observations ``frames.SEEN`` (B, T, ...) in the base frame, the index ``sentence`` of each
            instruction, and the head's targets in the policy's frame.
        """
        ...

    def some_clouds(self, max_clouds: int) -> Shuffled:
        """Return the point clouds of at most ``max_clouds`` scenes, for the control experiment ``shuffled``.

        The scenes are chosen at regular intervals from all scenes of the data.
        """
        ...
