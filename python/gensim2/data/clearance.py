"""Compute the robot's clearance to obstacles from recorded states, with the collision geometry of the solver."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

import gensim2_kpam as kpam
from gensim2.core.arrays import Array
from gensim2.objects import Library, ObjectModel
from gensim2.objects.types import ArticulatedObject, Hulls
from gensim2.perception.raycast.kinematics import Tree, pose_matrices, read_urdf, state_rows
from gensim2.robots import RobotProfile
from gensim2.rollout.recording import Recording
from gensim2.scenes.table import HALF_SIZE, corners
from gensim2.tasks.spec import TABLE, TaskSpec

Indices = npt.NDArray[np.int64]

FARTHEST = 0.2
"""Largest measured clearance, m."""
TOUCH = 1e-3
"""Distance (m) to both fingers within which an object counts as grasped."""
STILL = 1e-4
"""Movement of a body (m, and entries of rotation matrices) below which its pose in the scene is not updated."""
ITSELF = "itself"

_HELD = "/held"
"""Name of the grasped object in the solver's scene; it differs from all names of bodies."""


@dataclass(frozen=True)
class Clearance:
    """Clearance of one episode.

    Attributes:
        distance: smallest distance, m; negative for an overlap. Distances above ``FARTHEST`` are stored as
            ``FARTHEST``.
        to: nearest obstacle: ``"table"``, ``"itself"`` or the name of an object; None if it is farther than
            ``FARTHEST``.
    """

    distance: float
    to: str | None

    def least(self, other: Clearance) -> Clearance:
        return min(self, other, key=lambda each: each.distance)


@dataclass(frozen=True)
class _Body:
    """A rigid body: its convex hulls, and its poses (T, 4, 4) in the robot's base frame at T instants."""

    hulls: tuple[Array, ...]
    poses: Array


