"""The Panda of installations without ManiSkill is ManiSkill's, so that episodes are the same."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

import gensim2.robots
from gensim2.perception.raycast.shapes import read_links
from gensim2.robots.panda import panda_files
from gensim2.sim.mujoco.description import links_of, never_touching

pytest.importorskip("mani_skill")

OWN = Path(gensim2.robots.__file__).parent / "franka_description"


def test_it_is_used_without_maniskill(monkeypatch: pytest.MonkeyPatch) -> None:
    assert panda_files().urdf.name == "panda_v2.urdf"
    monkeypatch.setitem(sys.modules, "mani_skill", None)
    assert panda_files().urdf == OWN / "panda.urdf"
    assert panda_files().srdf == OWN / "panda.srdf"


def test_its_physics_is_that_of_maniskills() -> None:
    theirs = panda_files()
    assert never_touching(OWN / "panda.srdf") == never_touching(theirs.srdf)
    own, other = links_of(OWN / "panda.urdf"), links_of(theirs.urdf)
    assert [link.name for link in own] == [link.name for link in other]
    for link, twin in zip(own, other, strict=True):
        assert link.parent == twin.parent
        if link.joint is not None:
            assert twin.joint is not None
            assert (link.joint.name, link.joint.type, link.joint.limits) == (
                twin.joint.name,
                twin.joint.type,
                twin.joint.limits,
            )
            assert np.array_equal(link.joint.T, twin.joint.T)
        assert (link.inertial is None) == (twin.inertial is None)
        if link.inertial is not None and twin.inertial is not None:
            assert link.inertial.mass == twin.inertial.mass
            assert np.array_equal(link.inertial.center, twin.inertial.center)
            assert np.array_equal(link.inertial.inertia, twin.inertial.inertia)
        for solid, same in zip(link.solids, twin.solids, strict=True):
            assert (solid.kind, solid.size) == (same.kind, same.size)
            assert np.array_equal(solid.T, same.T)
            assert solid.vertices is None or np.array_equal(solid.vertices, same.vertices)


def test_it_looks_like_maniskills() -> None:
    """Link 4 of ManiSkill's file is 3 mm off, because its reader takes a small offset for none."""
    own, other = read_links(OWN / "panda.urdf"), read_links(panda_files().urdf)
    assert own.keys() == other.keys()
    for name, surface in own.items():
        twin = other[name]
        assert (surface is None) == (twin is None)
        if surface is not None and twin is not None:
            off = 4e-3 if name == "panda_link4" else 1e-5
            assert surface.corners[:, :3] == pytest.approx(twin.corners[:, :3], abs=off), name
