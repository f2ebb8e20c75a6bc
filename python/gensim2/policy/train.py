"""Train policies with any head on any source of data."""

from __future__ import annotations

import contextlib
import copy
import hashlib
import math
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

import torch

from gensim2.core.errors import InputError
from gensim2.core.files import remove_temporaries
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.core.resumable import FolderLock, held_already
from gensim2.core.seeding import rng
from gensim2.policy.checkpoint import CONFIG_JSON, PolicyCheckpoint
from gensim2.policy.config import PolicyConfig, TrainConfig
from gensim2.policy.control import MAX_CLOUDS
from gensim2.policy.curves import CURVES, Curves, read_curves
from gensim2.policy.devices import read_devices, share_of
from gensim2.policy.frames import check_turns
from gensim2.policy.gradient_step import GradientStep, training_batch
from gensim2.policy.heads.keypose import KeyposeHead
from gensim2.policy.network import PolicyNetwork, fresh_network
from gensim2.policy.replicas import Replicas
from gensim2.policy.source import Source
from gensim2.policy.text import prepare
from gensim2.policy.train_state import STATE_JSON, Identity, TrainState
from gensim2.robots import robot

FITTED = 1024
"""Number of samples from which the normalization is computed."""

TRAINING = "training"
"""Name of the subfolder of a checkpoint's folder with training state and curves."""


_STOPPING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))


@contextlib.contextmanager
def deferred_signals() -> Iterator[Callable[[], bool]]:
    """Defer SIGINT, SIGTERM and SIGHUP to the end of the block, so that no optimizer step is interrupted.

    The context yields a function that returns whether a signal has arrived. At the end the first deferred signal is
    raised again. Ignored signals stay ignored. Outside the main thread no signal is deferred.
    """
    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return
    came: list[int] = []

    def note(number: int, _: FrameType | None) -> None:
        came.append(number)

    former = {number: signal.getsignal(number) for number in _STOPPING}
    kept = {number: handler for number, handler in former.items() if handler not in (signal.SIG_IGN, None)}
    try:
        for number in kept:
            signal.signal(number, note)
        yield lambda: bool(came)
    finally:
        for number, handler in kept.items():
            signal.signal(number, handler)
    if came:
        signal.raise_signal(came[0])


@dataclass(frozen=True)
class TrainResult:
    """Result of a finished training run.

    Attributes:
        folder: folder of the checkpoint.
        checkpoint: policy with the averaged weights.
        loss: mean loss of the last logged interval.
        steps: total number of steps.
        cpu_s: CPU time of all steps, s, including the steps before the run was resumed.
        parameters: number of weights.
    """

    folder: Path
    checkpoint: PolicyCheckpoint
    loss: float
    steps: int
    cpu_s: float
    parameters: int

    def to_dict(self) -> dict[str, Any]:
        data = self.checkpoint.data
        return {
            "schema_version": 1,
            "folder": str(self.folder),
            "loss": self.loss,
            "steps": self.steps,
            "cpu_s": round(self.cpu_s, 3),
            "parameters": self.parameters,
            "policy": self.checkpoint.config.to_dict(),
            "training": self.checkpoint.training.to_dict(),
            "tasks": list(data.tasks),
            "demonstrations": data.episodes - data.noisy,
            "noisy_episodes": data.noisy,
            "relabels": data.relabels,
            "episodes": data.episodes,
            "frames": data.frames,
            "data": data.digest,
        }


def train_policy(
    source: Source,
    config: PolicyConfig,
    training: TrainConfig,
    out: Path,
    *,
    start: PolicyCheckpoint | None = None,
    resume: bool = False,
    device: str = "auto",
    progress: Progress = NULL_PROGRESS,
) -> TrainResult:
    """Train a policy and write its checkpoint with the averaged weights of the last step.

    With the same CPU model, threads and devices, a resumed run gives the same bytes as an uninterrupted run.

    Args:
        config: settings of the network; with ``start``, the settings of the starting policy.
        out: folder of the checkpoint. Its subfolder ``training/`` has the state of the training and the loss curves.
        start: checkpoint with the initial weights and normalization. The state of the optimizer is new.
        resume: whether to continue an interrupted training run in ``out``.
        device: as for :func:`~gensim2.policy.devices.read_devices`; each batch is divided among several devices.

    Raises:
        InputError: settings and data do not fit, or ``out`` has another training or is in use.
        KeyboardInterrupt: a signal has arrived; the state is written first.
    """
    with FolderLock(out):
        # Other subfolders may be in use, for example by ``gensim2 learn``.
        remove_temporaries(out, subfolders=False)
        remove_temporaries(out / TRAINING)
        return _train(source, config, training, out, start, resume, device, progress)


