"""Damaged object folders are accepted or refused in one line, in time; the script ``objects.py`` tries thousands."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from objects import attempt, bases, rough_hulls

from gensim2.objects.library import released

COUNT = 160


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GENSIM2_CACHE", str(tmp_path_factory.mktemp("cache")))
        return bases(tmp_path_factory.mktemp("good"))


@pytest.mark.parametrize("part", range(4))
def test_damaged_objects(part: int, good: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GENSIM2_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(released, "decompose_pair", rough_hulls)
    accepted = 0
    for number in range(COUNT // 4):
        generator = np.random.default_rng([7, part, number])
        (tmp_path / str(number)).mkdir()
        verdicts = attempt(good[number % len(good)], tmp_path / str(number), generator)
        accepted += verdicts["read"].accepted
    assert 0 < accepted < COUNT // 4
