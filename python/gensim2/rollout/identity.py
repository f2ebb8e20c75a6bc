"""Digests of the inputs of a run: a run that is gone on with must have the same."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import platform
import shlex
import subprocess
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gensim2.scenes.physics import Engine

if TYPE_CHECKING:
    from gensim2.objects import Library
    from gensim2.rollout.inputs import TaskInput

#: Distributions whose versions decide what an episode looks like, by the engine that simulates it.
VERSIONED: Mapping[Engine, tuple[str, ...]] = {
    "sapien": ("gensim2", "mani_skill", "sapien", "numpy", "torch", "h5py"),
    "mujoco": ("gensim2", "mujoco-core", "numpy", "h5py"),
}


def versions(engine: Engine) -> dict[str, str]:
    """Return the versions of Python and of the packages that decide the outcome.

    Args:
        engine: that simulates the episodes.
    """
    found = {"python": platform.python_version()}
    for name in VERSIONED[engine]:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = "absent"
    return found


def provenance() -> dict[str, str]:
    """Return where figures come from: commit of the sources (``unknown`` outside of a checkout), date, and command."""
    return {
        "commit": _commit(Path(__file__).parents[3]),
        "date": time.strftime("%Y-%m-%d"),
        "command": shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]]),
    }


def _commit(root: Path) -> str:
    """Commit of a checkout, with ``-modified`` where the sources in it are no longer those."""
    if not (root / ".git").exists():
        return "unknown"
    try:
        found = [
            subprocess.run(["git", "-C", str(root), *words], capture_output=True, text=True, check=True).stdout.strip()
            for words in (("rev-parse", "HEAD"), ("status", "--porcelain", "--", "python", "crates"))
        ]
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return f"{found[0]}-modified" if found[1] else found[0]


def digest(value: Any) -> str:
    """Digest of plain data: equal data, equal digest."""
    return hashlib.sha256(json.dumps(value, sort_keys=True, allow_nan=False).encode()).hexdigest()[:16]


def listing(library: Library, classes: Iterable[str]) -> str:
    """Digest of which objects there are: episodes draw from the list, so one object more is another run."""
    return digest({name: list(library.instances(name)) for name in classes})


def listings(given: Sequence[TaskInput]) -> dict[str, str]:
    """Of each class that tasks of one library draw from: the digest of its list."""
    return {name: listing(given[0].library, [name]) for name in _classes(given)}


def identity(given: Sequence[TaskInput]) -> dict[str, str]:
    """Of a run of several tasks on the objects of one library."""
    return {
        "tasks": digest([one.spec.model_dump(mode="json") for one in given]),
        "strategies": digest([one.strategies for one in given]),
        "objects": listing(given[0].library, _classes(given)),
    }


def _classes(given: Sequence[TaskInput]) -> list[str]:
    return sorted({thing.asset_class for one in given for thing in one.spec.objects.values()})
