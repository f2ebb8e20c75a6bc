"""Damaged folders of rigid objects are accepted, or refused in one line."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import trimesh

from gensim2.cli import main as cli
from gensim2.objects import AssetError, RigidObject, open_library

Change = Callable[[Path], object]
INFO: dict[str, Any] = {"scale": 1.0, "keypoints": {"rigidbody_object_head": [0, 0, 0.05]}}


@pytest.fixture
def release(cube: Callable[..., None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A library in the released format with one block."""
    monkeypatch.setenv("GENSIM2_CACHE", str(tmp_path / "cache"))
    folder = tmp_path / "library" / "rigidbody_objs" / "models" / "block"
    folder.mkdir(parents=True)
    for name in ("collision", "textured"):
        cube(folder, name, (-0.02, -0.03, -0.05), (0.02, 0.03, 0.05))
    (folder / "info.json").write_text(json.dumps(INFO))
    return tmp_path / "library"


def load(library: Path, change: Change) -> RigidObject:
    folder = library / "rigidbody_objs" / "models" / "block"
    change(folder)
    return open_library(library).load_rigid("block")


def told(**fields: Any) -> Change:
    return lambda folder: (folder / "info.json").write_text(json.dumps({**INFO, **fields}))


def pipe(name: str) -> Change:
    return lambda folder: ((folder / name).unlink(), os.mkfifo(folder / name))


REFUSED: dict[str, tuple[Change, str]] = {
    "collision is a pipe": (pipe("collision.obj"), r"collision\.obj: is a pipe, not a file"),
    "picture is a pipe": (pipe("textured.obj"), r"textured\.obj: is a pipe, not a file"),
    "info.json is a pipe": (pipe("info.json"), r"info\.json: is a pipe, not a file"),
    "collision is empty": (
        lambda folder: (folder / "collision.obj").write_text(""),
        r"collision\.obj: cannot be read: contains no triangle",
    ),
    "collision is a speck": (told(scale=1e-6), r"collision\.obj: the file has no usable collision part"),
    "scale is missing": (told(scale=None), r"info\.json: scale: is missing"),
    "scale is 1e30": (told(scale=1e30), r"info\.json: scale: must be a positive number of plausible size"),
    "scale is 1000": (told(scale=1000), r"scale: the largest value of the geometry is 50"),
    "keypoint is text": (told(keypoints={"a": ["1", "2", "3"]}), r"keypoints\.a: not three finite numbers"),
    "descriptions are a list": (told(keypoint_descriptions=[1]), r"keypoint_descriptions: must be a mapping"),
    "info.json is a list": (lambda folder: (folder / "info.json").write_text("[1]"), r"info\.json: holds no fields"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_used_is_refused(release: Path, name: str, capfd: pytest.CaptureFixture[str]) -> None:
    change, pattern = REFUSED[name]
    with pytest.raises(AssetError, match=pattern):
        load(release, change)
    assert cli.run(["assets", "show", "block", "--assets", str(release)]) == 2
    errors = [line for line in capfd.readouterr().err.splitlines() if line.startswith("gensim2: ")]
    assert len(errors) == 1
    assert re.search(pattern, errors[0])


def test_what_is_missing_is_counted(release: Path) -> None:
    assert load(release, lambda folder: None).warnings == ()
    assert load(release, lambda f: (f / "textured.mtl").unlink()).warnings == (
        "1 material files missing: textured.mtl",
    )
    assert "textured.obj cannot be read" in load(release, lambda folder: (folder / "textured.obj").unlink()).warnings[0]


def test_a_name_that_is_none_is_bad_input(release: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["assets", "validate", "x" * 500, "--assets", str(release)]) == 2
    errors = capfd.readouterr().err
    assert "one of block" in errors
    assert len(errors) < 300


def ycb(folder: Path, entry: Any, collision: bytes | None = None) -> None:
    """A folder like that of ManiSkill's YCB download, with one box."""
    model = folder / "models" / "box"
    model.mkdir(parents=True, exist_ok=True)
    mesh = trimesh.creation.box((0.04, 0.09, 0.17))
    mesh.export(model / "textured.obj")
    (model / "collision.ply").write_bytes(collision or mesh.export(file_type="ply"))
    (folder / "info_pick_v0.json").write_text(json.dumps({"box": entry}))


ENTRY = {"bbox": {"min": [-0.02, -0.045, -0.085], "max": [0.02, 0.045, 0.085]}, "scales": [0.8], "density": 700}
PLY = b"ply\nformat ascii 1.0\nelement vertex 9999999999\nproperty float x\nend_header\n0\n"


@pytest.mark.parametrize(
    ("entry", "collision", "message"),
    [
        (3, None, r"info_pick_v0\.json: box: holds no fields"),
        ({**ENTRY, "scales": ["a"]}, None, r"box\.scales: the value is not a positive number"),
        ({**ENTRY, "density": -1}, None, r"box\.density: the value is not a positive number"),
        ({**ENTRY, "bbox": [1]}, None, r"box\.bbox: no corners"),
        ({**ENTRY, "bbox": {"min": [0, 0], "max": 1}}, None, r"box\.bbox\.min: not three finite numbers"),
        (ENTRY, b"not ply", r"collision\.ply: cannot be read: the file is not a valid PLY file"),
        (ENTRY, bytes(range(256)) * 9, r"collision\.ply: cannot be read: the file is not a valid PLY file"),
        (ENTRY, PLY, r"collision\.ply: cannot be read"),
        (ENTRY, PLY.replace(b"ascii", b"binary_little_endian"), r"collision\.ply: cannot be read"),
    ],
)
def test_a_damaged_download_is_refused(
    entry: Any, collision: bytes | None, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GENSIM2_CACHE", str(tmp_path / "cache"))
    ycb(tmp_path / "ycb", entry, collision)
    with pytest.raises(AssetError, match=message):
        open_library(tmp_path / "ycb").load_rigid("box")


def test_an_edited_scale_is_another_object(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GENSIM2_CACHE", str(tmp_path / "cache"))
    sizes = []
    for scale in (0.5, 0.25):
        ycb(tmp_path / "ycb", {**ENTRY, "scales": [scale]})
        sizes.append(open_library(tmp_path / "ycb").load_rigid("box").size[2])
    assert sizes == [pytest.approx(0.085), pytest.approx(0.0425)]
