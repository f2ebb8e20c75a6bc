"""``gensim2 demo`` and ``gensim2 solve``: one task of the library, or one that a run left behind."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gensim2_kpam as kpam
from gensim2.assets import open_library
from gensim2.errors import InputError
from gensim2.files import write_json
from gensim2.pipeline.demonstrations import collect
from gensim2.pipeline.evaluator import PoolEvaluator
from gensim2.pipeline.records import SCHEMA_VERSION
from gensim2.pipeline.report import reported
from gensim2.pipeline.run import check_workers
from gensim2.pipeline.runfolder import RunFolder, default_run_dir, digest
from gensim2.planning.scene import Scene
from gensim2.processes import JOBS_PER_WORKER, TIME_LIMIT
from gensim2.progress import NULL_PROGRESS, Progress
from gensim2.tasks.library import load_config, load_config_file, load_task, load_task_file
from gensim2.tasks.spec import TaskSpec


@dataclass(frozen=True)
class DemoResult:
    """What ``demo`` leaves: ``demos`` demonstrations of ``name`` in ``run_dir``."""

    name: str
    run_dir: str
    demos: int
    notes: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            "schema_version": SCHEMA_VERSION,
            "name": self.name,
            "run_dir": self.run_dir,
            "demos": self.demos,
            "notes": list(self.notes),
        }


@dataclass(frozen=True)
class SolveResult:
    """One plan on the scene of one seed."""

    task: str
    asset_class: str
    instance: str
    plan: dict[str, Any]

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            "schema_version": SCHEMA_VERSION,
            "task": self.task,
            "class": self.asset_class,
            "instance": self.instance,
            "plan": self.plan,
        }


def task_and_config(task: str) -> tuple[TaskSpec, dict[str, Any]]:
    """Return the spec and the solver config of a library task, or of a folder with task.yaml and solver.yaml.

    Raises:
        InputError: there is no such task or folder, or a file in it cannot be used.
    """
    folder = Path(task)
    if folder.is_dir():
        return load_task_file(folder / "task.yaml"), load_config_file(folder / "solver.yaml")
    return load_task(task), load_config(task)


def demo(
    task: str,
    *,
    episodes: int = 5,
    seed: int = 0,
    assets: str | Path | None = None,
    instance: str | None = None,
    out: Path | None = None,
    workers: int = 2,
    resume: bool = False,
    video: bool = True,
    time_limit: float = TIME_LIMIT,
    jobs_per_worker: int = JOBS_PER_WORKER,
    progress: Progress = NULL_PROGRESS,
) -> DemoResult:
    """Record demonstrations of a task with its stored config.

    Args:
        task: name of a library task, or a folder that holds task.yaml and solver.yaml.
        episodes: successful demonstrations to keep.
        seed: of the scenes.
        assets: folder of objects, ``"builtin"``, or None for ``GENSIM2_ASSETS`` or else the built-in library.
        instance: what episodes draw from: ``train``, ``test``, ``all`` (or ``random``), or an id; all where None.
        out: run folder; default ``runs/<date>-<time>``.
        workers: simulator processes.
        resume: go on with the run that ``out`` holds.
        video: film the first demonstration where this machine can render.
        time_limit: seconds after which an episode counts as hung and is tried again.
        jobs_per_worker: jobs after which a simulator process is renewed.
        progress: listener.

    Raises:
        InputError: an argument cannot be used.
        NotRunError: some episodes could not be run; all others are finished, and ``resume`` goes on.
    """
    check_workers(time_limit, jobs_per_worker)
    if episodes < 1:
        raise InputError(f"must be at least 1, not {episodes}", field="episodes")
    spec, config = task_and_config(task)
    library = open_library(assets)
    ids = library.choose(spec.asset_class, instance or "all")
    with (
        RunFolder(
            Path(out) if out is not None else default_run_dir(),
            {
                "command": "demo",
                "target_task": spec.name,
                "episodes": episodes,
                "seed": seed,
                "assets": library.location,
                "instance": instance,
                "workers": workers,
            },
            {
                "task": digest(spec.model_dump(mode="json")),
                "config": digest(config),
                "objects": digest(list(ids)),
            },
            resume,
        ) as folder,
        reported(folder.path),
        PoolEvaluator(
            library.location,
            workers,
            progress,
            instance or "all",
            time_limit=time_limit,
            jobs_per_worker=jobs_per_worker,
            log=folder.errors_log,
        ) as evaluator,
    ):
        files = folder.task(spec.name)
        files.write_task(spec)
        files.write_config(config)
        collected = collect(
            spec,
            config,
            files,
            folder,
            evaluator,
            library,
            episodes=episodes,
            seed=seed,
            video=video,
            progress=progress,
        )
        result = DemoResult(spec.name, str(folder.path), collected.demos, collected.notes)
        folder.finish(result.to_dict())
    return result


def solve(
    task: str,
    *,
    seed: int = 0,
    assets: str | Path | None = None,
    instance: str | None = None,
    out: Path | None = None,
    view: Callable[[Scene, kpam.Plan], None] | None = None,
) -> SolveResult:
    """Plan the motion of a task on the scene of one seed, without executing it.

    Args:
        task: name of a library task, or a folder that holds task.yaml and solver.yaml.
        seed: of the scene.
        assets: as for ``demo``.
        instance: as for ``demo``; the seed draws one of several.
        out: folder in which to leave ``plan.json``.
        view: called with the scene and the plan at the end, for example to show them.

    Raises:
        InputError: an argument cannot be used.
    """
    from gensim2.planning.problem import SceneProblems
    from gensim2.sim.env import make_env

    spec, config = task_and_config(task)
    env = make_env(spec, assets=assets, instances=instance or "all", obs_mode="none")
    env.reset(seed=seed)
    chosen = env.instance
    if chosen is None:
        raise InputError("no object in the scene", field="instance")
    scene = env.scene_state()
    plan = kpam.plan(SceneProblems(scene, chosen.object_axis).problem(kpam.SolverConfig(config)))
    result = SolveResult(spec.name, spec.asset_class, chosen.id, plan.to_dict())
    if out is not None:
        write_json(Path(out) / "plan.json", result.to_dict())
    if view is not None:
        view(scene, plan)
    return result
