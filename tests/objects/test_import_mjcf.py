"""MJCF files become objects with the same joints and shapes; hostile files are refused with one line."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

pytest.importorskip("mujoco")

from gensim2.core.errors import InputError
from gensim2.objects import ArticulatedObject, open_library
from gensim2.objects.library.folder import ObjectFolder
from gensim2.objects.library.importer import import_object
from gensim2.objects.library.urdf import link_inertial, read_urdf
from gensim2.sim.mujoco.mjcf import write_object

CABINET = """
<mujoco>
  <compiler angle="degree" meshdir="meshes"/>
  <default><joint damping="0.3"/><default class="seen"><geom contype="0" conaffinity="0"/></default></default>
  <asset><mesh name="knob" file="knob.obj"/></asset>
  <worldbody>
    <light pos="0 0 3"/>
    <geom type="plane" size="1 1 0.1"/>
    <body name="cabinet" pos="1 2 3">
      <freejoint/>
      <geom type="box" size="0.1 0.1 0.2" mass="2"/>
      <body name="door" pos="-0.11 0.1 0">
        <joint name="hinge" axis="0 0 1" range="-5 115" ref="-5" pos="0 0 0.1" frictionloss="0.2"/>
        <geom type="box" pos="0 -0.1 0" size="0.01 0.1 0.2" mass="0.5"/>
        <geom class="seen" type="mesh" mesh="knob" pos="-0.02 -0.18 0" rgba="1 0 0 1" mass="0"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="hinge"/></actuator>
