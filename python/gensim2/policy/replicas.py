"""Train with data parallelism: replicas of a network in separate processes process parts of every batch."""

from __future__ import annotations

import contextlib
import copy
import signal
import time
from collections.abc import Sequence
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess

import torch
import torch.multiprocessing  # This import lets processes share the memory of tensors.

from gensim2.core.errors import InputError
from gensim2.core.processes.fork_server import ignore_interrupts
from gensim2.core.processes.pool import start_process
from gensim2.policy.config import PolicyConfig, TrainConfig
from gensim2.policy.gradient_step import GradientStep
from gensim2.policy.network import PolicyNetwork
from gensim2.policy.source import Source

PATIENCE_S = 10.0
"""Time limit for a replica's process to end, s."""


class Replicas:
    """Replicas of a network in separate processes.

    In each step the replicas get the weights of the network and compute gradients. The mean of these gradients goes to
    the parameters of the network. Weights and gradients pass through shared memory within milliseconds. Each replica
    has its own copy of the data and stores nothing between steps.

    Args:
        source, config, training: as for :class:`~gensim2.policy.gradient_step.GradientStep`.
        table: encoded instructions, on the CPU.
        share: number of samples that each replica processes in a step.
        devices: devices of the replicas; if empty, no process is started.

    Attributes:
        cpu_s: CPU time that the replicas have spent on steps, s.

    Raises:
        InputError: a device cannot be used.
        WorkerStartError: a process cannot be started.
    """

    def __init__(
        self,
        network: PolicyNetwork,
        source: Source,
        config: PolicyConfig,
        training: TrainConfig,
        table: torch.Tensor,
        share: int,
        devices: Sequence[torch.device],
    ) -> None:
        self.cpu_s = 0.0
        self._network = network
        self._replicas: list[tuple[BaseProcess, Connection, torch.Tensor]] = []
        if not devices:
            return
        try:
            self._weights = torch.empty(_size(_values(network))).share_memory_()
            model = copy.deepcopy(network).cpu()
            for number, device in enumerate(devices, 1):
                gradients = torch.empty(_size(_taught(network))).share_memory_()
                arguments = model, source, config, training, table, share, number, device, self._weights, gradients
                process, pipe = start_process(_replica, arguments)
                self._replicas.append((process, pipe, gradients))
            for number in range(len(devices)):
                self._receive(number)
        except BaseException as error:
            self._end()
            # PyTorch has no exception type for a lack of shared memory, so this error is recognized by its message.
            if isinstance(error, RuntimeError) and "shared memory" in str(error):
                remedy = "free memory in /dev/shm, or train on one device"
                raise InputError("the machine has too little shared memory", field="device", remedy=remedy) from error
            raise

    def begin(self, step: int) -> None:
        """Start computing the gradients of a step with the network's current weights."""
        if self._replicas:
            _fill(self._weights, _values(self._network))
        for _, pipe, _ in self._replicas:
            # The pipe of a dead replica is broken. ``mean_with`` reports the cause.
            with contextlib.suppress(BrokenPipeError):
                pipe.send(step)

    def mean_with(self, loss: float) -> float:
        """Wait for the replicas, set the network's gradients to the mean over all devices, and return the mean loss.

        Args:
            loss: loss of the samples that the network itself has processed.

        Raises:
            InputError: a replica failed or was killed; the network's weights are unchanged.
        """
        count = 1 + len(self._replicas)
        taught = _taught(self._network)
        for number, (_, _, gradients) in enumerate(self._replicas):
            its_loss, cpu_s = self._receive(number)
            loss, self.cpu_s = loss + its_loss, self.cpu_s + cpu_s
            for parameter, part in zip(taught, _parts(gradients, taught), strict=True):
                there = part.to(parameter.device)
                parameter.grad = there if parameter.grad is None else parameter.grad.add_(there)
        if count > 1:
            torch._foreach_div_([parameter.grad for parameter in taught if parameter.grad is not None], count)
        return loss / count

    def _receive(self, number: int) -> tuple[float, float]:
        """Wait for a replica's message and return loss and CPU time of its step.

        The first message only reports its start.
        """
        process, pipe, _ = self._replicas[number]
        try:
            said: tuple[float, float] | str = pipe.recv()
        except (EOFError, OSError) as error:
            process.join(PATIENCE_S)
            message = f"number {number + 2} was lost, its process ended with {process.exitcode}"
            remedy = "go on with --resume, or on fewer devices; a script must train below `if __name__ == '__main__':`"
            raise InputError(message, field="device", remedy=remedy) from error
        if isinstance(said, str):
            message = f"number {number + 2} cannot be used: {said}"
            raise InputError(message, field="device", remedy="use fewer devices, or a smaller batch")
        return said

    def __enter__(self) -> Replicas:
        return self

    def __exit__(self, *_: object) -> None:
        self._end()

    def _end(self) -> None:
        for _, pipe, _ in self._replicas:
            with contextlib.suppress(OSError):
                pipe.send(None)
        for process, pipe, _ in self._replicas:
            process.join(PATIENCE_S)
            if process.is_alive():
                process.kill()
                process.join()
            pipe.close()
        self._replicas = []


