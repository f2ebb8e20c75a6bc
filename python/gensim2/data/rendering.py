"""``gensim2 render``: compute the observations of a data set from its recorded states."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Unpack

from gensim2.core.errors import InputError
from gensim2.core.files import remove, remove_temporaries
from gensim2.core.plural import plural
from gensim2.core.processes import Execution, ExecutionArguments, Failure, Job, results
from gensim2.core.progress import NULL_PROGRESS, Progress, clock
from gensim2.core.resumable import FolderLock
from gensim2.data.dataset import DataSet
from gensim2.data.observation_file import DamagedObservationError, read_description, write_observation
from gensim2.data.store import OBSERVATIONS, TaskStore
from gensim2.data.used_objects import ObjectCheck
from gensim2.perception import ObservationSpec
from gensim2.perception.camera import require_cameras
from gensim2.robots import robot
from gensim2.rollout.record import Episode
from gensim2.scenes.config import SceneConfig

SCHEMA_VERSION = 1
"""Version of the command's JSON output."""

ERRORS_LOG = "render.log"

PRELOAD = ("gensim2.data.observing", "trimesh", "embreex.rtcore_scene", "fpsample", "scipy.spatial")

PICTURE_S, RAYS_S = 0.04, 0.0025
"""Time for one picture of one camera, s: rgb from the renderer without a GPU, and ray-cast depth with its points."""


@dataclass(frozen=True)
class Rendered:
    """Result of rendering one episode.

    Attributes:
        frames: number of observed instants: the number of control steps plus one.
        size: size of the file, bytes.
        cpu_s: CPU time of computing the observations, s.
    """

    frames: int
    size: int
    cpu_s: float


@dataclass(frozen=True)
class RenderingResult:
    """Result of :func:`render`.

    Attributes:
        folder: folder of the data set.
        episodes: number of episodes with observations, including earlier calls.
        rendered: number of episodes rendered in this call.
        frames: number of frames rendered in this call.
        bytes: size of all observations.
        cpu_s: CPU time of computing frames in this call, s, excluding file access.
    """

    folder: Path
    episodes: int
    rendered: int
    frames: int
    bytes: int
    cpu_s: float

    def to_dict(self) -> dict[str, Any]:
        return {"schema_version": SCHEMA_VERSION, **asdict(self), "folder": str(self.folder)}


def render(
    folder: Path | str,
    *,
    spec: ObservationSpec | None = None,
    tasks: Sequence[str] = (),
    episodes: int | None = None,
    resume: bool = False,
    assets: Path | str | None = None,
    progress: Progress = NULL_PROGRESS,
    **execution: Unpack[ExecutionArguments],
) -> RenderingResult:
    """Render observations of a data set. Each successful episode gets one observation file.

    Each file depends only on its episode and the spec.

    Example:
        ```python
        gensim2.render("night", spec=gensim2.ObservationSpec.of({"points": 512}))
        ```

    Args:
        folder: data set of a finished collection.
        spec: modalities, cameras and cloud settings; None: point clouds of 1,024 points.
        tasks: names of tasks; empty for all tasks.
        episodes: maximum number of episodes of each task; successful ones come first. None: all successful episodes.
        resume: keep existing observations, which must have the same spec.
        assets: current folder of the object library; None: the folder recorded in the data set.
        execution: see :class:`~gensim2.core.processes.ExecutionArguments`.

    Returns:
        Counts of episodes and frames, bytes, and CPU time.

    Raises:
        InputError: an argument is invalid, the collection is unfinished, or observations with other settings exist.
        WriteError: the disk is full; finished files are kept.
        NotRunError: some episodes could not be rendered; all others are finished.
    """
    how = Execution.of(execution)
    folder, spec = Path(folder), spec or ObservationSpec()
    if spec.is_proprioceptive:
        raise InputError("must include an observation that cameras provide", field="modalities")
    dataset = DataSet.open(folder, assets)
    require_cameras(spec.cameras, robot(dataset.record.scene.robot))
    wanted = {name: dataset.task(name) for name in tasks or dataset.tasks}
    with FolderLock(folder):
        for store in wanted.values():
            if (store.folder / OBSERVATIONS).is_dir():
                remove_temporaries(store.folder / OBSERVATIONS)
        return _Rendering(dataset, spec, episodes, resume, progress).run(wanted, how)


