"""Hostile programs, before each of the two layers apart: the allow-list, and the box with the allow-list off."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from hostile_programs import PROGRAMS, Hostile

from gensim2.design.sandbox import Sandbox, TaskCodeError, run_task_code, sandbox
from gensim2.design.sandbox.box import INSIDE, Limits

SECRET = "the word is xyzzy"
SMALL = Limits(wall_s=5.0, cpu_s=1, memory=160 * 2**20, answer=2**18)
#: A machine may be busy; a program that no limit holds runs for ever.
LONGEST_S = 60.0


@dataclass
class Witnesses:
    """What a program may not touch, and how it was before."""

    folder: Path
    server: socket.socket
    signals: list[int]

    @property
    def places(self) -> dict[str, object]:
        """What a program is aimed at."""
        port = self.server.getsockname()[1]
        return {"folder": self.folder, "secret": self.folder / "secret", "port": port, "parent": os.getpid()}

    def seen(self) -> list[str]:
        """What happened to them."""
        time.sleep(0.01)  # a signal is delivered
        found = [f"signal {number}" for number in self.signals]
        if sorted(path.name for path in self.folder.iterdir()) != ["secret"]:
            found.append("the folder has changed")
        secret = self.folder / "secret"
        if not secret.exists() or secret.read_text() != SECRET or secret.stat().st_mode & 0o777 != 0o600:
            found.append("the secret has changed")
        try:
            self.server.accept()
            found.append("a connection")
        except BlockingIOError:
            pass
        if _snapshot() != self.before:
            found.append("the sandbox's own files have changed")
        if left := self._left_behind():
            found.append(f"processes {left}")
        return found

    def __post_init__(self) -> None:
        self.before, self.there = _snapshot(), _of_boxes()

    def _left_behind(self) -> list[str]:
        """Processes of a box that were not there before and stay: what was killed takes a moment."""
        for _ in range(200):
            if not (found := _of_boxes() - self.there):
                break
            time.sleep(0.01)
        return sorted(found)


def _snapshot() -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in INSIDE.glob("*.py")}


def _of_boxes() -> set[str]:
    """Processes of a box that are this one's children or orphans, as those are whose maker was killed meanwhile."""
    return {folder.name for folder in Path("/proc").glob("[0-9]*") if _is_of_a_box(folder)}


def _is_of_a_box(folder: Path) -> bool:
    try:
        command = (folder / "cmdline").read_bytes()
        parent = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
    except OSError:
        return False  # it has just ended
    return b"inside/main.py" in command and parent in (1, os.getpid())


@pytest.fixture
def witnesses(tmp_path: Path) -> Iterator[Witnesses]:
    folder = tmp_path / "witnesses"
    folder.mkdir()
    (folder / "secret").touch(mode=0o600)
    (folder / "secret").write_text(SECRET)
    signals: list[int] = []
    before = signal.signal(signal.SIGUSR1, lambda number, _: signals.append(number))
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.setblocking(False)
        yield Witnesses(folder, server, signals)
    signal.signal(signal.SIGUSR1, before)


def walls() -> list[Sandbox]:
    """The sandbox of this machine as it is, and where that has two walls, the inner one alone."""
    found = sandbox()
    whole = Sandbox(found.bubblewrap, SMALL)
    return [whole] if found.bubblewrap is None else [whole, Sandbox(None, SMALL)]


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda program: program.name)
def test_the_box_alone_lets_nothing_out(program: Hostile, witnesses: Witnesses) -> None:
    for box in walls():
        begin = time.monotonic()
        ended = box.run(program.aimed_at(**witnesses.places), {}, checked=False)
        assert time.monotonic() - begin < LONGEST_S
        assert witnesses.seen() == []
        assert len(ended.answer) <= SMALL.answer
        assert SECRET.encode() not in ended.answer
        assert b'"task":' not in ended.answer or program.name == "a forged answer"


@pytest.fixture(scope="module")
def problems() -> dict[str, list[tuple[int, str]]]:
    """What the allow-list says of each program; in another process, as some are too deep for their reader."""
    listed = subprocess.run(
        [sys.executable, "-I", "-c", _LISTING, str(INSIDE)],
        input=json.dumps({program.name: program.source for program in PROGRAMS}),
        capture_output=True,
        text=True,
        check=True,
    )
    return dict(json.loads(listed.stdout))


_LISTING = """
import json, sys
sys.path.insert(0, sys.argv[1])
import allow_list, task_code
found = {}
for name, source in json.load(sys.stdin).items():
    try:
        found[name] = allow_list.problems(source, task_code.__all__, task_code.METHODS)
    except SyntaxError as error:
        found[name] = [[1, error.msg]]
print(json.dumps(found))
"""


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda program: program.name)
def test_the_allow_list_alone_refuses_by_name_and_line(
    program: Hostile, problems: dict[str, list[tuple[int, str]]]
) -> None:
    found = problems[program.name]
    assert any(line == program.line and program.refused in words for line, words in found), found


def test_a_forged_answer_is_checked_as_a_file_is(witnesses: Witnesses) -> None:
    forged = next(program for program in PROGRAMS if program.name == "a forged answer")
    with pytest.raises(TaskCodeError) as caught:
        run_task_code(forged.source, _Unchecked(sandbox().bubblewrap, SMALL))
    assert caught.value.kind == "invalid"


class _Unchecked(Sandbox):
    """For this test: the allow-list is off."""

    def run(self, source: str, criteria: dict[str, list[str]], *, checked: bool = True) -> object:  # type: ignore[override]
        return super().run(source, criteria, checked=False)


@pytest.mark.parametrize(
    ("name", "seen"),
    [
        ("write a file", "the folder has changed"),
        ("delete a file", "the secret has changed"),
        ("connect", "a connection"),
        ("run a shell", "the folder has changed"),
        ("a signal to its parent", "signal 10"),
    ],
)
def test_the_witnesses_would_tell(name: str, seen: str, witnesses: Witnesses) -> None:
    """Without the box: these programs work, and what they do is seen."""
    program = next(program for program in PROGRAMS if program.name == name)
    subprocess.run([sys.executable, "-c", program.aimed_at(**witnesses.places)], check=False)
    assert seen in witnesses.seen()
