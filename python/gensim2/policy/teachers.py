"""Create the demonstrations of a policy and train the policy, as a part of a ``gensim2 learn`` run.

The run limits the CPU time of demonstrations and training together.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from gensim2.core.errors import InputError
from gensim2.core.files import write_json
from gensim2.core.processes import Execution
from gensim2.core.progress import Progress
from gensim2.perception import ObservationSpec
from gensim2.policy.checkpoint import PolicyCheckpoint
from gensim2.policy.config import PolicyConfig, TrainConfig
from gensim2.policy.devices import read_devices, share_of
from gensim2.policy.gradient_step import GradientStep
from gensim2.policy.keypose.adding import BESIDE, DATA, plan_again, take_along
from gensim2.policy.keypose.data import Planned, plan_scenes
from gensim2.policy.keypose.source import PlannedSource
from gensim2.policy.keypose.teaching import pulls_last
from gensim2.policy.keypose.training import train_keypose
from gensim2.policy.learn_record import LEARN_JSON, LearnRecord
from gensim2.policy.network import fresh_network
from gensim2.policy.replicas import Replicas
from gensim2.policy.source import Source
from gensim2.policy.text import prepare
from gensim2.policy.train import TrainResult
from gensim2.rollout.counted_objects import number_of_objects
from gensim2.rollout.inputs import TaskInput

if TYPE_CHECKING:
    from gensim2.data.status import Status

DATA_SHARE = 0.4
"""Maximum fraction of the CPU time budget that is spent on data."""
LEAST_STEPS, MAX_STEPS = 20, 10_000
"""Minimum number of gradient steps, and maximum number of gradient steps for each task."""
EPISODES, PORTION = 600, 25
"""Maximum number of demonstrations of each task, and number collected between checks of the remaining time."""

How = tuple[PolicyConfig, TrainConfig, ObservationSpec, str]
"""Network and training settings, observation spec, and devices of the training."""


WARM_UP, PROBES, PROBE_S = 3, 5, 2.0
"""Measurement of the time of a step: unmeasured first steps, minimum number of steps, minimum total time (s)."""
CPU = torch.device("cpu")
OVERHEAD = 1.15
"""Factor on the measured time of a step that accounts for the optimizer and the averaged weights."""


def seconds_a_step(
    source: Source, policy: PolicyConfig, training: TrainConfig, devices: Sequence[torch.device] = (CPU,)
) -> float:
    """Measure the time of a gradient step (s).

    The time is the median over steps with a temporary network, times ``OVERHEAD``.

    The first steps are not counted, because they take up to four times as long as later steps.

    Args:
        source, policy, training: settings of the training.
        devices: devices that divide a batch. The result is the CPU time over all devices, or the wall time on GPUs.
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
    return OVERHEAD * float(np.median(taken[WARM_UP:]))


def teach_by_plans(
    group: Sequence[TaskInput],
    beside: Sequence[TaskInput],
    begun: PolicyCheckpoint | None,
    again: Sequence[TaskInput],
    folder: Path,
    out: Path,
    record: LearnRecord,
    how: How,
    execution: Execution,
    progress: Progress,
) -> tuple[dict[str, int], TrainResult]:
    from gensim2.rollout.runner import EpisodeRunner

    planned, spent = list[Planned](), 0.0
    if record.start is not None and begun is not None and not again:
        planned = take_along(Path(record.start[0]), folder, begun.data.tasks)
    parts = [(one, one.spec.name) for one in group] + [(one, f"{one.spec.name}{BESIDE}") for one in beside]
    objects = [number_of_objects(one) for one, _ in parts]
    of_task = Counter[str]()
    for (one, _), count in zip(parts, objects, strict=True):
        of_task[one.spec.name] += count
    limit, (config, training, spec, device) = DATA_SHARE * 60.0 * record.minutes / len(group), how
    with EpisodeRunner(group[0].scene.options, execution, progress) as evaluator:
        if again:
            planned, spent = plan_again(again, spec, folder, evaluator.executor, seed=record.seed, progress=progress)
        known = len(planned)
        for (one, name), count in zip(parts, objects, strict=True):
            made = plan_scenes(
                pulls_last(one),
                spec,
                folder / DATA / name,
                evaluator.executor,
                seed=record.seed,
                scenes=record.scenes,
                cpu_limit=limit * count / of_task[one.spec.name],
                verify=record.verify,
                engines=record.engines,
                progress=progress,
            )
            # Without demonstrations there are only examples of the class "done", which are useless.
            if made.demonstrations == 0:
                message = f"none of its {made.scenes} scenes could be planned; physics refuted {made.refuted}"
                remedy = "leave --generated out" if name.endswith(BESIDE) else "leave it out"
                raise InputError(message, field=f"tasks.{name}", remedy=remedy)
            planned.append(made)
    source, key = PlannedSource(planned, known), key_of(folder, out)
    record.data_cpu_s[key] = spent + sum(each.cpu_s for each in planned[known:])
    for each in planned[known:]:
        plans = f"{each.demonstrations} plans in {each.scenes} scenes"
        done = f"{_done_at_start(each)} already done at the start"
        left_out = f"{sum(each.failed.values()) - each.refuted} without a plan, {each.refuted} refuted by physics"
        of = f" ({each.record.scene['instances']})" if beside else ""
        progress.message(f"{each.record.task}{of}: {plans} ({done}, {left_out}), {each.cpu_s:.0f} s of CPU")
    policy = _hearing(config, record, len(group)) if begun is None else begun.config
    _decide_steps(
        record, key, len(group), lambda: seconds_a_step(source, policy, training, read_devices(device)), out, progress
    )
    training = TrainConfig.of({**training.to_dict(), "steps": record.steps[key], "seed": record.seed})
    trained = train_keypose(
        source, folder, policy=policy, training=training, start=begun, resume=True, device=device, progress=progress
    )
    taught = Counter[str]()
    for each in planned:
        taught[each.record.task] += each.demonstrations
    return dict(taught), trained


