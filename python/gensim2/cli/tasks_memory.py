"""``gensim2 tasks add``, ``remove`` and ``export``."""

from __future__ import annotations

import shlex
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from gensim2.cli import options
from gensim2.cli.output import line, report
from gensim2.core.errors import InputError


@click.command("add", cls=options.Command, short_help="Add what a run kept, or a task of your own, to your library.")
@click.argument("folder", type=click.Path(path_type=Path))
@click.option(
    "--episodes",
    type=options.count(),
    default=20,
    show_default=True,
    help="Number of episodes that verify a task of your own.",
)
@options.library
@options.scenes
@options.workers
@options.json_file
def add(folder: Path, json_file: str | None, **given: Any) -> None:
    """Add the tasks of FOLDER to your own library.

    FOLDER is that of a run-pipeline, whose tasks that were designed and kept are added; or one that holds task.yaml and
    strategies/, a task made by hand, which is verified first: of its --episodes fresh ones 0.6 must hold. What is not
    added is named with the reason.
    """
    with report(json_file, show_remembered) as (progress, give):
        if (folder / "task.yaml").is_file():
            from gensim2.design.adding import add_task

            remembered = add_task(folder, progress=progress, **given)
        else:
            context = click.get_current_context()
            for name in given:
                if context.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE:
                    option = f"--{name.replace('_', '-')}"
                    anew = shlex.join(["gensim2", "tasks", "add", str(folder / "tasks" / "NAME")])
                    remedy = f"{anew} verifies one of its tasks anew"
                    raise InputError("is of no use with the folder of a run", field=option, remedy=remedy)
            from gensim2.design.remembering import remember
            from gensim2.tasks.memory import Memory

            _ = Memory().folder  # there must be one, for this command has nothing else to do
            remembered = remember(folder)
        give({"schema_version": 1, **asdict(remembered)})


@click.command("remove", cls=options.Command, short_help="Remove a task from your own library.")
@click.argument("names", nargs=-1, required=True)
@options.library
@options.json_file
def remove(names: tuple[str, ...], json_file: str | None) -> None:
    """Remove tasks by NAMES from your own library; those of the package stay."""
    with report(json_file, _show_removed) as (_, give):
        from gensim2.tasks.memory import Memory

        memory = Memory()
        memory.remove(*names)
        give({"schema_version": 1, "library": str(memory.folder), "removed": list(dict.fromkeys(names))})


@click.command("export", cls=options.Command, short_help="Write tasks with their strategies to a folder or a .zip.")
@click.argument("names", nargs=-1)
@click.option("--origin", metavar="NAME", default=None, help="All that NAME proposed, where no task is named.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    required=True,
    metavar="DIR|FILE.zip",
    help="What is made: a folder, or an archive.",
)
@options.library
@options.json_file
def export(names: tuple[str, ...], origin: str | None, out: Path, json_file: str | None) -> None:
    """Write the tasks NAMES (or all of --origin) with all strategies that they use to a folder or an archive.

    Either can be given to every command as --library; OUT/<Task> of a folder also as a task.
    """
    with report(json_file, _show_exported) as (_, give):
        from gensim2.tasks.exporting import export as function
        from gensim2.tasks.library import task_names

        if bool(names) == (origin is not None):
            raise InputError("name tasks, or an --origin whose tasks are meant", field="names")
        wanted = list(dict.fromkeys(names)) or list(task_names(origin))
        function(wanted, out)
        give({"schema_version": 1, "out": str(out), "exported": wanted})


def show_remembered(result: dict[str, Any]) -> None:
    """Say what was added and what was not."""
    for name, why in result["left_out"].items():
        line(f"left out {name}: {why}")
    if not result["added"] and not result["left_out"]:
        line(
            "nothing to add: no task was designed and kept" if result["library"] else "there is no library of your own"
        )
    if result["added"]:
        line(f"in your library {result['library']}: {', '.join(result['added'])}")


def _show_removed(result: dict[str, Any]) -> None:
    line(f"removed {', '.join(result['removed'])} from {result['library']}")


def _show_exported(result: dict[str, Any]) -> None:
    count = len(result["exported"])
    line(f"{count} task{'' if count == 1 else 's'} in {result['out']}")
