"""List the commands of the pages: how ``first_hour.py`` runs them, or why it does not run them."""

from __future__ import annotations

import itertools
import os
import re
import shlex
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]

#: Programs whose lines in a block are commands.
PROGRAMS = (
    "gensim2",
    "python",
    "make",
    "pip",
    "maturin",
    "cargo",
    "export",
    "uv",
    "ray",
    "git",
    "cd",
    "curl",
    "docker",
)
#: A line that is a command; what precedes it is its environment.
_COMMAND = re.compile(rf"^((?:[A-Z_0-9]+=\S+ )*)({'|'.join(PROGRAMS)}) \S.*")
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
#: What is added without ``--full`` to commands that name no number.
ADDED = {
    r"^gensim2 train ": " --steps 20 --warmup 5",
    r"^gensim2 learn ": " --minutes 0.1 --scenes 4 --objects 4 --episodes 2 --controls none --videos 1",
    r"^gensim2 evaluate .*--checkpoint(?!.*--episodes)": " --episodes 1",
    r"^gensim2 benchmark(?!.*--runs)": " --runs 1",
    r"^gensim2 benchmark(?!.*--episodes)": " --episodes 1",
    r"^gensim2 robot run (?!.*--minutes)": " --minutes 0.1",
}
#: Words in commands that stand for something of the reader's, and what stands for it here.
STANDS_FOR = {"TASK": "CloseBox", "NAME": "CloseBox", "CLASS": "drawer", "RAD": "0.02", "METRES": "0.01"}
#: Why a command is not run, by what it holds; the first that fits counts. Tests that are named run it in its place, and
#: ``tests/test_first_hour.py`` looks whether they are there.
NEEDS: dict[str, str] = {
    r"--designer (?!offline)": "a language model; tests/design/runs/test_models.py has one of its own",
    r"--replay runs/": "a language model's answers; tests/design/runs/test_models.py",
    r"--ray head": "a cluster; tests/core/processes/test_ray.py has one, benchmarks/ray_two_nodes.py one of two nodes",
    r"^(pip|export|cargo|maturin) |^make ": "sets up or builds the clone itself: part of its own checks",
    r"^python (benchmarks|scripts)/": "measures or writes files of the clone: its options are looked up in its source",
    r"^uv .*\bfci\b": "an environment of its own for benchmarks/franka_chain.py",
    r"replay_trajectory": "a renderer; tests/rollout/test_trajectory.py",
    r"import 45001|--assets mylibrary|--findings": "objects of the reader's; tests/real/test_assets_real.py",
    r"import chest ": "a URDF that the page writes; tests/examples/test_tutorial.py",
    r"arms\.yaml": "a file of the reader's; tests/policy/experiments/test_experiment.py",
    r"calibrate --from|--board|fit-noise|noise\.json": "a log of several poses; tests/robot/test_calibration.py",
    r"--data more": "a second data set of the reader's; tests/policy/test_train.py",
    r"tasks (add|remove) ": "a task of the reader's; tests/cli/test_tasks.py",
    r"policy serve|ws://|RemoteController": "a server beside it; tests/policy/test_remote.py",
    r"mine\.py": "a controller of the reader's; tests/evaluation/test_evaluate.py",
    r"bench .*--problems ": "recorded problems; tests/bench/test_problems.py",
    r"--configs ": "recorded problems; tests/evaluation/test_original_configs.py",
    r"franka:|panda:|realsense:": "an arm and its cameras; tests/robot/test_drivers.py has fakes",
    r"recording:": "recordings of cameras; tests/robot/test_cameras.py",
    r"^gensim2 (robot )?view|--show": "a person before a browser; tests/pages/test_viewing.py opens one",
}
#: Why a command takes over a minute however small, by what it holds: it is begun and interrupted after a third of the
#: time that others have, and run whole with ``--full`` alone.
LONG: dict[str, str] = {
    r"run-pipeline": "a search of up to 150 episodes a task",
    r"benchmark(?! OpenDrawer)": "episodes of every task of the suite; benchmarks/results_table.py has them whole",
    r"collect --": "episodes of every task of the suite",
    r"tasks gallery|assets gallery": "pictures of every task, or of every object",
    r"experiment ": "several trainings",
    r"assets validate --all": "every object in physics",
}
_PLACEHOLDER = re.compile(r"(?<![\w.\-/=])<?(?!R\b|N\b|S\b)[A-Z]{3,}[A-Z_]*>?(?![\w=])")


