"""Record demonstrations of one task with its stored strategies, for ``gensim2 demo``."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Unpack

from gensim2.core.files import check_writable
from gensim2.core.processes import Execution
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.core.record_files import SCHEMA_VERSION
from gensim2.data.demonstrations import collect
from gensim2.data.runfolder import RunFolder, default_run_dir
from gensim2.design.report import reported
from gensim2.rollout.config import RunArguments
from gensim2.rollout.identity import digest, listing
from gensim2.rollout.inputs import check_counts, check_scene_source, read_task_input
from gensim2.rollout.runner import EpisodeRunner
from gensim2.rollout.tally import Tally, engines_record
from gensim2.scenes.physics import Engines


@dataclass(frozen=True)
class DemoResult:
    """Result of ``demo``.

    Attributes:
        name: name of the task.
        run_dir: run folder.
        demos: number of demonstrations.
        tally: counts over all episodes that were run.
        cpu_s: CPU time of all worker processes in this call, s, excluding their start.
        notes: remarks for the user.
    """

    name: str
    run_dir: str
    demos: int
    tally: Tally
    cpu_s: float
    notes: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return a dictionary for JSON."""
        return {
            "schema_version": SCHEMA_VERSION,
            "name": self.name,
            "run_dir": self.run_dir,
            "demos": self.demos,
            "episodes_run": self.tally.episodes,
            **self.tally.verdicts(),
            "causes": self.tally.causes,
            **engines_record(self.tally.engines, self.tally.disagreed),
            "cpu_s": round(self.cpu_s, 3),
            "notes": list(self.notes),
        }


def demo(
    task: str,
    *,
    episodes: int = 5,
    seed: int = 0,
    out: Path | None = None,
    resume: bool = False,
    videos: int = 1,
    engines: Engines = "one",
    progress: Progress = NULL_PROGRESS,
    **scene: Unpack[RunArguments],
) -> DemoResult:
    """Record demonstrations of a task with its stored strategies.

    Example:
        ```python
        result = gensim2.demo("OpenDrawer", episodes=2, assets="builtin")
        result.run_dir, result.demos
        ```

    Args:
        task: name of a library task, or folder with task.yaml and strategies/.
        episodes: number of successful demonstrations to keep.
        seed: seed of the scenes.
        out: run folder; default ``runs/<date>-<time>``.
        resume: continue the run in ``out``.
        videos: number of demonstrations to record as videos.
        engines: ``"both"`` runs each episode also in the other engine. A demonstration must succeed in both.
        progress: listener for stages and steps.
        scene: options of scenes, execution and worker processes: see :class:`~gensim2.rollout.config.RunArguments`.

    Returns:
        Run folder, number of demonstrations, and counts over all episodes.

    Raises:
        InputError: an argument cannot be used.
        NotRunError: some episodes could not be run; the others are finished. Call again with ``resume``.
    """
    check_counts(episodes=episodes)
    execution = Execution.of(scene)
    run_dir = Path(out) if out is not None else None
    if run_dir is not None:
        check_writable(run_dir / "run.json")
    given = read_task_input(task, seed=seed, **scene)
    given.scene.second_engine(engines)  # raises an error now if the second engine cannot be used
    rollout = replace(given.rollout, engines=engines)
    estimator = check_scene_source(given)
    spec, strategies, library = given.spec, given.strategies, given.library
    with (
        RunFolder(
            run_dir or default_run_dir(),
            {
                "command": "demo",
                "target_task": spec.name,
                "episodes": episodes,
                "seed": seed,
                **given.scene.options.to_record(),
                **rollout.to_record(),
                "instances": given.instances,
                "videos": videos,
                "workers": execution.workers,
            },
            {
                "task": digest(spec.model_dump(mode="json")),
                "strategies": digest(strategies),
                "objects": listing(library, sorted({thing.asset_class for thing in spec.objects.values()})),
                **({} if estimator is None else {"estimator": estimator}),
            },
            resume,
        ) as folder,
        reported(folder.path),
        EpisodeRunner(given.scene.options, execution, progress, rollout=rollout, log=folder.errors_log) as evaluator,
    ):
        files = folder.task(spec.name)
        files.write_task(spec)
        files.write_strategies(strategies)
        collected = collect(
            spec,
            strategies,
            files,
            folder,
            evaluator,
            library,
            given.instances,
            episodes=episodes,
            seed=seed,
            videos=videos,
            progress=progress,
        )
        result = DemoResult(spec.name, str(folder.path), collected.demos, collected.tally, evaluator.cpu_s)
        folder.finish(result.to_dict())
    return result
