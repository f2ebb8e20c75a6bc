"""Compare estimates with the true object at several instants of a recorded episode (``gensim2 perceive show``)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from gensim2.core.errors import InputError
from gensim2.core.seeding import rng
from gensim2.data.observing import objects_of
from gensim2.objects import ArticulatedObject
from gensim2.perception.estimation.classes import by_name
from gensim2.perception.estimation.estimator import SceneEstimator
from gensim2.perception.estimation.examples import Cameras, example, stacked
from gensim2.perception.estimation.measuring import measured
from gensim2.perception.estimation.pictures import save_estimates
from gensim2.perception.noise import DEPLOYED
from gensim2.scenes.initial_state import PlacedObject
from gensim2.viewing import Shown, of_recording

PICTURE = "estimates.png"


def show(
    what: Path | str,
    estimator: Path | str,
    *,
    out: Path,
    assets: Path | str | None = None,
    task: str | None = None,
    episode: int | None = None,
    instants: int = 5,
    noisy: bool = False,
    seed: int = 0,
) -> dict[str, Any]:
    """Estimate the object at several instants of a recorded episode, and draw the estimates beside the truth.

    Args:
        what: folder of a data set, or an episode file of a data set.
        estimator: folder of the estimator, as for :meth:`SceneEstimator.load`.
        out: folder for the picture ``estimates.png``.
        assets: folder that contains the data set's objects, if the objects have been moved since the recording.
        task, episode: name of the task and number of the episode in a data set, as for :func:`~gensim2.viewing.view`.
        instants: number of instants, from the start of the episode to its end.
        noisy: whether the depth images have the noise of a deployed camera.
        seed: seed of the noise.

    Returns:
        Plain data: the title of the episode, the path of the picture, and the errors of the estimate at each instant.

    Raises:
        InputError: the episode cannot be read, it has several objects, the estimator does not know the object's class,
            or the cameras do not see the object at any of the instants.
    """
    place = Path(what)
    shown = of_recording(place, task, episode, assets)
    if shown is None:
        raise InputError("is neither an episode file nor a data set", file=place, remedy="collect one: gensim2 collect")
    found = SceneEstimator.load(estimator, shown.profile)
    names = [each.name for each in found.classes]
    model = _model(shown)
    by_name(found.classes, model.asset_class)
    cameras, generator = Cameras(shown.profile, model), rng(seed, "perception/show")
    at, looks = [], []
    for index in np.unique(np.linspace(0, shown.recording.steps, instants).round().astype(int)):
        placed, q = _state(shown, model, int(index))
        look = cameras.look(placed, q, DEPLOYED if noisy else None, generator)
        if look is not None:
            at.append(int(index))
            looks.append(look)
    if not looks:
        raise InputError("the cameras do not see the object", file=place)
    arrays = stacked([example(look, names, shown.profile) for look in looks])
    rows = measured(found, arrays)
    given = measured(found, arrays, given=True)
    titles = [
        f"step {time}: {row.get('likeliest', 'no object')}, {1000 * row['keypoint_m']:.0f} mm"
        for time, row in zip(at, given, strict=True)
    ]
    save_estimates(out / PICTURE, found, arrays, rows, range(len(rows)), titles)
    return {
        "schema_version": 1,
        "episode": shown.title,
        "class": model.asset_class,
        "picture": str(out / PICTURE),
        "instants": [
            {"step": time, **{name: value for name, value in row.items() if name != "ratios"}}
            for time, row in zip(at, rows, strict=True)
        ],
    }


def _model(shown: Shown) -> ArticulatedObject:
    """Return the only object of an episode.

    Raises:
        InputError: the episode has several objects, or a rigid object.
    """
    objects = list(objects_of(shown.scene, shown.recording.instances).values())
    if len(objects) != 1 or not isinstance(objects[0], ArticulatedObject):
        message = f"has the objects {', '.join(each.asset_class for each in objects)}"
        remedy = "choose a task with one articulated object"
        raise InputError(f"{message}; an estimator supports only one articulated object", field="task", remedy=remedy)
    return objects[0]


def _state(shown: Shown, model: ArticulatedObject, index: int) -> tuple[PlacedObject, npt.NDArray[np.float64]]:
    """Return the placed object and the robot's joint values (n,) at a recorded instant."""
    states: Mapping[str, Any] = shown.recording.env_states["articulations"]
    [name] = shown.scene.task.objects
    row, arm = (np.asarray(states[each][index], dtype=np.float64) for each in (name, shown.profile.agent))
    turned = Rotation.from_quat(row[3:7], scalar_first=True)
    default = Rotation.from_quat(model.placement.quaternion, scalar_first=True)
    yaw = float((turned * default.inv()).as_rotvec()[2])
    joint = model.joint
    openness = (float(row[13]) - joint.lower) / (joint.upper - joint.lower)
    return PlacedObject(model, row[:3], row[3:7], yaw, openness), arm[13 : 13 + len(shown.profile.reset_qpos)]
