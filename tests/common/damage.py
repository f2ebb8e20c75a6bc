"""Ways to damage an object folder, such as the one of ``conftest.write_chest``."""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

Change = Callable[[Path], object]


class Kind(NamedTuple):
    """A kind of damage, which is either refused with ``error`` or accepted with ``warning``."""

    name: str
    change: Change
    error: str | None = None
    warning: str = ""


LEFT = "textured_objs/left.obj"
CUBE_FACES = "f 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n"


def put(name: str, content: str | bytes) -> Change:
    """Return a function that replaces the content of a file."""
    data = content if isinstance(content, bytes) else content.encode()
    return lambda folder: (folder / name).write_bytes(data)


def swap(name: str, old: str, new: str, count: int = -1) -> Change:
    """Return a function that replaces text in a file."""

    def change(folder: Path) -> None:
        text = (folder / name).read_text()
        assert old in text
        (folder / name).write_bytes(text.replace(old, new, count).encode("utf-8", "surrogatepass"))

    return change


def urdf(old: str, new: str, count: int = 1) -> Change:
    """Return a function that replaces text in ``mobility.urdf``."""
    return swap("mobility.urdf", old, new, count)


def told(**fields: Any) -> Change:
    """Return a function that changes fields in ``info.json``; None removes a field."""

    def change(folder: Path) -> None:
        file = folder / "info.json"
        value = {**json.loads(file.read_text()), **fields}
        file.write_text(json.dumps({k: v for k, v in value.items() if v is not None}))

    return change


def cut(name: str, share: float) -> Change:
    """Return a function that truncates a file to the given share."""
    return lambda folder: (folder / name).write_bytes(
        (folder / name).read_bytes()[: int(share * (folder / name).stat().st_size)]
    )


def instead(name: str, make: Callable[[Path], object]) -> Change:
    """Return a function that replaces a file by something else."""

    def change(folder: Path) -> None:
        (folder / name).unlink()
        make(folder / name)

    return change


def link_to(target: str) -> Callable[[Path], object]:
    """Return a function that makes a symlink."""
    return lambda path: path.symlink_to(target)


def listen(path: Path) -> None:
    """Make a socket; paths of sockets have a length limit, so the name is relative to the folder."""
    here = Path.cwd()
    os.chdir(path.parent)
    try:
        with socket.socket(socket.AF_UNIX) as stream:
            stream.bind(path.name)
    finally:
        os.chdir(here)


def sparse(size: int) -> Callable[[Path], object]:
    """Return a function that makes a sparse file of zeros."""

    def make(path: Path) -> None:
        with path.open("wb") as stream:
            stream.truncate(size)

    return make


def outside(folder: Path) -> None:
    """Replace a mesh by a link to a valid mesh outside the folder."""
    mesh = folder / LEFT
    mesh.rename(folder.parent.parent / "left.obj")
    mesh.symlink_to(folder.parent.parent / "left.obj")


def inside(folder: Path) -> None:
    """Replace a mesh by a link to a valid mesh in another place of the folder."""
    mesh = folder / LEFT
    mesh.rename(folder / "left.obj")
    mesh.symlink_to("../left.obj")


def twice_in_json(folder: Path) -> None:
    """Repeat the field ``scale`` in the JSON text."""
    file = folder / "info.json"
    file.write_text('{"scale": 0.5, ' + file.read_text().lstrip()[1:])


def chain_of_links(count: int) -> Change:
    """Return URDF text of links in a chain of fixed joints."""
    return urdf(
        "</robot>",
        "".join(
            f'<link name="c{i}"/><joint name="k{i}" type="fixed"><parent link="{f"c{i - 1}" if i else "base"}"/>'
            f'<child link="c{i}"/></joint>'
            for i in range(count)
        )
        + "</robot>",
    )


def joint(name: str, parent: str, child: str, more: str = "") -> str:
    """Return URDF text of a fixed joint."""
    return f'<joint name="{name}" type="fixed"><parent link="{parent}"/><child link="{child}"/>{more}</joint>'


BOMB = (
    '<?xml version="1.0"?><!DOCTYPE r [<!ENTITY a "aaaaaaaaaa">'
    + "".join(f'<!ENTITY {chr(98 + i)} "{f"&{chr(97 + i)};" * 10}">' for i in range(9))
    + '<robot name="&j;">'
)
EXTERNAL = '<?xml version="1.0"?><!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/passwd">]><robot name="&a;">'
FIRST_TAG = '<?xml version="1.0"?><robot name="chest">'
MIMIC_LOOP = (
    '<link name="m1"/><link name="m2"/>'
    + joint("a", "base", "m1", '<mimic joint="b"/>')
    + joint("b", "base", "m2", '<mimic joint="a"/>')
    + "</robot>"
)
