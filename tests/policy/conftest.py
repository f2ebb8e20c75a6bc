"""Fixtures of the tests of policies: one thread, small random CLIP weights."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import torch

os.environ["HF_HUB_OFFLINE"] = "1"  # read when transformers is imported
sys.path.insert(0, str(Path(__file__).parent))

import made_up


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """PyTorch with one thread: networks are small, and other tests run beside these."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(autouse=True)
def no_tensorboard(monkeypatch: pytest.MonkeyPatch) -> None:
    """TensorBoard is not installed here: it takes longer to begin than these trainings take to end."""
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", None)


@pytest.fixture(scope="session")
def clip(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Folder of small random CLIP weights."""
    return str(made_up.random_clip(tmp_path_factory.mktemp("clip") / "random"))


@pytest.fixture(scope="session")
def sentence_model(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A folder with an encoder of sentences, its weights small and random."""
    return str(made_up.random_sentence_model(tmp_path_factory.mktemp("sentence") / "random"))
