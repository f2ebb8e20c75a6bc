"""Compute the coverage of a data set and the quality of its motions, episode by episode."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.data.clearance import ClearanceMeter
from gensim2.data.dataset import DataSet
from gensim2.data.formats.frames import FIRST_JOINT
from gensim2.data.store import TaskStore
from gensim2.data.used_objects import ObjectCheck
from gensim2.robots import RobotProfile, robot
from gensim2.rollout.record import Episode
from gensim2.rollout.recording import Recording
from gensim2.scenes.physics import physics_switches
from gensim2.tasks.spec import TaskSpec

SAME_PLACE, SAME_YAW, SAME_OPENNESS = 1e-3, 0.02, 0.01
"""Two scenes count as equal if position (m), yaw (rad) and openness differ by less than these values."""


@dataclass
class TaskQuality:
    """Quality measures of the demonstrations of one task.

    Attributes:
        name, sentence: name and instruction of the task.
        tried: number of episodes that were run.
        held: number of successful episodes (verdict `held`).
        strict: number of episodes that also pass the stricter verdict `strict`.
        whole: number of successful episodes in which every motion was executed completely.
        causes: number of failed episodes by cause.
        places: placement of the first step's object in each episode (x, y in m, yaw in rad), and whether the episode
            succeeded.
        openness: initial openness of the first step's object in successful episodes. Empty if the object has no joint.
        lengths: number of control steps in each successful episode.
        jerks: root mean square of the arm's jerk (rad/s^3) in each successful episode.
        clearances: smallest clearance of each successful episode, m (:mod:`gensim2.data.clearance`).
        nearest: nearest obstacle of each successful episode: ``"table"``, ``"itself"`` or an object's name.
        instances: for each object, the number of successful episodes that use the object.
        same_scene: number of successful episodes that have the initial scene of an earlier episode, to a millimetre.
        same_actions: number of successful episodes whose actions are the same as in an earlier episode.
    """

    name: str
    sentence: str
    tried: int = 0
    held: int = 0
    strict: int = 0
    whole: int = 0
    causes: Counter[str] = field(default_factory=Counter)
    places: list[tuple[float, float, float, bool]] = field(default_factory=list)
    openness: list[float] = field(default_factory=list)
    lengths: list[int] = field(default_factory=list)
    jerks: list[float] = field(default_factory=list)
    clearances: list[float] = field(default_factory=list)
    nearest: Counter[str] = field(default_factory=Counter)
    instances: Counter[str] = field(default_factory=Counter)
    same_scene: int = 0
    same_actions: int = 0

    def to_dict(self) -> dict[str, Any]:
        """Return the quality measures as JSON data. Attributes that are lists are replaced by summary statistics."""
        found = asdict(self)
        for name in ("openness", "lengths", "jerks", "clearances"):
            found[name] = _spread(found[name])
        found["places"] = {
            axis: _spread([place[i] for place in self.places]) for i, axis in enumerate(("x", "y", "yaw"))
        }
        return {**found, **{name: dict(getattr(self, name)) for name in ("causes", "instances", "nearest")}}


def qualities(dataset: DataSet, progress: Progress = NULL_PROGRESS) -> Iterator[TaskQuality]:
    """Yield the quality measures of each task; one episode is in memory at a time.

    Raises:
        InputError: the collection is incomplete, or an episode or object is damaged, missing or changed.
    """
    scene = dataset.scene
    profile, objects = robot(scene.robot), ObjectCheck(dataset, progress)
    for name in dataset.tasks:
        store = dataset.task(name)
        progress.start(f"{name}: measuring episodes", dataset.record.tasks[name].tried)
        spec = store.spec()
        meter = ClearanceMeter(profile, spec, objects.library, physics_switches(scene.physics).hulls)
        yield _quality(store, spec, profile, objects, meter, progress)


def _quality(
    store: TaskStore,
    spec: TaskSpec,
    profile: RobotProfile,
    objects: ObjectCheck,
    meter: ClearanceMeter,
    progress: Progress,
) -> TaskQuality:
    found = TaskQuality(store.name, spec.description)
    role = spec.steps[0].object
    scenes: set[tuple[object, ...]] = set()
    motions: set[bytes] = set()
    for row in store.rows():
        thing = row.objects[role]
        x, y = thing.pose[:2]
        found.tried += 1
        found.places.append((x, y, thing.yaw, row.held))
        if row.cause is not None:
            found.causes[str(row.cause)] += 1
        if row.held:
            found.held += 1
            found.strict += row.strict
            found.whole += not row.partial
            found.lengths.append(row.control_steps)
            found.instances[thing.id] += 1
            if thing.openness_start is not None:
                found.openness.append(thing.openness_start)
            found.same_scene += _again(scenes, _scene(row))
            objects.episode(row, store.path(row.index))
            recording = store.recording(row)
            found.jerks.append(jerk(recording, profile))
            clearance = meter.of(recording)
            found.clearances.append(clearance.distance)
            if clearance.to is not None:
                found.nearest[clearance.to] += 1
            found.same_actions += _again(motions, hashlib.sha256(recording.actions.tobytes()).digest())
        progress.advance()
    return found


def jerk(recording: Recording, profile: RobotProfile) -> float:
    """Return the root mean square of the jerk of the measured arm joints over all joints and instants, rad/s^3."""
    columns = [FIRST_JOINT + index for index in profile.arm_columns]
    positions = np.asarray(recording.env_states["articulations"][profile.agent], dtype=np.float64)[:, columns]
    third = np.diff(positions, n=3, axis=0) * profile.control_hz**3
    return float(np.sqrt(np.mean(np.square(third)))) if len(third) else 0.0


def _scene(row: Episode) -> tuple[object, ...]:
    """Return a hashable key of the initial scene, rounded so that nearly equal scenes have the same key."""
    return tuple(
        (
            name,
            thing.asset_class,
            thing.id,
            *(round(each / SAME_PLACE) for each in thing.pose[:3]),
            round(thing.yaw / SAME_YAW),
            None if thing.openness_start is None else round(thing.openness_start / SAME_OPENNESS),
        )
        for name, thing in sorted(row.objects.items())
    )


def _again(seen: set[Any], value: Any) -> bool:
    known = value in seen
    seen.add(value)
    return known


def _spread(values: list[float]) -> dict[str, float] | None:
    if not values:
        return None
    low, middle, high = np.percentile(values, (5, 50, 95))
    return {
        "min": float(min(values)),
        "5 %": float(low),
        "median": float(middle),
        "95 %": float(high),
        "max": float(max(values)),
    }
