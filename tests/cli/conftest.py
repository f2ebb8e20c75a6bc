"""A run folder for the report."""

from __future__ import annotations

from pathlib import Path

import pytest
import run_folders


@pytest.fixture
def run_dir(tmp_path: Path) -> Path:
    """A finished run with two kept tasks and two rejected ones, of which one never became a folder."""
    return run_folders.run_folder(tmp_path / "run")
