"""Prepare batches for the network, and compute the gradients of a batch or of one device's part of the batch."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch

from gensim2.core.seeding import rng
from gensim2.policy.augment import augmented, off_its_way
from gensim2.policy.config import PolicyConfig, TrainConfig
from gensim2.policy.frames import SEEN, inputs_of
from gensim2.policy.network import CLOUD, PROPRIO, TEXT, PolicyNetwork
from gensim2.policy.source import SENTENCE, Source
from gensim2.robots import robot

if TYPE_CHECKING:
    import numpy as np


class GradientStep:
    """Computes gradients of a network on its device, for all samples of a step or for one device's part of the samples.

    Args:
        training: training settings; ``amp`` enables bfloat16 on a GPU.
        table: encoded instructions, on the network's device.
        size: number of samples that this device processes in a step.
        number: index of the device's part of the batch; every part contains different samples.
    """

    def __init__(
        self,
        network: PolicyNetwork,
        source: Source,
        config: PolicyConfig,
        training: TrainConfig,
        table: torch.Tensor,
        size: int,
        number: int = 0,
    ) -> None:
        self._network, self._source, self._config, self._training = network, source, config, training
        self._table, self._size = table, size
        self._purpose = f"policy/step/{number}" if number else "policy/step"
        self._loss = torch.compile(network.loss) if training.compile else network.loss
        self._bfloat16 = training.amp and table.device.type == "cuda"

    def __call__(self, step: int) -> float:
        """Store the gradients of a step in the network's parameters, and return the loss."""
        draw = rng(self._training.seed, self._purpose, step)
        where = self._table.device
        generator = torch.Generator(where).manual_seed(int(draw.integers(2**62)))
        batch = training_batch(self._source, self._config, self._table, draw, self._size, self._training, generator)
        with torch.autocast(where.type, torch.bfloat16, enabled=self._bfloat16):
            loss = self._loss(batch, generator)
        self._network.zero_grad(set_to_none=True)
        loss.backward()
        return float(loss.detach())


def training_batch(
    source: Source,
    config: PolicyConfig,
    table: torch.Tensor,
    draw: np.random.Generator,
    size: int,
    training: TrainConfig | None = None,
    generator: torch.Generator | None = None,
) -> dict[str, torch.Tensor]:
    """Return inputs and targets on the table's device, augmented if ``training`` and ``generator`` are given."""
    drawn = {name: value.to(table.device, non_blocking=True) for name, value in source.draw(draw, size).items()}
    if training is not None and generator is not None:
        if training.arm_noise > 0:
            drawn = off_its_way(drawn, robot(source.robot), training, generator)
        drawn = augmented(drawn, training, generator, ordered=config.encoder == "state")
    seen = {name: drawn.pop(name) for name in SEEN}
    inputs = inputs_of(seen, config, source.action.arm)
    return {CLOUD: inputs.cloud, PROPRIO: inputs.proprio, TEXT: table[drawn.pop(SENTENCE)], **drawn}