</mujoco>
"""


@pytest.fixture
def cabinet(tmp_path: Path) -> Path:
    (tmp_path / "meshes").mkdir()
    trimesh.creation.icosphere(1, 0.015).export(tmp_path / "meshes" / "knob.obj")
    file = tmp_path / "cabinet.xml"
    file.write_text(CABINET)
    return file


def imported(file: Path, **given: float) -> ArticulatedObject:
    library = file.parent / "library"
    import_object(file, library, "cabinet", "a", scale=1.0, **given)  # type: ignore[arg-type]
    return open_library(library).load_articulated("cabinet", "a")


def test_defaults_angles_anchors_and_masses_are_resolved(cabinet: Path) -> None:
    found = imported(cabinet)
    joint = found.joint
    assert (joint.name, joint.type, joint.child_link) == ("hinge", "revolute", "door")
    np.testing.assert_allclose((joint.lower, joint.upper), np.radians((0.0, 120.0)), atol=1e-6)
    np.testing.assert_allclose(joint.axis, [0, 0, 1], atol=1e-9)
    np.testing.assert_allclose(joint.origin[:2], [-0.11, 0.1], atol=1e-9)
    assert {link: len(hulls) for link, hulls in found.hulls.items()} == {"base": 1, "door": 1}
    np.testing.assert_allclose(found.hulls["base"][0].max(axis=0), [0.1, 0.1, 0.2], atol=1e-6)
    urdf = read_urdf(ObjectFolder(cabinet.parent / "library/articulated_objs/cabinet/a"))
    masses = [inertial.mass for name in ("cabinet", "door") if (inertial := link_inertial(urdf, name))]
    np.testing.assert_allclose(masses, (2.0, 0.5), rtol=1e-6)


@pytest.mark.parametrize("asset_class", ["drawer", "faucet"])
def test_an_exported_object_comes_back_the_same(asset_class: str, tmp_path: Path) -> None:
    model = open_library("builtin").load_articulated(asset_class, "0")
    write_object(model, tmp_path / "a.xml")
    import_object(tmp_path / "a.xml", tmp_path / "library", asset_class, "a", scale=1.0)
    found = open_library(tmp_path / "library").load_articulated(asset_class, "a")
    for field in ("lower", "upper", "friction", "damping", "axis", "origin", "T_root_child"):
        np.testing.assert_allclose(getattr(found.joint, field), getattr(model.joint, field), atol=1e-6, err_msg=field)
    assert (found.joint.name, found.joint.type) == (model.joint.name, model.joint.type)
    assert found.mass == pytest.approx(model.mass, rel=1e-5)
    assert found.hulls.keys() == model.hulls.keys()
    for link, hulls in model.hulls.items():
        boxes = [[np.concatenate([h.min(axis=0), h.max(axis=0)]) for h in each] for each in (hulls, found.hulls[link])]
        np.testing.assert_allclose(np.sort(boxes[0], axis=0), np.sort(boxes[1], axis=0), atol=1e-5)


def test_included_files_of_the_folder_are_read(cabinet: Path) -> None:
    text = cabinet.read_text()
    body = text[text.index('<body name="cabinet"') : text.index("</worldbody>")]
    (cabinet.parent / "body.xml").write_text(f"<mujocoinclude>{body}</mujocoinclude>")
    cabinet.write_text(text.replace(body, '<include file="body.xml"/>'))
    assert imported(cabinet).joint.name == "hinge"


def swap(one: str, other: str) -> Callable[[str], str]:
    return lambda text: text.replace(one, other, 1)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (swap("<asset>", '<include file="../secret.xml"/><asset>'), "lies outside the folder"),
        (swap("<asset>", '<include file="cabinet.xml"/><asset>'), "is included twice"),
        (swap('file="knob.obj"', 'file="../../secret.obj"'), "lies outside the folder"),
        (swap('file="knob.obj"', 'file="/etc/passwd"'), "lies outside the folder"),
        (swap("<mujoco>", '<!DOCTYPE m [<!ENTITY a "b">]><mujoco>'), "document type"),
        (swap("<asset>", '<extension><plugin plugin="a.b"/></extension><asset>'), "loads code"),
        (swap('<joint name="hinge"', '<plugin plugin="a"/><joint name="hinge"'), "loads code"),
        (swap('<body name="door"', '<replicate count="1000000000"/><body name="door"'), "<replicate>"),
        (swap('<body name="door"', '<composite type="grid" count="9999 9999 9999"/><body name="door"'), "<composite>"),
        (swap("<asset>", '<asset><hfield name="h" nrow="99999" ncol="99999" size="1 1 1 1"/>'), "<hfield>"),
        (swap('file="knob.obj"', 'builtin="supersphere" params="99999 1 1"'), "builtin"),
        (swap("<asset>", '<size memory="999T"/><asset>'), None),
        (swap('range="-5 115"', ""), None),
        (swap('axis="0 0 1" range="-5 115" ref="-5"', 'type="ball"'), "exactly one object with joints, but contains 0"),
        (swap('size="0.01 0.1 0.2"', 'size="nan 0.1 0.2"'), "<geom> size: contains NaN"),
        (swap('size="0.01 0.1 0.2"', 'size="-1 0.1 0.2"'), "MuJoCo cannot compile it"),
        (swap('type="box" pos="0 -0.1 0"', 'type="ellipsoid" pos="0 -0.1 0"'), "type that cannot be imported"),
        (swap("</mujoco>", ""), "not XML"),
        (swap("mujoco", "robot"), "not XML"),
    ],
)
def test_hostile_files_are_refused_with_one_line(cabinet: Path, change: Callable[[str], str], said: str | None) -> None:
    for name in ("secret.xml", "secret.obj"):
        (cabinet.parents[1] / name).write_text("<mujocoinclude/>")
    changed = change(cabinet.read_text())
    assert changed != cabinet.read_text()
    cabinet.write_text(changed)
    if said is None:
        imported(cabinet)
        return
    with pytest.raises(InputError, match=said) as refused:
        imported(cabinet)
    assert "\n" not in str(refused.value)
    assert not list(cabinet.parent.glob("library/articulated_objs/cabinet/*"))


def test_a_scene_of_two_objects_is_refused(cabinet: Path) -> None:
    cabinet.write_text(CABINET.replace("</worldbody>", '<body><joint/><geom size="0.1"/></body></worldbody>'))
    with pytest.raises(InputError, match="exactly one object with joints, but contains 2"):
        imported(cabinet)


def test_the_info_says_that_shapes_are_convex(cabinet: Path) -> None:
    imported(cabinet)
    info = json.loads((cabinet.parent / "library/articulated_objs/cabinet/a/info.json").read_text())
    assert info["collision"] == "convex"
