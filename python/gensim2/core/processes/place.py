"""The place where jobs run: worker processes of this machine, or Ray."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from gensim2.core.processes.executor import Executor
from gensim2.core.processes.pool import WorkerPool


def executor_at(ray: str | None) -> Callable[..., Executor]:
    """Return the constructor of executors, of the arguments of :class:`~gensim2.core.processes.WorkerPool`.

    Args:
        ray: ``"local"``, ``"auto"`` or ``HOST:PORT``; None: worker processes of this machine.

    Raises:
        InputError: ``ray`` is no address.
        MissingExtraError: Ray is not installed.
    """
    if ray is None:
        return WorkerPool
    from gensim2.core.processes.ray import RayPool, check_address

    check_address(ray)
    return partial(RayPool, ray)
