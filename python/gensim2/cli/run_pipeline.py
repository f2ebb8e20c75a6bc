"""``gensim2 run-pipeline``."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from gensim2.cli import options
from gensim2.cli.designers import NAMES, designer_of_command, designer_options
from gensim2.cli.output import line, report, table
from gensim2.cli.tasks_memory import show_remembered
from gensim2.core.errors import InputError


@click.command("run-pipeline", cls=options.Command, short_help="Design, verify and demonstrate new tasks.")
@click.option("--num-tasks", type=options.count(1000), default=2, show_default=True, help="Tasks to design.")
@click.option("--single", type=click.IntRange(0, 1000), help="Tasks of one step, in place of --num-tasks.")
@click.option("--long", type=click.IntRange(0, 1000), help="Tasks of several steps, in place of --num-tasks.")
@click.option(
    "--verify", type=options.count(), default=20, show_default=True, help="Fresh episodes that decide of each task."
)
@click.option("--from-empty", is_flag=True, help="The designer knows of no task that is stored.")
@click.option(
    "--episodes",
    type=click.IntRange(0, 1_000_000),
    default=5,
    show_default=True,
    help="Demonstrations to keep of each task; 0: none.",
)
@click.option(
    "--target-task",
    metavar="NAME",
    help="Design this task of the library anew, hidden from the designer. A model also takes a name of yours, and says "
    "what such a task is.",
)
@click.option("--target-object", metavar="CLASS", help="Tasks are to be about this class of objects.")
@click.option(
    "--stored-task",
    "stored_tasks",
    multiple=True,
    metavar="NAME",
    help="Also verify and demonstrate this task of the library as it is stored; may be given several times.",
)
@click.option(
    "--designer",
    metavar="offline|MODEL",
    help="Designer of tasks and configs: the search, or a language model by its name.  [default: offline]",
)
@designer_options
@options.scenes
@options.library
@options.out("Run folder.  [default: runs/<date>-<time>]")
@options.processes
@options.ray
@options.resume
@options.video
@options.json_file
def run_pipeline(
    target_task: str | None,
    target_object: str | None,
    designer: str | None,
    json_file: str | None,
    **given: Any,
) -> None:
    """Propose new tasks, find strategies that solve them, verify them in physics and record demonstrations.

    Leaves the tasks, their strategies, how they fared, the demonstrations, a video each and report.html in the
    run folder. A task is kept if enough of its fresh episodes hold that do not in the no-op baseline, on objects that
    the search never saw; it goes into your own library. With a language model the folder also holds every question, its
    answer and what it cost (docs/guides/pipeline.md).
    """
    with report(json_file, _show) as (progress, give):
        from gensim2.core.errors import InputError
        from gensim2.design import run_pipeline as function
        from gensim2.design.remembering import Remembered, remember
        from gensim2.scenes.config import SceneOptions, split_arguments
        from gensim2.tasks.memory import Memory

        memory = Memory()
        if memory.is_there:
            _ = memory.folder  # an archive is only read, which is said before anything starts
        asked = {name: given.pop(name) for name in NAMES}
        _check_kinds(designer, asked, given)
        scene = SceneOptions.of(**split_arguments(given)[0])
        by, target = designer_of_command(designer, target_task, target_object, scene, asked)
        result = function(
            designer=by,
            target_task=target,
            progress=progress,
            **given,
        ).to_dict()
        try:
            remembered = remember(Path(result["run_dir"]))
        except InputError as error:  # of the library: what the run made is told all the same
            give({**result, "remembered": asdict(Remembered(None, (), {"the kept tasks": error.message}))})
            raise
        give({**result, "remembered": asdict(remembered)})


def _check_kinds(designer: str | None, asked: dict[str, Any], given: dict[str, Any]) -> None:
    """Refuse to ask a model for tasks of a kind that it does not propose in this mode: each proposal would cost."""
    if designer in (None, "offline") and asked["config"] is None and asked["replay"] is None:
        return
    mode = asked["mode"]
    explores = mode in (None, "explore")
    kind, other = ("long", "topdown or bottomup") if explores else ("single", "explore")
    if given[kind]:
        steps = "one step" if explores else "several steps"
        message = f"a model proposes tasks of {steps} in --mode {mode or 'explore'}"
        raise InputError(message, field=f"--{kind}", remedy=f"give --mode {other}, in a run of its own")


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
    show_remembered(result["remembered"])
    line(f"report: {Path(result['run_dir']) / 'report.html'}")
