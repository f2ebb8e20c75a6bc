"""Ways to damage a folder of objects, ``conftest.write_chest``'s above all."""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

Change = Callable[[Path], object]


class Kind(NamedTuple):
    """One kind of damage: refused with ``error``, or else accepted with ``warning``."""

    name: str
    change: Change
    error: str | None = None
    warning: str = ""


LEFT = "textured_objs/left.obj"
CUBE_FACES = "f 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n"


def put(name: str, content: str | bytes) -> Change:
    """Other content for one file."""
    data = content if isinstance(content, bytes) else content.encode()
    return lambda folder: (folder / name).write_bytes(data)


def swap(name: str, old: str, new: str, count: int = -1) -> Change:
    """Replace text in one file."""

    def change(folder: Path) -> None:
        text = (folder / name).read_text()
        assert old in text
        (folder / name).write_bytes(text.replace(old, new, count).encode("utf-8", "surrogatepass"))

    return change


def urdf(old: str, new: str, count: int = 1) -> Change:
    """Replace text in ``mobility.urdf``."""
    return swap("mobility.urdf", old, new, count)


def told(**fields: Any) -> Change:
    """Other fields in ``info.json``; None removes one."""

    def change(folder: Path) -> None:
        file = folder / "info.json"
        value = {**json.loads(file.read_text()), **fields}
        file.write_text(json.dumps({k: v for k, v in value.items() if v is not None}))

    return change


def cut(name: str, share: float) -> Change:
    """Only the first share of a file."""
    return lambda folder: (folder / name).write_bytes(
        (folder / name).read_bytes()[: int(share * (folder / name).stat().st_size)]
    )


def instead(name: str, make: Callable[[Path], object]) -> Change:
    """Something else in place of a file."""

    def change(folder: Path) -> None:
        (folder / name).unlink()
        make(folder / name)

    return change


def link_to(target: str) -> Callable[[Path], object]:
    """Maker of a symlink."""
    return lambda path: path.symlink_to(target)


def listen(path: Path) -> None:
    """Maker of a socket; its address has a length limit, so from inside the folder."""
    here = Path.cwd()
    os.chdir(path.parent)
    try:
        with socket.socket(socket.AF_UNIX) as stream:
            stream.bind(path.name)
    finally:
        os.chdir(here)


def sparse(size: int) -> Callable[[Path], object]:
    """Maker of a file of zeros that takes no room."""

    def make(path: Path) -> None:
        with path.open("wb") as stream:
            stream.truncate(size)

    return make


def outside(folder: Path) -> None:
    """A good mesh beside the folder, to which a link leads."""
    mesh = folder / LEFT
    mesh.rename(folder.parent.parent / "left.obj")
    mesh.symlink_to(folder.parent.parent / "left.obj")


def inside(folder: Path) -> None:
    """A good mesh elsewhere in the folder, to which a link leads."""
    mesh = folder / LEFT
    mesh.rename(folder / "left.obj")
    mesh.symlink_to("../left.obj")


def twice_in_json(folder: Path) -> None:
    """The field ``scale`` once more."""
    file = folder / "info.json"
    file.write_text('{"scale": 0.5, ' + file.read_text().lstrip()[1:])


def chain_of_links(count: int) -> Change:
    """Links joined by fixed joints, one after the other."""
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
    """A fixed joint."""
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
