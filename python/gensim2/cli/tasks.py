"""Commands ``gensim2 tasks``."""

from __future__ import annotations

import shlex
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal

import click

from gensim2.cli.options import EPISODES, command, is_given
from gensim2.cli.output import line, table
from gensim2.cli.typed import Count, Name, Option
from gensim2.core.errors import InputError
from gensim2.core.plural import plural
from gensim2.core.progress import Progress

Page = Annotated[Path, click.Path(path_type=Path, file_okay=False), Option(metavar="DIR")]


def _show_list(result: dict[str, Any]) -> None:
    rows = [
        (
            task["name"],
            f"{task['origin'] or ''}{'' if task['packaged'] else ' (yours)'}",
            ", ".join(dict.fromkeys(thing["class"] for thing in task["objects"].values())),
            len(task["steps"]),
            task["description"],
            task["env_id"] or "",
        )
        for task in result["tasks"]
    ]
    table(("task", "origin", "objects", "steps", "what", "environment"), rows)


def _show_task(task: dict[str, Any]) -> None:
    line(f"{task['name']}: {task['description']}")
    environment = "" if task["env_id"] is None else f"{task['env_id']}, "
    line(f"{task['type']}, {environment}at most {task['max_episode_steps']} control steps")
    _show_provenance(task)
    line(f"goal: {task['goal']}\n")
    rows = [(thing["name"], thing["class"], thing["place"], thing["randomization"]) for thing in task["objects"]]
    table(("object", "class", "stands", "randomization"), rows)
    line("")
    table(("", "step", "acts on", "with", "strategies, in order", "until"), _steps(task["steps"]))
    line("")
    _show_figures(task["figures"])


def _show_provenance(task: dict[str, Any]) -> None:
    if task["origin"] is not None:
        line(f"proposed by {task['origin']}" + (f", prompts {task['prompts'][:12]}" if task["prompts"] else ""))
    if (found := task["verification"]) is not None:
        low, high = found["interval"]
        objects = ", ".join(f"{name} ({count})" for name, count in found["objects"].items())
        held = f"{found['held']} of {found['episodes']} fresh episodes succeeded ({low:.2f} to {high:.2f})"
        line(f"verified: {held}, seed {found['seed']}, {found['instances']} objects: {objects}")


def _steps(steps: list[dict[str, Any]]) -> list[tuple[object, ...]]:
    return [
        (
            number,
            step["name"],
            step["object"],
            step["tool"] or "the hand",
            "\n".join(_strategy(strategy) for strategy in step["strategies"]),
            step["done"],
        )
        for number, step in enumerate(steps, 1)
    ]


def _strategy(strategy: dict[str, Any]) -> str:
    made = "" if strategy["by"] is None else f" (by {strategy['by']}, seen: {strategy['seen']})"
    return f"{strategy['name']}: {strategy['kind']}{made}"


def _show_figures(figures: dict[str, Any]) -> None:
    rows: list[tuple[object, ...]] = []
    if (paper := figures["paper"]) is not None:
        rows.append(("the paper", "", f"{paper['mean']:.2f} ± {paper['deviation']:.2f}", "", ""))
    if (original := figures["original"]) is not None:
        rate = original["successes"] / original["episodes"]
        rows.append(("the original's release, as measured", original["episodes"], f"{rate:.2f}", "", ""))
    for row in figures["measured"]:
        (low, high), rates = row["rates"]["held"]["interval"], row["rates"]
        held = f"{rates['held']['mean']:.2f} ({low:.2f} to {high:.2f})"
        words = (f"{rates['paper']['mean']:.2f}", held, f"{rates['strict']['mean']:.2f}")
        rows.append((row["in_words"], row["episodes"], *words))
    if rows:
        table(("figures", "episodes", "paper", "held (95 %)", "strict"), [tuple(map(str, row)) for row in rows])
    else:
        line("no figures: it has not been measured")


def show_remembered(result: dict[str, Any]) -> None:
    """Print which tasks were added to the library, and why other tasks were not added."""
    for name, why in result["left_out"].items():
        line(f"left out {name}: {why}")
    if not result["added"] and not result["left_out"]:
        line("nothing to add: no task was designed and kept" if result["library"] else "the user library is disabled")
    if result["added"]:
        line(f"in your library {result['library']}: {', '.join(result['added'])}")


def _show_removed(result: dict[str, Any]) -> None:
    line(f"removed {', '.join(result['removed'])} from {result['library']}")


def _show_exported(result: dict[str, Any]) -> None:
    line(f"{plural(len(result['exported']), 'task')} in {result['out']}")


def _show_gallery(result: dict[str, Any]) -> None:
    for name, reason in result["skipped"].items():
        line(f"skipped {name}: {reason}")
    for name, cause in result["without"].items():
        line(f"{name}: no episode held, the last because of: {cause}")
    line(f"{plural(len(result['shown']), 'task')} shown: {result['index']}")


@command("library", name="list", show=_show_list)
def list_tasks(*, origin: Name | None = None) -> dict[str, Any]:
    """List the tasks of the library.

    The list contains the paper's suite, the designed tasks, and your own.

    Args:
        origin: List only tasks proposed by NAME: paper, or a designer.
    """
    from gensim2.tasks.library import load_task, origin_of, packaged_names, task_names

    specs = [load_task(name) for name in task_names(origin)]
    return {
        "schema_version": 1,
        "tasks": [
            {
                **spec.model_dump(mode="json"),
                "origin": origin_of(spec),
                "packaged": spec.name in packaged_names(),
                "env_id": spec.env_id if spec.name in packaged_names() else None,
            }
            for spec in specs
        ],
    }


