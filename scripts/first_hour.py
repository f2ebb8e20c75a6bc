"""Run the commands of the README and of docs/ in their order, as a new user would; ends with 1 where one fails.

    python scripts/first_hour.py                 # every command, made small, a minute each at the most
    python scripts/first_hour.py --list          # what would be run, and what cannot be and why
    python scripts/first_hour.py --page docs/data.md --full     # as written, as long as it takes

Commands are taken from the blocks of the pages themselves: lines that begin with ``gensim2``, ``python`` or ``make``.
Those of a page run in one fresh folder, so that one may use what another left. A command fails where it ends with a
code other than 0 and 1, prints a traceback, or prints nothing at all. Without ``--full`` numbers of episodes, tasks,
seconds and the like are made small, and what has not ended in a minute is interrupted and must then end in order.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import re
import shlex
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]

#: Seconds after which a command is interrupted by default, and those in which it must then end.
LIMIT, GRACE = 60.0, 30.0
#: A line that is a command; what precedes it is its environment.
_COMMAND = re.compile(r"^((?:[A-Z_0-9]+=\S+ )*)(gensim2|python|make) .*")
_COMMENT = re.compile(r"\s{2,}#.*$|\s#\s.*$")
_OPTIONAL = re.compile(r"\s*\[[^][]*\]")
_CHOICE = re.compile(r"(?<=\s)([\w.-]+)(?:\|[\w.-]+)+")
#: Options whose numbers are made small without ``--full``, and to what.
SMALL = {
    "--episodes": "2",
    "--num-tasks": "1",
    "--single": "1",
    "--long": "0",
    "--verify": "2",
    "--attempts": "1",
    "--random": "1",
    "--points": "64",
    "--minutes": "0.05",
    "--rounds": "1",
    "--steps": "5",
    "--scenes": "2",
    "--videos": "1",
    "--control-episodes": "2",
    "--trials": "1",
    "--kills": "1",
    "--objects": "2",
}
#: Words in commands that stand for something of the reader's, and what stands for it here.
STANDS_FOR = {"TASK": "CloseBox", "NAME": "CloseBox", "CLASS": "drawer", "RAD": "0.02", "METRES": "0.01"}
#: Why a command cannot be run everywhere, by what it holds.
NEEDS: dict[str, str] = {
    r"--designer (?!offline)": "a language model",
    r"--base-url|OPENAI": "a language model",
    r"\$GENSIM2_ASSETS|--assets (DIR|OBJECTS|ASSETS|FOLDER|[\w/]*gensim2-assets)|ASSETS=": "a folder of real objects",
    r"--ray|ray_": "the extra ray",
    r"^make (setup|demo|test|figures|lock|clean|lint|docs|wheels|api)": "the clone itself: part of its own checks",
    r"^python (benchmarks|scripts|tests|examples)/": "the clone itself: tests and benchmarks run it",
    r"replay_trajectory": "a renderer; tests/rollout/test_trajectory.py runs it",
    r"maturin|cargo|pip ": "a build",
    r"45001|mylibrary|arms\.yaml|robot-2027|--data more|tape|my_task": "files of the reader's",
    r"mine\.py|--problems|runs/demo": "files of the reader's",
    r"tasks remove": "a task of the reader's own",
    r"franka:|realsense:": "an arm and its cameras",
    r"^gensim2 (robot )?view|--show": "a person before a browser; tests/pages/test_viewing.py opens one",
}
_PLACEHOLDER = re.compile(r"(?<![\w.\-/=])<?[A-Z]{3,}[A-Z_]*>?(?![\w=])")


@dataclass
class Command:
    """One command of a page.

    Attributes:
        page: where it stands, with its line.
        text: as it stands there, without comment and optional words.
        run: as it is run; None where it is not.
        why: it is not run.
        code: exit code; None where it was interrupted.
        seconds: wall time.
        fault: what is wrong with how it ended.
    """

    page: str
    text: str
    run: str | None = None
    why: str | None = None
    code: int | None = None
    seconds: float = 0.0
    fault: str | None = None


def pages() -> list[Path]:
    """Return the pages in the order in which a reader meets them."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def commands_of(page: Path) -> Iterator[Command]:
    """Yield the commands of a page's fenced and indented blocks."""
    fenced, language, joined, first = False, "", "", 0
    for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1):
        if line.lstrip().startswith("```"):
            fenced, language = not fenced, line.strip().strip("`")
            continue
        in_block = (fenced and language in ("", "bash", "sh", "console")) or (not fenced and line.startswith("    "))
        text = line.strip() if in_block else ""
        if joined:
            joined += " " + text
        elif _COMMAND.match(text):
            joined, first = text, number
        else:
            continue
        if joined.endswith("\\"):
            joined = joined[:-1].rstrip()
            continue
        plain = _COMMENT.sub("", joined).strip().rstrip(";")
        joined = ""
        yield Command(f"{page.relative_to(ROOT)}:{first}", _CHOICE.sub(r"\1", _OPTIONAL.sub("", plain)))


