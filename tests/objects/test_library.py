"""Opening libraries, finding instances, preparing and caching them."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import time
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from gensim2.core.errors import InputError
from gensim2.objects import Library, listing, open_library
from gensim2.objects.library.catalogue import SETS
from gensim2.objects.library.selection import select, words_of_objects
from gensim2.objects.physics import CLASS_RULES


def test_default_is_the_environment_then_builtin(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("GENSIM2_ASSETS", raising=False)
    assert open_library(None).name == "builtin"
    monkeypatch.setenv("GENSIM2_ASSETS", str(tmp_path / "absent"))
    with pytest.raises(InputError, match=r"absent: GENSIM2_ASSETS: no such folder"):
        open_library(None)
    assert open_library("builtin").name == "builtin"
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="contains no objects"):
        open_library(tmp_path / "empty")


def test_unknown_names_say_what_is_near(library: Library) -> None:
    with pytest.raises(InputError, match="did you mean box_rotate"):
        library.load("box_rotat", "0")
    with pytest.raises(InputError, match="a number from 0 to 1000000"):
        library.load("box_rotate", "-1")
    with pytest.raises(InputError, match="a number from 0 to 1000000"):
        library.load("box_rotate", "01")
    assert library.load("box_rotate", "123456").id == "123456"


def test_listing_counts_instances(library: Library) -> None:
    rows = {row.asset_class: row for row in listing(library)}
    assert set(rows) == set(library.classes())
    row = rows["drawer"]
    assert (row.kind, row.joint_type, row.source, row.license) == (
        "articulated",
        "prismatic",
        "generated",
        "Apache-2.0",
    )
    assert row.ids == tuple(str(i) for i in range(20))


def test_split_is_a_partition_and_small_classes_have_no_test(library: Library) -> None:
    ids = library.instances("drawer")
    train, test = library.split("drawer", "train"), library.split("drawer", "test")
    assert len(test) == 2
    assert sorted(train + test, key=int) == list(ids)
    assert library.split("drawer", "test") == test


@pytest.mark.parametrize("asset_class", ["drawer", "faucet"])  # 20 and 13 instances
def test_each_of_the_tenths_leaves_out_others_until_all_were(library: Library, asset_class: str) -> None:
    ids = library.instances(asset_class)
    found = [library.split(asset_class, "test", tenth) for tenth in range(10)]
    assert {len(each) for each in found} == {2}
    assert set().union(*found) == set(ids)
    drawn = [each for tenth in found[: len(ids) // 2] for each in tenth]
    assert len(set(drawn)) == len(drawn)
    for tenth in range(1, 10):
        assert library.choose(asset_class, f"test-{tenth}") == found[tenth]
        assert set(library.choose(asset_class, f"train-{tenth}")) == set(ids) - set(found[tenth])
    for word in ("test-0", "test-10", "train-"):
        with pytest.raises(InputError, match="no instance"):
            library.choose(asset_class, word)
    with pytest.raises(
        InputError, match=r"tenth: the number of the tenth used for testing must lie in 0\.\.9, but is 10"
    ):
        library.split(asset_class, "test", 10)
    assert library.choose("mug", "train-3") == library.instances("mug")


def test_one_word_stands_for_instances(library: Library) -> None:
    assert library.choose("drawer", "all") == library.instances("drawer")
    assert library.choose("drawer", "test") == library.split("drawer", "test")
    assert library.choose("drawer", "654321") == ("654321",)
    drawn = {library.choose("drawer", "random", seed) for seed in range(30)}
    assert len(drawn) > 5
    assert all(len(ids) == 1 and ids[0] in library.instances("drawer") for ids in drawn)
    assert library.choose("drawer", "random", 3) == library.choose("drawer", "random", 3)


def test_new_ones_are_a_hundred_that_no_list_has(library: Library, tmp_path: Path) -> None:
    for name in library.classes("articulated"):
        new = library.choose(name, "new")
        assert len(set(new)) == 100
        assert not set(new) & set(library.instances(name))
    assert library.load("drawer", new[0]).id == new[0]
    urdf = tmp_path / "drawer" / "7" / "mobility.urdf"
    urdf.parent.mkdir(parents=True)
    urdf.write_text("<robot/>")
    with pytest.raises(InputError, match=r"drawer has no new instances, because its objects are real .*builtin"):
        open_library(tmp_path).choose("drawer", "new")


def test_a_set_is_said_of_every_object_and_an_id_of_one(library: Library) -> None:
    classes = {"ball": "golf_ball", "drawer": "drawer", "box": "box_rotate"}
    for word in SETS:
        assert words_of_objects(library.instances, classes, (word,)) == dict.fromkeys(classes, (word,))
    assert words_of_objects(library.instances, classes, ("3",)) == {"ball": ("all",), "drawer": ("3",), "box": ("all",)}
    assert words_of_objects(library.instances, {"ball": "golf_ball"}, ("0",)) == {"ball": ("0",)}


@pytest.mark.parametrize("name", ["toilet", "oven"])
def test_small_class_has_no_test_split(library: Library, name: str) -> None:
    assert library.choose(name, "train") == library.instances(name)
    with pytest.raises(
        InputError, match=rf"{name} has only \d instances, which are all used for training.*use train or all"
    ):
        library.choose(name, "test")


def test_samples_are_new_numbers(library: Library) -> None:
    drawn = library.sample("drawer", 10, 1)
    assert len(set(drawn)) == 10
    assert all(20 <= int(number) <= 10**6 for number in drawn)
    assert drawn == open_library("builtin").sample("drawer", 10, 1)
    assert drawn != library.sample("drawer", 10, 2)


def test_selection_names_each_object_once(library: Library) -> None:
    assert select(library, ["drawer/3", "drawer/3", "faucet/random"], seed=1)[0] == ("drawer", "3")
    assert len(select(library, ["drawer/3", "drawer"])) == 20
    assert len(select(library, [])) == sum(len(library.instances(c)) for c in library.classes())
    assert {c for c, _ in select(library, [], kind="rigid")} == set(library.classes("rigid"))
    assert {c for c, _ in select(library, [], drawn=1)} == set(library.classes())
    assert len(select(library, [], drawn=1, kind="articulated")) == 34
    assert len(select(library, [], every=True, drawn=1)) == 224 + 34 + 45, "there are no more of a rigid object"
    assert [i for _, i in select(library, ["oven/0"], drawn=2)][1:] == list(library.sample("oven", 2))


def test_second_load_is_quick_and_the_same(library: Library) -> None:
    first = library.load("drawer", "1")
    fresh = open_library("builtin")
    started = time.process_time()
    again = fresh.load("drawer", "1")
    assert time.process_time() - started < 0.05
    assert again.content_hash == first.content_hash
    assert again.mass == first.mass
    for link, hulls in first.hulls.items():
        for a, b in zip(hulls, again.hulls[link], strict=True):
            np.testing.assert_array_equal(a, b)


def test_library_pickles_without_what_it_loaded(library: Library) -> None:
    library.load("drawer", "1")
    copy = pickle.loads(pickle.dumps(library))
    assert copy.__dict__["_loaded"] == {}
    assert copy.load("drawer", "1").content_hash == library.load("drawer", "1").content_hash


def test_processes_may_race_for_one_object(tmp_path: Path) -> None:
    code = (
        "from gensim2.objects import open_library\nprint(open_library('builtin').load('safe_rotate', '5').content_hash)"
    )
    environment = {**os.environ, "GENSIM2_CACHE": str(tmp_path), "PYTHONPATH": os.pathsep.join(sys.path)}
    racers = [
        subprocess.Popen([sys.executable, "-c", code], env=environment, stdout=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    hashes = {racer.communicate(timeout=300)[0].strip() for racer in racers}
    assert [racer.returncode for racer in racers] == [0, 0]
    assert len(hashes) == 1
    left = [p.name for p in (tmp_path / "objects").iterdir()]
    assert len(left) == 1
    assert not left[0].startswith(".")


def test_cache_that_cannot_be_written_is_bad_input(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("GENSIM2_CACHE", str(tmp_path / "file"))
    with pytest.raises(InputError, match="GENSIM2_CACHE"):
        open_library("builtin").load("faucet", "0")


def test_urdf_has_what_parsers_need(library: Library) -> None:
    instance = library.load("microwave", "2")
    root = ET.parse(instance.urdf).getroot()
    joint = root.find("joint")
    assert joint is not None
    limit, dynamics = joint.find("limit"), joint.find("dynamics")
    assert limit is not None
    assert dynamics is not None
    assert {"lower", "upper", "effort", "velocity"} <= set(limit.attrib)
    assert float(dynamics.attrib["friction"]) == pytest.approx(instance.joint.friction, rel=1e-5)
    for link in root.findall("link"):
        mass = link.find("inertial/mass")
        assert mass is not None
        assert float(mass.attrib["value"]) > 0
        shapes = link.findall("collision/geometry")
        assert len(shapes) == len(instance.hulls[link.attrib["name"]])
    for mesh in root.iter("mesh"):
        assert (instance.urdf.parent / mesh.attrib["filename"]).is_file()


def test_openness_at_the_start_is_the_originals() -> None:
    for name, rule in CLASS_RULES.items():
        closed = name.endswith(("_lift", "_move")) or name == "toaster_press"
        assert rule.default_openness == (1.0 if name == "stapler_press" else 0.0 if closed else 0.5), name
