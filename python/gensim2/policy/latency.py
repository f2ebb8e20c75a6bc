"""Measure the time from an observation to an action, by stage, for every kind of head."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.perception import ObservationSpec
from gensim2.perception.cloud import candidates_for
from gensim2.policy.config import HEADS, PolicyConfig
from gensim2.policy.frames import SEEN, inputs_of
from gensim2.policy.network import CLOUD, PROPRIO, TEXT, fresh_network
from gensim2.policy.text import prepare
from gensim2.sim import HeadlessEnv

TASK = "CloseBox"
WARM_UP = 10
"""Number of decisions before the measurement starts."""


class Stopwatch:
    """Measures how long each stage of a repeated computation takes.

    Args:
        stages: names of the stages in order. The time of all stages together is measured as ``total``.
    """

    def __init__(self, *stages: str) -> None:
        self._stages = (*stages, "total")
        self._marks: list[tuple[float, float]] = []
        self._passes: list[npt.NDArray[np.float64]] = []

    def __len__(self) -> int:
        return len(self._passes)

    def begin(self) -> None:
        """Start measuring a run of the computation, and discard the previous run if it is unfinished."""
        self._marks = []
        self.mark()

    def mark(self) -> None:
        """End the current stage and start the next one."""
        self._marks.append((time.perf_counter(), time.process_time()))

    def keep(self) -> None:
        """Store the times of a finished run of the computation."""
        marks = np.array(self._marks)
        self._passes.append(np.vstack([np.diff(marks, axis=0), marks[-1:] - marks[:1]]))

    def percentiles(self, warm_up: int) -> dict[str, dict[str, float]]:
        """Return milliseconds by stage: ``p50`` and ``p95`` of wall time, and the median ``cpu`` time.

        Args:
            warm_up: number of passes at the beginning that are left out.
        """
        # The axes of the array are the run, the stage, and the clock (wall time or CPU time).
        times = np.array(self._passes[warm_up:])

        def by_stage(share: float, clock: int) -> dict[str, float]:
            found = 1e3 * np.percentile(times[..., clock], share, axis=0)
            return dict(zip(self._stages, found.round(3).tolist(), strict=True))

        return {"p50": by_stage(50, 0), "p95": by_stage(95, 0), "cpu": by_stage(50, 1)}


def measure_latencies(
    heads: Sequence[str] = HEADS,
    encoders: Sequence[str] = ("mlp",),
    *,
    points: int = 512,
    decisions: int = 100,
    threads: int = 1,
    device: str = "cpu",
    assets: str | None = None,
    settings: dict[str, Any] | None = None,
    progress: Progress = NULL_PROGRESS,
) -> dict[str, Any]:
    """Measure the latency of decisions in a simulated scene with batch size 1.

    The planner of ``keypose`` is not measured.

    The stages are ``observation`` (cameras, point cloud, state), ``inputs`` (transformation into the policy's frame)
    and ``network``. Their sum is ``total``.

    Args:
        heads, encoders: names of heads and encoders; all combinations are measured.
        points: number of points in a cloud.
        decisions: number of measured decisions, after ``WARM_UP`` decisions that are not measured.
        threads: number of PyTorch threads.
        assets: folder of the scene's objects, or the name of a built-in set.
        settings: further network settings of all measured policies.

    Returns:
        A dictionary with the entries ``rows`` (one for each combination), ``threads`` and ``decisions`` (the
        arguments), and ``load`` (load average of the machine at the start). A row contains the settings of the network,
        its number of weights under ``parameters``, and the times as returned by :meth:`Stopwatch.percentiles`.
    """
    kinds = []
    for encoder in encoders:
        for head in heads:
            config = PolicyConfig.of({**(settings or {}), "encoder": encoder, "head": head, "points": points})
            cloud = {"points": points, "candidates": candidates_for(points), "source": config.source}
            spec = ObservationSpec.of(cloud)
            kinds.append((config, spec))
    torch.set_num_threads(threads)
    load = os.getloadavg()[0]
    env = HeadlessEnv(TASK, assets=assets)
    env.reset(0)
    rows = []
    progress.start("latency", len(kinds))
    for config, spec in kinds:
        rows.append(_measure(env, spec, config, decisions, device))
        progress.advance()
    return {"schema_version": 1, "rows": rows, "threads": threads, "decisions": decisions, "load": load}


def _measure(
    env: HeadlessEnv, spec: ObservationSpec, config: PolicyConfig, decisions: int, device: str
) -> dict[str, Any]:
    table = prepare([env.task.description], config).to(device)
    arm = env.profile.arm_size
    network = fresh_network(config, arm, table.shape[1:], 0).eval().to(device)
    noise = torch.zeros(1, *network.head.noise, device=device)
    watch = Stopwatch("observation", "inputs", "network")
    env.step(env.profile.rest_action)
    for _ in range(decisions + WARM_UP):
        env.step(env.profile.rest_action)
        watch.begin()
        observation = env.observe(spec)
        frame = {name: np.array(observation[name], dtype=np.float32) for name in SEEN}
        watch.mark()
        seen = {
            name: torch.from_numpy(value).to(device).expand(1, config.history, *value.shape)
            for name, value in frame.items()
        }
        inputs = inputs_of(seen, config, arm)
        watch.mark()
        with torch.no_grad():
            found = network({CLOUD: inputs.cloud, PROPRIO: inputs.proprio, TEXT: table}, noise)
        (found if isinstance(found, torch.Tensor) else found[0]).cpu()
        watch.mark()
        watch.keep()
    return {
        "encoder": config.encoder,
        "head": config.head,
        "points": spec.cloud.points,
        "device": device,
        "parameters": sum(parameter.numel() for parameter in network.parameters()),
        **watch.percentiles(WARM_UP),
    }