def _done_at_start(planned: Planned) -> int:
    """Return the number of scenes in which the task was done at the start, so that no step was planned."""
    seeds, is_step = planned.arrays["seed"], planned.arrays["way"] >= 0
    return len(np.setdiff1d(seeds[~is_step], seeds[is_step]))


def teach_by_episodes(
    group: Sequence[TaskInput],
    named: Sequence[str],
    folder: Path,
    out: Path,
    record: LearnRecord,
    how: How,
    execution: Execution,
    progress: Progress,
) -> tuple[dict[str, int], TrainResult]:
    from gensim2.data.collection import collect
    from gensim2.data.rendering import render
    from gensim2.policy.demonstrations import Demonstrations
    from gensim2.policy.train import train_policy

    data, key = folder / DATA, key_of(folder, out)
    limit, most = DATA_SHARE * 60.0 * record.minutes, min(EPISODES, record.scenes)
    scene: dict[str, Any] = dict(record.scene)
    config, training, spec, device = how
    collected = None
    while collected is None or (record.episodes[key] < most and record.data_cpu_s[key] < limit):
        # The record counts the CPU time and the episodes of earlier iterations and of interrupted runs.
        spent, count = record.data_cpu_s.get(key, 0.0), record.episodes.get(key, 0)
        # There may be a copied or interrupted data set. Its number of episodes must not fall.
        record.episodes[key] = max(_begun_with(data), min(count + PORTION, most) if spent < limit else count)
        tried = record.episodes[key] * len(named)
        progress.start(f"{', '.join(one.spec.name for one in group)}: demonstrations", tried)
        collected = collect(
            named,
            episodes=record.episodes[key],
            objects=record.objects,
            engines=record.engines,
            out=data,
            seed=record.seed,
            workers=execution.workers,
            resume=True,
            listener=_CollectionProgress(progress),
            **scene,
        )
        rendered = render(data, spec=spec, workers=execution.workers, resume=True, progress=progress)
        record.data_cpu_s[key] = spent + collected.cpu_s + rendered.cpu_s
        write_json(out / LEARN_JSON, record.model_dump(mode="json"))
    for task in collected.status.tasks:
        if task.held == 0:
            message = f"none of its {task.tried} demonstrations held"
            raise InputError(message, field=f"tasks.{task.name}", remedy="leave it out, or give more --minutes")
    policy = _hearing(config, record, len(group))
    source = Demonstrations.open([data], policy, (), progress=progress)
    _decide_steps(
        record, key, len(group), lambda: seconds_a_step(source, policy, training, read_devices(device)), out, progress
    )
    training = TrainConfig.of({**training.to_dict(), "steps": record.steps[key], "seed": record.seed})
    trained = train_policy(source, policy, training, folder, resume=True, device=device, progress=progress)
    return {task.name: task.held for task in collected.status.tasks}, trained


def _begun_with(data: Path) -> int:
    """Return the number of episodes of each task in the record of a data set; 0 if the data set does not exist."""
    from gensim2.data.dataset import DATASET_JSON, DataSet

    return DataSet.open(data).record.episodes if (data / DATASET_JSON).exists() else 0


class _CollectionProgress(Progress):
    """Shows the number of collected episodes in the current stage of a progress display."""

    def __init__(self, progress: Progress) -> None:
        self._progress, self._counted = progress, 0

    def message(self, text: str) -> None:
        self._progress.message(text)

    def update(self, status: Status) -> None:
        """Advance the progress by the number of episodes tried since the last update."""
        self._progress.advance(status.tried - self._counted)
        self._counted = status.tried


def _decide_steps(
    record: LearnRecord, key: str, tasks: int, seconds: Callable[[], float], out: Path, progress: Progress
) -> None:
    """Compute the number of gradient steps from the remaining CPU time; a resumed run keeps the recorded number."""
    if key not in record.steps:
        left = 60.0 * record.minutes - record.data_cpu_s[key]
        each = seconds()
        record.steps[key] = max(LEAST_STEPS, min(int(left / each), MAX_STEPS * tasks))
        if left <= 0:
            progress.message(
                f"the data took all of the {record.minutes:g} minutes: training uses the minimum number of steps"
            )
        progress.message(f"training: {record.steps[key]} steps of {1000 * each:.0f} ms")
    write_json(out / LEARN_JSON, record.model_dump(mode="json"))


def _hearing(policy: PolicyConfig, record: LearnRecord, tasks: int) -> PolicyConfig:
    """Return the network settings, with a text encoder if the policy learns several tasks."""
    text = (record.text or "small") if tasks > 1 else "none"
    told = {"text": text, "text_model": record.text_model or policy.text_model}
    return PolicyConfig.of({**policy.to_dict(), **told})


def key_of(folder: Path, out: Path) -> str:
    """Return the key of a policy in the record of a run: the policy's folder relative to the run's folder."""
    return str(folder.relative_to(out))
