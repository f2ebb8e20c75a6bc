"""Run the commands of the README and of docs/ in order, as a new user would; the exit code is 1 if one fails.

    python scripts/first_hour.py                 # every command, made small; what takes over a minute is begun
    python scripts/first_hour.py --list          # what would be run, and what cannot be and why
    python scripts/first_hour.py --page docs/guides/data.md --full     # as written, as long as it takes
    python scripts/first_hour.py --state DIR     # keeps in DIR what was run; a second call goes on

Commands are read from the code blocks of the pages. All commands of a page run in one folder, so that a command can use
the output of earlier ones. A command fails if its exit code is not 0 or 1, if it prints a traceback, or if it prints
nothing. Without ``--full``, numbers such as episodes, tasks and seconds are reduced. A command that takes more than a
minute of CPU time (ten minutes if later commands need its output) is interrupted by Ctrl-C and must then end properly.
``GENSIM2_ASSETS`` is the folder of real objects that some commands need. ``first_hour_pages.py`` lists, with reasons,
the commands that are not run, and the commands that always take more than a minute and are interrupted.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import re
import resource
import shlex
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import asdict
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from first_hour_pages import ROOT, Command, all_commands, left_by, pages

#: Seconds of CPU after which a command is interrupted, the factor for one that others wait for, and those to end in.
LIMIT, AWAITED, GRACE = 60.0, 10.0, 30.0
#: Wall time for each second of CPU: machines are shared, and a robot's line waits for its clock.
IDLE = 10.0
#: Share of the time for a command that takes longer however small.
BEGUN = 1 / 3


def run(command: Command, folder: Path, limit: float | None, grace: float = GRACE) -> None:
    """Run a command in a folder, and store its exit code, output and duration."""
    assert command.run is not None
    begin, before = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
    environment = {
        **{name: value for name, value in os.environ.items() if name != "GENSIM2_ASSETS"},  # a new user has none
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
        "GENSIM2_LIBRARY": str(folder / "library"),
    }
    process = subprocess.Popen(
        ["bash", "-c", command.run],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        stdin=subprocess.DEVNULL,
        text=True,
        errors="replace",
        env=environment,
        start_new_session=True,
    )
    command.code = command.fault = None
    interrupted = False
    try:
        said = _wait(process, limit)
    except subprocess.TimeoutExpired:
        interrupted = True
        os.killpg(process.pid, signal.SIGINT)
        try:
            said = _wait(process, grace)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            said, _ = process.communicate()
            command.fault = f"did not end {grace:.0f} s after Ctrl-C"
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    command.seconds = round(time.monotonic() - begin, 1)
    command.cpu_s = round(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, 1)
    command.code, command.interrupted = process.returncode, interrupted
    command.said = "\n".join(said.strip().splitlines()[-5:])
    if command.fault is None:
        command.fault = fault_of(said, process.returncode, interrupted)


def _wait(process: subprocess.Popen[str], limit: float | None) -> str:
    """Wait for the end of a command, and return its output.

    Raises:
        TimeoutExpired: the command's processes have used ``limit`` seconds of CPU, or ten times as many seconds have
            passed.
    """
    begin, before = time.monotonic(), _cpu_of_session(process.pid)
    while True:
        try:
            return process.communicate(timeout=None if limit is None else min(limit, 1.0))[0]
        except subprocess.TimeoutExpired:
            assert limit is not None
            if _cpu_of_session(process.pid) - before > limit or time.monotonic() - begin > IDLE * limit:
                raise


def _cpu_of_session(session: int) -> float:
    """Return the CPU time (s) of the running processes of a session."""
    ticks = 0
    for file in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):  # it has ended
            fields = file.read_text().rpartition(")")[2].split()
            if int(fields[3]) == session:
                ticks += sum(map(int, fields[11:15]))  # its own and those of children that have ended
    return ticks / os.sysconf("SC_CLK_TCK")


def fault_of(said: str, code: int, interrupted: bool = False) -> str | None:
    """Return the reason why a command counts as failed; None if it succeeded."""
    if "Traceback (most recent call last)" in said:
        return "a traceback: " + said.strip().splitlines()[-1]
    if not said.strip():
        return "prints nothing"
    if interrupted:
        if code not in (0, 1, 130, -signal.SIGINT):  # it may have ended by itself in the meantime
            return f"exit code {code} after Ctrl-C: " + said.strip().splitlines()[-1]
        return None
    if code not in (0, 1):  # 1 is a check that found something
        return f"exit code {code}: " + said.strip().splitlines()[-1]
    return None


class State:
    """Folder that stores finished commands, so that a second call continues."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        self._file = folder / "commands.jsonl"
        self._known: dict[tuple[str, str], dict[str, object]] = {}
        if self._file.exists():
            for line in self._file.read_text(encoding="utf-8").splitlines():
                each = json.loads(line)
                self._known[each["page"].partition(":")[0], each["run"]] = each

    def restore(self, command: Command) -> bool:
        """Fill in the stored result of a command; return whether it ran without a fault."""
        known = self._known.get((command.file, command.run or ""))
        if known is None or known["fault"] is not None:
            return False
        for name in ("code", "interrupted", "seconds", "cpu_s", "fault", "said"):
            setattr(command, name, known[name])
        return True

    def keep(self, command: Command) -> None:
        """Store the result of a command."""
        with self._file.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(asdict(command)) + "\n")

    def page(self, name: str) -> Path:
        """Return the folder in which the commands of a page run."""
        folder = self.folder / name.replace("/", "_")
        if not folder.exists():
            folder.mkdir()
            for each in ("examples", "plugins"):
                (folder / each).symlink_to(ROOT / each)
        return folder


