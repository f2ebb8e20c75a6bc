"""``gensim2 evaluate``: the benchmark's scenes, verdicts and table for anybody's controller."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from gensim2.core.errors import GenSim2Error, InputError
from gensim2.core.processes import Execution
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.core.record_files import SCHEMA_VERSION
from gensim2.evaluation.benchmark_table import TaskRow, groups
from gensim2.evaluation.running import finish_table, run_episodes
from gensim2.perception import ObservationSpec
from gensim2.rollout.config import EpisodeConfig, EvaluationArguments
from gensim2.rollout.controller import is_privileged, spec_of
from gensim2.rollout.controller_spec import ControllerSpec, close
from gensim2.rollout.inputs import TaskInput, check_counts, read_task_inputs
from gensim2.rollout.record import Episode
from gensim2.rollout.recording import Recording
from gensim2.rollout.run import STOPS, Stop

if TYPE_CHECKING:
    from gensim2.data.runfolder import RunFolder
    from gensim2.rollout.runner import EpisodeRunner

Keep = partial[Episode] | None


@dataclass(frozen=True)
class EvaluationResult:
    """The table.

    Attributes:
        run_dir: the run folder.
        controller: ``target`` and ``arguments`` that it was made with, ``privileged``, and its ``observation`` spec.
        arguments: what was asked for beside it.
        versions: of the packages that decide the outcome.
        rows: one a task.
        skipped: tasks that could not be run on these objects, with the reason.
        speeds: episodes a second of wall time in this call, by task; None where all were there.
        videos: films, by task.
        cpu_s: CPU of all processes in this call, their start apart.
    """

    run_dir: str
    controller: dict[str, Any]
    arguments: dict[str, Any]
    versions: dict[str, str]
    rows: tuple[TaskRow, ...]
    skipped: dict[str, str]
    speeds: dict[str, float | None]
    videos: dict[str, list[str]]
    cpu_s: float

    @property
    def held_mean(self) -> float:
        """Mean over the tasks of the share of episodes that held, 0 to 1."""
        rates = [rate for row in self.rows for rate in row.rates("held")]
        return sum(rates) / len(rates)

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            "schema_version": SCHEMA_VERSION,
            "run_dir": self.run_dir,
            "controller": self.controller,
            "arguments": self.arguments,
            "versions": self.versions,
            "tasks": [row.to_dict() for row in self.rows],
            "groups": groups(self.rows),
            "skipped": self.skipped,
            "episodes_per_second": self.speeds,
            "videos": self.videos,
            "cpu_s": round(self.cpu_s, 3),
        }


def evaluate(
    controller: str | type | ControllerSpec,
    tasks: str | Sequence[str],
    *,
    arguments: Mapping[str, Any] | None = None,
    data: Path | None = None,
    stop: Stop = "goal",
    runs: int = 1,
    episodes: int = 50,
    seed: int = 0,
    videos: int = 0,
    out: Path | None = None,
    resume: bool = False,
    progress: Progress = NULL_PROGRESS,
    **scene: Unpack[EvaluationArguments],
) -> EvaluationResult:
    """Run a controller on the scenes that a benchmark with this seed has, and judge its episodes as it does.

    Example:
        ```python
        result = gensim2.evaluate("mine.py:Policy", ["CloseBox"], arguments={"weights": "policy.pt"}, episodes=50)
        result.held_mean
        ```

    Args:
        controller: ``module:Class``, ``FILE.py:Class``, or a class that another process can import
            (docs/guides/controllers.md).
        tasks: names of library tasks, or folders that hold task.yaml and strategies/.
        arguments: keyword arguments of the controller, plain data.
        data: rendered data set that the controller was trained on: its observations must be of the same spec.
        stop: ``"goal"``: an episode ends where the controller says None, where the goal has held for half a second and
            still does when the scene rests, or at the step limit, and is judged. ``"controller"``: one that never says
            None is cut and has not held.
        runs, episodes, seed, out, resume, progress, scene: as for :func:`~gensim2.evaluation.benchmark`.
        videos: number of episodes of each task that are filmed by ray casting, beside the controller's point cloud.

    Returns:
        The table: one row a task with its three verdicts and their 95 % intervals, and the films.

    Raises:
        ControllerError: the controller cannot be made, fails, or gives no action that can be used.
        InputError: an argument cannot be used.
        NotRunError: some episodes could not be run; all others are finished, and ``resume`` goes on.
    """
    check_counts(runs=runs, episodes=episodes)
    execution = Execution.of(scene)
    if stop not in STOPS:
        raise InputError(f"no way to stop {stop!r}", field="stop", remedy=f"one of {', '.join(STOPS)}")
    given, skipped = read_task_inputs((tasks,) if isinstance(tasks, str) else tasks, seed=seed, **scene)
    spec = ControllerSpec.of(controller, arguments)
    about = _about(spec, given[0], data)
    # Only now what takes long to import.
    from gensim2.data.runfolder import RunFolder, default_run_dir
    from gensim2.rollout.identity import identity, versions
    from gensim2.rollout.runner import EpisodeRunner

    options = given[0].scene.options
    asked = {
        "seed": seed,
        "runs": runs,
        "episodes": episodes,
        "stop": stop,
        **options.to_record(),
        "instances": scene.get("instances", "all"),
    }
    with (
        RunFolder(
            Path(out) if out is not None else default_run_dir(),
            {
                "command": "evaluate",
                "stored_tasks": [one.spec.name for one in given],
                **asked,
                **execution.to_record(),
            },
            {**identity(given), "controller": spec.digest, "stop": stop},
            resume,
        ) as folder,
        EpisodeRunner(
            options,
            execution,
            progress,
            log=folder.errors_log,
        ) as evaluator,
    ):
        rows, speeds, films = [], {}, {}
        for one in given:
            files = folder.task(one.spec.name).path
            found, speeds[one.spec.name] = run_episodes(
                one.spec,
                files,
                evaluator,
                _episode,
                partial(_arguments, evaluator.config(one.spec, one.instances), spec, stop, files, videos),
                runs=runs,
                episodes=episodes,
                seed=seed,
                progress=progress,
            )
            folder.add_episodes(given[0].library, found, folder.path / "run.json")
            folder.save()
            rows.append(TaskRow(one.spec, runs, tuple(found)))
            if videos:
                _keep_missing(one, folder, evaluator, spec, stop, min(videos, runs * episodes), found, progress)
                films[one.spec.name] = _film(one, spec, about, folder, evaluator, seed, progress)
        result = EvaluationResult(
            str(folder.path),
            about,
            asked,
            versions(evaluator.scene.engine),
            tuple(rows),
            skipped,
            speeds,
            films,
            evaluator.cpu_s,
        )
        finish_table(folder, result.to_dict())
    return result


def _about(spec: ControllerSpec, given: TaskInput, data: Path | None) -> dict[str, Any]:
    """Describe a controller, which is made once before anything starts.

    Raises:
        InputError: it cannot be made, or looks at something else than its data.
    """
    from gensim2.perception.cameras import require_cameras
    from gensim2.robots import robot

    profile = robot(given.scene.robot)
    made = spec.make(given.spec, profile)
    seen = spec_of(made)
    close(made)
    require_cameras(seen.cameras, profile)
    if data is not None:
        from gensim2.data.dataset import DataSet

        seen.require(DataSet.open(Path(data)).observation_spec(), str(data), of=spec.target)
    return {**spec.to_dict(), "privileged": is_privileged(made) or seen.is_privileged, "observation": seen.to_dict()}


def _arguments(
    config: EpisodeConfig, spec: ControllerSpec, stop: Stop, folder: Path, videos: int, index: int, seed: int
) -> tuple[Any, ...]:
    return config, spec, seed, stop, partial(_keep, folder, index) if index < videos else None, index


def _episode(
    config: EpisodeConfig, spec: ControllerSpec, seed: int, stop: Stop, keep: partial[Episode] | None, index: int
) -> Episode:
    """One episode; called in a worker."""
    from gensim2.rollout import worker

    return worker.evaluate(config, spec, seed, stop, keep, index)


def _keep(folder: Path, index: int, episode: Episode, recording: Recording | None) -> Episode:
    """Keep the states of an episode that is to be filmed; called in a worker."""
    from gensim2.data.store import TaskStore

    TaskStore(folder).add(index, episode, recording)
    return episode


def _keep_missing(
    given: TaskInput,
    folder: RunFolder,
    evaluator: EpisodeRunner,
    spec: ControllerSpec,
    stop: Stop,
    videos: int,
    episodes: Sequence[Episode],
    progress: Progress,
) -> None:
    """Run those of the first episodes once more whose states were not kept, for no film was asked for then."""
    from gensim2.core.processes import Job

    files = folder.task(given.spec.name).path
    kept = _recorded(files)
    config = evaluator.config(given.spec, given.instances)
    missing = [
        Job(index, _arguments(config, spec, stop, files, videos, index, episodes[index].seed))
        for index in range(videos)
        if index not in kept and episodes[index].control_steps  # of one without a step there is nothing to film
    ]
    if not missing:
        return
    progress.start(f"{given.spec.name}: episodes to film", len(missing))
    try:
        for _ in evaluator.run(_episode, missing, f"{given.spec.name}: episodes to film"):
            progress.advance()
    except GenSim2Error as error:  # the table is whole without films
        progress.message(f"{given.spec.name}: not all episodes can be filmed: {error}")


def _recorded(folder: Path) -> dict[int, tuple[Path, str]]:
    """Files and digests of a task's episodes whose states were kept, by index."""
    from gensim2.data.store import TaskStore

    found = TaskStore(folder).found()
    return {each.index: (each.path, each.row.digest) for each in found if each.row is not None and each.row.recorded}


