"""Write the report of ``gensim2 learn``: results, training curves, videos, and causes of failures."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gensim2.core.files import write_atomic
from gensim2.core.pages import template
from gensim2.data.films import film_index
from gensim2.policy.curves import read_curves
from gensim2.policy.train import TRAINING
from gensim2.rollout.tally import interval

if TYPE_CHECKING:
    from gensim2.evaluation.benchmark_table import TaskRow
    from gensim2.policy.learning import LearnResult
    from gensim2.rollout.record import Episode

REPORT = "report.html"
SEEDS = 5
"""Maximum number of seeds listed for a cause of failure."""
NAMED = 3
"""Maximum number of a policy's tasks that are listed by name; a larger number of tasks is only counted."""
CONTROLS = {"blind_mean": "blind", "shuffled_mean": "shuffled", "no_op_mean": "no-op", "expert_mean": "expert"}
"""Titles of columns for control experiments; only measured columns are shown."""
EXPLAINED = {
    "blind_mean": "the policy with its point cloud blanked out. A policy that uses its cloud fails in most episodes.",
    "shuffled_mean": "the policy with the point clouds of other scenes. A policy that uses its cloud succeeds less "
    "often here than with its own clouds. It may still succeed in some episodes, because objects of a class have "
    "similar positions.",
    "no_op_mean": "an arm that does not move. Its success rate should be 0, otherwise the task solves itself.",
    "expert_mean": "the planner that made the training data, on the same scenes: what the policy could reach.",
}
"""Description of each control experiment."""
DEMONSTRATIONS = {
    True: "planned task steps on which the policy was trained; a scene gives one for each step of its task",
    False: "successful simulated episodes on which the policy was trained",
}
"""Description of the demonstrations of a policy, by whether the policy learns from plans."""
_WIDTH, _HEIGHT = 280.0, 100.0


def write_page(result: LearnResult) -> Path:
    """Write the report of a ``gensim2 learn`` run into its output folder, and return the path of the report.

    Raises:
        WriteError: the output folder cannot be written to.
    """
    out = Path(result.out)
    curves: dict[str, Any] = {}
    failures: list[dict[str, Any]] = []
    films: list[dict[str, Any]] = []
    for each in result.learned:
        points = read_curves(each.folder / TRAINING)
        name = ", ".join(each.demonstrations) if len(each.demonstrations) <= NAMED else "all tasks"
        if points:
            curves[name] = _curve([point["loss"] for point in points], points[-1]["step"])
        for row in each.measured.policy.rows:
            failures += _failures(row)
            films += _films(row, each.measured.policy.videos.get(row.task.name, ()), out)
    told = result.to_dict()
    controls = [row["control_episodes"] for row in told["tasks"]]
    page = template("gensim2.policy", "learned.html.j2").render(
        rows=told["tasks"],
        measured=[(n, words) for n, words in CONTROLS.items() if any(row[n] is not None for row in told["tasks"])],
        explained=EXPLAINED,
        control=_control,
        named=NAMED,
        record=result.record.model_dump(),
        demonstrations=DEMONSTRATIONS[result.record.is_of_plans],
        controls=min(controls, default=0),
        seen_objects=told["seen_objects"],
        curves=curves,
        failures=failures,
        films=films,
    )
    write_atomic(out / REPORT, page)
    return out / REPORT


def _control(row: Mapping[str, Any], name: str) -> str:
    """Return the number of successes of a control experiment with its 95 % interval; empty if it was not run."""
    if row[name] is None:
        return ""
    episodes = row["control_episodes"]
    successes = round(row[name] * episodes)
    low, high = interval(successes, episodes)
    return f"{successes} of {episodes} ({low:.2f} to {high:.2f})"


def _failures(row: TaskRow) -> list[dict[str, Any]]:
    """Return a task's failed episodes by cause, most frequent first."""
    found: dict[str, list[Episode]] = {}
    for episode in row.episodes:
        if not episode.held:
            found.setdefault(_cause(episode), []).append(episode)
    return [
        {
            "task": row.task.name,
            "cause": cause,
            "count": len(several),
            "objects": ", ".join(sorted({_objects(each) for each in several})),
            "seeds": ", ".join(str(each.seed) for each in several[:SEEDS]) + (", ..." if len(several) > SEEDS else ""),
        }
        for cause, several in sorted(found.items(), key=lambda pair: -len(pair[1]))
    ]


def _films(row: TaskRow, films: Sequence[str], out: Path) -> list[dict[str, Any]]:
    """Return a task's videos, each with the outcome of the recorded episode."""
    found = []
    for film in films:
        episode = row.episodes[film_index(Path(film))]
        came = "held" if episode.held else _cause(episode)
        found.append({"file": os.path.relpath(film, out), "words": f"{row.task.name}, {_objects(episode)}: {came}"})
    return found


def _cause(episode: Episode) -> str:
    return "no cause found" if episode.cause is None else episode.cause.value


def _objects(episode: Episode) -> str:
    return " + ".join(f"{thing.asset_class}/{thing.id}" for thing in episode.objects.values())


def _curve(losses: Sequence[float], steps: int) -> dict[str, Any]:
    """Return the points of a loss curve in pixels; loss 0 is at the bottom of the box, the largest loss at the top."""
    top, last = max(*losses, 1e-9), max(len(losses) - 1, 1)
    corners = ((_WIDTH * n / last, _HEIGHT * (1.0 - loss / top)) for n, loss in enumerate(losses))
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in corners)
    return {"points": points, "steps": steps, "top": top}
