"""Read XML and meshes of untrusted robots and objects from regular files of limited size."""

from __future__ import annotations

import contextlib
import io
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gensim2.core.foreign.library import read_by_library
from gensim2.core.foreign.limits import MAX_MESH
from gensim2.core.foreign.tree import ForeignTree, read_input, read_regular

if TYPE_CHECKING:
    import trimesh

MAX_URDF = 16 * 2**20  # maximum size of a URDF or SRDF, bytes


def read_xml(file: Path) -> ET.Element:
    """Parse a URDF or SRDF file.

    Raises:
        InputError: the file cannot be read.
    """
    content = read_input(file, MAX_URDF)
    with read_by_library(file, "correct its XML"):
        return ET.fromstring(content)


@contextlib.contextmanager
def opened_mesh(file: Path) -> Iterator[trimesh.Scene]:
    """Yield the scene of a mesh file. An exception in the block is reported as a damaged file.

    Raises:
        InputError: the file is not a regular file, is too large, or is damaged.
    """
    import trimesh

    content = read_input(file, MAX_MESH)
    with read_by_library(file, "replace it with an intact mesh file", "is not a readable mesh"):
        beside: Any = _Beside(file)
        yield trimesh.load_scene(io.BytesIO(content), file.suffix.lstrip("."), resolver=beside, process=False)


class _Beside:
    """Resolver for trimesh that reads the materials and textures of a mesh from regular files in the mesh's folder."""

    def __init__(self, file: Path) -> None:
        self.file_name = file.name
        self._folder = ForeignTree(file.parent)

    def get(self, name: str) -> bytes:
        wanted = name.strip()
        # trimesh's own resolver tries the same paths in the same order
        candidates = (wanted, wanted.lstrip("/"), Path(wanted).name)
        found = next((each for each in candidates if self._folder.has(each)), wanted)
        return read_regular(self._folder.inside(found), MAX_MESH)

    __getitem__ = get
