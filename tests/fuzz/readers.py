"""Damage tasks, configs, run folders, episodes and problems, and check what the readers and the command line do.

``python tests/fuzz/readers.py --inputs 10000 --commands 300`` tries this many in process and through the command line,
and prints how they ended. Readers run in forked processes with 1 GiB of memory and 5 s of CPU. Object folders are
tested by ``objects.py``.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

sys.path += [str(Path(__file__).parents[1] / name) for name in ("kill", "common")]

import fake_world
from constraints import point_to_point
from mutate import LIMIT, LONGEST_MESSAGE, Kind, damaged, judged
from runner import CANARY, Ended, Round, Say, Tally, in_process, main, tried

from gensim2.bench import read_problems
from gensim2.core.record_files import read_record
from gensim2.data.records import CheckerRecord, Verification, VerificationRecord
from gensim2.data.runfolder import RunFolder, TaskFolder
from gensim2.data.store import TaskStore
from gensim2.data.trajectory import TrajectoryMetadata, write_trajectory
from gensim2.design.designs import CandidateRecord, Design, DesignRecord, StageRecord
from gensim2.design.report import write_report
from gensim2.rollout.checker_result import CheckerResult, Mutation, WorldCount
from gensim2.rollout.episode_log import EpisodeLog
from gensim2.rollout.inputs import task_and_strategies
from gensim2.tasks.library import load_strategies, load_task, task_names

TASK = "OpenDrawer"
SEEDS = (11, 12, 13)
ARGUMENTS = {
    "command": "demo",
    "seed": 0,
    "assets": "builtin",
    "physics": "default",
    "robot": "panda",
    "engine": "sapien",
    "open_loop": False,
    "randomization": "paper",
    "target_task": TASK,
    "episodes": 2,
}


@dataclass(frozen=True)
class Subject:
    """A good file and its reader.

    Attributes:
        name: kind of input.
        file: the file to damage, relative to the folder.
        kind: kind of its content.
        read: takes the folder.
        command: arguments of a command that reads the file and takes at most a second if it accepts it; None if no
            command reads it alone.
    """

    name: str
    file: str
    kind: Kind
    read: Callable[[Path], object]
    command: Callable[[Path], list[str]] | None = None


def good_folder(folder: Path, problems: str) -> None:
    """Write a complete task folder and run folder.

    Args:
        folder: folder to fill.
        problems: planning problems, one per line.
    """
    for number, name in enumerate(task_names("paper")):  # all of the library, to cover all fields
        files = TaskFolder(folder / f"task{number}")
        files.write_task(load_task(name))
        files.write_strategies(load_strategies(name))
    (folder / "problems.jsonl").write_text(problems)
    task, strategies = load_task(TASK), load_strategies(TASK)
    episodes = [fake_world.episode_of(task, seed, held=seed != 13, instance="3") for seed in SEEDS]
    with RunFolder(folder / "run", ARGUMENTS, {"task": "0" * 16}, resume=False) as run:
        files = run.task(TASK)
        files.write_task(task)
        files.write_strategies(strategies)
        files.write_verification(Verification(tuple(episodes), 0.5, "new"))
        about = ("articulated_open",)
        files.write_checker(CheckerResult.of([[WorldCount(None, str(Mutation.AT_START), "drawer", about, 3, 1)]]))
        stage = StageRecord(name="physics", episodes=2, successes=1.0, causes={"object did not move": 1})
        candidate = CandidateRecord(
            index=0,
            label="hook",
            steps={task.steps[0].name: strategies},
            provenance={},
            stages=[stage],
            cause="object did not move",
        )
        chosen = {task.steps[0].name: strategies}
        design = {**Design((), chosen, ("a note",)).to_dict(), "candidates": [candidate.model_dump()]}
        (files.path / "design.json").write_text(json.dumps(design))
        log = EpisodeLog(files.path / "attempts.jsonl", SEEDS)
        store, random = TaskStore(files.path), np.random.default_rng(0)
        for index, episode in enumerate(episodes):
            digest = store.add(index, episode, fake_world.recording(episode.seed, {"drawer": "3"}, random))
            log.add(index, episode.at(index, digest))
        _merge(folder)
        run.finish({"name": TASK, "demos": 2, "rejected": [], "notes": [], "tasks": []})


def subjects() -> list[Subject]:
    """Return every kind of file with its reader."""

    def inside(name: str) -> str:
        return f"run/tasks/{TASK}/{name}"

    def record(file: str, model: Any) -> Callable[[Path], object]:
        return lambda folder: read_record(folder / file, model, "restore it")

    def problems(folder: Path) -> list[str]:
        return ["bench", "solver", "--problems", str(folder / "problems.jsonl"), "--json", str(folder / "out")]

    found = [
        Subject("run.json", "run/run.json", "json", _resume, _resuming),
        Subject("run.json, report", "run/run.json", "json", lambda folder: write_report(folder / "run")),
        Subject("attempts.jsonl", inside("attempts.jsonl"), "lines", _attempts),
        Subject("verification.json", inside("verification.json"), "json", _verification),
        Subject("checker.json", inside("checker.json"), "json", record(inside("checker.json"), CheckerRecord)),
        Subject("design.json", inside("design.json"), "json", record(inside("design.json"), DesignRecord)),
        Subject("task.yaml, report", inside("task.yaml"), "yaml", lambda folder: write_report(folder / "run")),
        Subject("trajectory.json, report", inside("trajectory.json"), "json", lambda f: write_report(f / "run")),
        Subject("episode.h5", inside("episodes/000001.h5"), "binary", _merge),
        Subject("problems.jsonl", "problems.jsonl", "lines", lambda f: read_problems(f / "problems.jsonl"), problems),
    ]
    for number, name in enumerate(task_names("paper")):
        folder = f"task{number}"
        for file in ("task.yaml", *(f"strategies/{strategy}.yaml" for strategy in load_strategies(name))):
            kind = "task.yaml" if file == "task.yaml" else "strategy"
            found.append(Subject(kind, f"{folder}/{file}", "yaml", _task_reader(folder), _demonstrating(folder)))
    return found


def attempt(folder: Path, beside: Path, subject: Subject, generator: np.random.Generator) -> Ended:
    """Run a reader on a damaged file in a process; then restore the good file.

    Args:
        folder: folder of the good files.
        beside: working directory of the process, from which it could import modules.
        subject: file to damage.
        generator: source of the damage.

    Raises:
        AssertionError: it hangs, or refuses in more than one line.
    """
    path = folder / subject.file
    good = path.read_bytes()
    path.write_bytes(damaged(good, subject.kind, generator))
    try:
        outcome, *cost = in_process(lambda: judged(lambda: subject.read(folder)).outcome, beside, 2**30)
    finally:
        path.write_bytes(good)
    return Ended(f"{subject.name}: {outcome}", *cost)


def attempt_command(folder: Path, subject: Subject, generator: np.random.Generator) -> tuple[int, float]:
    """Return the exit code and CPU seconds of a command with a damaged file.

    Raises:
        AssertionError: it hangs, prints a traceback, or refuses in more than one line.
    """
    assert subject.command is not None
    path = folder / subject.file
    good = path.read_bytes()
    path.write_bytes(damaged(good, subject.kind, generator))
    script = "import sys, time; from gensim2.cli.main import run; code = run(sys.argv[1:]); "
    script += "print(time.process_time(), file=sys.stderr); sys.exit(code)"
    try:
        done = subprocess.run(
            [sys.executable, "-c", script, *subject.command(folder)],
            capture_output=True,
            text=True,
            errors="replace",
            timeout=120,
            check=False,
            cwd=folder,
        )
    finally:
        path.write_bytes(good)
    *said, seconds = done.stderr.splitlines()
    assert "Traceback" not in done.stderr, done.stderr
    assert done.returncode in (0, 2), done.stderr
    if done.returncode == 2:
        refusal = [text for text in said if not text.startswith(("scenes: ", "plans: "))]
        assert len(refusal) == 1, refusal
        assert len(refusal[0]) <= LONGEST_MESSAGE, refusal[0][:200]
    spent = float(seconds)
    assert spent < LIMIT, f"took {spent:.1f} s of CPU"
    return done.returncode, spent


def _resume(folder: Path) -> None:
    with RunFolder(folder / "run", ARGUMENTS, {"task": "0" * 16}, resume=True):
        pass


def _attempts(folder: Path) -> None:
    EpisodeLog(folder / "run" / "tasks" / TASK / "attempts.jsonl", SEEDS)


def _verification(folder: Path) -> None:
    path = folder / "run" / "tasks" / TASK / "verification.json"
    record = read_record(path, VerificationRecord, "delete it")
    assert len(record.episodes) >= record.held


def _merge(folder: Path) -> None:
    """Merge the episodes into the log, as a run does at its end."""
    task = folder / "run" / "tasks" / TASK
    logged = EpisodeLog(task / "attempts.jsonl", SEEDS).done
    kept = [(TaskStore(task).path(each.index), each.episode_digest) for each in logged.values() if each.held]
    write_trajectory(task, _provenance(), kept)


def _task_reader(name: str) -> Callable[[Path], object]:
    return lambda folder: task_and_strategies(str(folder / name))


def _demonstrating(name: str) -> Callable[[Path], list[str]]:
    """Return the command for a task, which is refused only because the folder contains a run already."""
    return lambda folder: ["demo", str(folder / name), "--assets", "builtin", "--out", str(folder / "run")]


def _resuming(folder: Path) -> list[str]:
    """Return the command for a record, which is refused only because its strategies differ."""
    run = ["--out", str(folder / "run"), "--resume"]
    return ["demo", TASK, "--episodes", "2", "--assets", "builtin", *run]


def _provenance() -> TrajectoryMetadata:
    return TrajectoryMetadata(load_task(TASK), load_strategies(TASK), "builtin", {"drawer/3": "CC0"}, 0)


def problem_line() -> str:
    """Return a planning problem as a line of the file: pull open a drawer in front of the arm."""
    pose = np.eye(4)
    pose[:3, 3] = (0.5, 0.0, 0.2)
    config = {
        "constraint_list": [point_to_point("tool_head", "articulated_object_head", 0.001)],
        "pre_actuation_motions": [["translate_z", -0.05]],
        "post_actuation_motions": [["translate_x", -0.05]],
    }
    drawer = {
        "cls": "drawer",
        "id": "1",
        "root_p": [0.0, 0.0, 0.1],
        "root_q": [1.0, 0.0, 0.0, 0.0],
        "qpos": [0.1],
        "close_qpos": 0.0,
        "open_qpos": 0.3,
        "scale": 0.2,
    }
    return (
        json.dumps(
            {
                "id": "a",
                "objects": {"articulated": drawer, "rigid": None},
                "config": config,
                "start_time": 0.0,
                "actuation_time": 6.0,
                "pre_actuation_times": [3.0],
                "post_actuation_times": [9.0],
                "q_current": [0.0, -0.32, 0.0, -2.61799, 0.0, 2.23, 0.785398, 0.04, 0.04],
                "T_world_base": np.eye(4).tolist(),
                "T_base_object": pose.tolist(),
                "tool_keypoints_hand": {"tool_head": [0.0, 0.0, 0.105]},
                "object_keypoints_base": {"articulated_object_head": [0.5, 0.0, 0.2]},
                "object_yaw": 0.0,
                "object_axis": "y",
            }
        )
        + "\n"
    )


def run(commands: bool, folder: Path, numbers: range, seed: int, scratch: Path, say: Say) -> Tally:
    """Try damaged inputs, kinds in turn and each kind's files in turn; report and count failures."""
    kinds: dict[str, list[Subject]] = {}
    for subject in subjects():
        if subject.command is not None or not commands:
            kinds.setdefault(subject.name, []).append(subject)
    chosen = list(kinds.values())
    beside = scratch / "readers"
    beside.mkdir(parents=True, exist_ok=True)
    (beside / "canary.py").write_text(CANARY)

    def one(number: int) -> Ended:
        files = chosen[number % len(chosen)]
        subject = files[number // len(chosen) % len(files)]
        generator = np.random.default_rng([seed, number])
        if commands:
            code, seconds = attempt_command(folder, subject, generator)
            return Ended(f"{subject.name}: exit code {code}", seconds)
        return attempt(folder, beside, subject, generator)

    return tried(numbers, one, say)


def prepare(folder: Path) -> dict[str, list[Round]]:
    """Write the good files."""
    good_folder(folder, problem_line())
    for subject in subjects():
        subject.read(folder)  # imports what the forked processes need
    return {"inputs": [partial(run, False, folder)], "commands": [partial(run, True, folder)]}


if __name__ == "__main__":
    sys.exit(main(str(__doc__), {"inputs": 10_000, "commands": 300}, prepare))