def _train(
    source: Source,
    config: PolicyConfig,
    training: TrainConfig,
    out: Path,
    start: PolicyCheckpoint | None,
    resume: bool,
    device: str,
    progress: Progress,
) -> TrainResult:
    devices = read_devices(device)
    share_of(training.batch, devices)
    if training.threads:
        torch.set_num_threads(training.threads)
    profile = robot(source.robot)
    check_turns(profile, config)
    points = source.observation.cloud.points
    if config.points not in (None, points):
        message = f"the data have {points} points, the policy {config.points}"
        raise InputError(
            message, field="points", remedy=f"render with --points {config.points}, or train with {points}"
        )
    if training.yaw > 0 and config.frame == "base" and source.action.kind != "joint-relative":
        wrong = "needs joint-relative actions, or a policy whose setting 'frame' is 'turned'"
        raise InputError(wrong, field="yaw")
    if training.arm_noise > 0 and (source.observation.cloud.robot != "none" or config.head == "keypose"):
        message = "is of action chunks and clouds without the robot"
        raise InputError(message, field="arm_noise", remedy="render with --keep-robot none, or leave it out")
    if source.observation.cloud.source != config.source:
        message = f"is {config.encoder}, and the clouds are made of {source.observation.cloud.source}"
        raise InputError(
            message, field="encoder", remedy="the encoder state needs clouds of gensim2 render --source keypoints"
        )
    config = PolicyConfig.of({**config.to_dict(), "points": points})
    table = prepare(source.sentences, config)
    arm = source.action.arm
    network = fresh_network(config, arm, table.shape[1:], training.seed)
    if start is None:
        drawn, moved = rng(training.seed, "policy/fit"), None
        # This batch determines the scale of the actions, so it needs the noise that enlarges them.
        if training.arm_noise > 0:
            moved = torch.Generator(table.device).manual_seed(training.seed)
        network.fit(training_batch(source, config, table, drawn, FITTED, training, moved))
    else:
        _start_from(network, start, source)
    network.to(devices[0])
    state = TrainState(network, copy.deepcopy(network).eval(), optimizer_of(network, training))
    identity = _identity(source, config, training, start)
    folder = out / TRAINING
    if resume and (folder / STATE_JSON).exists():
        state.load(folder, identity)
    elif resume and (out / CONFIG_JSON).exists():
        said = "does not exist, so there is nothing to resume"
        raise InputError(said, file=folder / STATE_JSON, remedy="choose another --out")
    elif holds_training(out):
        raise held_already(out, "a policy")
    out.mkdir(parents=True, exist_ok=True)
    source.some_clouds(MAX_CLOUDS).save(out)
    loss = _run(state, source, table, config, training, folder, identity, devices, progress)
    checkpoint = PolicyCheckpoint(
        copy.deepcopy(state.average).cpu().eval(),
        source.robot,
        source.action,
        source.observation,
        source.sentences,
        table,
        source.record,
        training,
        state.step,
        _versions(),
    )
    checkpoint.save(out)
    parameters = sum(parameter.numel() for parameter in network.parameters())
    return TrainResult(out, checkpoint, loss, state.step, state.cpu_s, parameters)


def _run(
    state: TrainState,
    source: Source,
    table: torch.Tensor,
    config: PolicyConfig,
    training: TrainConfig,
    folder: Path,
    identity: Identity,
    devices: Sequence[torch.device],
    progress: Progress,
) -> float:
    """Run all remaining steps on all devices, and return the mean loss of the last logged interval."""
    share = share_of(training.batch, devices)
    gradients = GradientStep(state.network, source, config, training, table.to(devices[0]), share)
    with Replicas(state.network, source, config, training, table, share, devices[1:]) as others:

        def all_gradients(step: int) -> float:
            others.begin(step)
            return others.mean_with(gradients(step))

        return take_steps(state, all_gradients, training, folder, identity, progress, lambda: others.cpu_s)


def take_steps(
    state: TrainState,
    gradients: Callable[[int], float],
    training: TrainConfig,
    folder: Path,
    identity: Identity,
    progress: Progress = NULL_PROGRESS,
    more_cpu_s: Callable[[], float] = lambda: 0.0,
) -> float:
    """Run all remaining steps, and return the mean loss of the last logged interval.

    Args:
        state: state of the training run, which is saved to ``folder`` at intervals and at the end.
        gradients: function that stores the gradients of one step in the network's parameters and returns the loss.
        training: settings.
        folder: folder for the state and the loss curves.
        identity: all settings and data that determine the result of the run.
        more_cpu_s: function that returns the CPU time (s) of other processes since the start.

    Raises:
        InputError: the loss is not finite, or computing the gradients failed; the state is written first.
        KeyboardInterrupt: a signal has arrived; the state is written first.
    """
    parameters = [parameter for parameter in state.network.parameters() if parameter.requires_grad]
    curves = Curves(folder, state.step)
    state.network.train()
    progress.start("training", training.steps)
    progress.advance(state.step)
    began, spent = time.process_time(), state.cpu_s
    with curves, deferred_signals() as stop:
        while state.step < training.steps:
            try:
                loss = gradients(state.step)
            except InputError:  # A replica has ended unexpectedly; save the state before the error is raised.
                state.save(folder, identity)
                raise
            norm = torch.nn.utils.clip_grad_norm_(parameters, training.clip)
            rate = learning_rate(state.step, training)
            for group in state.optimizer.param_groups:
                group["lr"] = rate
            state.optimizer.step()
            _average(state.average, state.network, training.ema, state.step)
            state.step += 1
            state.cpu_s = spent + time.process_time() - began + more_cpu_s()
            state.losses.append(loss)
            if not math.isfinite(state.losses[-1]):
                message = f"the loss is {state.losses[-1]} at step {state.step}"
                raise InputError(message, field="training", remedy="lower the learning rate")
            progress.advance()
            if state.step % training.log_every == 0 or state.step == training.steps:
                state.loss = sum(state.losses) / len(state.losses)
                state.losses = []
                curves.add(
                    step=state.step, loss=state.loss, gradient=float(norm), learning_rate=rate, cpu_s=state.cpu_s
                )
            # Check once in each step. A signal during a save ends the run after the next step.
            stopping = stop()
            if stopping or state.step % training.save_every == 0 or state.step == training.steps:
                state.save(folder, identity)
            if stopping:
                break
    if state.loss is not None:
        return state.loss
    # State files of older versions do not contain the loss. In this case, read the last loss from the training curves.
    points = read_curves(folder)
    if not points:
        raise InputError("has no loss", file=folder / CURVES, remedy="delete the folder and train again")
    return float(points[-1]["loss"])


