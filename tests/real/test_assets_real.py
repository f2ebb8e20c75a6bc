"""The reader with the released objects."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from gensim2.objects import open_library
from gensim2.objects.library.importer import import_object
from gensim2.objects.meshwork.convexes import ConvexBlock, depth_inside
from gensim2.objects.shapes import transform

pytestmark = pytest.mark.real


def test_every_class_is_found(real_assets: Path) -> None:
    library = open_library(real_assets)
    assert len(library.classes("articulated")) == 34
    assert sum(len(library.instances(c)) for c in library.classes("articulated")) == 183


@pytest.mark.parametrize(
    ("asset_class", "instance_id", "note"),
    [
        ("faucet", "1011", "1 mesh files missing: textured_objs/original-5.obj"),
        (
            "safe_rotate",
            "102278",
            "1 collision files consist of one slanted triangle, which PhysX drops, and became plates",
        ),
        ("dishwasher", "12085", "joint is prismatic, the class is known as revolute"),
        ("trash_can", "102181", "no scale: 0.4, the median of its class"),
        ("bucket_swing", "100435", "does not overlap the limits"),
        ("coffee_machine", "103030", "none is near the moving link"),
    ],
)
def test_what_is_odd_is_noted(real_assets: Path, asset_class: str, instance_id: str, note: str) -> None:
    warnings = open_library(real_assets).load_articulated(asset_class, instance_id).warnings
    assert any(note in warning for warning in warnings), warnings


@pytest.mark.parametrize("asset_class", ["box_rotate", "drawer", "faucet", "microwave", "toaster_move"])
def test_import_proposes_about_what_people_annotated(real_assets: Path, tmp_path: Path, asset_class: str) -> None:
    """Released models, imported as plain PartNet-Mobility folders: most head keypoints are within 35 mm of the
    annotation.
    """
    gaps = []
    for folder in sorted((real_assets / "articulated_objs" / asset_class).iterdir()):
        written = json.loads((folder / "info.json").read_text())
        done = import_object(folder, tmp_path, asset_class, folder.name, scale=written["scale"])
        proposed = json.loads((done.folder / "info.json").read_text())
        head, other = (info["keypoints"]["articulated_object_head"] for info in (written, proposed))
        gaps.append(written["scale"] * float(np.linalg.norm(np.subtract(head, other))))
    assert np.median(gaps) < 0.035


@pytest.mark.parametrize("instance_id", ["19179", "20453"])
def test_open_drawer_is_hollow(real_assets: Path, instance_id: str) -> None:
    """A 2 cm cube at the keypoint inside the open drawer touches nothing."""
    instance = open_library(real_assets).load_articulated("drawer", instance_id)
    T = instance.link_pose(1.0)
    center = transform(T, instance.keypoints["articulated_object_inside"].position[None])[0]
    probe = center + 0.01 * np.array([[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)])
    blocks = [ConvexBlock.of(h) for h in instance.hulls["base"]]
    blocks += [ConvexBlock.of(transform(T, h)) for h in instance.hulls[instance.joint.child_link]]
    assert depth_inside(probe, blocks).max() == 0.0


@pytest.mark.parametrize(("asset_class", "instance_id"), [("box_rotate", "100664"), ("safe_rotate", "101584")])
def test_lowest_point_rests_on_the_table(real_assets: Path, asset_class: str, instance_id: str) -> None:
    instance = open_library(real_assets).load_articulated(asset_class, instance_id)
    assert instance.placement.quaternion.tolist() == [1.0, 0.0, 0.0, 0.0]
    lowest = min(
        float(
            np.concatenate([*instance.hulls["base"], *(transform(T, h) for h in instance.hulls["link_0"])])[:, 2].min()
        )
        for T in (instance.link_pose(share) for share in np.linspace(0, 1, 13))
    )
    assert instance.placement.position[2] + lowest == pytest.approx(0, abs=1e-5)
