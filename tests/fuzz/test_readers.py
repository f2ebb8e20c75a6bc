"""A few hundred damaged files; the script ``readers.py`` tries thousands."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mutate import damaged, judged
from readers import good_folder, problem_line, run, subjects

from gensim2.cli.main import run as run_command
from gensim2.core.errors import InputError


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("good")
    good_folder(folder, problem_line())
    return folder


@pytest.mark.parametrize("subject", subjects(), ids=lambda subject: f"{subject.name}-{subject.file}")
def test_the_good_ones_are_accepted(folder: Path, subject: object) -> None:
    """Otherwise the tests with damaged files would prove nothing."""
    verdict = judged(lambda: subject.read(folder))  # type: ignore[attr-defined]
    assert verdict.accepted, verdict.message


def test_a_good_problem_is_solved_by_its_command(folder: Path) -> None:
    commands = {subject.name: subject.command for subject in subjects() if subject.command is not None}
    assert run_command(commands["problems.jsonl"](folder)) == 0


def test_damage_is_accepted_or_refused_in_one_line(folder: Path) -> None:
    faults: list[str] = []
    tally = run(False, folder, range(300), 7, folder, faults.append)
    assert not faults
    ended = tally.ended
    assert sum(ended.values()) == 300
    for name in {subject.name for subject in subjects()}:
        assert ended[f"{name}: refused"] > 0, name  # each kind must have refusals


def test_damage_is_accepted_or_refused_by_the_command_line(folder: Path) -> None:
    faults: list[str] = []
    tally = run(True, folder, range(6), 7, folder, faults.append)
    assert not faults
    assert sum(tally.ended.values()) == 6


@pytest.mark.fast
def test_the_same_seed_gives_the_same_damage() -> None:
    data = b'{"a": [1, 2.5, "x"], "b": {"c": null}}'
    for kind in ("json", "yaml", "lines", "binary"):
        first, second, other = (
            [damaged(data, kind, np.random.default_rng([seed, n])) for n in range(50)]  # type: ignore[arg-type]
            for seed in (1, 1, 2)
        )
        assert first == second
        assert first != other


@pytest.mark.fast
def test_the_judge_sees_what_is_wrong() -> None:
    def hang() -> None:
        while True:
            pass

    def two_lines() -> None:
        error = InputError("x")
        error.args = ("a\nb",)
        raise error

    with pytest.raises(AssertionError, match="took longer"):
        judged(hang, 0.2)
    with pytest.raises(AssertionError, match="more than one line"):
        judged(two_lines)
    with pytest.raises(ZeroDivisionError):
        judged(lambda: 1 // 0)
    assert judged(lambda: None).accepted
