"""Devices of a training, by their names."""

from __future__ import annotations

import torch

from gensim2.errors import InputError


def read_devices(names: str) -> tuple[torch.device, ...]:
    """Return the devices of a training; the first holds its state.

    Args:
        names: ``"auto"``, the first GPU where there is one, or names of PyTorch's with commas: ``"cuda:0,cuda:1"``.

    Raises:
        InputError: one cannot be used.
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
    return tuple(found)
