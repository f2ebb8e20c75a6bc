"""The terminal output of ``gensim2 benchmark``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from gensim2.cli.benchmark import COLUMNS, _show

RESULT: dict[str, Any] = json.loads((Path(__file__).parents[1] / "data" / "former" / "benchmark.json").read_text())


def test_partial_and_replanned_are_counts_and_columns_are_explained(capsys: pytest.CaptureFixture[str]) -> None:
    (first, *_) = RESULT["tasks"]
    _show({**RESULT, "tasks": [{**first, "partial": 3, "partial_share": 0.75, "replanned": 1}], "groups": []})
    said = capsys.readouterr().out
    head, row = (line.split("  ") for line in said.splitlines()[:2])
    cells = dict(zip((word.strip() for word in head if word), (word.strip() for word in row if word), strict=False))
    assert "0.75" not in said
    assert "3" in cells.values()
    legend = said.partition("CPU; episodes")[2]
    for column in filter(None, (word.strip().partition(" (")[0] for word in head)):
        assert column in ("task", "episodes") or f"{column}: " in legend or f"{column}, " in legend


def test_columns_of_both_engines_are_explained_once(capsys: pytest.CaptureFixture[str]) -> None:
    one = {**RESULT, "groups": []}
    _show({"engines": {"sapien": one, "mujoco": one}, "compared": []})
    said = capsys.readouterr().out
    for words in COLUMNS:
        assert said.count(words) == 1
