"""CPU time of a gradient step, measured before a training of so many minutes."""

from __future__ import annotations

import time

import numpy as np
import torch

from gensim2.policy.config import PolicyConfig, TrainConfig
from gensim2.policy.keypose.source import PlannedSource
from gensim2.policy.network import fresh_network
from gensim2.policy.source import Source
from gensim2.policy.text import prepare
from gensim2.policy.train import training_batch
from gensim2.seeding import rng

WARM_UP, PROBES, PROBE_S = 3, 5, 2.0
"""Steps by which the time of one is measured, at least, and the CPU seconds that they take: the first are slow."""
BESIDE = 1.15
"""Of a step's time, for the optimizer and the averages."""


def seconds_a_step(source: Source, policy: PolicyConfig, training: TrainConfig) -> float:
    """CPU seconds of a gradient step: the median of many on a network that is thrown away.

    The first ones are not counted: they touch memory for the first time, and take up to four times as long.
    """
    torch.set_num_threads(training.threads or 1)
    ways = len(source.ways) if isinstance(source, PlannedSource) else policy.ways
    config = PolicyConfig.of({**policy.to_dict(), "ways": ways, "points": source.observation.cloud.points})
    table = prepare(source.sentences, config)
    network = fresh_network(config, source.action.arm, table.shape[1:], 0).train()
    generator, draw, taken = torch.Generator().manual_seed(0), rng(0, "keypose/probe"), list[float]()
    while len(taken) < WARM_UP + PROBES or sum(taken) < PROBE_S:
        begin = time.process_time()
        batch = training_batch(source, config, table, draw, training.batch, training, generator)
        network.loss(batch, generator).backward()
        taken.append(time.process_time() - begin)
    return BESIDE * float(np.median(taken[WARM_UP:]))
