"""Select the devices for a training run."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from gensim2.core.errors import InputError


def read_devices(names: str) -> tuple[torch.device, ...]:
    """Return the devices of a training run. The optimizer's state is on the first device.

    Args:
        names: ``"auto"`` (the first GPU, or the CPU without a GPU), or PyTorch devices such as ``"cuda:0,cuda:1"``.

    Raises:
        InputError: a device cannot be used, or CPUs and GPUs are mixed.
    """
    if names == "auto":
        return (torch.device("cuda" if torch.cuda.is_available() else "cpu"),)
    found = []
    for name in names.split(","):
        try:
            device = torch.device(name.strip())
            torch.zeros(1, device=device)
        except (RuntimeError, AssertionError) as error:
            reason = str(error).splitlines()[0]
            message = f"{name.strip()!r} cannot be used: {reason}"
            raise InputError(message, field="device", remedy="use cpu or auto") from error
        found.append(device)
    if len({device.type for device in found}) > 1:
        raise InputError(f"{names!r} mixes CPU and GPU devices", field="device", remedy="give GPUs only")
    return tuple(found)


def share_of(batch: int, devices: Sequence[torch.device]) -> int:
    """Return the number of samples of a batch that each device processes.

    Raises:
        InputError: the batch is not a multiple of the number of devices.
    """
    share, left = divmod(batch, len(devices))
    if left:
        message = f"is {batch}, which {len(devices)} devices cannot share"
        raise InputError(message, field="batch", remedy=f"make it a multiple of {len(devices)}")
    return share
