"""``gensim2 bench``."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import click

from gensim2.cli.output import line, report, table


@click.group("bench")
def bench() -> None:
    """Measure the solver."""


@bench.command("solver", short_help="Solve a file of planning problems.")
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
@click.option("--threads", type=click.IntRange(min=1), default=1, show_default=True, help="Solver threads.")
@click.option("--sample-dt", type=float, default=None, metavar="S", help="Also write the joints every S seconds.")
@click.option(
    "--json",
    "out",
    type=click.Path(path_type=Path),
    required=True,
    metavar="OUT",
    help="JSON Lines are written here, one object a problem.",
)
def solver(
    problems: Path,
    assets: Path | None,
    frames: Literal["original", "object"],
    threads: int,
    sample_dt: float | None,
    out: Path,
) -> None:
    """Solve a file of planning problems and write what was found, one JSON object a line.

    Times are CPU time of the solver calls alone; reading and mesh loading come before.
    """
    with report(None, _show) as (progress, give):
        from gensim2.bench import bench_solver

        give(
            bench_solver(
                problems,
                out,
                assets=assets,
                frames=frames,
                threads=threads,
                sample_dt=sample_dt,
                progress=progress,
            ).to_dict()
        )
    line(f"written: {out}")


def _show(result: dict[str, Any]) -> None:
    statuses = ", ".join(f"{status} {count}" for status, count in result["statuses"].items())
    table(
        ("what", "value"),
        [
            ("problems", str(result["problems"])),
            ("statuses", statuses),
            ("with an actuation pose", str(result["with_actuation"])),
            ("warnings", str(result["warnings"])),
            ("actuation, CPU ms, median", f"{result['cpu_ms_actuation']:.3f}"),
            ("trajectory, CPU ms, median", f"{result['cpu_ms_trajectory']:.3f}"),
            ("plan, CPU ms, median", f"{result['cpu_ms_total']:.3f}"),
            ("plan, CPU ms, 99th percentile", f"{result['cpu_ms_total_p99']:.3f}"),
            ("peak memory, MB", f"{result['peak_memory_mb']:.0f}"),
        ],
    )
