"""Implement ``gensim2 design``, which searches and verifies strategies for a user's task as ``run_pipeline`` does."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Unpack

from gensim2.core.files import write_atomic
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.data.records import PipelineResult
from gensim2.data.runfolder import TaskFolder
from gensim2.design.execution import VERIFY_EPISODES
from gensim2.design.remembering import verified
from gensim2.design.run import run_pipeline
from gensim2.design.search import Budget
from gensim2.rollout.config import RunArguments
from gensim2.scenes.physics import Engines
from gensim2.tasks.library import TASK_FILE, load_strategies_beside, load_task_file, strategies_of

RUN = "design"
"""Name of the run folder inside the task's folder."""

BEFORE = "before.yaml"
"""Name of the copy of ``task.yaml`` in the run folder."""


@dataclass(frozen=True)
class TaskDesign:
    """Result of ``design_task``.

    Attributes:
        run: result of the run, whose only task was verified or rejected.
        folder: folder with task.yaml and the found strategies; None: no strategy was kept.
        strategies: names of the strategies, in order of preference.
    """

    run: PipelineResult
    folder: Path | None
    strategies: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the result as a dictionary for JSON."""
        folder = None if self.folder is None else str(self.folder)
        return {**self.run.to_dict(), "task_folder": folder, "strategies": list(self.strategies)}


def design_task(
    folder: Path | str,
    *,
    out: Path | None = None,
    verify: int = VERIFY_EPISODES,
    seed: int = 0,
    resume: bool = False,
    videos: int = 1,
    engines: Engines = "one",
    budget: Budget | None = None,
    progress: Progress = NULL_PROGRESS,
    **scene: Unpack[RunArguments],
) -> TaskDesign:
    """Find strategies for a task of your own by search, and verify them in physics on new scenes.

    Example:
        ```python
        found = gensim2.design_task("CloseTeaChest", assets="mylibrary")
        found.strategies
        ```

    Args:
        folder: folder with ``task.yaml``; strategies in it are ignored.
        out: run folder. None: ``design`` in ``folder``; kept strategies are then also written to ``folder``.
        verify: number of new verification episodes. 80 % of them must succeed, or 60 % if the task has several steps.
        seed: seed of all random choices.
        resume: continue the run in the run folder.
        videos: number of episodes to film; failed episodes are filmed if the task is not kept.
        engines: ``"both"`` also verifies in the other engine. Enough episodes must succeed in both engines.
        budget: limits of the search; None: the default budget.
        progress: listener for stages and steps.
        scene: see :class:`~gensim2.rollout.config.RunArguments`.

    Returns:
        The run, the folder of the finished task and the names of its strategies.

    Raises:
        InputError: the folder or an argument cannot be used.
        NotRunError: some episodes could not be run; ``resume`` continues.
    """
    folder = Path(folder)
    task = load_task_file(folder)
    run_dir = folder / RUN if out is None else Path(out)
    result = run_pipeline(
        num_tasks=1, episodes=0, target_task=folder, out=run_dir,
        verify=verify, seed=seed, resume=resume, videos=videos, engines=engines, budget=budget, progress=progress,
        **scene,
    )  # fmt: skip
    if not any(each.kept for each in result.tasks):
        return TaskDesign(result, None, ())
    found = run_dir / "tasks" / task.name
    designed = load_task_file(found)
    verification = TaskFolder(found).verification()
    assert verification is not None
    assert designed.provenance is not None
    told = designed.provenance.model_copy(update={"verification": verified(verification, seed)})
    designed = designed.model_copy(update={"provenance": told})
    if out is None:
        if not (run_dir / BEFORE).exists():
            write_atomic(run_dir / BEFORE, (folder / TASK_FILE).read_text(encoding="utf-8"))
        files = TaskFolder(folder)
        files.write_task(designed)
        files.write_strategies(load_strategies_beside(found, designed))
        found = folder
    return TaskDesign(result, found, strategies_of(designed))
