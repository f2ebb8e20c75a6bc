"""Carry out an instruction in simulation, for ``gensim2 do``."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Unpack

from gensim2.core.files import write_atomic
from gensim2.core.pages import template
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.core.record_files import SCHEMA_VERSION
from gensim2.data.runfolder import TaskFolder, default_run_dir
from gensim2.doing.composing import Composed, compose
from gensim2.evaluation.evaluating import EvaluationResult, evaluate
from gensim2.instructions.grammar import parse
from gensim2.instructions.steps import Step
from gensim2.objects import open_library
from gensim2.rollout.config import PERCEIVED_SCENE, EvaluationArguments, RolloutOptions
from gensim2.rollout.controller_spec import planner_spec
from gensim2.rollout.inputs import check_counts, scene_options
from gensim2.rollout.record import Episode
from gensim2.rollout.tally import interval
from gensim2.tasks.exporting import write_task
from gensim2.tasks.spec import TaskSpec

PAGE = "report.html"


@dataclass(frozen=True)
class DoResult:
    """Result of an instruction that was carried out in simulation.

    Attributes:
        sentence: the instruction.
        steps: steps of the instruction.
        composed: task made from the steps.
        evaluation: results of the episodes. The controller ends each episode by itself.
    """

    sentence: str
    steps: tuple[Step, ...]
    composed: Composed = field(repr=False)
    evaluation: EvaluationResult = field(repr=False)

    @property
    def task(self) -> TaskSpec:
        """Task that carries out the instruction."""
        return self.composed.task

    @property
    def episodes(self) -> tuple[Episode, ...]:
        """Records of the episodes."""
        (row,) = self.evaluation.rows
        return row.episodes

    @property
    def held(self) -> int:
        """Number of episodes that pass the verdict ``held``."""
        return sum(each.held for each in self.episodes)

    @property
    def is_done(self) -> bool:
        """Whether every episode passes the verdict ``held``."""
        return self.held == len(self.episodes)

    @property
    def videos(self) -> list[str]:
        """Video files."""
        return self.evaluation.videos.get(self.task.name, [])

    def to_dict(self) -> dict[str, Any]:
        """Return a dictionary for JSON."""
        return {
            "schema_version": SCHEMA_VERSION,
            "run_dir": self.evaluation.run_dir,
            "sentence": self.sentence,
            "steps": [each.text for each in self.steps],
            "task": self.task.name,
            "is_from_library": self.composed.is_from_library,
            "controller": self.evaluation.controller["target"],
            "episodes_run": len(self.episodes),
            "held": self.held,
            "held_interval": list(interval(self.held, len(self.episodes))),
            "strict": sum(each.strict for each in self.episodes),
            "stopped": sum(not each.truncated for each in self.episodes),
            "episodes": [_told(each, self.task) for each in self.episodes],
            "videos": self.videos,
            "cpu_s": round(self.evaluation.cpu_s, 3),
        }


def do(
    sentence: str,
    *,
    scene_source: str = PERCEIVED_SCENE,
    depth_noise: str | None = None,
    policy: str | None = None,
    episodes: int = 1,
    seed: int = 0,
    videos: int = 1,
    out: Path | None = None,
    resume: bool = False,
    progress: Progress = NULL_PROGRESS,
    **scene: Unpack[EvaluationArguments],
) -> DoResult:
    """Parse an instruction, and carry it out in random scenes. The controller ends each episode by itself.

    Example:
        ```python
        result = gensim2.do("open the box, put the apple into it and close it", scene_source="true", assets="builtin")
        result.held, [step.text for step in result.steps]
        ```

    Args:
        sentence: instruction in English.
        scene_source: source of the planner's scene, as in :class:`~gensim2.rollout.config.RolloutOptions`.
        depth_noise: noise of the depth cameras for an estimated scene.
        policy: folder of a policy that acts instead of the planner, or ``"builtin"``.
        episodes: number of random scenes.
        seed: seed of the scenes.
        videos: number of episodes to record as videos.
        out: run folder; default ``runs/<date>-<time>``.
        resume: continue the run in ``out``.
        progress: listener for stages and steps.
        scene: options of scenes and worker processes, as for :func:`~gensim2.evaluation.evaluate`.

    Returns:
        The steps, the task, and the record of each episode.

    Raises:
        SentenceError: the instruction is not understood or cannot be done.
        InputError: an argument is invalid, the estimator does not know an object's class, or the policy does not know
            the task.
        NotRunError: some episodes could not be run; call again with ``resume``.
    """
    check_counts(episodes=episodes)
    steps = parse(sentence)
    options = scene_options(**scene)
    rollout = RolloutOptions(scene_source=scene_source, depth_noise=depth_noise)
    composed = compose(steps, open_library(options.assets), options.robot)
    run_dir = Path(out) if out is not None else default_run_dir()
    given: dict[str, Any] = {"episodes": episodes, "seed": seed, "videos": videos, "out": run_dir, "resume": resume}
    given |= {"stop": "controller", "progress": progress, **scene}
    with tempfile.TemporaryDirectory() as folder:
        name = composed.task.name
        if not composed.is_from_library:
            name = str(Path(folder) / name)
            write_task(Path(name), composed.task, composed.strategies)
        if policy is None:
            spec = planner_spec(composed.task, composed.strategies, rollout, options.robot)
            evaluation = evaluate(spec, [name], **given)
        else:
            from gensim2.policy.evaluating import evaluate_policy  # imported late, because it needs PyTorch

            evaluation = evaluate_policy(policy, [name], controls="none", **given).policy
    result = DoResult(sentence, steps, composed, evaluation)
    files = TaskFolder(run_dir / "tasks" / composed.task.name)
    files.write_task(composed.task)
    files.write_strategies(composed.strategies)
    _write_page(result, run_dir)
    return result


def _told(episode: Episode, task: TaskSpec) -> dict[str, Any]:
    """Return the record of an episode for JSON: its verdicts, and for each step whether it was done."""
    records = {each.name: each for each in episode.steps}
    return {
        "seed": episode.seed,
        "held": episode.held,
        "strict": episode.strict,
        "stopped": not episode.truncated,
        "cause": episode.cause,
        "steps": [
            {
                "name": step.name,
                "done": step.name in records and records[step.name].done,
                "plans": len(records[step.name].plans) if step.name in records else 0,
            }
            for step in task.steps
        ],
    }


def _write_page(result: DoResult, run_dir: Path) -> None:
    """Write the page of a run: the steps, the episodes and the videos."""
    films: Sequence[str] = [os.path.relpath(each, run_dir) for each in result.videos]
    page = template("gensim2.doing", "instruction.html.j2").render(told=result.to_dict(), films=films)
    write_atomic(run_dir / PAGE, page)