class _Rendering:
    def __init__(
        self, dataset: DataSet, spec: ObservationSpec, episodes: int | None, resume: bool, progress: Progress
    ) -> None:
        self._dataset, self._spec, self._resume, self._progress = dataset, spec, resume, progress
        self._episodes = episodes
        self._size = self._there = 0

    def run(self, stores: dict[str, TaskStore], execution: Execution) -> RenderingResult:
        missing = [(store, row) for store in stores.values() for row in self._missing(store)]
        objects = ObjectCheck(self._dataset, self._progress)
        for store, row in missing:
            objects.episode(row, store.path(row.index))
        scenes = {name: self._scene(store) for name, store in stores.items()}
        jobs = (
            Job(number, (store.folder, row, scenes[store.name], self._spec))
            for number, (store, row) in enumerate(missing)
        )
        frames = sum(row.control_steps + 1 for _, row in missing) * len(self._spec.cameras)
        if total := frames * (PICTURE_S * ("rgb" in self._spec.modalities) + RAYS_S * self._spec.casts):
            episodes = plural(len(missing), "episode")
            without = " without a GPU" if "rgb" in self._spec.modalities else ""
            self._progress.message(
                f"{', '.join(self._spec.modalities)}{without}: about {total / len(missing):.1f} s per episode, "
                f"{clock(total / (execution.workers or 1))} for {episodes}"
            )
        what = f"observations of {plural(len(stores), 'task')}"
        self._progress.start(what, self._there + len(missing))
        self._progress.advance(self._there)
        rendered = frames = 0
        cpu = 0.0
        log = self._dataset.path / ERRORS_LOG
        failed = partial(Failure.report, progress=self._progress, log=log)
        with execution.at_most(len(missing)).executor(preload=PRELOAD, on_failure=failed) as pool:
            for _, made in results(pool.map_unordered(render_episode, jobs), "observations", log):
                rendered, frames, cpu = rendered + 1, frames + made.frames, cpu + made.cpu_s
                self._size += made.size
                self._progress.advance()
        return RenderingResult(self._dataset.path, self._there + rendered, rendered, frames, self._size, round(cpu, 3))

    def _missing(self, store: TaskStore) -> Iterator[Episode]:
        """Yield successful episodes that have no observations, and remove damaged observation files."""
        held = (row for row in store.rows() if row.held)
        for row in itertools.islice(held, self._episodes):
            path = store.observation_path(row.index)
            if not path.exists():
                yield row
                continue
            if not self._resume:
                remedy = "to continue with the same options add --resume; for other options remove this folder"
                raise InputError("the data set has observations already", file=path.parent, remedy=remedy)
            try:
                found = read_description(path)
            except DamagedObservationError:
                remove(path)
                yield row
                continue
            expected = _description(store, row, self._spec)
            for name in ("episode_digest", *self._spec.to_dict()):
                if found.get(name) != expected[name]:
                    remedy = f"use the same options, or remove {path.parent}"
                    wrong = (
                        f"the file was rendered with {found.get(name)!r}, but the current value is {expected[name]!r}"
                    )
                    raise InputError(wrong, file=path, field=name, remedy=remedy)
            self._there += 1
            self._size += path.stat().st_size

    def _scene(self, store: TaskStore) -> SceneConfig:
        # Each episode records the objects that it used, so the scene needs no set of objects from which to sample.
        return self._dataset.scene.with_task(store.spec())


def render_episode(folder: Path, row: Episode, scene: SceneConfig, spec: ObservationSpec) -> Rendered:
    """Render one episode and write its observation file; runs in a worker process.

    Raises:
        InputError: the episode's file is missing or damaged, or an object's files cannot be used.
        WriteError: the file cannot be written.
    """
    store = TaskStore(folder)
    recording = store.recording(row)
    # Imported here because it loads the ray caster, which argument checks do not need.
    from gensim2.data.observing import observe, segmentation_ids

    profile = robot(scene.robot)
    begin = time.process_time()
    arrays = observe(recording, scene, spec)
    cpu = time.process_time() - begin
    path = store.observation_path(row.index)
    description = _description(store, row, spec) | {
        "language": scene.task.description,
        "robot": scene.robot,
        "steps": recording.steps,
        "seed": recording.seed,
        "instances": recording.instances,
        "segmentation_ids": segmentation_ids(recording, scene, spec),
        "camera_links": {each.name: each.link for each in profile.cameras if each.name in spec.cameras},
    }
    write_observation(path, description, arrays)
    return Rendered(recording.steps + 1, path.stat().st_size, cpu)


def _description(store: TaskStore, row: Episode, spec: ObservationSpec) -> dict[str, Any]:
    return {"task": store.name, "index": row.index, "episode_digest": row.episode_digest, **spec.to_dict()}
