"""Check the claims of ``common/suite.py`` about the suite."""

from __future__ import annotations

from suite import FAST, LONGEST, PARTLY_FAST, SLOW_ROOMS, TESTS


def test_files_that_are_named_are_there_and_named_once() -> None:
    for names in ((*FAST, *PARTLY_FAST), LONGEST):
        assert len(set(names)) == len(names)
        assert [name for name in names if not (TESTS / name).is_file()] == []


def test_every_room_has_quick_tests() -> None:
    rooms = {file.relative_to(TESTS).parts[0] for file in TESTS.rglob("*/test_*.py")}
    assert rooms - {name.split("/")[0] for name in (*FAST, *PARTLY_FAST)} == set(SLOW_ROOMS)


def test_what_is_said_to_be_partly_quick_has_a_mark() -> None:
    for name in PARTLY_FAST:
        assert "pytest.mark.fast" in (TESTS / name).read_text(), name
