"""``gensim2 design``."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

from gensim2.cli.options import EPISODES, PROCESSES, Ending, command
from gensim2.cli.output import line
from gensim2.cli.run_pipeline import show_tasks
from gensim2.cli.typed import Count, Folder
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


@command(*EPISODES, "library", *PROCESSES, "ray", "resume", "videos", show=_show)
def design(
    folder: Folder, *, out: Folder | None = None, verify: Count = 20, progress: Progress, **given: Any
) -> dict[str, Any] | Ending:
    """Find strategies for your own task.

    FOLDER holds task.yaml. The offline designer, which needs no language model, searches for strategies of each step,
    tries them in physics and verifies the best on new scenes. The task is kept if 80 % of the episodes hold (60 % of a
    task of several steps). Its strategies and task.yaml are then written to FOLDER; the former task.yaml stays in the
    run folder as before.yaml. report.html shows the plan with keypoints and residuals, films, and all candidates. After
    Ctrl-C, --resume continues. Ends with exit code 1 if no strategy is kept.

    Args:
        out: Run folder; FOLDER then stays as it is.  [default: FOLDER/design]
        verify: Number of new episodes that verify the task.
    """
    from gensim2.design.own import design_task

    result = design_task(folder, out=out, verify=verify, progress=progress, **given).to_dict()
    return Ending(result) if result["task_folder"] is None else result
