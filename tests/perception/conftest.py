"""Fixtures of the tests of perception."""

from pathlib import Path
from typing import Any

import pytest
from one_thread import one_thread as one_thread

from gensim2.perception.estimation.training import train_estimator

SMALL: dict[str, Any] = {"classes": ("box_rotate", "drawer"), "objects": 1, "looks": 2, "batch": 4, "seed": 3}
"""Settings of a training that takes a second."""


@pytest.fixture(scope="session")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of an estimator after six steps."""
    out = tmp_path_factory.mktemp("perceive") / "whole"
    result = train_estimator(out, steps=6, **SMALL)
    assert result["steps"] == 6
    return out
