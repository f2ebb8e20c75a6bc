"""A few damaged logs and related files; the script ``logs.py`` tries thousands."""

from __future__ import annotations

from pathlib import Path

import logs
import pytest

COUNT = 30


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = Path(tmp_path_factory.mktemp("fuzz")).resolve() / "good"
    logs.good_folder(folder)
    return folder


@pytest.mark.parametrize("subject", [logs.LOG, *logs.FILES], ids=lambda subject: subject.name)
def test_the_good_ones_are_accepted(good: Path, subject: logs.Subject) -> None:
    """Otherwise the tests with damaged files would prove nothing."""
    found = subject.read(good)
    assert found
    logs.check_accepted(found, good, good, subject, "bytes")


def test_the_observations_of_the_good_log_are_made_anew(good: Path) -> None:
    found = logs.replay(good / "log")
    assert (found.questions, found.clouds, found.different, found.missing) == (2, 2, (), 0)
    assert logs.fit_log(good / "log", good.parent / "noise.json")["recordings"] == 1


@pytest.mark.parametrize("subjects", [(logs.LOG,), logs.FILES], ids=["logs", "files"])
def test_damaged_ones_are_accepted_as_they_are_or_refused_in_one_line(
    good: Path, tmp_path: Path, subjects: tuple[logs.Subject, ...]
) -> None:
    faults: list[str] = []
    tally = logs.run(good, subjects, range(COUNT), 7, tmp_path, faults.append)
    assert not faults
    assert sum(tally.ended.values()) == COUNT
    assert any("refused" in outcome for outcome in tally.ended)
