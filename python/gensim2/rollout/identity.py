"""Compute digests of a run's inputs; a run can be resumed only if its digests are unchanged."""

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

#: Packages whose versions affect episodes, by simulation engine.
VERSIONED: Mapping[Engine, tuple[str, ...]] = {
    "sapien": ("gensim2", "mani_skill", "sapien", "numpy", "torch", "h5py"),
    "mujoco": ("gensim2", "mujoco-core", "numpy", "h5py"),
}


def versions(*engines: Engine) -> dict[str, str]:
    """Return the versions of Python and of the packages that affect results.

    Args:
        engines: simulation engines of the episodes.
    """
    found = {"python": platform.python_version()}
    for name in dict.fromkeys(name for engine in engines for name in VERSIONED[engine]):
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = "absent"
    return found


def provenance() -> dict[str, str]:
    """Describe the origin of results: commit of the sources (``unknown`` without a git checkout), date, and command."""
    return {
        "commit": _commit(Path(__file__).parents[3]),
        "date": time.strftime("%Y-%m-%d"),
        "command": shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]]),
    }


def _commit(root: Path) -> str:
    """Return the commit of a checkout, with the suffix ``-modified`` if its sources have changed."""
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
    """Return a hash of plain data: the first 16 hexadecimal digits of the SHA-256."""
    return hashlib.sha256(json.dumps(value, sort_keys=True, allow_nan=False).encode()).hexdigest()[:16]


def listing(library: Library, classes: Iterable[str]) -> str:
    """Return a hash of all ids in the given classes.

    A resumed run compares it to find out whether the library has changed.
    """
    return digest({name: list(library.instances(name)) for name in classes})


def listings(given: Sequence[TaskInput]) -> dict[str, str]:
    """Return a hash of the list of objects for each class that the tasks use."""
    return {name: listing(given[0].library, [name]) for name in _classes(given)}


def identity(given: Sequence[TaskInput]) -> dict[str, str]:
    """Return the hashes of a run's tasks, strategies and object ids."""
    return {
        "tasks": digest([one.spec.model_dump(mode="json") for one in given]),
        "strategies": digest([one.strategies for one in given]),
        "objects": listing(given[0].library, _classes(given)),
    }


def _classes(given: Sequence[TaskInput]) -> list[str]:
    return sorted({thing.asset_class for one in given for thing in one.spec.objects.values()})
