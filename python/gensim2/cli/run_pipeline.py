"""``gensim2 run-pipeline``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gensim2.cli import options
from gensim2.cli.output import line, report, table

if TYPE_CHECKING:
    from gensim2.pipeline.setting import Physics
    from gensim2.tasks.presets import PresetName


@click.command("run-pipeline", cls=options.Command, short_help="Design, verify and demonstrate new tasks.")
@click.option("--num-tasks", type=options.count(1000), default=2, show_default=True, help="Tasks to design.")
@click.option(
    "--episodes",
    type=options.count(),
    default=5,
    show_default=True,
    help="Demonstrations to keep of each task.",
)
@click.option("--target-task", metavar="NAME", help="Design this task of the library anew, hidden from the designer.")
@click.option(
    "--stored-task",
    "stored_tasks",
    multiple=True,
    metavar="NAME",
    help="Also verify and demonstrate this task of the library as it is stored; may be given several times.",
)
@click.option("--designer", default="offline", show_default=True, help="Who proposes tasks and configs.")
@options.seed
@options.library
@options.assets
@options.instances
@options.physics
@options.randomization
@options.robot
@options.open_loop
@options.out("Run folder.  [default: runs/<date>-<time>]")
@options.workers
@options.time_limit
@options.jobs_per_worker
@options.resume
@options.video
@options.json_file
def run_pipeline(
    num_tasks: int,
    episodes: int,
    target_task: str | None,
    stored_tasks: tuple[str, ...],
    designer: str,
    seed: int,
    assets: str | None,
    instances: str,
    physics: Physics,
    randomization: PresetName,
    robot: str,
    open_loop: bool,
    out: Path | None,
    workers: int,
    time_limit: float,
    jobs_per_worker: int,
    resume: bool,
    video: bool,
    json_file: str | None,
) -> None:
    """Propose new tasks, find strategies that solve them, verify them in physics and record demonstrations.

    Leaves the tasks, their strategies, how they fared, the demonstrations, a video each and report.html in the
    run folder. A task is kept if 70 % of at least 20 fresh episodes hold that do not with a still arm, on objects that
    the search never saw.
    """
    with report(json_file, _show) as (progress, give):
        from gensim2.pipeline import run_pipeline as function

        give(
            function(
                num_tasks=num_tasks,
                episodes=episodes,
                seed=seed,
                assets=assets,
                out=out,
                workers=workers,
                time_limit=time_limit,
                jobs_per_worker=jobs_per_worker,
                target_task=target_task,
                stored_tasks=stored_tasks,
                physics=physics,
                randomization=randomization,
                instances=instances,
                robot=robot,
                open_loop=open_loop,
                resume=resume,
                designer=designer,
                video=video,
                progress=progress,
            ).to_dict()
        )


def _show(result: dict[str, Any]) -> None:
    rows = [
        (
            task["name"],
            task["class"],
            task["goal"],
            *(f"{task['verified'][name]}/{task['verified']['episodes']}" for name in ("paper", "held", "strict")),
            sum(task["verified"]["objects"].values()),
            "yes" if task["kept"] else "no",
            task["demos"],
        )
        for task in result["tasks"]
    ]
    table(("task", "class", "goal", "paper", "held", "strict", "objects", "kept", "demos"), rows)
    for rejected in result["rejected"]:
        line(f"rejected {rejected['name']}: {rejected['reason']}")
    for note in result["notes"]:
        line(f"note: {note}")
    line(f"report: {Path(result['run_dir']) / 'report.html'}")