def _film(
    given: TaskInput,
    spec: ControllerSpec,
    about: Mapping[str, Any],
    folder: RunFolder,
    evaluator: EpisodeRunner,
    seed: int,
    progress: Progress,
) -> list[str]:
    """Film the episodes of a task whose states were kept, with the cloud that the controller is given."""
    from gensim2.core.processes import Job
    from gensim2.data.trajectory import TrajectoryMetadata, write_trajectory
    from gensim2.evaluation.films import film_episode, film_path
    from gensim2.rollout.identity import versions

    task, files = given.spec, folder.task(given.spec.name).path
    kept = _recorded(files)
    episodes = [kept[index] for index in sorted(kept)]
    if not episodes:
        return []
    provenance = TrajectoryMetadata(
        task=task,
        strategies={},
        assets=evaluator.scene.assets,
        licenses=folder.record.licenses,
        seed=seed,
        environment=evaluator.scene.environment,
        details={"versions": versions(evaluator.scene.engine)},
        controller=spec.target,
    )
    write_trajectory(files, provenance, episodes)
    films = [film_path(files, index) for index in sorted(kept)]
    scene, seen = evaluator.config(task, given.instances).scene, ObservationSpec.of(about["observation"])
    missing = [
        Job(n, (path, scene, seen, film))
        for n, ((path, _), film) in enumerate(zip(episodes, films, strict=True))
        if not film.exists()
    ]
    progress.start(f"{task.name}: films", len(missing))
    try:
        for _ in evaluator.run(film_episode, missing, f"{task.name}: films"):
            progress.advance()
    except GenSim2Error as error:
        progress.message(f"{task.name}: no video: {error}")
    return [str(film) for film in films if film.exists()]