def holds_training(folder: Path) -> bool:
    """Return whether a folder contains a policy or the state of a training run."""
    return (folder / CONFIG_JSON).exists() or (folder / TRAINING / STATE_JSON).exists()


def learning_rate(step: int, training: TrainConfig) -> float:
    """Return the learning rate of a step (counted from 0): linear warm-up, then cosine decay to zero."""
    warmup = min(training.warmup, training.steps // 2)
    if step < warmup:
        return training.learning_rate * (step + 1) / warmup
    done = (step - warmup) / max(training.steps - warmup, 1)
    return training.learning_rate * 0.5 * (1 + math.cos(math.pi * done))


def optimizer_of(network: torch.nn.Module, training: TrainConfig) -> torch.optim.AdamW:
    """Return an AdamW optimizer whose weight decay applies only to the matrices of linear and convolution layers."""
    matrices = {id(m.weight) for m in network.modules() if isinstance(m, torch.nn.Linear | torch.nn.Conv1d)}
    groups: tuple[list[torch.nn.Parameter], list[torch.nn.Parameter]] = ([], [])
    for parameter in network.parameters():
        groups[id(parameter) in matrices].append(parameter)
    decay = training.weight_decay
    return torch.optim.AdamW(
        [{"params": groups[0], "weight_decay": 0.0}, {"params": groups[1], "weight_decay": decay}],
        lr=training.learning_rate,
        fused=True,
    )


@torch.no_grad()  # type: ignore[untyped-decorator]
def _average(average: torch.nn.Module, network: torch.nn.Module, decay: float, step: int) -> None:
    """Update the moving averages of the weights.

    The decay is smaller at first, so that the initial weights are forgotten.
    """
    share = 1.0 - min(decay, (1 + step) / (10 + step))
    pairs = list(zip(average.parameters(), network.parameters(), strict=True))
    torch._foreach_lerp_([a for a, _ in pairs], [b for _, b in pairs], share)
    for mine, other in zip(average.buffers(), network.buffers(), strict=True):
        mine.copy_(other)


def _start_from(network: PolicyNetwork, start: PolicyCheckpoint, source: Source) -> None:
    start.require_robot(source.robot, "--from")
    start.observation.require(source.observation, "the data", of="the policy given with --from")
    if start.action != source.action:
        wrong = f"the policy predicts actions of the type {start.action}, but the data contain {source.action}"
        raise InputError(wrong, file="--from", field="action")
    mine, its = network.config.to_dict(), start.config.to_dict()
    for name in mine:
        grows = name == "ways" and mine[name] > its[name]
        if mine[name] != its[name] and name not in ("execute", "denoise_steps") and not grows:
            message = f"has {its[name]!r}, the settings {mine[name]!r}"
            raise InputError(message, file="--from", field=name, remedy="leave the setting out")
    weights = dict(start.network.state_dict())
    if isinstance(network.head, KeyposeHead):
        assert isinstance(start.network.head, KeyposeHead)
        grown = network.head.grown(start.network.head.state_dict())
        weights |= {f"head.{name}": value for name, value in grown.items()}
    network.load_state_dict(weights)


def _identity(source: Source, config: PolicyConfig, training: TrainConfig, start: PolicyCheckpoint | None) -> Identity:
    """Return all settings and data that determine the result of a training run."""
    told = training.to_dict()
    for name in ("save_every", "log_every", "threads"):
        del told[name]
    what: dict[str, Any] = {
        "policy": config.to_dict(),
        "training": told,
        "data": source.record.model_dump(mode="json"),
        "action": source.action.model_dump(mode="json"),
        "sentences": list(source.sentences),
    }
    if start is not None:
        found = hashlib.sha256()
        for name, value in start.network.state_dict().items():
            found.update(name.encode() + value.detach().cpu().contiguous().numpy().tobytes())
        what["start"] = found.hexdigest()
    return Identity(what)


def _versions() -> dict[str, str]:
    from importlib.metadata import version

    return {name: version(name) for name in ("gensim2", "torch", "safetensors")}