@command("library", show=_show_task)
def show(task: str) -> dict[str, Any]:
    """Describe a task.

    The command prints the instruction of TASK, its objects, its steps, its strategies and their origin, its goal, and
    its success rates: the paper's, the original release's, and our own. TASK is a task of the library, or a folder that
    holds task.yaml and strategies/.
    """
    from gensim2.design.description import description_of
    from gensim2.objects import open_library
    from gensim2.rollout.inputs import task_and_strategies

    spec, strategies = task_and_strategies(task)
    return {"schema_version": 1, **description_of(spec, strategies, open_library("builtin"))}


@command(
    "origin", "library", "seed", "assets", "engine", "physics", "workers", "time_limit", "resume", show=_show_gallery
)
def gallery(tasks: tuple[str, ...] = (), *, out: Page, progress: Progress, **given: Any) -> dict[str, Any]:
    """Write a page with a video of every task.

    The page shows TASKS. Without TASKS, it shows all tasks of the paper, or of --origin. For each task the page has a
    picture, a video, the instruction, the steps and the success rates. For the video, the command runs at most five
    episodes and records the first successful one. After Ctrl-C, --resume continues.

    Args:
        out: Folder of the page.
    """
    from gensim2.design import tasks_gallery as function

    return function(tasks, out=out, progress=progress, **given).to_dict()


@command("library", *EPISODES, "workers", show=show_remembered)
def add(
    folder: Path, *, episodes: Count = 20, engines: Literal["one", "both"] = "one", progress: Progress, **given: Any
) -> dict[str, Any]:
    """Add the kept tasks of a run, or your own task, to your library.

    FOLDER is a run folder of run-pipeline, or a folder with task.yaml and strategies/ that you wrote. From a run
    folder, the command adds the designed tasks that the run kept. A task that you wrote is first verified in new
    episodes, and is added only if at least 60 % of the episodes succeed. If a task is not added, the command prints the
    reason.

    Args:
        episodes: Number of episodes that verify your own task.
        engines: both also verifies your own task in the other physics engine, on the same scenes.
    """
    if (folder / "task.yaml").is_file():
        from gensim2.design.remembering import add_task

        return {
            "schema_version": 1,
            **asdict(add_task(folder, episodes=episodes, engines=engines, progress=progress, **given)),
        }
    context = click.get_current_context()
    for name in ("episodes", "engines", *given):
        if is_given(context, name):
            anew = shlex.join(["gensim2", "tasks", "add", str(folder / "tasks" / "NAME")])
            remedy = f"to verify one of its tasks again, run {anew}"
            option = f"--{name.replace('_', '-')}"
            raise InputError("does not apply to a run folder", field=option, remedy=remedy)
    from gensim2.design.remembering import remember
    from gensim2.tasks.memory import Memory

    _ = Memory().folder  # Raises an error if the user has disabled the library.
    return {"schema_version": 1, **asdict(remember(folder))}


@command("library", show=_show_removed)
def remove(names: tuple[str, ...]) -> dict[str, Any]:
    """Remove tasks from your own library.

    The command removes the tasks NAMES; tasks of the package cannot be removed.
    """
    from gensim2.tasks.memory import Memory

    memory = Memory()
    memory.remove(*names)
    return {"schema_version": 1, "library": str(memory.folder), "removed": list(dict.fromkeys(names))}


_OF_SCENES = ("seed", "assets", "instances", "randomization", "robot")


@command("library", *_OF_SCENES, show=_show_exported)
def export(
    names: tuple[str, ...] = (),
    *,
    origin: Name | None = None,
    to: Literal["library", "mjcf"] = "library",
    out: Annotated[Path, Option(metavar="DIR|FILE.zip")],
    **scene: Any,
) -> dict[str, Any]:
    """Write tasks to a folder or a .zip.

    The command writes the tasks NAMES, or all tasks of --origin. With --to library, the output is a task library. You
    can give the folder OUT as --library to every command, and a subfolder OUT/<Task> wherever a command expects a task.
    With --to mjcf, the command writes one scene of each task, including the robot, to the file OUT/<Task>.xml. python
    -m mujoco.viewer can show this file.

    Args:
        origin: Export all tasks proposed by NAME; replaces NAMES.
        to: library writes task.yaml and the strategies that a task uses; mjcf (extra gensim2[mujoco]) writes MuJoCo's
            XML.
        out: Folder or archive to write.
    """
    from gensim2.tasks.exporting import export as function
    from gensim2.tasks.library import task_names

    if bool(names) == (origin is not None):
        raise InputError("give task names or --origin, but not both", field="names")
    wanted = list(dict.fromkeys(names)) or list(task_names(origin))
    if to == "library":
        for name in _OF_SCENES:
            if is_given(click.get_current_context(), name):
                raise InputError("applies only with --to mjcf", field=f"--{name}")
        function(wanted, out)
        return {"schema_version": 1, "out": str(out), "exported": wanted}
    from gensim2.sim.mujoco.mjcf import write_scene
    from gensim2.tasks.library import load_task

    for name in wanted:
        write_scene(load_task(name), out / f"{name}.xml", **scene)
    return {"schema_version": 1, "out": str(out), "exported": wanted}


tasks = click.Group(
    "tasks", commands=[list_tasks, show, gallery, add, remove, export], help="Inspect and extend the task library."
)
