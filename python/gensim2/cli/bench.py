"""Commands ``gensim2 bench``: timing of the solver, of motion planning and of policies."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Annotated, Any, Literal

import click

from gensim2.cli.options import Checkpoint, Robot, command, is_given
from gensim2.cli.output import table
from gensim2.cli.typed import Count, File, Folder, Name, Option, count
from gensim2.core.progress import Progress

Threads = Annotated[int, count(1024)]


def _json_lines(result: dict[str, Any]) -> str:
    from gensim2.bench import json_lines

    return json_lines(result["records"])


def _show_summary(**rows: tuple[str, str]) -> Callable[[dict[str, Any]], None]:
    """Return a function that prints fields of a summary. Each keyword gives the label and the format of a field."""

    def show(result: dict[str, Any]) -> None:
        summary = result["summary"]
        statuses = ", ".join(f"{status} {count}" for status, count in summary["statuses"].items())
        head = [("problems", str(summary["problems"])), ("statuses", statuses)]
        rest = [(label, format(summary[field], form)) for field, (label, form) in rows.items()]
        table(("what", "value"), [*head, *rest])

    return show


_show_problems = _show_summary(
    with_actuation=("with an actuation pose", "d"),
    warnings=("warnings", "d"),
    cpu_ms_actuation=("actuation, CPU ms, median", ".3f"),
    cpu_ms_trajectory=("trajectory, CPU ms, median", ".3f"),
    cpu_ms_total=("plan, CPU ms, median", ".3f"),
    cpu_ms_total_p99=("plan, CPU ms, 99th percentile", ".3f"),
    peak_memory_mb=("peak memory, MB", ".0f"),
)
_show_motions = _show_summary(
    cpu_ms_median=("CPU ms, median", ".3f"),
    cpu_ms_p95=("CPU ms, 95th percentile", ".3f"),
    duration_median=("duration of motions, s, median", ".3f"),
    length_median=("length of paths, rad, median", ".3f"),
)


def _show_policy(result: dict[str, Any]) -> None:
    if "looks" in result:
        _show_times(result, ("tasks",), lambda row: (", ".join(row["tasks"]),), f"{result['looks']} looks, ")
        return
    _show_times(result, ("encoder", "head", "weights"), lambda row: (row["encoder"], row["head"], row["parameters"]))


def _show_times(
    result: dict[str, Any], heads: Sequence[str], cells: Callable[[dict[str, Any]], tuple[Any, ...]], title: str = ""
) -> None:
    """Print a table with the time of each stage in ms.

    Args:
        result: result of the measurement; each entry of its ``rows`` becomes one row of the table.
        cells: function that returns the values of the first columns for an entry of ``rows``.
    """
    stages = list(result["rows"][0]["p50"])
    rows = [
        (*cells(row), *(f"{row['p50'][each]:.1f} {row['p95'][each]:.1f} ({row['cpu'][each]:.1f})" for each in stages))
        for row in result["rows"]
    ]
    title = f"{title}{result['threads']} threads, load of the machine {result['load']:.1f}"
    table((*heads, *(f"{stage}, ms: p50 p95 (CPU)" for stage in stages)), rows, title=title)


@command(show=_show_problems, text=_json_lines)
def solver(
    *,
    problems: File,
    assets: Folder | None = None,
    frames: Literal["original", "object"] = "original",
    threads: Threads = 1,
    sample_dt: Annotated[float | None, Option(metavar="S")] = None,
    progress: Progress,
) -> dict[str, Any]:
    """Time the keypoint solver on a file of planning problems.

    --json writes one line with a JSON object for each problem. Times are CPU times of the solver calls, without reading
    files and loading meshes.

    Args:
        problems: File with one planning problem per line.
        assets: Folder of real objects, used as obstacles.  [default: the table is the only obstacle]
        frames: Frame of the config's translations after actuation. original uses the frame of GenSim2's solver, rotated
            by the object's yaw. object uses the frame of the hand.
        threads: Number of solver threads.
        sample_dt: Also write the joint positions at this interval in seconds.
    """
    from gensim2.bench import solve_problems, summary_of

    records = solve_problems(
        problems, assets=assets, frames=frames, threads=threads, sample_dt=sample_dt, progress=progress
    )
    return {"records": records, "summary": summary_of(records).to_dict()}


@command(show=_show_motions, text=_json_lines)
def motion(
    *,
    problems: File,
    robot: Robot = "panda",
    margin: Annotated[float, Option(metavar="M")] = 0.005,
    deadline_ms: Annotated[float | None, Option(metavar="MS")] = None,
    progress: Progress,
) -> dict[str, Any]:
    """Time the planner on a file of joint-to-joint motion problems.

    --json writes one line with a JSON object for each problem. Times are CPU times for the whole computation of a
    motion, including the construction of the scene.

    Args:
        problems: File with one motion problem per line.
        robot: Robot of the problems.
        margin: Minimum distance to all obstacles, in metres.
        deadline_ms: Time limit of each problem in milliseconds.  [default: none]
    """
    from gensim2.bench import motion_summary, read_motion_problems, solve_motions

    read = read_motion_problems(problems)
    records = solve_motions(read, robot=robot, margin=margin, deadline_ms=deadline_ms, progress=progress)
    return {"records": records, "summary": motion_summary(records).to_dict()}


@command("library", "assets", show=_show_policy)
def policy(
    *,
    checkpoint: Checkpoint | None = None,
    heads: Annotated[tuple[Name, ...], Option("--head", "NAME")] = (),
    encoders: Annotated[tuple[Name, ...], Option("--encoder", "NAME")] = (),
    points: Annotated[int, count(49152)] = 512,
    decisions: Count = 100,
    threads: Threads = 1,
    device: str = "cpu",
    progress: Progress,
    **given: Any,
) -> dict[str, Any]:
    """Measure the latency of policies from observation to action.

    Without --checkpoint, the command measures each type of policy with random weights and batch size 1 in a simulated
    scene. The latency then includes the ray casting that makes the observation, but not the motion planner, which moves
    the hand to the poses that a keypose policy predicts. With --checkpoint, the command measures a trained keypose
    policy. The latency then includes the motion planner.

    Args:
        checkpoint: Trained keypose policy (a policy that predicts hand poses) to measure in episodes of its tasks.
        heads: Policy head to measure, which is the part of the network that outputs actions; can be repeated.
            [default: all heads]
        encoders: Point cloud encoder to measure; can be repeated.  [default: mlp]
        points: Number of points of a point cloud.
        decisions: Number of decisions to measure for each policy.
        threads: Number of PyTorch threads.
        device: PyTorch device, such as cpu or cuda.
    """
    from gensim2.policy.config import HEADS
    from gensim2.policy.keypose.latency import measure_looks
    from gensim2.policy.latency import measure_latencies

    timed: dict[str, Any] = {"threads": threads, "progress": progress, **given}
    if checkpoint is not None:
        _refuse_beside_a_checkpoint(click.get_current_context())
        return measure_looks(checkpoint, looks=decisions, **timed)
    own: dict[str, Any] = {"points": points, "decisions": decisions, "device": device}
    return measure_latencies(heads or HEADS, encoders or ("mlp",), **own, **timed)


def _refuse_beside_a_checkpoint(context: click.Context) -> None:
    """Refuse options that cannot be combined with ``--checkpoint``. The checkpoint determines these settings."""
    for param in context.command.params:
        fits = param.name in ("checkpoint", "decisions", "threads", "assets", "library", "json_file")
        if not fits and is_given(context, param.name or ""):
            wrong = f"Give {param.opts[0]} without --checkpoint: the trained policy determines this option."
            raise click.UsageError(wrong)


bench = click.Group("bench", commands=[solver, motion, policy], help="Measure the solver and policies.")