class ClearanceMeter:
    """Measures the clearance of one task's episodes.

    The clearance is the smallest distance between a link and the table, another link, or an object that the task does
    not use. An object that both fingers touch counts as grasped, so it is a part of the hand. Its distances to the
    table and to its first support are left out.

    Objects that the task uses, links without a joint, and pairs that can never touch are ignored.

    Args:
        task: task of the episodes.
        library: library of their objects.
        hulls: name of the convex decomposition that the objects had when the episodes were recorded.
    """

    def __init__(self, profile: RobotProfile, task: TaskSpec, library: Library, hulls: Hulls = "default") -> None:
        self._profile, self._task, self._library, self._hulls = profile, task, library, hulls
        self._others = tuple(name for name in task.objects if name not in task.acted_on)
        rigid = [name for name, spec in task.objects.items() if library.kind(spec.asset_class) == "rigid"]
        self._may_be_held = tuple(name for name in rigid if name in task.acted_on)

    def of(self, recording: Recording) -> Clearance:
        """Return the smallest clearance over all recorded instants of an episode.

        Raises:
            InputError: an object's files cannot be used, or the states do not fit the task and robot.
        """
        states, size = recording.env_states, len(self._profile.model.joint_names)
        q = state_rows(states, "articulations", self._profile.agent, 13 + 2 * size)[:, 13 : 13 + size].astype(float)
        bodies = {TABLE: _Body((corners(),), np.tile(self._table(), (len(q), 1, 1)))}
        for name in self._others:
            bodies |= self._bodies(recording, name)
        found = self._nearest(q, bodies, None, np.arange(len(q)))
        for name in self._may_be_held:
            (held,) = self._bodies(recording, name).values()
            below = self._task.objects[name].place.on
            beside = {key: body for key, body in bodies.items() if key.partition("/")[0] not in (TABLE, below)}
            found = found.least(self._nearest(q, beside, held, self._held(q, held)))
        return found

    def _nearest(self, q: Array, bodies: Mapping[str, _Body], held: _Body | None, instants: Indices) -> Clearance:
        """Return the smallest clearance at the given instants.

        Args:
            q: (T, n) joint positions.
            bodies: obstacles by name, with T poses each.
            held: object that the hand grasps at all of the instants; None: no object.
            instants: indices from 0 to T - 1.
        """
        least = Clearance(FARTHEST, None)
        if not len(instants):
            return least
        joints, poses = q[instants], {name: body.poses[instants] for name, body in bodies.items()}
        placed = [
            _body(name, body.hulls, "table" if name == TABLE else "rigid", poses[name][0])
            for name, body in bodies.items()
        ]
        if held is not None:
            T_hand_base = np.linalg.inv(self._profile.model.forward_kinematics(joints))
            poses[_HELD] = T_hand_base @ held.poses[instants]
            placed.append(_body(_HELD, held.hulls, "attached", poses[_HELD][0]))
        scene = kpam.Scene(self._profile.model, placed)
        for span in _spans(np.stack(list(poses.values()), axis=1)):
            for name, each in poses.items():
                scene = scene.with_pose(name, each[span.start])
            distances = np.asarray(scene.distance(joints[span], FARTHEST))
            worst = int(np.argmin(distances))
            if distances[worst] < least.distance:
                (pair, *_) = scene.check(joints[span][worst], FARTHEST)
                least = Clearance(float(pair["distance"]), _named(pair["bodies"], bodies))
        return least

    def _held(self, q: Array, thing: _Body) -> Indices:
        """Return the instants at which both fingers touch an object."""
        fingers, found = set(self._profile.gripper.pads), []
        scene = kpam.Scene(self._profile.model, [_body(_HELD, thing.hulls, "rigid", thing.poses[0])])
        for instant, (joints, pose) in enumerate(zip(q, thing.poses, strict=True)):
            pairs = scene.with_pose(_HELD, pose).check(joints, TOUCH)
            if fingers <= {pair["bodies"][0] for pair in pairs if pair["bodies"][1] == _HELD}:
                found.append(instant)
        return np.array(found, dtype=np.int64)

    def _bodies(self, recording: Recording, name: str) -> dict[str, _Body]:
        """Return the rigid bodies of an object, keyed by ``<object>/<link>``."""
        asset_class = self._task.objects[name].asset_class
        model: ObjectModel = self._library.load(asset_class, recording.instances[name], self._hulls)
        T_base_world = np.linalg.inv(self._profile.T_world_base)
        if not isinstance(model, ArticulatedObject):
            rows = state_rows(recording.env_states, "actors", name, 13)
            (hulls,) = model.hulls.values()
            return {f"{name}/": _Body(hulls, T_base_world @ pose_matrices(rows[:, :7]))}
        rows = state_rows(recording.env_states, "articulations", name, 15)
        tree = Tree.of(read_urdf(model.urdf), (model.joint.name,))
        poses = tree.poses(T_base_world @ pose_matrices(rows[:, :7]), rows[:, 13:14].astype(float))
        return {
            f"{name}/{link}": _Body(model.hulls[link], poses[:, index])
            for index, link in enumerate(tree.names)
            if model.hulls.get(link)
        }

    def _table(self) -> Array:
        T_world_table = np.eye(4)
        T_world_table[2, 3] = -HALF_SIZE[2]
        return np.asarray(np.linalg.inv(self._profile.T_world_base) @ T_world_table)


def _body(name: str, hulls: tuple[Array, ...], role: str, pose: Array) -> kpam.Body:
    return kpam.Body(name, role, [kpam.Shape.convex_hull(hull) for hull in hulls], pose)  # type: ignore[arg-type]


def _named(pair: tuple[str, str], bodies: Mapping[str, _Body]) -> str:
    return pair[1].partition("/")[0] if pair[1] in bodies else ITSELF


def _spans(poses: Array) -> Iterator[slice]:
    """Yield time ranges in which no entry of the poses (T, B, 4, 4) changes by more than ``STILL``."""
    begin = 0
    for instant in range(1, len(poses)):
        if np.abs(poses[instant] - poses[begin]).max(initial=0.0) > STILL:
            yield slice(begin, instant)
            begin = instant
    yield slice(begin, len(poses))
