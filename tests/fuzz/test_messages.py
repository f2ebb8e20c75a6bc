"""A few hostile messages; the script ``messages.py`` tries thousands."""

from __future__ import annotations

import shutil
from pathlib import Path

import messages
import pytest

COUNT = 60


@pytest.mark.parametrize("what", messages.GOOD)
def test_hostile_messages_are_accepted_as_they_are_or_refused_in_one_line(what: str, tmp_path: Path) -> None:
    faults: list[str] = []
    tally = messages.run(what, range(COUNT), 7, tmp_path, faults.append)
    assert not faults
    assert sum(tally.ended.values()) == COUNT
    assert {ended.split(": ")[1] for ended in tally.ended} == {"accepted", "refused"}


def test_good_messages_are_accepted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Otherwise the tests with hostile messages would prove nothing."""
    monkeypatch.setenv(messages.TOKEN, messages.SECRET)
    assert messages.try_first(messages.encode(messages.HELLO)) == "accepted"
    for request in messages.REQUESTS:
        assert messages.try_request(messages.encode(request), request["kind"]) == "accepted"
    for answer in messages.ANSWERS:
        expected = "refused" if answer["kind"] == "error" else "accepted"
        assert messages.try_answer(messages.encode(answer), answer["kind"]) == expected


def test_what_is_run_printed_or_left_behind_is_seen(tmp_path: Path) -> None:
    folder = tmp_path / "there"
    folder.mkdir()
    (folder / "canary.py").write_text(messages.CANARY)

    def load() -> str:
        import canary  # type: ignore[import-not-found]

        return str(canary.robot.__name__)

    def say() -> str:
        print("x", flush=True)
        return "accepted"

    def fill() -> str:
        return str(len(bytes(2**31)))

    for attempt, said in ((load, "wrote"), (say, "printed"), (fill, "MemoryError"), (lambda: "", "unpack")):
        with pytest.raises((AssertionError, ValueError), match=said):
            messages.in_process(attempt, folder)
        shutil.rmtree(folder / "__pycache__", ignore_errors=True)
        (folder / "ran").unlink(missing_ok=True)
