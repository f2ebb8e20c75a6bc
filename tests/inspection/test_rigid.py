"""Rigid objects at rest in physics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from gensim2.inspection.rigid import physical_findings, validate_rigid
from gensim2.objects import Library, RigidLibrary, open_rigid_library
from gensim2.objects.types import Placement


@pytest.fixture(scope="module")
def rigid(library: Library) -> RigidLibrary:
    """The generated rigid objects, in the cache of the generated library's tests."""
    return open_rigid_library("builtin")


def test_all_of_them_are_sound(rigid: RigidLibrary) -> None:
    reports = list(validate_rigid(rigid))
    assert len(reports) == len(rigid.names())
    assert {r.id: r.findings for r in reports if not r.sound} == {}


def test_an_object_that_does_not_rest_is_found(rigid: RigidLibrary) -> None:
    block = rigid.load("wood_block")
    turn = trimesh.transformations.quaternion_from_euler(0.5, 0.0, 0.0)
    tilted = replace(block, resting=Placement(np.array([0.0, 0.0, 0.08]), turn))
    assert {f.check for f in physical_findings(tilted)} == {"rest_drift", "rest_turn"}
