"""``gensim2 bench``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal

import click
from click.core import ParameterSource

from gensim2.cli import options
from gensim2.cli.output import report, table


@click.group("bench")
def bench() -> None:
    """Measure the solver and policies."""


@bench.command("solver", cls=options.Command, short_help="Solve a file of planning problems.")
@click.option(
    "--problems", type=click.Path(path_type=Path), required=True, metavar="FILE", help="Problems, one a line."
)
@click.option(
    "--assets",
    type=click.Path(path_type=Path),
    default=None,
    metavar="DIR",
    help="Folder of real objects, which are then obstacles.  [default: the table is the only one]",
)
@click.option(
    "--frames",
    type=click.Choice(["original", "object"]),
    default="original",
    show_default=True,
    help="Reading of motion frames: the original's, or the object's own.",
)
@click.option("--threads", type=options.count(1024), default=1, show_default=True, help="Solver threads.")
@click.option("--sample-dt", type=float, default=None, metavar="S", help="Also write the joints every S seconds.")
@options.json_file
def solver(
    problems: Path,
    assets: Path | None,
    frames: Literal["original", "object"],
    threads: int,
    sample_dt: float | None,
    json_file: str | None,
) -> None:
    """Solve a file of planning problems and say what was found; --json writes one JSON object a problem, each a line.

    Times are CPU time of the solver calls alone; reading and mesh loading come before.
    """
    with report(json_file, _show, _json_lines) as (progress, give):
        from gensim2.bench import solve_problems, summary_of

        records = solve_problems(
            problems, assets=assets, frames=frames, threads=threads, sample_dt=sample_dt, progress=progress
        )
        give({"records": records, "summary": summary_of(records).to_dict()})


def _json_lines(result: dict[str, Any]) -> str:
    from gensim2.bench import json_lines

    return json_lines(result["records"])


def _show(result: dict[str, Any]) -> None:
    summary = result["summary"]
    statuses = ", ".join(f"{status} {count}" for status, count in summary["statuses"].items())
    table(
        ("what", "value"),
        [
            ("problems", str(summary["problems"])),
            ("statuses", statuses),
            ("with an actuation pose", str(summary["with_actuation"])),
            ("warnings", str(summary["warnings"])),
            ("actuation, CPU ms, median", f"{summary['cpu_ms_actuation']:.3f}"),
            ("trajectory, CPU ms, median", f"{summary['cpu_ms_trajectory']:.3f}"),
            ("plan, CPU ms, median", f"{summary['cpu_ms_total']:.3f}"),
            ("plan, CPU ms, 99th percentile", f"{summary['cpu_ms_total_p99']:.3f}"),
            ("peak memory, MB", f"{summary['peak_memory_mb']:.0f}"),
        ],
    )


@bench.command("motion", cls=options.Command, short_help="Plan a file of joint-to-joint problems.")
@click.option(
    "--problems", type=click.Path(path_type=Path), required=True, metavar="FILE", help="Problems, one a line."
)
@click.option(
    "--robot",
    type=options.ROBOT,
    default="panda",
    show_default=True,
    metavar="NAME|FILE.py",
    help="Robot that the problems are for.",
)
@click.option(
    "--margin", type=float, default=0.005, show_default=True, metavar="M", help="Distance kept from everything, m."
)
@click.option("--deadline-ms", type=float, default=None, metavar="MS", help="Time for each problem.  [default: none]")
@options.json_file
def motion(problems: Path, robot: str, margin: float, deadline_ms: float | None, json_file: str | None) -> None:
    """Plan joint-to-joint problems and say what was found; --json writes one JSON object a problem, each a line.

    Times are CPU time from the problem to the timed motion, the building of each scene included.
    """
    with report(json_file, _show_motion, _json_lines) as (progress, give):
        from gensim2.bench import motion_summary, read_motion_problems, solve_motions

        records = solve_motions(
            read_motion_problems(problems), robot=robot, margin=margin, deadline_ms=deadline_ms, progress=progress
        )
        give({"records": records, "summary": motion_summary(records).to_dict()})


def _show_motion(result: dict[str, Any]) -> None:
    summary = result["summary"]
    statuses = ", ".join(f"{status} {count}" for status, count in summary["statuses"].items())
    table(
        ("what", "value"),
        [
            ("problems", str(summary["problems"])),
            ("statuses", statuses),
            ("CPU ms, median", f"{summary['cpu_ms_median']:.3f}"),
            ("CPU ms, 95th percentile", f"{summary['cpu_ms_p95']:.3f}"),
            ("duration of motions, s, median", f"{summary['duration_median']:.3f}"),
            ("length of ways, rad, median", f"{summary['length_median']:.3f}"),
        ],
    )


@bench.command("policy", cls=options.Command, short_help="Time policies from observation to action.")
@click.option(
    "--checkpoint",
    default=None,
    metavar="DIR|builtin",
    help="A keypose policy, whose looks are timed in episodes of its tasks, the planner included.",
)
@click.option("--head", "heads", multiple=True, metavar="NAME", help="Only this one; may be given again.")
@click.option("--encoder", "encoders", multiple=True, metavar="NAME", help="May be given again.  [default: mlp]")
@click.option(
    "--points", type=options.count(49152), default=512, show_default=True, help="Number of points of a cloud."
)
@click.option(
    "--decisions", type=options.count(), default=100, show_default=True, help="Number of decisions of each policy."
)
@click.option("--threads", type=options.count(1024), default=1, show_default=True, help="Number of PyTorch's threads.")
@click.option("--device", default="cpu", show_default=True, help="Device by PyTorch's name.")
@options.library
@options.assets
@options.json_file
def policy(
    checkpoint: str | None, heads: tuple[str, ...], encoders: tuple[str, ...], json_file: str | None, **given: Any
) -> None:
    """Time decisions of every head on a live scene, rays included, with fresh weights, batch 1.

    The planner that executes keyposes is not part of it; --checkpoint times a trained policy with it.
    """
    if checkpoint is not None:
        _refuse_beside_a_checkpoint(click.get_current_context())
    with report(json_file, _show_policy if checkpoint is None else _show_looks) as (progress, give):
        if checkpoint is not None:
            from gensim2.policy.keypose.latency import measure_looks

            looks = {name: given[name] for name in ("threads", "assets")}
            return give(measure_looks(checkpoint, looks=given["decisions"], progress=progress, **looks))
        from gensim2.policy.config import HEADS
        from gensim2.policy.latency import measure_latencies

        give(measure_latencies(heads or HEADS, encoders or ("mlp",), progress=progress, **given))


def _refuse_beside_a_checkpoint(context: click.Context) -> None:
    """Refuse what a trained policy says itself: its network, and that it runs on the processor."""
    for param in context.command.params:
        told = context.get_parameter_source(param.name or "") is ParameterSource.COMMANDLINE
        if told and param.name not in ("checkpoint", "decisions", "threads", "assets", "library", "json_file"):
            raise click.UsageError(f"Give {param.opts[0]} without --checkpoint: a trained policy says it itself.")


def _show_looks(result: dict[str, Any]) -> None:
    _show_times(result, ("tasks",), lambda row: (", ".join(row["tasks"]),), f"{result['looks']} looks, ")


def _show_policy(result: dict[str, Any]) -> None:
    _show_times(result, ("encoder", "head", "weights"), lambda row: (row["encoder"], row["head"], row["parameters"]))


def _show_times(
    result: dict[str, Any], heads: Sequence[str], cells: Callable[[dict[str, Any]], tuple[Any, ...]], what: str = ""
) -> None:
    """Show rows of times by stage, each behind the ``cells`` of its own."""
    stages = list(result["rows"][0]["p50"])
    rows = [
        (*cells(row), *(f"{row['p50'][each]:.1f} {row['p95'][each]:.1f} ({row['cpu'][each]:.1f})" for each in stages))
        for row in result["rows"]
    ]
    title = f"{what}{result['threads']} threads, load of the machine {result['load']:.1f}"
    table((*heads, *(f"{stage}, ms: p50 p95 (CPU)" for stage in stages)), rows, title=title)