def run_all(found: list[Command], state: State, limit: float | None) -> None:
    """Run commands page by page, and print the result of each."""
    missing: dict[str, Command] = {}
    page = ""
    for number, command in enumerate(found):
        if command.run is None:
            continue
        if page != command.file:
            page = command.file
            missing.clear()
        folder, out = state.page(page), left_by(command)
        words = shlex.split(command.run)
        waits = next((each for each in missing if each in words and each != out), None)
        if waits is not None:
            command.why, command.run = f"{waits} of {missing[waits].page} was not finished", None
            continue
        if not state.restore(command):
            awaited = out is not None and any(
                each.file == page and out in shlex.split(each.run or "") for each in found[number + 1 :]
            )
            if out is not None and "--resume" not in words and (folder / out).is_dir():
                subprocess.run(["rm", "-r", "--", str(folder / out)], check=True)  # of a try before
            share = BEGUN if command.long is not None else AWAITED if awaited else 1.0
            run(command, folder, None if limit is None else limit * share)
            state.keep(command)
            ended = "interrupted" if command.interrupted else f"{command.code}"
            print(f"{command.seconds:6.1f} s  {ended:12} {command.page}: {command.run}", flush=True)
            if command.fault:
                print(f"          FAILED: {command.fault}", flush=True)
        if out is not None and (command.interrupted or command.fault):
            missing[out] = command


def summary(found: list[Command]) -> dict[str, object]:
    """Return the counts and durations of all commands."""
    done = [command for command in found if command.run is not None]
    return {
        "pages": len({command.file for command in found}),
        "commands": len(found),
        "run": len(done),
        "to_the_end": sum(not command.interrupted for command in done),
        "interrupted": sum(command.interrupted for command in done),
        "failed": sum(command.fault is not None for command in done),
        "not_run": len(found) - len(done),
        "seconds": round(sum(command.seconds for command in done), 1),
        "cpu_s": round(sum(command.cpu_s for command in done), 1),
    }


def rules(found: list[Command]) -> dict[str, int]:
    """Return the number of commands that were not run, by reason, most frequent first."""
    why = [re.sub(r"^as \S+", "run already", command.why) for command in found if command.why is not None]
    return dict(Counter(why).most_common())


def main() -> int:
    """Run the commands and print the results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--list", action="store_true", help="run nothing")
    parser.add_argument("--full", action="store_true", help="as written, without a limit")
    parser.add_argument("--page", action="append", type=Path, help="only this page; may be given again")
    parser.add_argument("--limit", type=float, default=LIMIT, help="seconds of CPU a command may take without --full")
    parser.add_argument("--state", type=Path, help="folder that keeps what was run")
    parser.add_argument("--json", type=Path, help="write the figures, and how each fared")
    given = parser.parse_args()
    # A background job of a shell ignores Ctrl-C, and its child processes would ignore it, too.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    found = all_commands([each.resolve() for each in given.page] if given.page else pages(), given.full)
    if given.list:
        for command in found:
            long = f"    # begun alone: {command.long}" if command.long and not given.full else ""
            how = f"{command.run}{long}" if command.run else f"not run, {command.why}: {shlex.quote(command.text)}"
            print(f"{command.page}: {how}")
        print(f"{len(found)} commands, {sum(command.run is not None for command in found)} to run")
        return 0
    with tempfile.TemporaryDirectory(prefix="first-hour-") as temporary:
        run_all(found, State(given.state or Path(temporary)), None if given.full else given.limit)
    told, left_out = summary(found), rules(found)
    if given.json:
        whole = {**told, "why_not_run": left_out, "each": [asdict(command) for command in found]}
        given.json.write_text(json.dumps(whole, indent=1) + "\n", encoding="utf-8")
    for why, count in left_out.items():
        print(f"not run, {why}: {count}")
    print("; ".join(f"{name.replace('_', ' ')}: {value}" for name, value in told.items()))
    return 1 if told["failed"] else 0


if __name__ == "__main__":
    sys.exit(main())