def _replica(
    pipe: Connection,
    model: PolicyNetwork,
    source: Source,
    config: PolicyConfig,
    training: TrainConfig,
    table: torch.Tensor,
    share: int,
    number: int,
    device: torch.device,
    weights: torch.Tensor,
    gradients: torch.Tensor,
) -> None:
    """Compute the gradients of each step whose number arrives in the pipe, until the pipe closes or sends None."""
    ignore_interrupts()
    # These signals reach all processes of the group. A replica ignores them, because the trainer ends its replicas.
    for each in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(each, signal.SIG_IGN)
    if training.threads:
        torch.set_num_threads(training.threads)
    try:
        # The argument's memory is shared with the trainer, so the replica works on a copy.
        network = copy.deepcopy(model).to(device).train()
        take = GradientStep(network, source, config, training, table.to(device), share, number)
        taught = _taught(network)
        pipe.send((0.0, 0.0))
        with contextlib.suppress(EOFError):  # If the trainer is killed, the pipe closes and ``recv`` raises EOFError.
            while (step := pipe.recv()) is not None:
                begin, values = time.process_time(), _values(network)
                for value, part in zip(values, _parts(weights, values), strict=True):
                    value.copy_(part)
                loss = take(step)
                _fill(gradients, [torch.zeros_like(each) if each.grad is None else each.grad for each in taught])
                pipe.send((loss, time.process_time() - begin))
    except Exception as error:  # noqa: BLE001 - the trainer reports the error
        with contextlib.suppress(OSError):
            pipe.send(f"{type(error).__name__}: {str(error).partition(chr(10))[0]}")


def _values(network: torch.nn.Module) -> list[torch.Tensor]:
    """Return the floating-point weights and buffers, which are copied to the replicas."""
    with torch.no_grad():
        every = [*network.parameters(), *network.buffers()]
        return [each.detach() for each in every if each.is_floating_point()]


def _taught(network: torch.nn.Module) -> list[torch.nn.Parameter]:
    return [parameter for parameter in network.parameters() if parameter.requires_grad]


def _size(tensors: Sequence[torch.Tensor]) -> int:
    return sum(each.numel() for each in tensors)


def _parts(flat: torch.Tensor, tensors: Sequence[torch.Tensor]) -> list[torch.Tensor]:
    parts = flat.split([each.numel() for each in tensors])
    return [part.view_as(each) for part, each in zip(parts, tensors, strict=True)]


def _fill(flat: torch.Tensor, tensors: Sequence[torch.Tensor]) -> None:
    for part, each in zip(_parts(flat, tensors), tensors, strict=True):
        part.copy_(each.detach())
