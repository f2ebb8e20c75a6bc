"""Damaged object folders are accepted, or refused in one line and in time, by every command.

Each kind of damage is a row of ``damage_kinds.KINDS``: its name, what it does to the chest of ``conftest.write_chest``,
and either a pattern of the error or, if the object is accepted, ``None`` with a pattern of the warning (``""``: none).
"""

from __future__ import annotations

import json
import re
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from damage import Kind, told, urdf
from damage_kinds import KINDS

from gensim2.cli import main as cli
from gensim2.inspection.validate import validate
from gensim2.objects import AssetError, open_library
from gensim2.objects.library.catalogue import load_all
from gensim2.objects.library.importer import import_object

LONGEST = 5.0  # s of CPU, convex decomposition apart

#: Damage that ``import`` does not notice, because it does not read the file, repairs it, or leaves it to the later
#: check.
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
    """A chest whose convex parts are cached already."""
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
    assert cli.run(["assets", "prepare", f"box_rotate/{refused[0]}", *words]) == 1
    said, counted = capfd.readouterr().out.splitlines()
    assert said.startswith(f"box_rotate/{refused[0]}: {library}")
    assert counted.startswith("0 objects of library prepared")
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
