"""``gensim2 benchmark``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from gensim2.cli import options
from gensim2.cli.output import line, report, table


@click.command("benchmark", cls=options.Command, short_help="Measure how often tasks succeed.")
@click.argument("tasks", nargs=-1)
@click.option("--runs", type=options.count(1000), default=5, show_default=True, help="Repetitions.")
@click.option(
    "--episodes",
    type=options.count(),
    default=50,
    show_default=True,
    help="Number of episodes of each task in each run.",
)
@options.origin
@options.library
@options.scenes
@click.option(
    "--attempts",
    type=options.count(100),
    default=1,
    show_default=True,
    help="Most attempts of an episode: from the same start with another strategy first and another seed of the solver, "
    "until one holds.",
)
@click.option(
    "--disturb",
    "disturbance",
    type=click.Choice(("push", "drop")),
    default=None,
    help="At a seeded moment of each episode push the object that is to be taken 3 cm aside, or open the fingers that "
    "hold it; tasks without such an object are left out.",
)
@click.option(
    "--method",
    type=click.Choice(("chain", "one-plan", "original-configs")),
    default="chain",
    show_default=True,
    help="chain: our strategies, a step planned again where something goes otherwise. one-plan: the paper's method "
    "with our solver, every step planned once, at its turn, by its first strategy. original-configs: the solver "
    "configs of --configs, with the original's fingers, drives and stepping, by default in its physics.",
)
@click.option(
    "--configs",
    type=click.Path(path_type=Path),
    default=None,
    metavar="FILE.jsonl",
    help="Planning problems with the original's configs (docs/benchmarks.md).",
)
@click.option(
    "--scenes",
    "scenes",
    type=click.Choice(("recorded", "drawn")),
    default=None,
    help="With original-configs: every scene of the file once, or --episodes of each task.  [default: recorded]",
)
@options.out("Folder to write to.  [default: runs/<date>-<time>]")
@options.processes
@options.ray
@options.resume
@options.json_file
def benchmark(tasks: tuple[str, ...], json_file: str | None, **given: Any) -> None:
    """Run TASKS (the paper's suite, or all of --origin, where none is named) on random scenes, in the paper's protocol.

    Three verdicts stand beside each other: paper (what the paper counts), held (true at the end, at rest, and not in
    the no-op baseline) and strict, each with its 95 % interval. The JSON holds every episode, from which the table
    follows. Tasks for which these objects do not do are named and left out.
    """
    method = given.pop("method")
    if method == "original-configs":
        return _configs(tasks, json_file, given)
    _refuse(("configs", "scenes"), f"is of no use with --method {method}")
    with report(json_file, _show) as (progress, give):
        from gensim2.evaluation import benchmark as function

        given = {name: value for name, value in given.items() if name not in ("configs", "scenes")}
        give(function(tasks, one_plan=method == "one-plan", progress=progress, **given).to_dict())


_RUN = ("out", "resume", "workers", "ray", "time_limit", "jobs_per_worker")
_OF_CONFIGS = ("configs", "scenes", "episodes", "seed", "assets", "physics", *_RUN)
"""Options that ``original-configs`` takes; others are refused where they were given."""


def _configs(tasks: tuple[str, ...], json_file: str | None, given: dict[str, Any]) -> None:
    _refuse([name for name in given if name not in _OF_CONFIGS], "is of our own method")
    if given["configs"] is None:
        raise click.UsageError("--method original-configs needs --configs FILE.jsonl")
    chosen = {name: given[name] for name in _OF_CONFIGS}
    chosen["scenes"] = chosen["scenes"] or "recorded"
    if not _was_given("physics"):
        redraw = click.get_current_context().meta.get(options.REDRAW)
        chosen["physics"] = "original" if redraw is None else f"original+redraw={redraw}"
    if chosen["scenes"] == "recorded" and _was_given("episodes"):
        raise click.UsageError("--episodes is of --scenes drawn: recorded ones are run once each")
    if not _was_given("episodes"):
        del chosen["episodes"]
    with report(json_file, _show_configs) as (progress, give):
        from gensim2.evaluation import benchmark_configs

        give(benchmark_configs(tasks, progress=progress, **chosen).to_dict())


def _was_given(name: str) -> bool:
    source = click.get_current_context().get_parameter_source(name)
    return source is not click.core.ParameterSource.DEFAULT


def _refuse(names: Sequence[str], why: str) -> None:
    for name in names:
        if _was_given(name):
            option = {"disturbance": "disturb"}.get(name, name).replace("_", "-")
            raise click.UsageError(f"--{option} {why}")


def _show_configs(result: dict[str, Any]) -> None:
    rows = [
        (
            row["name"],
            *(_rate(row[name]) for name in ("paper", "held", "release")),
            _figure(row["p_value"]),
            _figure(row["published"]),
            ", ".join(f"{count} {cause}" for cause, count in row["causes"].items()),
        )
        for row in result["tasks"]
    ]
    whole = result["in_all"]
    total = (_rate(whole["paper"]), "", _rate(whole["release"]), _figure(whole["p_value"]))
    rows.append(("tasks of one step", *total, "", ""))
    table(("task", "paper (95 %)", "held (95 %)", "its release (95 %)", "p", "published", "causes"), rows)
    for name, reason in (*result["left_out"].items(), *result["warnings"].items()):
        line(f"{name}: {reason}")
    line(f"{result['cpu_s']:.1f} s of CPU; episodes: {Path(result['run_dir']) / 'tasks'}")


def _rate(found: dict[str, Any] | None) -> str:
    if found is None or found["rate"] is None:
        return ""
    low, high = found["interval"]
    return f"{found['count']}/{found['of']} = {found['rate']:.2f} ({low:.2f} to {high:.2f})"


def _show(result: dict[str, Any]) -> None:
    speeds = result["episodes_per_second"]
    rows = [
        (
            row["name"],
            row["episodes"],
            f"{row['success_mean']:.2f} ± {row['success_std']:.2f} {_interval(row, 'success')}",
            f"{row['held_mean']:.2f} {_interval(row, 'held')}",
            f"{row['strict_mean']:.2f} {_interval(row, 'strict')}",
            _figure(row["paper_figure"]),
            _figure(row["original_figure"]),
            f"{row['partial_share']:.2f}",
            row["replanned"],
            row["different_objects"],
            row["seen"] or "",
            _figure(speeds[row["name"]]),
            ", ".join(f"{count} {cause}" for cause, count in row["causes"].items()),
        )
        for row in result["tasks"]
    ]
    for group in result["groups"]:
        means = (f"{group[f'{name}_mean']:.2f} {_interval(group, name)}" for name in ("success", "held", "strict"))
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


def _interval(row: dict[str, Any], verdict: str) -> str:
    low, high = row[f"{verdict}_interval"]
    return f"({low:.2f} to {high:.2f})"


def _figure(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"
