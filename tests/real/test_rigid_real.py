"""Rigid objects of the release."""

from __future__ import annotations

from pathlib import Path

import pytest

from gensim2.inspection.validate import validate
from gensim2.objects import open_library
from gensim2.objects.library.rigid import CLASSES

pytestmark = pytest.mark.real


def test_all_forty_load_rest_and_fit_into_a_gripper(real_assets: Path) -> None:
    library = open_library(real_assets)
    real = [name for name in library.classes("rigid") if library.source(name) == "real"]
    assert len(real) == 40
    assert library.classes("rigid") == tuple(CLASSES), "what the release lacks is generated"
    assert {r.asset_class: r.findings for r in validate(library, [(name, "0") for name in real]) if not r.sound} == {}
