"""Keypoints that are stated on one object of a class and transferred to the others."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from piano_lids import CLASS, write_pianos

from gensim2.cli import main as cli
from gensim2.objects import ArticulatedObject, AssetError, open_library
from gensim2.objects.library.importer import import_object

Array = npt.NDArray[np.float64]


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GENSIM2_CACHE", str(tmp_path / "cache"))


def imported(file: Path, library: Path, name: str, **given: object) -> ArticulatedObject:
    """Import a piano and load it."""
    import_object(file, library, CLASS, name, **{"scale": 1.0, "replace": True, **given})  # type: ignore[arg-type]
    return open_library(library).load_articulated(CLASS, name)


def box_of(model: ArticulatedObject, link: str) -> tuple[Array, Array]:
    """Return the lower and upper corner of a link in its frame, whose axes are those of the root frame when closed."""
    points = np.concatenate(model.hulls[link])
    return points.min(axis=0), points.max(axis=0)


def test_keypoints_keep_their_place_in_the_box_of_their_link(tmp_path: Path) -> None:
    """A corner and an inner point of the lid, a point above it, and a point on the case."""
    files, library = write_pianos(tmp_path / "pianos", 2), tmp_path / "library"
    first = imported(files[0], library, "0")
    low, high = box_of(first, "lid")
    case_low, case_high = box_of(first, "base")
    on_case = case_low + (0.0, 0.75, 1.0) * (case_high - case_low)
    points = {
        "head": (low[0], high[1], high[2]),
        "tail": low + (0.5, 0.25, 1.0) * (high - low),
        "above": (low[0], 0.0, high[2] + 0.1),
        "keys_base": on_case,
    }
    first = imported(files[0], library, "0", keypoints=points)
    # The second piano has other units.
    second = imported(files[1], library, "1", like="0", scale=0.8)
    assert list(second.keypoints) == list(first.keypoints)
    assert [each.link for each in second.keypoints.values()] == [each.link for each in first.keypoints.values()]
    found = {name.removeprefix("articulated_object_"): each.position for name, each in second.keypoints.items()}
    low, high = box_of(second, "lid")
    case_low, case_high = box_of(second, "base")
    assert not np.allclose(high - low, np.subtract(*box_of(first, "lid")[::-1]), atol=0.01), "another size"
    np.testing.assert_allclose(found["head"], (low[0], high[1], high[2]), atol=1e-6)
    np.testing.assert_allclose(found["tail"], low + (0.5, 0.25, 1.0) * (high - low), atol=1e-6)
    np.testing.assert_allclose(found["above"], (low[0], 0.0, high[2] + 0.1), atol=1e-6)
    np.testing.assert_allclose(found["keys_base"], case_low + (0.0, 0.75, 1.0) * (case_high - case_low), atol=1e-6)


def test_a_keypoint_on_the_surface_stays_on_the_surface(tmp_path: Path) -> None:
    """The shelves of the pianos have different heights relative to the case."""
    files, library = write_pianos(tmp_path / "pianos", 2), tmp_path / "library"
    front, level = shelf_of(files[0])
    imported(files[0], library, "0", keypoints={"keys_base": (front + 0.01, 0.0, level)})
    second = imported(files[1], library, "1", like="0")
    front, level = shelf_of(files[1])
    at = second.keypoints["articulated_object_keys_base"].position
    assert at[2] == pytest.approx(level, abs=1e-4)
    assert front < at[0] < front + 0.03
    low, high = box_of(second, "base")
    share = (shelf_of(files[0])[1], *(each[2] for each in box_of(imported(files[0], library, "0"), "base")))
    assert abs(low[2] + (share[0] - share[1]) / (share[2] - share[1]) * (high[2] - low[2]) - level) > 0.004


def shelf_of(file: Path) -> tuple[float, float]:
    """Return the front edge (x, m) and the height (m) of the shelf under the keys: the second box of the case."""
    shape = ET.parse(file).getroot().findall("link[@name='case']/collision")[1]
    origin, box = shape.find("origin"), shape.find("geometry/box")
    assert origin is not None
    assert box is not None
    at, size = ([float(each) for each in text.split()] for text in (origin.attrib["xyz"], box.attrib["size"]))
    return at[0] - 0.5 * size[0], at[2] + 0.5 * size[2]


def test_the_command_transfers_keypoints_and_names_a_missing_object(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    files, library = write_pianos(tmp_path / "pianos", 2), tmp_path / "library"
    imported(files[0], library, "0", keypoints={"head": (-0.05, 0.02, 0.0)})
    words = ["assets", "import", str(files[1]), "--class", CLASS, "--name", "1", "--scale", "1", "--out", str(library)]
    assert cli.run([*words, "--like", "5"]) == 2
    assert f"no instance '5' of {CLASS}" in capfd.readouterr().err
    assert cli.run([*words, "--like", "0"]) == 0
    info = json.loads((library / "articulated_objs" / CLASS / "1" / "info.json").read_text())
    assert info["keypoints"]["articulated_object_head"][1] > 0.01, "beside the middle, as on the first piano"
    with pytest.raises(AssetError, match="no such folder"):
        imported(files[1], tmp_path / "nowhere", "1", like="0")
