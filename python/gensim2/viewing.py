"""Show an episode in the browser (viser): meshes, planned keyframes, a policy's point cloud, and a time slider."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack, cast

import numpy as np
import numpy.typing as npt

from gensim2.core.arrays import Array
from gensim2.core.errors import InputError, required
from gensim2.data.dataset import DATASET_JSON, DataSet
from gensim2.data.store import TaskStore
from gensim2.data.used_objects import ObjectCheck
from gensim2.perception import EmptyCloudError, ObservationSpec
from gensim2.robots import RobotProfile
from gensim2.robots import robot as robot_profile
from gensim2.rollout.config import EpisodeConfig, RolloutArguments
from gensim2.rollout.recording import Recording
from gensim2.scenes.config import SceneConfig

if TYPE_CHECKING:
    from gensim2.rollout.solving import SolvedStep


CLOUD_POINT = 0.006
"""Size of a drawn point, m."""


@dataclass(frozen=True)
class Shown:
    """Episode that is shown on a web page.

    Attributes:
        title: title of the page.
        scene: scene of the episode.
        recording: states and actions of the episode.
        plans: a plan for each step, made from the predicted result of the steps before; may be empty.
    """

    title: str
    scene: SceneConfig
    recording: Recording
    plans: Sequence[SolvedStep] = field(default=())

    @property
    def profile(self) -> RobotProfile:
        return robot_profile(self.scene.robot)

    @property
    def times(self) -> Array:
        """Times (T + 1,) of the recorded states since the reset, s."""
        return np.arange(self.recording.steps + 1) / self.profile.control_hz


def view(
    what: str | Path,
    *,
    task: str | None = None,
    episode: int | None = None,
    seed: int = 0,
    spec: ObservationSpec | None = None,
    host: str = "localhost",
    port: int = 8080,
    **scene: Unpack[RolloutArguments],
) -> Any:
    """Serve a page that shows an episode in the browser, and return immediately.

    Args:
        what: a task to plan and run (name or folder), the folder of a data set, or one of its episode files.
        task: name of a task in the data set; None: the first task.
        episode: index of an episode in the data set; None: the first successful episode.
        seed: seed of the scene, if a task is run.
        spec: observation spec of the point cloud; None: the default of policies.
        host: address to listen on.
        port: port of the page; if the port is in use, the next free port is used.
        scene: options for a task (:class:`~gensim2.rollout.config.RolloutArguments`). A data set has only the option
            ``assets``.

    Returns:
        The ``viser.ViserServer``; its method ``stop()`` ends the page.

    Raises:
        InputError: the task or episode does not exist, or an argument is invalid.
        MissingExtraError: viser is not installed.
    """
    required("viser", "viz")
    found = of_recording(Path(what), task, episode, _location(scene.get("assets")))
    if found is None:
        require_no_selection(task, episode)
        found = of_task(str(what), seed, **scene)
    return serve(found, spec or ObservationSpec(), host=host, port=port)


def _location(assets: object) -> Path | str | None:
    """Return the path of an open object library. A path or None is returned unchanged."""
    return cast(Path | str | None, getattr(assets, "location", assets))


def of_task(name: str, seed: int, **scene: Unpack[RolloutArguments]) -> Shown:
    """Plan and run a task in the scene of a seed.

    There are no plans if the scene is estimated from images.

    Raises:
        InputError: the task does not exist, or an argument is invalid.
    """
    from gensim2.rollout.inputs import check_scene_source, read_task_input
    from gensim2.rollout.solving import solve
    from gensim2.rollout.worker import record

    given = read_task_input(name, seed=seed, **scene)
    check_scene_source(given)
    plans = () if given.rollout.is_estimated else solve(name, seed=seed, **scene).steps
    config = EpisodeConfig(given.scene, given.rollout)
    episode, recording = record(config, given.strategies, seed, lambda episode, recording: (episode, recording))
    if recording is None:
        reason = plans[0].found.reason if plans else episode.cause
        raise InputError(f"no motion was found: {reason}", field=given.spec.name, remedy="try another --seed")
    ended = "held" if episode.held else f"not held: {episode.cause}"
    return Shown(f"{given.spec.name}, seed {seed}: {ended}", given.scene, recording, plans)


def require_no_selection(task: str | None, index: int | None) -> None:
    """Raise an error if a task or an episode is selected, although the input is not the folder of a data set.

    Raises:
        InputError: ``task`` or ``index`` is given.
    """
    for name, value in (("task", task), ("episode", index)):
        if value is not None:
            remedy = f"give the folder of a data set, or omit {name}"
            raise InputError("selects from the folder of a data set only", field=name, remedy=remedy)


def of_recording(place: Path, task: str | None, index: int | None, assets: Path | str | None = None) -> Shown | None:
    """Read a recorded episode.

    Args:
        place: the folder of a data set, or the file of an episode in a data set.
        task, index: task and number of the episode, as for :func:`of_data_set`; None if ``place`` is a file.
        assets: current folder of the objects, if it has changed.

    Returns:
        The episode; None if ``place`` is neither a data set nor an episode file.

    Raises:
        InputError: the episode does not exist, or cannot be read.
    """
    if place.suffix == ".h5":
        require_no_selection(task, index)
        return of_file(place, assets)
    return of_data_set(place, task, index, assets) if (place / DATASET_JSON).exists() else None


def of_data_set(folder: Path, task: str | None, index: int | None, assets: Path | str | None = None) -> Shown:
    """Read an episode of a data set; ``assets`` is the current folder of the objects, if it has changed.

    Raises:
        InputError: the task or episode does not exist, has no states, or an object is missing or has changed.
    """
    dataset = DataSet.open(folder, assets)
    store = dataset.task(task or dataset.tasks[0])
    row = next((row for row in store.rows() if (row.held if index is None else row.index == index)), None)
    if row is None:
        wrong = "no episode succeeded" if index is None else f"there is no episode {index}"
        raise InputError(wrong, file=store.folder, field="episode", remedy="--episode N takes another")
    recording = store.recording(row)
    scene = dataset.scene.with_task(store.spec(), dataset.record.tasks[store.name].instances)
    ObjectCheck(dataset).episode(row, store.path(row.index, row.held))
    return Shown(f"{store.name}, episode {row.index}: {'held' if row.held else row.cause}", scene, recording)


def of_file(path: Path, assets: Path | str | None = None) -> Shown:
    """Read an episode from its file in a data set; ``assets`` is as for :func:`of_data_set`.

    Raises:
        InputError: the file is not an episode of a data set, or cannot be read.
    """
    folder = path.parent.parent
    if not (folder.parent / DATASET_JSON).exists() or not path.stem.isdigit():
        wrong = "is not an episode file in a data set"
        raise InputError(wrong, file=path, remedy="give the folder of the data set")
    if not path.exists():
        raise InputError("is not there", file=path)
    return of_data_set(folder.parent, TaskStore(folder).name, int(path.stem), assets)


def serve(shown: Shown, spec: ObservationSpec, *, host: str = "localhost", port: int = 8080) -> Any:
    """Serve the page of one episode; return the ``viser.ViserServer`` at once.

    Raises:
        InputError: a file of the robot or of an object cannot be used.
        MissingExtraError: viser or Embree is not installed.
    """
    from gensim2.data.observing import objects_of
    from gensim2.perception.raycast.observer import Observer
    from gensim2.planning.show import draw_plans, open_page, quaternion
    from gensim2_kpam.show import add_clock, add_text

    server = open_page(host, port, (1.2, -0.95, 0.8), (0.4, 0.0, 0.15), shown.title)
    recording = shown.recording
    observer = Observer(shown.profile, objects_of(shown.scene, recording.instances), spec, recording.seed)
    solids, poses = observer.scene.solids, observer.scene.poses(recording.env_states)
    meshes = [draw_solid(server, observer.scene.names[solid.id], solid.surface) for solid in solids]
    commands = [1.0, *map(float, recording.actions[:, -1])]

    @lru_cache(maxsize=64)
    def cloud_at(index: int) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.uint8]]:
        try:
            seen = observer.observe(_row(recording.env_states, index), index, commands[index]).cloud
        except EmptyCloudError:
            return np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint8)
        assert seen is not None, "a spec without a cloud shows none"
        return seen.xyz.astype(np.float32), seen.rgb

    xyz, rgb = cloud_at(0)
    cloud = server.scene.add_point_cloud("/cloud", xyz, rgb, point_size=CLOUD_POINT)

    def stand_at(index: int) -> None:
        for handle, pose in zip(meshes, poses[index], strict=True):
            handle.position, handle.wxyz = pose[:3, 3], quaternion(pose)
        cloud.points, cloud.colors = cloud_at(index)

    plans = {f"{number} {step.name}": step.found.plan for number, step in enumerate(shown.plans, 1)}
    found = {name: plan for name, plan in plans.items() if plan is not None}
    draw_plans(server, found, shown.profile)
    for name, plan in found.items():
        add_text(server, _said_of(name, plan))
    _add_switches(server, meshes, cloud, bool(shown.plans))
    add_clock(server, cast(Any, _Clock(shown.times)), lambda index: stand_at(int(index)))
    return server


class _Clock:
    """Maps the time of the viewer's slider to the index of a recorded state."""

    def __init__(self, times: Array) -> None:
        self.times = times

    def sample(self, time: float) -> tuple[int]:
        """Return the index of the recorded state at ``time``, s."""
        return (int(np.clip(np.searchsorted(self.times, time + 1e-9) - 1, 0, len(self.times) - 1)),)


