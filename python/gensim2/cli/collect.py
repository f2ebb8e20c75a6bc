"""Command ``gensim2 collect``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from gensim2.cli.collect_view import CollectionView
from gensim2.cli.options import EPISODES, PROCESSES, command
from gensim2.cli.output import line, show_engines, table
from gensim2.cli.typed import Folder, Option, Real, count


def _show(result: dict[str, Any]) -> None:
    rows = [
        (
            task["name"],
            task["tried"],
            task["held"],
            task["strict"],
            ", ".join(f"{count} {cause}" for cause, count in task["causes"].items()),
        )
        for task in result["tasks"]
    ]
    table(("task", "episodes", "held", "strict", "causes"), rows)
    for name, reason in result["skipped"].items():
        line(f"skipped {name}: {reason}")
    for task in result["tasks"]:
        show_engines(task["name"], task["tried"], task)
    rate = result["episodes_per_second"]
    speed = f", {rate:.2f} episodes a second including the start of the workers" if rate is not None else ""
    line(f"{result['held']} of {result['episodes']} episodes hold; {result['bytes'] / 1e6:.1f} MB{speed}")
    line(f"report: {Path(result['folder']) / 'report.html'}")


@command(*EPISODES, "engines", *PROCESSES, "ray", show=_show)
def collect(
    tasks: tuple[str, ...] = (),
    *,
    episodes: Annotated[int, count(999_999_999)],
    out: Folder,
    keep_failures: bool = False,
    noise: Annotated[float, Real(0, 0.2), Option(metavar="RAD")] = 0.0,
    strategy: Annotated[tuple[str, ...], Option(metavar="NAME")] = (),
    objects: Annotated[int | None, count(100_000)] = None,
    resume: bool = False,
    **given: Any,
) -> dict[str, Any]:
    """Collect a data set of demonstrations for many tasks.

    The command runs --episodes episodes of each task in TASKS. Without TASKS, it runs the tasks of the paper. The data
    set contains a record of every episode, and the states and actions of successful episodes. Use `gensim2 render` to
    add observations. A collection that was interrupted and resumed has the same result as an uninterrupted collection.
    With --resume you may increase --episodes and add TASKS.

    Args:
        episodes: Number of episodes of each task.
        out: Folder of the data set.
        keep_failures: Also keep the states of failed episodes.
        noise: Standard deviation of the noise that is added from time to time to the commands of the arm's joints. The
            data set also contains the commands without noise, and policies are trained on the commands without noise.
        strategy: Name of a strategy. A step that has a strategy of this name uses no other strategy. Can be repeated.
        objects: Number of new generated objects of each class to use instead of --instances.  [default: the objects of
            --instances]
        resume: Continue the data set in --out, if there is one.
    """
    from gensim2.data import collect as function

    own: dict[str, Any] = {
        "keep_failures": keep_failures,
        "noise": noise,
        "strategy": strategy,
        "objects": objects,
        "resume": resume,
    }
    with CollectionView() as view:
        return function(tasks, listener=view, episodes=episodes, out=out, **own, **given).to_dict()
