"""Rigid objects at rest in physics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from gensim2.inspection.rigid import physical_findings
from gensim2.inspection.validate import validate
from gensim2.objects import Library, Placement


def test_all_of_them_are_sound(library: Library) -> None:
    items = [(name, "0") for name in library.classes("rigid")]
    assert len(items) == 45
    assert {r.asset_class: r.findings for r in validate(library, items) if not r.sound} == {}


def test_an_object_that_does_not_rest_is_found(library: Library) -> None:
    block = library.load_rigid("wood_block")
    turn = Rotation.from_euler("x", 0.5).as_quat(scalar_first=True)
    tilted = replace(block, placement=Placement(np.array([0.0, 0.0, 0.08]), turn))
    assert {f.check for f in physical_findings(tilted)} == {"rest_drift", "rest_turn"}
