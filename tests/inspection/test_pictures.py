"""Images of objects and the page that shows them."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from gensim2.core.errors import InputError
from gensim2.inspection import pictures
from gensim2.inspection.gallery import build_gallery
from gensim2.objects import Library, RigidObject, open_library
from gensim2.objects.library.articulated import GeneratedShelf
from gensim2.objects.library.rigid import GeneratedRigidShelf
from gensim2.objects.types import Hulls


def test_page_is_whole_and_keeps_its_pictures(library: Library, tmp_path: Path) -> None:
    found = tmp_path / "findings.json"
    finding = {"check": "overlap of the meshes, mm", "value": 2.5, "limit": 1.0}
    objects = [
        {"class": "switch", "id": "0", "sound": False, "findings": [finding]},
        {"class": "switch", "id": "1", "sound": True, "findings": []},
    ]
    found.write_text(json.dumps({"objects": objects}))
    made = build_gallery([library], tmp_path / "out", classes=["switch"], findings=[found], views=2, size=40)
    assert (made.made, made.kept, made.refused) == (2, 0, ())
    page = made.index.read_text()
    for wanted in ("switch/0", "switch/1", "overlap of the meshes, mm: 2.5 (limit 1.0)", "1 finding", "sound", "head"):
        assert wanted in page
    shown = re.findall(r'data-picture="([^"]+)"', page)
    assert len(shown) == 2
    for name in shown:
        assert not name.startswith(("/", "http", "file"))
        assert Image.open(made.index.parent / name).size == (2 * 40, 3 * 40)
    assert "://" not in page, "nothing is fetched from anywhere"

    (made.index.parent / shown[0]).unlink()
    again = build_gallery([library], tmp_path / "out", classes=["switch"], views=2, size=40)
    assert (again.made, again.kept) == (1, 1)
    other = build_gallery([library], tmp_path / "out", classes=["switch"], views=3, size=40)
    assert (other.made, other.kept) == (2, 0), "other pictures than those that are there"
    assert len(list((tmp_path / "out").rglob("*.webp"))) == 2, "outdated ones are gone"


class FewShelf(GeneratedRigidShelf):
    """A library of a few generated rigid objects."""

    def classes(self) -> tuple[str, ...]:
        """Return two existing classes and a broken one."""
        return ("apple", "broken", "mug")

    def describe(self, asset_class: str) -> str:
        """Return no further description."""
        return asset_class

    def load_rigid(self, asset_class: str, hulls: Hulls = "default") -> RigidObject:
        """Raise an error for the broken object."""
        if asset_class == "broken":
            raise InputError("no mesh", field="broken", remedy="mend it")
        return super().load_rigid(asset_class, hulls)


def test_rigid_objects_stand_beside_the_others(library: Library, tmp_path: Path) -> None:
    few = Library("few", "builtin", [GeneratedShelf(), FewShelf()])
    found = tmp_path / "findings.json"
    wrong = {"check": "turns over when put down, degrees", "value": 40.0, "limit": 5.0}
    found.write_text(json.dumps({"objects": [{"class": "mug", "id": "0", "sound": False, "findings": [wrong]}]}))
    classes = ["switch", "apple", "broken", "mug"]
    made = build_gallery([few], tmp_path / "out", classes=classes, findings=[found], views=2, size=40)
    assert made.made == 4
    assert [(name, number) for name, number, _ in made.refused] == [("broken", "0")]
    page = made.index.read_text()
    for wanted in ("apple/0", "mug/0", "held at", "turns over when put down, degrees: 40.0 (limit 5.0)", "no mesh"):
        assert wanted in page, wanted
    rows = {name: Image.open(made.index.parent / name).size for name in re.findall(r'data-picture="([^"]+)"', page)}
    one_row = [size for name, size in rows.items() if "/mug/" in name or "/apple/" in name]
    assert one_row == [(80, 40), (80, 40)], "at rest"
    again = build_gallery([few], tmp_path / "out", classes=classes, views=2, size=40)
    assert (again.made, again.kept) == (0, 4)


def test_object_that_cannot_be_loaded_is_on_the_page(tmp_path: Path) -> None:
    broken = tmp_path / "assets" / "drawer" / "7"
    broken.mkdir(parents=True)
    (broken / "mobility.urdf").write_text("<robot/>")
    (broken / "info.json").write_text("{}")
    made = build_gallery([open_library(tmp_path / "assets")], tmp_path / "out", views=1, size=40)
    assert [(name, number) for name, number, _ in made.refused] == [("drawer", "7")]
    assert "no keypoints" in made.index.read_text()


@pytest.mark.parametrize(
    ("classes", "text", "message"),
    [
        (["no_such_class"], '{"objects": []}', "no class"),
        (["switch"], '{"objects": [{"id": "0"}]}', "contains no findings"),
        (["switch"], '{"objects": [{"class": "switch", "id": "0", "findings": [{}]}]}', "contains no findings"),
        (["switch"], "[" * 100_000, "not JSON: nested too deeply"),
        (["switch"], "[]", "holds no fields"),
        (["switch"], "not JSON", "not JSON"),
    ],
)
def test_bad_input_is_named(library: Library, tmp_path: Path, classes: list[str], text: str, message: str) -> None:
    file = tmp_path / "findings.json"
    file.write_text(text)
    with pytest.raises(InputError, match=message):
        build_gallery([library], tmp_path / "out", classes=classes, findings=[file])


def test_two_folders_of_one_name_would_take_each_others_pictures(library: Library, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="two folders are called"):
        build_gallery([library, library], tmp_path / "out", classes=["switch"])


def covered(picture: Image.Image | np.ndarray) -> np.ndarray:
    """Return a mask of the pixels whose colour differs from the colour in the upper left corner."""
    pixels = np.asarray(picture).astype(float)
    return np.abs(pixels - pixels[:6, :6].reshape(-1, 3).mean(axis=0)).max(axis=2) > 40


def test_pictures_show_the_object_its_motion_and_its_keypoints(library: Library) -> None:
    drawer, head = library.load("drawer", "0"), "articulated_object_head"
    views = [(0.0, pictures.THREE_QUARTER), (1.0, pictures.THREE_QUARTER), (0.0, pictures.THREE_QUARTER + 180.0)]
    shut, wide, behind = pictures.drawn(drawer, views, 96, marked=False)
    assert 0.08 < covered(shut).mean() < 0.9, "the object fills a good part of the picture"
    assert np.abs(np.asarray(shut).astype(float) - np.asarray(wide)).max(axis=2).mean() > 2, "the drawer moves"
    red = np.array([int(pictures.mark_colour(drawer, head)[i : i + 2], 16) for i in (1, 3, 5)])

    def marks(picture: Image.Image) -> np.ndarray:
        return np.argwhere(np.abs(np.asarray(picture).astype(float) - red).max(axis=2) < 30)

    marked, _, ring = pictures.drawn(drawer, views, 96)
    rows, columns = marks(marked).mean(axis=0).round().astype(int)
    assert covered(shut)[rows, columns], "the head lies on the object"
    assert 0 < len(marks(ring)) < len(marks(marked)), "a ring seen from behind, and a disc seen from the front"
    assert len(marks(shut)) == len(marks(behind)) == 0


def test_sheets_have_a_place_for_each_picture(library: Library) -> None:
    drawer, faucet, mug = (library.load(*each) for each in (("drawer", "0"), ("faucet", "0"), ("mug", "0")))
    assert pictures.contact_sheet([drawer, faucet, mug], 2, 48).size == (2 * 54 - 6, 2 * 76 - 6)
    assert pictures.turntable(drawer, 2, 48).size == (2 * 48, 3 * 48)
    assert pictures.strip(mug, 48).size == (3 * 52 - 4, 48 + 26)
    assert pictures.png(pictures.strip(drawer, 48)) == pictures.png(pictures.strip(drawer, 48))


def test_picture_of_a_rigid_object_shows_it_at_rest(library: Library) -> None:
    sheet = pictures.turntable(library.load_rigid("mug"), 3, 96)
    assert sheet.size == (3 * 96, 96)
    views = [sheet.crop((96 * k, 0, 96 * (k + 1), 96)) for k in range(3)]
    for view in views:
        assert 0.05 < covered(view).mean() < 0.9, "the mug fills a good part of the picture"
    turned = np.abs(np.asarray(views[0]).astype(float) - np.asarray(views[1]))
    assert turned.max(axis=2).mean() > 2, "its handle goes round"


def test_the_whole_object_fits_the_picture(library: Library) -> None:
    # The stem of the apple is not part of its collision shape.
    mask = covered(pictures.drawn(library.load("apple", "0"), [(0.0, pictures.THREE_QUARTER)], 96, marked=False)[0])
    assert mask.any()
    assert not np.concatenate([mask[0], mask[-1], mask[:, 0], mask[:, -1]]).any()
