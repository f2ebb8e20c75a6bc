"""Rigid objects of the release."""

from __future__ import annotations

from pathlib import Path

import pytest

from gensim2.inspection.rigid import validate_rigid
from gensim2.objects import open_rigid_library
from gensim2.objects.library.rigid import CLASSES

pytestmark = pytest.mark.real


def test_all_forty_load_rest_and_fit_into_a_gripper(real_assets: Path) -> None:
    library = open_rigid_library(real_assets)
    assert len(library.names()) == 40
    assert set(library.names()) <= set(CLASSES)
    assert {r.id: r.findings for r in validate_rigid(library) if not r.sound} == {}
