"""A run folder for tests of the report."""

from __future__ import annotations

from pathlib import Path

import pytest
import run_folders


@pytest.fixture
def run_dir(tmp_path: Path) -> Path:
    return run_folders.run_folder(tmp_path / "run")
