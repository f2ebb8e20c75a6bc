"""``gensim2 evaluate``: run any controller in the scenes of the benchmark, with the benchmark's verdicts and table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from gensim2.core.errors import InputError
from gensim2.core.processes import Execution
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.evaluation.running import Arguments, Table, TableExtent, tabulate
from gensim2.perception import ObservationSpec
from gensim2.rollout.config import DEFAULT_ROLLOUT, EpisodeConfig, EvaluationArguments
from gensim2.rollout.controller import is_privileged, spec_of
from gensim2.rollout.controller_spec import ControllerSpec, close
from gensim2.rollout.inputs import TaskInput, check_counts, read_task_inputs
from gensim2.rollout.record import Episode
from gensim2.rollout.recording import Recording
from gensim2.rollout.run import STOPS, Stop

if TYPE_CHECKING:
    from gensim2.data.runfolder import RunFolder
    from gensim2.rollout.runner import EpisodeRunner


@dataclass(frozen=True, kw_only=True)
class EvaluationResult(Table):
    """Result of an evaluation.

    Attributes:
        controller: description of the controller: ``target``, ``arguments``, ``privileged`` and ``observation`` spec.
        videos: video files by task.
    """

    controller: dict[str, Any] = field(repr=False)
    videos: dict[str, list[str]]

    @property
    def held_mean(self) -> float:
        """Mean success rate over all tasks by the verdict ``held``, from 0 to 1."""
        rates = [rate for row in self.rows for rate in row.rates("held")]
        return sum(rates) / len(rates)

    def to_dict(self) -> dict[str, Any]:
        return {**super().to_dict(), "controller": self.controller, "videos": self.videos}


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
    """Run a controller in the same scenes as a benchmark with the same seed, and judge success by the same verdicts.

    A script must call this function below ``if __name__ == "__main__":``, because worker processes import the script.

    Example:
        ```python
        result = gensim2.evaluate("mine.py:Policy", ["CloseBox"], arguments={"weights": "policy.pt"}, episodes=50)
        result.held_mean
        ```

    Args:
        controller: ``module:Class``, ``FILE.py:Class``, or an importable class (docs/guides/controllers.md).
        tasks: names of library tasks, or folders with task.yaml and strategies/.
        arguments: keyword arguments of the controller, as JSON data.
        data: rendered data sets with which the controller was trained. The data sets must have the same observation
            spec.
        stop: rule for the end of an episode. ``"goal"``: the episode ends when the controller returns None, at the step
            limit, or when the goal has held for half a second and still holds after the scene has settled.
            ``"controller"``: only the controller ends the episode; at the step limit it fails.
        runs, episodes, seed, out, resume, progress, scene: as for :func:`~gensim2.evaluation.benchmark`.
        videos: number of ray-cast videos of each task. The videos also show the point cloud of the controller.

    Returns:
        A table with a row for each task, which has the rates of three verdicts with 95 % intervals, and the videos.

    Raises:
        ControllerError: the controller cannot be created, raises an exception, or returns an invalid action.
        InputError: an argument is invalid.
        NotRunError: some episodes could not be run; all others are finished, and ``resume`` continues.
    """
    check_counts(runs=runs, episodes=episodes)
    execution = Execution.of(scene)
    if stop not in STOPS:
        raise InputError(f"unknown value {stop!r}", field="stop", remedy=f"one of {', '.join(STOPS)}")
    given, skipped = read_task_inputs((tasks,) if isinstance(tasks, str) else tasks, seed=seed, **scene)
    spec = ControllerSpec.of(controller, arguments)
    about = _about(spec, given[0], data)
    # Import late, because these modules take long to import.
    from gensim2.rollout.identity import identity

    films: dict[str, list[str]] = {}

    def of_task(_: TaskInput, config: EpisodeConfig, files: Path) -> Arguments:
        return partial(_arguments, config, spec, stop, files, videos)

    def film(one: TaskInput, folder: RunFolder, runner: EpisodeRunner, found: Sequence[Episode]) -> None:
        if videos:
            _keep_missing(one, folder, runner, spec, stop, min(videos, runs * episodes), found)
            films[one.spec.name] = _film(one, spec, about, folder, runner, seed)

    return tabulate(
        given,
        {"stop": stop, **given[0].scene.options.to_record(), "instances": scene.get("instances", "all")},
        {**identity(given), "controller": spec.digest, "stop": stop},
        _episode,
        of_task,
        lambda table: EvaluationResult(**vars(table), controller=about, videos=films),
        command="evaluate",
        extent=TableExtent(runs, episodes, seed),
        rollout=DEFAULT_ROLLOUT,
        skipped=skipped,
        execution=execution,
        out=out,
        resume=resume,
        progress=progress,
        after=film,
    )


def _about(spec: ControllerSpec, given: TaskInput, data: Path | None) -> dict[str, Any]:
    """Create the controller before any episode, check that it fits the data set, and return its description."""
    from gensim2.perception.camera import require_cameras
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
    from gensim2.rollout import worker

    return worker.evaluate(config, spec, seed, stop, keep, index)


def _keep(folder: Path, index: int, episode: Episode, recording: Recording | None) -> Episode:
    """Store the states of an episode, so that a video of it can be made. Workers call this function."""
    from gensim2.data.store import TaskStore

    TaskStore(folder).add(index, episode, recording)
    return episode


def _keep_missing(
    given: TaskInput,
    folder: RunFolder,
    runner: EpisodeRunner,
    spec: ControllerSpec,
    stop: Stop,
    videos: int,
    episodes: Sequence[Episode],
) -> None:
    """Repeat the episodes that need a video but have no stored states, and store their states."""
    files = folder.task(given.spec.name).path
    kept = _recorded(files)
    config = runner.config(given.spec, given.instances)
    missing = {
        index: _arguments(config, spec, stop, files, videos, index, episodes[index].seed)
        for index in range(videos)
        if index not in kept and episodes[index].control_steps  # an episode without control steps has no video
    }
    runner.make_films(_episode, missing, f"{given.spec.name}: episodes to film")


def _recorded(folder: Path) -> dict[int, tuple[Path, str]]:
    """Return a mapping from the index of each episode with stored states to its file and the digest of the file."""
    from gensim2.data.store import TaskStore

    found = TaskStore(folder).found()
    # An episode without control steps has no states.
    return {index: (path, str(each.episode_digest)) for index, path, each in found if each and each.control_steps}


def _film(
    given: TaskInput,
    spec: ControllerSpec,
    about: Mapping[str, Any],
    folder: RunFolder,
    runner: EpisodeRunner,
    seed: int,
) -> list[str]:
    """Record videos of a task's episodes with stored states; the controller's point cloud appears next to the image."""
    from gensim2.data.films import film_episode, film_path
    from gensim2.data.trajectory import TrajectoryMetadata, write_trajectory
    from gensim2.rollout.identity import versions

    task, files = given.spec, folder.task(given.spec.name).path
    kept = _recorded(files)
    episodes = [kept[index] for index in sorted(kept)]
    if not episodes:
        return []
    provenance = TrajectoryMetadata(
        task=task,
        strategies={},
        assets=runner.scene.assets,
        licenses=folder.record.licenses,
        seed=seed,
        environment=runner.scene.environment,
        details={"versions": versions(runner.scene.engine)},
        controller=spec.target,
    )
    write_trajectory(files, provenance, episodes)
    films = [film_path(files, index) for index in sorted(kept)]
    scene, seen = runner.config(task, given.instances).scene, ObservationSpec.of(about["observation"])
    missing = {
        n: (path, scene, seen, film)
        for n, ((path, _), film) in enumerate(zip(episodes, films, strict=True))
        if not film.exists()
    }
    runner.make_films(film_episode, missing, f"{task.name}: films")
    return [str(film) for film in films if film.exists()]
