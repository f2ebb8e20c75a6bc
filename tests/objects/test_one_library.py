"""A common library of articulated and rigid objects."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from pathlib import Path

import pytest

from gensim2.cli import main as cli
from gensim2.core.errors import InputError
from gensim2.objects import Library, ObjectModel, listing, open_library
from gensim2.objects.library.catalogue import SETS
from gensim2.objects.library.selection import select

Cube = Callable[..., None]


def test_a_rigid_object_is_the_only_one_of_its_class(library: Library) -> None:
    assert library.kind("mug") == "rigid"
    assert library.kind("drawer") == "articulated"
    assert library.instances("mug") == library.choose("mug", "all") == library.choose("mug", "train") == ("0",)
    assert library.choose("mug", "random", 7) == library.sample("mug", 3) == ("0",)
    assert library.joint_type("mug") is None
    with pytest.raises(InputError, match="no instance '1' of mug"):
        library.load("mug", "1")
    # The draw from a set of articulated objects does not depend on the rigid ones beside them.
    assert {library.choose("mug", word) for word in SETS} == {("0",)}


def test_kinds_are_a_partition(library: Library) -> None:
    articulated, rigid = library.classes("articulated"), library.classes("rigid")
    assert (len(articulated), len(rigid)) == (34, 45)
    assert sorted((*articulated, *rigid)) == list(library.classes())
    assert [row.asset_class for row in listing(library)] == [*articulated, *rigid]


@pytest.mark.parametrize("name", ["drawer", "mug"])
def test_objects_have_one_protocol(library: Library, name: str) -> None:
    model: ObjectModel = library.load(name, "0")
    assert (model.asset_class, model.id, model.source, model.license) == (name, "0", "generated", "Apache-2.0")
    assert model.content_hash
    assert model.warnings == ()
    assert 0 < model.mass < 10
    assert model.placement.rotation.shape == (3, 3)
    assert {point.link for point in model.keypoints.values()} <= set(model.hulls)
    assert all(hull.shape[1] == 3 for hulls in model.hulls.values() for hull in hulls)
    if model.joint is None:
        assert set(model.hulls) == {"body"}
    else:
        assert model.joint.child_link in model.hulls


def test_who_asks_for_the_wrong_kind_is_told(library: Library) -> None:
    assert library.load_articulated("drawer", "0") is library.load("drawer", "0")
    assert library.load_rigid("mug") is library.load("mug", "0")
    with pytest.raises(InputError, match="mug is rigid: it has no joint"):
        library.load_articulated("mug", "0")
    with pytest.raises(InputError, match="drawer has a joint: it is not rigid"):
        library.load_rigid("drawer")


@pytest.fixture
def release(chest: Callable[..., Path], cube: Cube, tmp_path: Path) -> Path:
    """A library in the released format: one chest, one mug."""
    chest(tmp_path / "release" / "articulated_objs" / "box_rotate" / "1")
    mug = tmp_path / "release" / "rigidbody_objs" / "models" / "mug"
    mug.mkdir(parents=True)
    for name in ("collision", "textured"):
        cube(mug, name, (-0.02, -0.03, -0.05), (0.02, 0.03, 0.05))
    (mug / "info.json").write_text('{"scale": 1.0, "keypoints": {"rigidbody_object_head": [0, 0, 0.05]}}')
    return tmp_path / "release"


def test_a_folder_gives_what_it_has_and_generated_objects_for_what_it_lacks(release: Path) -> None:
    opened = open_library(release)
    assert opened.classes("articulated") == ("box_rotate",)
    assert len(opened.classes("rigid")) == 45
    assert (opened.source("mug"), opened.source("lemon"), opened.source("box_rotate")) == ("real", "generated", "real")
    assert (opened.load("mug", "0").source, opened.load("lemon", "0").source) == ("real", "generated")
    assert opened.own_classes() == ("box_rotate", "mug")
    assert select(opened, []) == [("box_rotate", "1"), ("mug", "0")]
    rows = {row.asset_class: row for row in listing(opened)}
    assert rows["lemon"].license == "Apache-2.0" != rows["mug"].license
    copy = pickle.loads(pickle.dumps(opened))
    assert copy.classes() == opened.classes()
    assert open_library(opened.location).classes() == opened.classes()


@pytest.mark.parametrize("part", ["articulated_objs", "rigidbody_objs/models"])
def test_one_half_of_the_layout_is_a_library(release: Path, part: str) -> None:
    opened = open_library(release / part)
    real = {name for name in opened.classes() if opened.source(name) == "real"}
    assert real == ({"box_rotate"} if part == "articulated_objs" else {"mug"})


def test_two_objects_of_one_name_are_refused(release: Path, cube: Cube) -> None:
    other = release / "rigidbody_objs" / "models" / "box_rotate"
    other.mkdir()
    cube(other, "collision", (-0.02, -0.03, -0.05), (0.02, 0.03, 0.05))
    with pytest.raises(InputError, match="box_rotate: the name belongs to both an articulated class and a rigid"):
        open_library(release)


def test_commands_take_either_kind(release: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["assets", "list", "--assets", str(release)]) == 0
    listed = capsys.readouterr().out
    assert {tuple(row.split()[:4]) for row in listed.splitlines()} >= {
        ("mug", "1", "rigid", "real"),
        ("lemon", "1", "rigid", "generated"),
        ("box_rotate", "1", "revolute", "real"),
    }
    assert cli.run(["assets", "list", "--kind", "rigid", "--assets", str(release)]) == 0
    assert "box_rotate" not in capsys.readouterr().out
    assert cli.run(["assets", "show", "mug", "--assets", str(release)]) == 0
    shown = capsys.readouterr().out
    assert "held at" in shown
    assert "rigidbody_object_head" in shown
    assert cli.run(["assets", "validate", "mug", "box_rotate", "--no-physics", "--assets", str(release)]) in (0, 1)
    assert "mug/0" in capsys.readouterr().out
