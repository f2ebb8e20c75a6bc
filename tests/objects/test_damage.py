"""Folders of objects under damage: accepted, or refused in one line and in time, whatever the command.

Each kind of damage is one row of ``KINDS``: its name, what it does to the chest of ``conftest.write_chest``, and either
a pattern of the error, or ``None`` where the object is used all the same, with a pattern of the warning (``""``: there
is none).
"""

from __future__ import annotations

import json
import os
import re
import shutil
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from gensim2.cli import main as cli
from gensim2.inspection.validate import validate
from gensim2.objects import AssetError, open_library
from gensim2.objects.library.importer import import_object
from gensim2.objects.library.loading import load_all

LONGEST = 5.0  # s of CPU, convex decomposition apart

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

KINDS = (
    # Files that are none
    Kind("no info.json", lambda folder: (folder / "info.json").unlink(), r"info\.json: cannot be read: No such file"),
    Kind("info.json is a pipe", instead("info.json", os.mkfifo), r"info\.json: is a pipe, not a file"),
    Kind("info.json is a folder", instead("info.json", Path.mkdir), r"info\.json: is a folder, not a file"),
    Kind("info.json leads to a device", instead("info.json", link_to("/dev/zero")), r"info\.json: lies outside"),
    Kind("URDF is a pipe", instead("mobility.urdf", os.mkfifo), r"mobility\.urdf: is a pipe, not a file"),
    Kind("URDF leads nowhere", instead("mobility.urdf", link_to("gone")), r"mobility\.urdf: cannot be read: No such"),
    Kind("URDF leads to itself", instead("mobility.urdf", link_to("mobility.urdf")), r"cannot be read: .*symbolic"),
    Kind("mesh is a pipe", instead(LEFT, os.mkfifo), r"urdf: link link_1: visual: .*left\.obj is a pipe, not a file"),
    Kind("mesh is a folder", instead(LEFT, Path.mkdir), r"link link_1: visual: .*left\.obj is a folder, not a file"),
    Kind("mesh is a socket", instead(LEFT, listen), r"link link_1: visual: .*left\.obj is a socket, not a file"),
    Kind("mesh leads to a device", instead(LEFT, link_to("/dev/zero")), r"left\.obj lies outside the folder"),
    Kind("mesh leads out of the folder", outside, r"left\.obj lies outside the folder \(copy it"),
    Kind("mesh leads elsewhere inside", inside),
    Kind(
        "mesh path goes up", urdf(LEFT, "../left.obj"), r"link link_1: visual: \.\./left\.obj lies outside the folder"
    ),
    Kind("mesh path is a device", urdf(LEFT, "/dev/zero.obj"), r"/dev/zero\.obj lies outside the folder"),
    Kind("mesh path is overlong", urdf(LEFT, "x" * 5000 + ".obj"), r"xxx\.\.\. cannot be read: File name too long"),
    Kind("mesh path is empty", urdf(LEFT, ""), r"only mesh geometry is read"),
    Kind("mesh is missing", lambda folder: (folder / LEFT).unlink(), None, r"1 mesh files missing: textured_objs/left"),
    Kind("mesh is an STL file", urdf(LEFT, "textured_objs/left.stl"), r"'.*left\.stl' is no \.obj file \(convert"),
    Kind(
        "material file is a pipe",
        instead("textured_objs/left.mtl", os.mkfifo),
        r"left\.obj: mtllib: textured_objs/left\.mtl is a pipe",
    ),
    Kind(
        "material path goes up", swap(LEFT, "left.mtl", "../../../x.mtl"), r"left\.obj: mtllib: .*x\.mtl lies outside"
    ),
    Kind(
        "material file is missing", swap(LEFT, "left.mtl", "gone.mtl"), None, r"1 material files missing: .*gone\.mtl"
    ),
    Kind("a stray pipe lies in it", lambda folder: os.mkfifo(folder / "stray")),
    # Too much
    Kind("info.json is huge", instead("info.json", sparse(2**33)), r"info\.json: is larger than|holds over 512 MiB"),
    Kind("URDF is huge", instead("mobility.urdf", sparse(20 * 2**20)), r"mobility\.urdf: is larger than 16 MiB"),
    Kind("mesh is huge", instead(LEFT, sparse(40 * 2**20)), r"left\.obj is larger than 32 MiB"),
    Kind("folder is huge", lambda folder: sparse(2**40)(folder / "stray"), r"holds over 512 MiB"),
    Kind("50,001 elements", urdf("</robot>", "<x/>" * 50_001 + "</robot>"), r"urdf: has over 50000 elements"),
    Kind("nested 100,000 deep", urdf("</robot>", "<x>" * 10**5 + "</x>" * 10**5 + "</robot>"), r"over 64 levels deep"),
    Kind(
        "one mesh 10,000 times",
        urdf(
            "</robot>",
            '<link name="m">'
            + f'<visual><geometry><mesh filename="{LEFT}"/></geometry></visual>' * 10_000
            + "</link>"
            + joint("m", "base", "m")
            + "</robot>",
        ),
        None,
    ),
    Kind(
        "a face of 1,000,000 corners",
        put(LEFT, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf " + "1 2 3 " * 333_333),
        r"link link_1: collision: its meshes have over 2,000,000 triangles \(simplify",
    ),
    Kind(
        "3,000 materials",
        put(LEFT, "v 0 0 0\nv 1 0 0\nv 0 1 0\n" + "".join(f"usemtl m{i}\nf 1 2 3\n" for i in range(3000))),
        None,
        r"1 mesh files unreadable: .*3000 materials, at most 2000",
    ),
    Kind("chain of 5,000 links", chain_of_links(5_000)),
    Kind("1,000 keypoints", told(keypoints={f"k{i}": [0, 0, 0] for i in range(1000)}), r"1000 keypoints, at most 256"),
    # XML
    Kind("URDF is empty", put("mobility.urdf", ""), r"mobility\.urdf: not XML: no element found"),
    Kind("URDF is cut off", cut("mobility.urdf", 0.6), r"mobility\.urdf: not XML"),
    Kind("URDF is binary", put("mobility.urdf", bytes(range(256)) * 40), r"mobility\.urdf: not XML"),
    Kind("URDF is not UTF-8", put("mobility.urdf", b'<robot name="\xff\xfe\xff"/>'), r"mobility\.urdf: not XML"),
    Kind(
        "URDF in no known encoding", put("mobility.urdf", '<?xml version="1.0" encoding="zz"?><a/>'), r"urdf: not XML"
    ),
    Kind(
        "entities expand", urdf(FIRST_TAG, BOMB.replace("<robot", "]><robot")), r"has a DOCTYPE, which a URDF does not"
    ),
    Kind("entity reads a file", urdf(FIRST_TAG, EXTERNAL), r"has a DOCTYPE, which a URDF does not"),
    # Tree
    Kind("two joints of one name", urdf('"joint_1"', '"joint_0"'), r"joint joint_0: two joints have this name"),
    Kind(
        "two links of one name", urdf("</robot>", '<link name="base"/></robot>'), r"link base: two links have this name"
    ),
    Kind("a link without a name", urdf('link name="link_1"', "link"), r"urdf: link: '' is no name"),
    Kind("a link named as a path", urdf("link_0", "../../../link_0", -1), r"urdf: link: .* is no name \(1 to 100"),
    Kind(
        "a moving link named base",
        lambda folder: (urdf('"base"', '"root"', -1)(folder), urdf('"link_0"', '"base"', -1)(folder)),
        r"link base: a moving link cannot be named so",
    ),
    Kind("a joint without child", urdf('<child link="link_1"/>', ""), r"joint joint_1: a joint needs a parent and a"),
    Kind("a joint to no link", urdf('<child link="link_1"/>', '<child link="x"/>'), r"joint joint_1: no link 'x'"),
    Kind("two roots", urdf("</robot>", '<link name="lost"/></robot>'), r"2 root links, one is needed"),
    Kind("links in a circle", urdf('<parent link="base"/>', '<parent link="link_0"/>'), r"joints form a loop"),
    Kind("a link with two parents", urdf("</robot>", joint("x", "base", "link_1") + "</robot>"), r"hangs on joint_1"),
    Kind(
        "a loop apart",
        urdf("</robot>", '<link name="a"/><link name="b"/>' + joint("x", "a", "b") + joint("y", "b", "a") + "</robot>"),
        r"joint [xy]: joints form a loop",
    ),
    Kind(
        "joints that mimic each other", urdf("</robot>", MIMIC_LOOP), r"joint a: mimic: joints mimic each other: a -> b"
    ),
    Kind("a joint that mimics itself", urdf('<axis xyz="-1 0 0"/>', '<mimic joint="joint_0"/>'), r"mimic each other"),
    Kind(
        "a joint that mimics none", urdf('<axis xyz="-1 0 0"/>', '<mimic joint="x"/>'), r"joint_0: mimic: no joint 'x'"
    ),
    Kind(
        "it mimics a fixed joint", urdf('<axis xyz="-1 0 0"/>', '<mimic joint="joint_1"/>'), r"joint_1, which is fixed"
    ),
    Kind("a joint of no type", urdf(' type="revolute"', ""), r"joint joint_0: type: joint type ''"),
    # Numbers in the URDF
    Kind("an origin that is NaN", urdf('xyz="0 0.2 -0.4"', 'xyz="0 nan 0"'), r"joint_0: origin\.xyz: not three finite"),
    Kind("an origin at 1e30", urdf('xyz="0 0.2 -0.4"', 'xyz="0 1e30 0"'), r"origin\.xyz: 1e\+30 is beyond 1e\+06"),
    Kind("two numbers", urdf('xyz="0 0.2 -0.4"', 'xyz="0 0.2"'), r"joint_0: origin\.xyz: not three finite"),
    Kind("a zero axis", urdf('"-1 0 0"', '"0 0 0"'), r"joint joint_0: axis: zero axis"),
    Kind("limits that are NaN", urdf('upper="2"', 'upper="nan"'), r"joint_0: limit\.upper: not one finite number"),
    Kind("limits that are words", urdf('lower="0"', 'lower="1 2"'), r"joint_0: limit\.lower: not one finite number"),
    Kind(
        "limits reversed",
        lambda folder: (urdf('upper="2"', 'upper="-2"')(folder), told(joint_position_range=None)(folder)),
        r"joint_0: limit: empty range \(lower and upper",
    ),
    *(
        Kind(f"mesh scale {value}", urdf("<mesh ", f'<mesh scale="{value}" '), pattern)
        for value, pattern in (
            ("0 1 1", r"visual: mesh\.scale: must be positive"),
            ("1 -1 1", r"visual: mesh\.scale: must be positive"),
            ("nan 1 1", r"visual: mesh\.scale: not three finite numbers"),
            ("2", r"visual: mesh\.scale: not three finite numbers"),
        )
    ),
    # info.json
    Kind("info.json is empty", put("info.json", ""), r"info\.json: not JSON: Expecting value"),
    Kind("info.json is cut off", cut("info.json", 0.5), r"info\.json: not JSON"),
    Kind("info.json is a list", put("info.json", "[]"), r"info\.json: holds no fields"),
    Kind("info.json is not UTF-8", put("info.json", b'{"scale": "\xff"}'), r"info\.json: not JSON: 'utf-8' codec"),
    Kind("info.json is nested", put("info.json", "[" * 10**5), r"info\.json: not JSON: nested too deeply"),
    Kind(
        "a number of 5,000 digits", swap("info.json", "0.25", "9" * 5000, 1), r"info\.json: not JSON: Exceeds the limit"
    ),
    Kind("a field that stands twice", twice_in_json, r"info\.json: not JSON: field 'scale' stands twice"),
    Kind("a field that nobody knows", told(sclae=2), None, r"1 unknown fields of info\.json not used: sclae"),
    *(
        Kind(f"scale {value!r:.20}", told(scale=value), r"info\.json: scale: not a positive number in range")
        for value in (0, -1.0, True, "0.25", [0.25], 1e30, 1e-30, 10**400, float("nan"), float("inf"))
    ),
    *(
        Kind(f"keypoint {value!r:.20}", told(keypoints={"a": value}), r"keypoints\.a: not three finite numbers")
        for value in ("abc", ["0", "0", "0"], [0, 0], [0, 0, True], [0, 0, 1e30], [0, 0, 10**400], {"x": 0}, None)
    ),
    Kind("a keypoint far away", told(keypoints={"a": [0, 0, 100]}), r"keypoints\.a: its keypoint reaches to 25"),
    Kind("a keypoint without a name", told(keypoints={"": [0, 0, 0]}), r"keypoints: '' is no name"),
    Kind("a keypoint name of no text", told(keypoints={"\ud800\n": [0, 0, 0]}), r"keypoints: .* is no name"),
    Kind("keypoints in a list", told(keypoints=[1, 2]), r"keypoints: no keypoints"),
    Kind("descriptions in a list", told(keypoint_descriptions=["a"]), r"keypoint_descriptions: not a phrase"),
    Kind(
        "a description of no text",
        told(keypoint_descriptions={"a": "\ud800"}),
        r"descriptions\.a: .* cannot be printed",
    ),
    Kind("a range reversed", told(joint_position_range=[1, 0]), r"joint_position_range: not an increasing range"),
    Kind("a range of words", told(joint_position_range=["0", "1"]), r"joint_position_range: not two finite numbers"),
    Kind("a range of nothing", told(joint_position_range=[1, 1 + 1e-9]), r"joint_position_range: not an increasing"),
    Kind("an axis in a list", told(axis=["x"]), r"info\.json: axis: \['x'\] is not x, y or z"),
    Kind("a license that is a number", told(license=3), r"info\.json: license: 3 is no text"),
    # Meshes
    Kind("mesh is empty", put(LEFT, ""), None, r"1 mesh files unreadable: .*holds no triangle"),
    Kind("mesh is cut off", cut(LEFT, 0.5), None, r"1 mesh files unreadable: .*a vertex has under three numbers"),
    Kind("mesh is binary", put(LEFT, bytes(range(256)) * 400), None, r"1 mesh files unreadable"),
    Kind("mesh is STL in disguise", put(LEFT, b"solid left\nfacet normal 0 0 1\n"), None, r"holds no triangle"),
    Kind("a vertex that is NaN", swap(LEFT, "-0.5", "nan"), None, r"a vertex is not finite"),
    Kind("a vertex at 1e30", swap(LEFT, "-0.5", "1e30"), None, r"a vertex is beyond 1e\+06"),
    Kind("vertices of two numbers", swap(LEFT, " 0.4\n", "\n"), None, r"1 mesh files unreadable"),
    Kind("a face that refers to 0", swap(LEFT, "f 1 4", "f 0 4"), None, r"refers to a vertex that is not there"),
    Kind("a face that refers to 99", swap(LEFT, "f 1 4", "f 99 4"), None, r"refers to a vertex that is not there"),
    Kind(
        "a face that refers to 1e30", swap(LEFT, "f 1 4", f"f {10**30} 4"), None, r"refers to a vertex that is not th"
    ),
    Kind("a face that refers to -99", swap(LEFT, "f 1 4", "f -99 4"), None, r"refers to a vertex that is not there"),
    Kind("a face of two corners", swap(LEFT, "f 1 4 3 2", "f 1 4"), None, r"a face has under three corners"),
    Kind("lines end as in DOS", swap(LEFT, "\n", "\r\n")),
    Kind("lines are continued", swap(LEFT, "f 1 4 3 2", "f 1 4 \\\n3 2")),
    Kind(
        "words are parted by tabs", lambda folder: (swap(LEFT, "v ", "\tv\t")(folder), swap(LEFT, "f ", "f\t")(folder))
    ),
    Kind("faces count backwards", swap(LEFT, CUBE_FACES, "f -8 -5 -6 -7\n" + CUBE_FACES.split("\n", 1)[1])),
    Kind("faces with normals and textures", swap(LEFT, "f 1 4 3 2", "f 1/1/1 4//2 3/3 2")),
    Kind("a face of eight corners", swap(LEFT, "f 4 1 5 8", "f 4 1 1 1 5 5 5 8")),
    Kind(
        "a colour that is NaN", put("textured_objs/left.mtl", "newmtl paint\nKd nan 0 0\n"), None, r"colour that is no"
    ),
    Kind("materials that are binary", put("textured_objs/left.mtl", bytes(range(256)) * 40)),
    Kind(
        "a lid of no volume", put("textured_objs/lid.obj", "v 0 0 0\nv 0 0 0\nv 0 0 0\nf 1 2 3\n"), r"no collision geom"
    ),
    Kind(
        "a lid that is missing",
        lambda folder: (folder / "textured_objs/lid.obj").unlink(),
        r"no collision geometry \(1",
    ),
    Kind(
        "no body",
        lambda folder: [
            (folder / f"textured_objs/{n}.obj").unlink() for n in ("floor", "left", "right", "back", "front")
        ],
        None,
        r"5 mesh files missing",
    ),
)


#: What ``import`` does not read, and what it mends or leaves to the check after it.
ONLY_READ = (
    "info.json",
    "scale ",
    "keypoint",
    "description",
    "a range",
    "an axis",
    "license",
    "a field",
    "a number of",
)
MENDED = ("a lid of no volume", "it mimics a fixed joint", "a moving link named base", "folder is huge")


@pytest.fixture(scope="module")
def whole(chest: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A chest whose convex parts are known already."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GENSIM2_CACHE", str(tmp_path_factory.mktemp("cache")))
        folder = chest(tmp_path_factory.mktemp("assets") / "articulated_objs" / "box_rotate" / "1")
        open_library(folder.parents[1]).load("box_rotate", "1")
        yield folder


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_damage_is_accepted_or_refused_in_one_line(
    kind: Kind, whole: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "articulated_objs" / "box_rotate" / "1"
    shutil.copytree(whole, folder)
    kind.change(folder)
    began = time.process_time()
    code = cli.run(["assets", "show", "box_rotate/1", "--assets", str(tmp_path)])
    spent = time.process_time() - began
    output, printed = capfd.readouterr()
    errors = [line for line in printed.splitlines() if not line.startswith("preparing ")]
    if kind.error is None:
        assert (code, errors) == (0, [])
        notes = [line for line in output.splitlines() if line.startswith("note: ")]
        assert len(notes) == (1 if kind.warning else 0), notes
        assert re.search(kind.warning, "".join(notes))
    else:
        assert code == 2
        assert output == ""
        assert len(errors) == 1
        assert re.search(kind.error, errors[0])
        assert str(folder) in errors[0]
        assert len(errors[0]) < 800
    assert spent < LONGEST


@pytest.mark.parametrize(
    "kind", [kind for kind in KINDS if not any(word in kind.name for word in ONLY_READ)], ids=lambda kind: kind.name
)
def test_import_of_damage_ends_alike(kind: Kind, whole: Path, tmp_path: Path) -> None:
    folder = tmp_path / "objects" / "box_rotate" / "1"
    shutil.copytree(whole, folder)
    kind.change(folder)
    began = time.process_time()
    if kind.error is None or kind.name in MENDED:
        notes = import_object(folder, tmp_path / "mine", "box_rotate", "1").notes
        assert re.search(kind.warning, "\n".join(notes))
    else:
        with pytest.raises(AssetError) as refusal:
            import_object(folder, tmp_path / "mine", "box_rotate", "1")
        assert str(folder) in str(refusal.value)
        assert len(str(refusal.value).splitlines()) == 1
        assert not (tmp_path / "mine" / "articulated_objs" / "box_rotate" / "1").exists()
    assert time.process_time() - began < LONGEST


SAMPLE = ("info.json is a pipe", "URDF is a pipe", "mesh is a pipe", "mesh is missing", "scale 1e+30", "two roots")


def test_every_command_stands_damage(whole: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    kinds = [kind for kind in KINDS if kind.name in SAMPLE]
    assert len(kinds) == len(SAMPLE)
    library = tmp_path / "library"
    for number, kind in enumerate(kinds):
        folder = library / "box_rotate" / str(number)
        shutil.copytree(whole, folder)
        kind.change(folder)
    refused = [str(number) for number, kind in enumerate(kinds) if kind.error]
    words = ["--assets", str(library)]

    assert cli.run(["assets", "list", *words, "--json", "-"]) == 0
    listed = json.loads(capfd.readouterr().out)["classes"][0]["instances"]
    assert listed == [str(number) for number in range(len(kinds))]
    opened, items = open_library(library), [("box_rotate", number) for number in listed]
    assert [item[1] for item, reason in load_all(opened, items) if reason] == refused
    reports = validate(opened, items, physics=False)
    assert [r.id for r in reports if [f.check for f in r.findings] == ["loads"]] == refused
    out, picture = str(tmp_path / "out"), str(tmp_path / "x.png")
    for command in (("show",), ("export", "--out", out), ("render", "--out", picture)):
        assert cli.run(["assets", command[0], f"box_rotate/{refused[0]}", *command[1:], *words]) == 2
        errors = capfd.readouterr().err
        assert [line for line in errors.splitlines() if line.startswith("gensim2: ")] == [errors.splitlines()[-1]]


def test_an_unusable_neighbour_has_no_say_in_the_median(whole: Path, tmp_path: Path) -> None:
    for name, scale in (("1", None), ("2", 0.125), ("3", 1e30)):
        shutil.copytree(whole, tmp_path / "box_rotate" / name)
        told(scale=scale)(tmp_path / "box_rotate" / name)
    instance = open_library(tmp_path).load("box_rotate", "1")
    assert instance.warnings == ("no scale: 0.125, the median of its class",)


def test_mesh_scale_counts(whole: Path, tmp_path: Path) -> None:
    folder = tmp_path / "box_rotate" / "1"
    shutil.copytree(whole, folder)
    asis = open_library(tmp_path).load("box_rotate", "1").hulls.values()
    urdf("<mesh ", '<mesh scale="0.5 0.5 0.5" ', -1)(folder)
    halved = open_library(tmp_path).load("box_rotate", "1").hulls.values()
    for before, after in zip(asis, halved, strict=True):
        sizes = [np.ptp(np.concatenate(hulls), axis=0) for hulls in (before, after)]
        np.testing.assert_allclose(sizes[1], sizes[0] / 2, atol=2e-3)
