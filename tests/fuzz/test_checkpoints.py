"""A few damaged checkpoints; the script ``checkpoints.py`` tries thousands."""

from __future__ import annotations

from pathlib import Path

import checkpoints
import numpy as np
import pytest

COUNT = 20


@pytest.fixture(scope="module")
def goods(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return checkpoints.good_checkpoints(tmp_path_factory.mktemp("good").resolve())


def test_the_good_ones_are_accepted_and_damage_is_refused_in_one_line(
    goods: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    faults: list[str] = []
    tally = checkpoints.run(goods, range(COUNT), 7, tmp_path.resolve(), faults.append)
    assert not faults
    assert sum(tally.ended.values()) == COUNT
    monkeypatch.setattr(checkpoints, "damage", lambda *_: "nothing")
    for good in goods:
        assert tally.ended[f"{good.name}: refused"] > 0, good.name
        (tmp_path / good.name).mkdir()
        told, ended = checkpoints.attempt(good, tmp_path / good.name, np.random.default_rng(0))
        assert (told, ended.outcome) == ("nothing", f"{good.name}: accepted")


def test_code_that_runs_is_a_fault(goods: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checkpoints, "CANARY", checkpoints.CANARY + "raise SystemExit(0)\n")
    monkeypatch.setattr(checkpoints, "read", checkpoints.imports_the_canary)
    with pytest.raises(AssertionError, match=r"wrote .*ran"):
        checkpoints.attempt(goods[1], tmp_path.resolve(), np.random.default_rng(0))
