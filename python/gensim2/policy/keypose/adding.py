"""Plans of the tasks that a keypose policy knows already, for one that is to know more."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Unpack

from gensim2.errors import InputError
from gensim2.files import new_folder
from gensim2.policy.keypose.data import RECORD, Planned, PlannedRecord, read_planned
from gensim2.record_files import read_record
from gensim2.rollout.counted_objects import is_counted
from gensim2.rollout.inputs import TaskInput, read_task_input, scene_options
from gensim2.scenes.config import SceneArguments

DATA = "data"
"""Folder of a learned policy that holds the plans which taught it, a folder a task."""
REMEDY = "give a folder that gensim2 learn has made"


def taught_before(start: Path, known: Sequence[str], *, seed: int, **scene: Unpack[SceneArguments]) -> list[TaskInput]:
    """Tasks of a policy with the listed objects of this library that they were taught on; others are left out.

    Args:
        start: folder of the policy, as ``gensim2 learn`` left it.
        known: names of the policy's tasks.
        seed: of the run.
        scene: see :class:`~gensim2.scenes.config.SceneArguments`.

    Raises:
        InputError: the policy has no plans beside it.
    """
    found, here = [], scene_options(**scene).to_record()["assets"]
    for name in known:
        was = read_record(_plans(start, name) / RECORD, PlannedRecord, REMEDY).scene
        if was["assets"] == here and not is_counted(was["instances"]):
            found.append(read_task_input(name, seed=seed, **{**scene, "instances": was["instances"]}))
    return found


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
        there, here = _plans(start, name), folder / DATA / name
        if not here.exists():
            here.parent.mkdir(parents=True, exist_ok=True)
            with new_folder(here) as made:
                shutil.copytree(there, made, dirs_exist_ok=True)
        found.append(read_planned(here))
    return found


def _plans(start: Path, name: str) -> Path:
    folder = start / DATA / name
    if not folder.is_dir():
        raise InputError("the plans that taught it are not beside it", file=folder, remedy=REMEDY)
    return folder
