"""Command ``gensim2 run-pipeline``."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import click

from gensim2.cli.designers import NAMES, OFFLINE, Designing, designer_of_command
from gensim2.cli.options import EPISODES, PROCESSES, Ending, command
from gensim2.cli.output import line, table
from gensim2.cli.tasks import show_remembered
from gensim2.cli.typed import Count, Option, count
from gensim2.core.errors import InputError
from gensim2.core.progress import Progress

Several = Annotated[int | None, click.IntRange(0, 1000)]


def _check_kinds(designer: str | None, asked: dict[str, Any], single: int | None, long: int | None) -> None:
    """Reject ``--single`` or ``--long``, before any request costs money, if the mode has no tasks of this kind."""
    if designer in (None, OFFLINE) and asked["config"] is None and asked["replay"] is None:
        return
    mode = asked["mode"]
    if mode == "free":
        return
    explores = mode in (None, "explore")
    kind, other = ("long", "topdown or bottomup") if explores else ("single", "explore")
    if {"single": single, "long": long}[kind]:
        steps = "one step" if explores else "several steps"
        message = f"the model proposes only tasks of {steps} in --mode {mode or 'explore'}"
        raise InputError(message, field=f"--{kind}", remedy=f"start a separate run with --mode {other}")


def show_tasks(result: dict[str, Any]) -> None:
    """Print the table of a run's tasks, the rejected tasks, and advice if no task was kept."""
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
    if rows:
        table(("task", "class", "goal", "paper", "held", "strict", "objects", "kept", "demos"), rows)
    for rejected in result["rejected"]:
        line(f"rejected {rejected['name']}: {rejected['reason']}")
    for note in result["notes"]:
        line(f"note: {note}")
    if not any(task["kept"] for task in result["tasks"]):
        from gensim2.design.next_steps import next_steps

        line("no task was kept; next:")
        for advice in next_steps(Path(result["run_dir"])):
            line(f"- {advice}")


def _show(result: dict[str, Any]) -> None:
    show_tasks(result)
    show_remembered(result["remembered"])
    line(f"report: {Path(result['run_dir']) / 'report.html'}")


@command(Designing, *EPISODES, "engines", "library", "out", *PROCESSES, "ray", "resume", "videos", show=_show)
def run_pipeline(
    *,
    num_tasks: Annotated[int, count(1000)] = 2,
    single: Several = None,
    long: Several = None,
    verify: Count = 20,
    from_empty: bool = False,
    episodes: Annotated[int, click.IntRange(0, 1_000_000)] = 5,
    target_task: Annotated[str | None, Option(metavar="NAME")] = None,
    target_object: Annotated[str | None, Option(metavar="CLASS")] = None,
    stored_tasks: Annotated[tuple[str, ...], Option("--stored-task", "NAME")] = (),
    designer: Annotated[str | None, Option(metavar="offline|MODEL")] = None,
    progress: Progress,
    **given: Any,
) -> dict[str, Any] | Ending:
    """Design, verify and demonstrate new tasks.

    The pipeline proposes tasks and searches for strategies that solve them. Then it verifies each task in new simulated
    episodes with objects that the search never used. It keeps a task if enough of these episodes succeed. An episode
    does not count as a success if the goal also becomes true in the same scene when the robot does not move. Finally
    the pipeline records demonstrations of the kept tasks and adds the tasks to your own library.

    The run folder contains the tasks, strategies, verifications, demonstrations, a video of each task and report.html.
    With a language model, the folder also contains every request with its answer and cost (docs/guides/pipeline.md).

    Args:
        num_tasks: Number of tasks to design.
        single: Number of single-step tasks; replaces --num-tasks.
        long: Number of tasks with several steps; replaces --num-tasks.
        verify: Number of new episodes that verify each task.
        from_empty: Design as if the library were empty: hide all stored tasks from the designer.
        episodes: Number of demonstrations to keep for each task; 0 records none.
        target_task: Redesign this library task without using its stored solution. A language model also accepts a new
            name, and then describes the task itself.
        target_object: Class of objects that the tasks must use.
        stored_tasks: Library task that the run also verifies and demonstrates, with the stored strategies of the task;
            can be repeated.
        designer: Designer of tasks and strategies. offline is a search without a language model, and MODEL is the name
            of a language model.  [default: offline]
    """
    from gensim2.design import run_pipeline as function
    from gensim2.design.remembering import Remembered, remember
    from gensim2.scenes.config import SceneOptions, split_arguments
    from gensim2.tasks.memory import Memory

    memory = Memory()
    if memory.is_there:
        # Fail before the work begins if the library is an archive. Tasks cannot be added to an archive.
        _ = memory.folder
    asked = {name: given.pop(name) for name in NAMES}
    _check_kinds(designer, asked, single, long)
    scene = SceneOptions.of(**split_arguments(given)[0])
    by, target = designer_of_command(designer, target_task, target_object, scene, asked)
    counts: dict[str, Any] = {
        "num_tasks": num_tasks,
        "single": single,
        "long": long,
        "verify": verify,
        "episodes": episodes,
    }
    wanted: dict[str, Any] = {"from_empty": from_empty, "target_task": target, "stored_tasks": stored_tasks}
    result = function(designer=by, progress=progress, **counts, **wanted, **given).to_dict()
    try:
        remembered = remember(Path(result["run_dir"]))
    # The run has finished, so its result is returned even if a task cannot be added to the user's library.
    except InputError as error:
        left_out = Remembered(None, (), {"the kept tasks": error.message})
        return Ending({**result, "remembered": asdict(left_out)}, error)
    return {**result, "remembered": asdict(remembered)}
