"""Plans of the tasks that a keypose policy knows already, for one that is to know more."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

from gensim2.errors import InputError
from gensim2.files import new_folder
from gensim2.policy.keypose.data import Planned, read_planned

DATA = "data"
"""Folder of a learned policy that holds the plans which taught it, a folder a task."""
RATE = 0.3
"""Of the learning rate of a training from nothing, for a network that knows something already."""


def take_along(start: Path, folder: Path, known: Sequence[str]) -> list[Planned]:
    """Copy the plans that taught a policy to another, and return them in the order of its tasks.

    Args:
        start: folder of the policy, as ``gensim2 learn`` left it.
        folder: of the other.
        known: names of the policy's tasks.

    Raises:
        InputError: the policy has no plans beside it.
    """
    found = []
    for name in known:
        there, here = start / DATA / name, folder / DATA / name
        if not there.is_dir():
            remedy = "give a folder that gensim2 learn has made"
            raise InputError("the plans that taught it are not beside it", file=there, remedy=remedy)
        if not here.exists():
            here.parent.mkdir(parents=True, exist_ok=True)
            with new_folder(here) as made:
                shutil.copytree(there, made, dirs_exist_ok=True)
        found.append(read_planned(here))
    return found
