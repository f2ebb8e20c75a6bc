"""Fixtures for the tests of policies: one thread, small random CLIP weights."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

os.environ["HF_HUB_OFFLINE"] = "1"  # read when transformers is imported
sys.path.insert(0, str(Path(__file__).parent))

import made_up
from one_thread import one_thread as one_thread


@pytest.fixture(autouse=True)
def no_tensorboard(monkeypatch: pytest.MonkeyPatch) -> None:
    """Hide TensorBoard, which takes longer to start than these trainings take."""
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", None)


@pytest.fixture(scope="session")
def clip(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Folder of small random CLIP weights."""
    return str(made_up.random_clip(tmp_path_factory.mktemp("clip") / "random"))


@pytest.fixture(scope="session")
def sentence_model(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A folder with a sentence encoder with small random weights."""
    return str(made_up.random_sentence_model(tmp_path_factory.mktemp("sentence") / "random"))
