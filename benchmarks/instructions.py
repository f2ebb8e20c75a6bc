"""Measure how many instructions in plain English are understood, and how many of these are done in simulation.

    python benchmarks/instructions.py --out runs/instructions --json instructions.json

The sentences come from ``sentences.toml``, which also states the steps that a person means. An outcome counts as good
if the parser finds these steps, or if it refuses the sentence with a reason; steps that the person does not mean count
as wrong. Each understood sentence is then carried out in random scenes with new generated objects. The planner
estimates the scene from point clouds, or with ``--scene true`` knows the true scene.
"""

from __future__ import annotations

import argparse
import json
import sys
import tomllib
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gensim2
from gensim2.core.progress import ConsoleProgress
from gensim2.doing.composing import Composed, compose
from gensim2.instructions.grammar import parse
from gensim2.instructions.steps import SentenceError
from gensim2.rollout.tally import interval
from gensim2.tasks.exporting import write_task

sys.path.append(str(Path(__file__).parents[1] / "tests" / "common"))
from step_notation import in_words

SENTENCES = Path(__file__).parent / "sentences.toml"


def read(say: str, meant: Sequence[str], library: gensim2.Library) -> tuple[dict[str, Any], Composed | None]:
    """Parse a sentence, and return its row of the table with the task that carries it out."""
    row: dict[str, Any] = {"say": say, "meant": list(meant), "steps": [], "reason": None, "task": None}
    try:
        steps = parse(say)
        composed = compose(steps, library, "panda")
    except SentenceError as error:
        row |= {"outcome": "refused", "reason": str(error).partition(" (")[0]}
        return row, None
    row["steps"] = [in_words(step) for step in steps]
    row["outcome"] = "as meant" if row["steps"] == row["meant"] else "not as meant"
    row["task"] = composed.task.name
    return row, composed if row["outcome"] == "as meant" else None


def measure(rows: list[dict[str, Any]], tasks: dict[str, Composed], out: Path, arguments: argparse.Namespace) -> None:
    """Run the tasks of all understood sentences, and add the results to their rows."""
    scene = arguments.scene
    for name, composed in tasks.items():
        write_task(out / "written" / name, composed.task, composed.strategies)
    with ConsoleProgress() as progress:
        result = gensim2.benchmark(
            [str(out / "written" / name) for name in sorted(tasks)],
            runs=1,
            episodes=arguments.episodes,
            seed=arguments.seed,
            out=out / scene,
            resume=(out / scene / "run.json").exists(),
            workers=arguments.workers,
            assets="builtin",
            instances="new",
            scene_source=scene,
            progress=progress,
        )
    found = {row.task.name: row.episodes for row in result.rows}
    for row in rows:
        if row["task"] in found:
            episodes = found[row["task"]]
            row["episodes"] = len(episodes)
            row["held"] = sum(each.held for each in episodes)
            row["strict"] = sum(each.strict for each in episodes)
            row["stopped"] = sum(not each.truncated for each in episodes)
            row["causes"] = dict(Counter(str(each.cause) for each in episodes if each.cause is not None))


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the figures over all sentences, with 95 % intervals."""
    outcomes = Counter(row["outcome"] for row in rows)
    good = outcomes["as meant"] + outcomes["refused"]
    asked = [row for row in rows if row["meant"]]
    figures: dict[str, Any] = {
        "sentences": len(rows),
        "outcomes": dict(outcomes),
        "as meant or refused": [good, *interval(good, len(rows))],
        "meant as steps": len(asked),
        "meant as steps and understood": sum(row["outcome"] == "as meant" for row in asked),
        "to be refused and refused": sum(row["outcome"] == "refused" for row in rows if not row["meant"]),
    }
    done = [row for row in rows if "held" in row]
    episodes = sum(row["episodes"] for row in done)
    if episodes:
        held = sum(row["held"] for row in done)
        figures["held"] = [held, episodes, *interval(held, episodes)]
        figures["strict"] = [sum(row["strict"] for row in done), episodes]
        figures["stopped"] = [sum(row["stopped"] for row in done), episodes]
    return figures


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sentences", type=Path, default=SENTENCES)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--episodes", type=int, default=1, help="episodes of each sentence; 0 only parses")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--scene", choices=("perceived", "true"), default="perceived", help="scene of the planner")
    parser.add_argument("--workers", type=int, default=1)
    arguments = parser.parse_args()
    library = gensim2.open_library("builtin")
    rows, tasks = [], dict[str, Composed]()
    for each in tomllib.loads(arguments.sentences.read_text())["sentences"]:
        row, composed = read(each["say"], each["meant"], library)
        rows.append(row)
        if composed is not None:
            tasks[composed.task.name] = composed
    if arguments.episodes:
        measure(rows, tasks, arguments.out, arguments)
    result = {"figures": summary(rows), "sentences": rows}
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(result, indent=1) + "\n")
    for row in rows:
        told = f"{row['held']} of {row['episodes']} held" if "held" in row else row["reason"] or row["steps"]
        print(f"{row['outcome']:13} {row['say']}  [{told}]")
    print(json.dumps(result["figures"], indent=1))


if __name__ == "__main__":
    main()
