"""Command ``gensim2 collect``."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Self, TextIO

from gensim2.cli.options import EPISODES, PROCESSES, command
from gensim2.cli.output import line, show_engines, table
from gensim2.cli.typed import Folder, Option, Real, count
from gensim2.core.plural import plural
from gensim2.core.progress import LINE_SECONDS, Progress, clock

if TYPE_CHECKING:
    from rich.console import RenderableType

    from gensim2.data.status import Status, TaskStatus


class CollectionView(Progress):
    """Context manager that shows the progress of a collection on standard error; the last table stays on the screen."""

    def __init__(self, stream: TextIO | None = None) -> None:
        from rich.console import Console
        from rich.live import Live

        self._console = Console(file=stream or sys.stderr, highlight=False)
        self._live = Live(console=self._console, auto_refresh=False) if self._console.is_terminal else None
        self._said, self._has_estimate, self._is_over = float("-inf"), False, False

    def __enter__(self) -> Self:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live is not None:
            self._live.stop()

    def update(self, status: Status) -> None:
        """Show the status."""
        if self._live is not None:
            self._live.update(_picture(status), refresh=True)
            return
        if self._is_over:
            return
        self._is_over = status.tried == status.total
        is_first_estimate = status.left is not None and not self._has_estimate
        if is_first_estimate or self._is_over or time.monotonic() - self._said > LINE_SECONDS:
            self._said, self._has_estimate = time.monotonic(), status.left is not None
            self.message(summary(status))

    def message(self, text: str) -> None:
        """Print one line above the table."""
        self._console.print(text, markup=False, soft_wrap=True)


def summary(status: Status) -> str:
    """Return one line: number of episodes, rate without the workers' start, remaining time and size."""
    held = sum(task.held for task in status.tasks)
    words = [f"{status.tried}/{status.total} episodes", f"{held} held"]
    if status.tried < status.total:
        if status.left is not None and status.pace is not None:
            rate = f"{1 / max(status.pace, 1e-9):.2f} a second without the start of the workers"
            words += [rate, f"about {clock(status.left)} left"]
        else:
            words.append("an estimate of the time follows after two episodes of each worker")
    words.append(f"{status.stored / 1e6:.1f} MB, {status.free / 1e9:.1f} GB free")
    if status.failed_tries:
        words.append(f"{plural(status.failed_tries, 'failed attempt')} repeated")
    return ", ".join(words)


def _picture(status: Status) -> RenderableType:
    from rich.console import Group
    from rich.markup import escape
    from rich.progress_bar import ProgressBar
    from rich.table import Table

    grid = Table(box=None, pad_edge=False, header_style="bold")
    for name in ("task", "", "episodes", "held", "causes"):
        grid.add_column(
            name, justify="right" if name in ("episodes", "held") else "left", overflow="ellipsis", no_wrap=True
        )
    begun = [task for task in status.tasks if task.tried]
    for task in begun:
        bar = ProgressBar(total=task.total, completed=task.tried, width=20)
        causes = ", ".join(f"{count} {cause}" for cause, count in task.causes.items())
        grid.add_row(escape(task.name), bar, f"{task.tried}/{task.total}", _share(task), escape(causes))
    to_come = len(status.tasks) - len(begun)
    return Group(grid, *([f"{plural(to_come, 'task')} to come"] if to_come else []), summary(status))


def _share(task: TaskStatus) -> str:
    return f"{task.held / task.tried:.0%}"


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
