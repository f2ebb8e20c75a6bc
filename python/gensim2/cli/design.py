"""Command ``gensim2 design``."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated, Any

from gensim2.cli.options import EPISODES, PROCESSES, Ending, command
from gensim2.cli.output import line
from gensim2.cli.run_pipeline import show_tasks
from gensim2.cli.typed import Count, Folder, Option
from gensim2.core.progress import Progress


def _show(result: dict[str, Any]) -> None:
    show_tasks(result)
    line(f"report: {Path(result['run_dir']) / 'report.html'}")
    if result["task_folder"] is None:
        return
    folder = result["task_folder"]
    for name in result["strategies"]:
        line(f"strategy: {Path(folder) / 'strategies' / name}.yaml")
    line(f"next: {shlex.join(['gensim2', 'tasks', 'add', result['run_dir']])} adds the task to your library")


@command(*EPISODES, "engines", "library", *PROCESSES, "ray", "resume", "videos", show=_show)
def design(
    folder: Annotated[Path, Option(metavar="DIR")],
    *,
    out: Folder | None = None,
    verify: Count = 20,
    progress: Progress,
    **given: Any,
) -> dict[str, Any] | Ending:
    """Find strategies for your own task.

    The folder DIR contains task.yaml. The command uses the offline designer, which needs no language model. The
    designer searches for strategies for each step, tests them in simulation and verifies the best strategies in new
    scenes. The task is kept if 80 % of the episodes succeed (60 % if the task has several steps). The exit code is 1 if
    the task is not kept.

    The command writes the strategies and a new task.yaml to DIR, and saves the old task.yaml in the run folder as
    before.yaml. The run folder also contains report.html with pictures of the plan and its keypoints, the remaining
    errors of the constraints, videos, and all candidate strategies. After Ctrl-C, --resume continues the search.

    Args:
        out: Run folder; with this option DIR is not changed.  [default: DIR/design]
        verify: Number of new episodes that verify the task.
    """
    from gensim2.design.own import design_task

    result = design_task(folder, out=out, verify=verify, progress=progress, **given).to_dict()
    return Ending(result) if result["task_folder"] is None else result