@dataclass
class Command:
    """One command of a page.

    Attributes:
        page: page and line of the command.
        text: text of the command, without comment and optional words.
        run: command line that is run; None if the command is not run.
        why: reason why the command is not run.
        long: reason why the command takes more than a minute.
        code: exit code.
        interrupted: whether the command was interrupted by Ctrl-C because it took too long.
        seconds: wall time.
        cpu_s: CPU time of the command's processes, s.
        fault: reason why the command counts as failed; None if it succeeded.
        said: last lines of the output.
    """

    page: str
    text: str
    run: str | None = None
    why: str | None = None
    long: str | None = None
    code: int | None = None
    interrupted: bool = False
    seconds: float = 0.0
    cpu_s: float = 0.0
    fault: str | None = None
    said: str = ""

    @property
    def file(self) -> str:
        """The page without the line."""
        return self.page.partition(":")[0]


def pages() -> list[Path]:
    """Return the pages in reading order."""
    others = (
        sorted(ROOT.glob(each))
        for each in ("docs/**/*.md", "python/README.md", "crates/*/README.md", "plugins/*/README.md")
    )
    return [ROOT / "README.md", *itertools.chain(*others), ROOT / "CONTRIBUTING.md"]


def blocks_of(page: Path) -> Iterator[tuple[int, str, str]]:
    """Yield (line number, language, line) of a page's fenced and indented blocks."""
    fence, language = "", ""
    for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1):
        if mark := re.match(r"\s*(```+)(.*)", line):
            fence, language = ("", "") if fence else (mark[1], mark[2].strip())
        elif fence:
            yield number, language, line.strip()
        elif line.startswith("    "):
            yield number, "", line.strip()


def commands_of(page: Path) -> Iterator[Command]:
    """Yield the commands of a page."""
    joined, first = "", 0
    for number, language, text in blocks_of(page):
        if language not in ("", "bash", "sh", "console"):
            continue
        text = text.removeprefix("$ ")
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
        while plain != (plain := _OPTIONAL.sub("", plain)):
            pass
        yield Command(f"{page.relative_to(ROOT)}:{first}", _CHOICE.sub(r"\1", plain))


def prepare(command: Command, full: bool) -> None:
    """Determine how a command is run, or why it is not run."""
    for pattern, why in NEEDS.items():
        if re.search(pattern, command.text):
            command.why = f"needs {why}"
            return
    text = re.sub(r"\s?\.\.\.(?=\s|$)", "", command.text)
    text = re.sub(r"(?<=--policy )DIR\b|(?<=--checkpoint )DIR\b", "builtin", text)
    text = text.replace("runs/robot-20270101-120000", '"$(ls -d runs/robot-* | head -n 1)"')
    assets = os.environ.get("GENSIM2_ASSETS")
    if re.search(r"--assets DIR|ASSETS=DIR", text):
        if assets is None:
            command.why = "needs a folder of real objects, GENSIM2_ASSETS"
            return
        text = text.replace("DIR", shlex.quote(assets))
    for word, stands in STANDS_FOR.items():
        text = re.sub(rf"(?<![\w-])<?{word}>?(?![\w=])", stands, text)
    text = re.sub(r"(?<=--seed )S\b", "1", text)
    text = re.sub(r"(?<=--(?:runs|each) )[RN]\b", "1", text)
    text = re.sub(r"(?<=--episodes )N\b", "2", text)
    if not full:
        for option, small in SMALL.items():
            text = re.sub(rf"(?<=\s){option} [\d.]+", f"{option} {small}", text)
        for pattern, more in ADDED.items():
            if re.search(pattern, text):
                text += more
    text = text.replace("OUT.json", "out.json")
    left = _PLACEHOLDER.search(text)
    if left:
        command.why = f"{left[0]} stands for something of the reader's"
        return
    command.run = text
    command.long = next((why for pattern, why in LONG.items() if re.search(pattern, text)), None)


def all_commands(chosen: Iterable[Path], full: bool) -> list[Command]:
    """Return the prepared commands of pages; a repeated command without output files is run only once."""
    found = [command for page in chosen for command in commands_of(page)]
    seen: dict[str, Command] = {}
    for command in found:
        prepare(command, full)
        if command.run is not None and command.run in seen and left_by(command) is None:
            command.why, command.run = f"as {seen[command.run].page}", None
        elif command.run is not None:
            seen[command.run] = command
    return found


def left_by(command: Command) -> str | None:
    """Return the output folder or file that a command names, or None."""
    words = shlex.split(command.run or "")
    return next((after for word, after in itertools.pairwise(words) if word == "--out"), None)
