"""A few hostile calls of the solver; ``solver.py`` as a script makes thousands."""

from __future__ import annotations

from pathlib import Path

import solver

COUNT = 300


def test_hostile_calls_return_right_answers_or_one_line(tmp_path: Path) -> None:
    faults: list[str] = []
    (calls,) = solver.prepare(tmp_path)["inputs"]
    tally = calls(range(COUNT), 7, tmp_path, faults.append)
    assert not faults
    assert sum(tally.ended.values()) == COUNT
    assert {ended.split(": ")[1] for ended in tally.ended} == {"accepted", "refused"}