def _add_switches(server: Any, meshes: Sequence[Any], cloud: Any, has_plan: bool) -> None:
    def switch(name: str, shown: Sequence[Any]) -> None:
        box = server.gui.add_checkbox(name, initial_value=True)

        def show(_: Any) -> None:
            for handle in shown:
                handle.visible = box.value

        box.on_update(show)

    switch("scene", meshes)
    switch("cloud", [cloud])
    if has_plan:
        switch("plan", [server.scene.add_frame("/plan", show_axes=False)])


def _said_of(name: str, plan: Any) -> str:
    """Return one line of text with a plan's status and collision margin."""
    nearer = f", {len(plan.tight)} nearer at keyframes" if plan.tight else ""
    return f"{name}: {plan.status}, keeps {1e3 * plan.margin:.1f} mm{nearer}"


def draw_solid(server: Any, name: tuple[str, str], surface: Any) -> Any:
    """Draw a surface from the ray caster in the colours of its materials; a texture is shown as its mean colour."""
    import trimesh

    colors = np.array(surface.colors, dtype=np.uint8)
    for texture in surface.textures:
        colors[texture.faces] = texture.image.reshape(-1, 3).mean(axis=0).astype(np.uint8)
    mesh = trimesh.Trimesh(surface.vertices, surface.faces, face_colors=colors, process=False)
    return server.scene.add_mesh_trimesh(f"/scene/{name[0]}/{name[1]}", mesh)


def _row(tree: Mapping[str, Any], index: int) -> dict[str, Any]:
    return {
        key: _row(value, index) if isinstance(value, Mapping) else value[index : index + 1]
        for key, value in tree.items()
    }
