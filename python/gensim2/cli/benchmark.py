"""Command ``gensim2 benchmark``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from gensim2.cli.options import EPISODES, PLANNER, PROCESSES, command
from gensim2.cli.output import line, table
from gensim2.cli.typed import Count, Option, count
from gensim2.core.progress import Progress

if TYPE_CHECKING:
    from gensim2.evaluation.benchmarking import BenchmarkResult, BothEngines


COLUMNS = (
    "paper, held, strict: success rates by the three verdicts, with 95 % confidence intervals; ± is the standard "
    "deviation between runs",
    "published: success rate in the GenSim2 paper; original: success rate of the code released with the paper",
    "partial: number of episodes in which only part of a motion was executed; replanned: in which a step was replanned",
    "objects: number of different objects in the episodes, over all classes of the task",
    "seen: objects with which the strategies were designed: train (training split) or all",
    "episodes/s: speed of this call, by the wall time; causes: number of failed episodes by cause of failure",
)
"""Explanations of the columns of the table."""


def _show(result: dict[str, Any]) -> None:
    if "engines" not in result:
        _show_one(result)
        return _explain()
    for engine, one in result["engines"].items():
        line(f"engine {engine}:")
        _show_one(one)
    rows = [
        (row["name"], row["episodes"], *row["held"], f"{row['p_value']:.3f}", len(row["lost"]), len(row["won"]))
        for row in result["compared"]
    ]
    one, other = result["engines"]
    table(("task", "episodes", f"held in {one}", f"in {other}", "p (Fisher)", f"only {one}", f"only {other}"), rows)
    _explain()
    line(
        f"p (Fisher): p-value of Fisher's exact test of equal success rates; only {one}, only {other}: seeds whose "
        "episode holds in this engine alone"
    )


def _explain() -> None:
    for words in COLUMNS:
        line(words)


def _show_one(result: dict[str, Any]) -> None:
    speeds = result["episodes_per_second"]
    rows = [
        (
            row["name"],
            row["episodes"],
            f"{row['success_mean']:.2f} ± {row['success_std']:.2f} {interval_of(row, 'success')}",
            f"{row['held_mean']:.2f} {interval_of(row, 'held')}",
            f"{row['strict_mean']:.2f} {interval_of(row, 'strict')}",
            _figure(row["paper_figure"]),
            _figure(row["original_figure"]),
            row["partial"],
            row["replanned"],
            row["different_objects"],
            row["seen"] or "",
            _figure(speeds[row["name"]]),
            ", ".join(f"{count} {cause}" for cause, count in row["causes"].items()),
        )
        for row in result["tasks"]
    ]
    for group in result["groups"]:
        means = (f"{group[f'{name}_mean']:.2f} {interval_of(group, name)}" for name in ("success", "held", "strict"))
        figures = (_figure(group["paper_figure"]), _figure(group["original_figure"]))
        rows.append((f"mean of {group['tasks']} {group['type']}", group["episodes"], *means, *figures, *[""] * 6))
    table(
        (
            "task",
            "episodes",
            "paper (95 %)",
            "held (95 %)",
            "strict (95 %)",
            "published",
            "original",
            "partial",
            "replanned",
            "objects",
            "seen",
            "episodes/s",
            "causes",
        ),
        rows,
    )
    for name, reason in result["skipped"].items():
        line(f"skipped {name}: {reason}")
    if result["arguments"]["disturbance"] is not None:
        for row in result["tasks"]:
            line(f"{row['name']}: disturbed in {row['disturbed']} of {row['episodes']} episodes")
    line(f"{result['cpu_s']:.1f} s of CPU; episodes: {Path(result['run_dir']) / 'tasks'}")


def interval_of(row: dict[str, Any], verdict: str) -> str:
    """Format the 95 % confidence interval of a success rate, such as ``"(0.42 to 0.61)"``.

    Args:
        row: result of a task.
        verdict: name of the definition of success: ``"paper"``, ``"held"`` or ``"strict"``.
    """
    low, high = row[f"{verdict}_interval"]
    return f"({low:.2f} to {high:.2f})"


def _figure(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"


@command("origin", "library", *EPISODES, *PLANNER, "out", *PROCESSES, "ray", "resume", show=_show)
def benchmark(
    tasks: tuple[str, ...] = (),
    *,
    runs: Annotated[int, count(1000)] = 5,
    episodes: Count = 50,
    attempts: Annotated[int, count(100)] = 1,
    disturbance: Annotated[Literal["push", "drop"] | None, Option("--disturb")] = None,
    method: Literal["chain", "one-plan"] = "chain",
    engines: Literal["one", "both"] = "one",
    progress: Progress,
    **given: Any,
) -> dict[str, Any]:
    """Measure the success rates of tasks.

    The command runs TASKS on random scenes by the protocol of the GenSim2 paper. Without TASKS, it runs the tasks of
    the paper, or all tasks of --origin. Tasks without suitable objects are reported and skipped.

    For each task, the command reports three success rates with 95 % confidence intervals, because there are three
    verdicts (definitions of success). The verdict paper counts successes as the paper does. The verdict held requires
    that the goal is true at the end, that the scene is then at rest, and that the goal stays false in the same scene if
    the robot does not move. The verdict strict adds further conditions. The JSON output contains every episode.

    Args:
        runs: Number of repetitions.
        episodes: Number of episodes of each task in each run.
        attempts: Maximum number of attempts in an episode. All attempts start from the same state, but each attempt
            tries another strategy first and uses another solver seed. The first successful attempt ends the episode.
        disturbance: At a random moment of each episode, push moves the object to be grasped 3 cm aside, and drop opens
            the gripper that holds the object. Tasks without an object to grasp are skipped.
        method: chain uses several strategies for each step and replans after a deviation. one-plan is the paper's
            method with our solver: it plans each step only once, at the start of the step, with the first strategy.
        engines: both also runs the same scenes in the other physics engine, and compares the success rates.
    """
    from gensim2.evaluation import benchmark as one
    from gensim2.evaluation import benchmark_both as both

    function: Callable[..., BenchmarkResult | BothEngines] = one if engines == "one" else both
    return function(
        tasks,
        runs=runs,
        episodes=episodes,
        attempts=attempts,
        disturbance=disturbance,
        one_plan=method == "one-plan",
        progress=progress,
        **given,
    ).to_dict()
