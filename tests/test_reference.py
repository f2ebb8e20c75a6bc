"""Generated tables of the documentation agree with the code."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[1] / "scripts/reference.py"
_SPEC = importlib.util.spec_from_file_location("reference", SCRIPT)
assert _SPEC is not None
assert _SPEC.loader is not None
reference = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(reference)


def test_the_pages_are_what_the_code_makes() -> None:
    for path, text in reference.pages().items():
        assert path.read_text() == text, f"{path.name}: run scripts/reference.py"


def test_every_field_and_criterion_has_a_meaning() -> None:
    rows = [line for line in (reference.fields_of_tasks() + "\n" + reference.criteria()).splitlines() if "|" in line]
    assert len(rows) > 50
    assert all(cell.strip() for row in rows for cell in row.strip("|").split(" | "))


def test_a_page_without_its_block_is_an_error() -> None:
    with pytest.raises(ValueError, match="no block"):
        reference.filled("# Tasks", "fields", "")
