"""Generated objects in physics and within the robot's reach."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gensim2.inspection.validate import physical_findings
from gensim2.objects import Library
from gensim2.objects.generators.classes import object_classes
from gensim2.robots import robot

CLASSES = sorted(object_classes())


@pytest.mark.parametrize("name", CLASSES)
def test_stays_where_it_is_left_and_moves_through_its_range(library: Library, name: str) -> None:
    pytest.importorskip("sapien")
    assert physical_findings(library.load(name, "1")) == []


@pytest.mark.parametrize("name", CLASSES)
def test_the_robot_reaches_it_over_its_range(library: Library, name: str) -> None:
    pytest.importorskip("mani_skill")
    from gensim2.inspection.validate import reach_findings

    for number in ("0", "1", "600"):
        assert reach_findings(library.load(name, number), robot()) == []


def test_what_is_out_of_reach_is_said_in_millimetres(library: Library) -> None:
    pytest.importorskip("mani_skill")
    from gensim2.inspection.validate import in_base, reach_findings

    near = library.load("drawer", "0")
    far = replace(near, placement=replace(near.placement, position=near.placement.position + np.array([0.5, 0.0, 0.0])))
    shift = np.subtract(*(in_base(thing, "articulated_object_head", 0.3, robot()) for thing in (far, near)))
    np.testing.assert_allclose(shift, [0.5, 0, 0], atol=1e-12)
    found = {finding.check: finding for finding in reach_findings(far, robot())}
    finding = found["fingertips from articulated_object_head at openness 0, mm"]
    assert finding.limit == 10.0
    assert isinstance(finding.value, float)
    assert 50 < finding.value < 500
    below = replace(
        near, placement=replace(near.placement, position=near.placement.position - np.array([0.0, 0.0, 0.2]))
    )
    assert any("table" in str(finding.value) for finding in reach_findings(below, robot()))
