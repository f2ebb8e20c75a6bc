"""Time of a gradient step, measured before a training of so many minutes."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np
import torch

from gensim2.policy.config import PolicyConfig, TrainConfig
from gensim2.policy.devices import share_of
from gensim2.policy.gradient_step import GradientStep
from gensim2.policy.keypose.source import PlannedSource
from gensim2.policy.network import fresh_network
from gensim2.policy.replicas import Replicas
from gensim2.policy.source import Source
from gensim2.policy.text import prepare

WARM_UP, PROBES, PROBE_S = 3, 5, 2.0
"""Steps by which the time of one is measured, at least, and the seconds that they take: the first are slow."""
CPU = torch.device("cpu")
BESIDE = 1.15
"""Of a step's time, for the optimizer and the averages."""


def seconds_a_step(
    source: Source, policy: PolicyConfig, training: TrainConfig, devices: Sequence[torch.device] = (CPU,)
) -> float:
    """Seconds of a gradient step: the median of many on a network that is thrown away.

    The first ones are not counted: they touch memory for the first time, and take up to four times as long.

    Args:
        source, policy, training: of the training.
        devices: that share a batch. CPU seconds of all where they are CPUs, else seconds by the clock.
    """
    torch.set_num_threads(training.threads or 1)
    ways = len(source.ways) if isinstance(source, PlannedSource) else policy.ways
    config = PolicyConfig.of({**policy.to_dict(), "ways": ways, "points": source.observation.cloud.points})
    table, share = prepare(source.sentences, config), share_of(training.batch, devices)
    network = fresh_network(config, source.action.arm, table.shape[1:], 0).to(devices[0]).train()
    gradients = GradientStep(network, source, config, training, table.to(devices[0]), share)
    on_cpu, taken = devices[0].type == "cpu", list[float]()
    with Replicas(network, source, config, training, table, share, devices[1:]) as others:

        def clock() -> float:
            return time.process_time() + others.cpu_s if on_cpu else time.perf_counter()

        while len(taken) < WARM_UP + PROBES or sum(taken) < PROBE_S:
            begin = clock()
            others.begin(len(taken))
            others.mean_with(gradients(len(taken)))
            taken.append(clock() - begin)
    return BESIDE * float(np.median(taken[WARM_UP:]))
