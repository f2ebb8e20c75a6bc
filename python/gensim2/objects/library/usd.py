"""Convert a USD file to a URDF file with meshes, which :mod:`gensim2.objects.library.importer` reads.

Objects are untrusted, so :mod:`gensim2.objects.library.usd_reader` reads the file in a subprocess with limited memory
and time.
"""

from __future__ import annotations

import os
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

from gensim2.core.errors import MissingExtraError
from gensim2.core.foreign.limits import MAX_OBJECT
from gensim2.core.foreign.process import Bounds, isolated
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.objects.library.folder import ObjectFolder

SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
CPU_S = 60  # maximum CPU time of the reader, s


def convert(source: Path, scratch: Path) -> tuple[Path, bool]:
    """Convert a USD file, and return the URDF file in the existing folder ``scratch``.

    Returns:
        The URDF file, and whether all collision shapes are convex.

    Raises:
        InputError: the file cannot be imported.
        MissingExtraError: usd-core is not installed.
    """
    if find_spec("pxr") is None:
        raise MissingExtraError("usd-core", "usd")
    tree = ObjectFolder(source.parent)
    bounds = replace(Bounds.of(len(tree.read(source.name, MAX_OBJECT))), cpu_s=CPU_S)
    return isolated(_convert, (source, scratch), source, bounds, NULL_PROGRESS)


def _convert(source: Path, scratch: Path, progress: Progress) -> tuple[Path, bool]:
    """Convert a file in the subprocess."""
    for name in [name for name in os.environ if name.startswith("PXR_")]:
        del os.environ[name]  # the PXR_ variables can name plugins to load and folders in which USD searches for files
    from gensim2.objects.library.usd_reader import read

    return read(source, scratch)