def prepare(command: Command, full: bool) -> None:
    """Decide how a command is run, or why it is not."""
    for pattern, why in NEEDS.items():
        if re.search(pattern, command.text):
            command.why = f"needs {why}"
            return
    text = re.sub(r"\s?\.\.\.(?=\s|$)", "", command.text)
    for word, stands in STANDS_FOR.items():
        text = re.sub(rf"(?<![\w-])<?{word}>?(?![\w=])", stands, text)
    if not full:
        for option, small in SMALL.items():
            text = re.sub(rf"(?<=\s){option} [\d.]+", f"{option} {small}", text)
    left = _PLACEHOLDER.search(text)
    if left:
        command.why = f"{left[0]} stands for something of the reader's"
        return
    command.run = text


def left_by(command: Command) -> str | None:
    """Return the folder or file that a command leaves, if it says one."""
    words = shlex.split(command.run or "")
    return next((after for word, after in itertools.pairwise(words) if word == "--out"), None)


def run(command: Command, folder: Path, limit: float | None) -> None:
    """Run a command in a folder and note how it ended."""
    assert command.run is not None
    begin = time.monotonic()
    environment = {
        **os.environ,
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
    interrupted = False
    try:
        said, _ = process.communicate(timeout=limit)
    except subprocess.TimeoutExpired:
        interrupted = True
        os.killpg(process.pid, signal.SIGINT)
        try:
            said, _ = process.communicate(timeout=GRACE)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            said, _ = process.communicate()
            command.fault = f"did not end {GRACE:.0f} s after Ctrl-C"
    command.seconds = round(time.monotonic() - begin, 1)
    command.code = None if interrupted else process.returncode
    if command.fault is None:
        command.fault = fault_of(said, command.code)


def fault_of(said: str, code: int | None) -> str | None:
    """Return what is wrong with how a command ended; None where nothing is."""
    if "Traceback (most recent call last)" in said:
        return "a traceback: " + said.strip().splitlines()[-1]
    if not said.strip():
        return "prints nothing"
    if code not in (0, 1, None):  # 1 is a check that found something
        return f"exit code {code}: " + said.strip().splitlines()[-1]
    return None


def main() -> int:
    """Run the commands and print how they fared."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--list", action="store_true", help="run nothing")
    parser.add_argument("--full", action="store_true", help="as written, without a limit")
    parser.add_argument("--page", action="append", type=Path, help="only this page; may be given again")
    parser.add_argument("--limit", type=float, default=LIMIT, help="seconds a command may take without --full")
    parser.add_argument("--json", type=Path, help="write how each fared")
    given = parser.parse_args()
    # A background job of a shell ignores Ctrl-C, and so would the commands.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    chosen = [each.resolve() for each in given.page] if given.page else pages()
    found = [command for page in chosen for command in commands_of(page)]
    seen: dict[str, Command] = {}
    for command in found:
        prepare(command, given.full)
        if command.run is not None and command.run in seen and left_by(command) is None:
            command.why, command.run = f"as {seen[command.run].page}", None
        elif command.run is not None:
            seen[command.run] = command
    with tempfile.TemporaryDirectory(prefix="first-hour-") as temporary:
        unfinished: dict[str, Command] = {}
        page = ""
        for command in found:
            if page != (page := command.page.partition(":")[0]):
                unfinished.clear()
                folder = Path(temporary) / page.replace("/", "_")
                folder.mkdir()
                (folder / "examples").symlink_to(ROOT / "examples")
            waits = next((out for out in unfinished if out in shlex.split(command.run or "")), None)
            if waits is not None and waits != left_by(command):
                command.why, command.run = f"{waits} of {unfinished[waits].page} was not finished", None
            if command.run is not None and not given.list:
                run(command, folder, None if given.full else given.limit)
                if command.code is None and (out := left_by(command)) is not None:
                    unfinished[out] = command
                ended = "interrupted" if command.code is None else f"{command.code}"
                print(f"{command.seconds:6.1f} s  {ended:14} {command.page}: {command.run}", flush=True)
                if command.fault:
                    print(f"          FAILED: {command.fault}", flush=True)
            elif given.list:
                print(f"{command.page}: {command.run or f'not run, {command.why}: {shlex.quote(command.text)}'}")
    if given.json:
        given.json.write_text(json.dumps([asdict(command) for command in found], indent=1) + "\n", encoding="utf-8")
    faults = [command for command in found if command.fault]
    done = sum(command.run is not None for command in found)
    print(f"{len(found)} commands of {len(chosen)} pages, {done} run, {len(faults)} failed")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
