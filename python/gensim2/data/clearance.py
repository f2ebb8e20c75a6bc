"""Clearance between the robot and what it is not to touch, from recorded states and the solver's own geometry."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

import gensim2_kpam as kpam
from gensim2.objects import Library, ObjectModel
from gensim2.objects.types import ArticulatedObject, Hulls
from gensim2.perception.raycast.kinematics import Tree, pose_matrices, read_urdf, state_rows
from gensim2.robots import RobotProfile
from gensim2.rollout.recording import Recording
from gensim2.scenes.table import HALF_SIZE, corners
from gensim2.tasks.spec import TABLE, TaskSpec

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

FARTHEST = 0.2
"""Metres beyond which distances are not measured: a clearance is at most that."""
TOUCH = 1e-3
"""Metres from both fingers within which an object is held."""
STILL = 1e-4
"""Metres, and entries of rotation matrices, by which a body may move before it is put where it is."""
ITSELF = "itself"

_HELD = "/held"
"""Name in the solver's scene; no body of an object is called so."""


@dataclass(frozen=True)
class Clearance:
    """Of one episode.

    Attributes:
        distance: smallest distance at any recorded instant, m; negative where things overlap, at most ``FARTHEST``.
        to: what came nearest: ``"table"``, ``"itself"`` or an object's name; None where nothing came near.
    """

    distance: float
    to: str | None

    def least(self, other: Clearance) -> Clearance:
        """The smaller of both."""
        return min(self, other, key=lambda each: each.distance)


@dataclass(frozen=True)
class _Body:
    """A piece of the scene: its convex parts, and (T, 4, 4) where it was, in the base frame."""

    hulls: tuple[Array, ...]
    poses: Array


class ClearanceMeter:
    """Measures episodes of one task.

    The robot's links are measured against the table, each other, and every object that no step acts on. What both
    fingers touch they hold; it counts as a part of the hand, but not against the table and not against the object that
    it stood on: it is picked up from there. Objects that steps act on are meant to be touched. Pairs of links that can
    never touch, by the robot's description, are left out, and so are links that no joint moves.

    Args:
        profile: of the robot.
        task: of the episodes.
        library: of their objects.
        hulls: how real meshes became collision parts where the episodes were recorded.
    """

    def __init__(self, profile: RobotProfile, task: TaskSpec, library: Library, hulls: Hulls = "default") -> None:
        self._profile, self._task, self._library, self._hulls = profile, task, library, hulls
        self._others = tuple(name for name in task.objects if name not in task.acted_on)
        rigid = [name for name, spec in task.objects.items() if library.kind(spec.asset_class) == "rigid"]
        self._may_be_held = tuple(name for name in rigid if name in task.acted_on)

    def of(self, recording: Recording) -> Clearance:
        """Look at every recorded instant of an episode.

        Raises:
            InputError: an object's files cannot be used, or the states are not of this task and robot.
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
        """Over some instants; where ``held`` rides on the hand, it is held at all of them."""
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
        """Instants at which both fingers touch it."""
        fingers, found = set(self._profile.gripper.pads), []
        scene = kpam.Scene(self._profile.model, [_body(_HELD, thing.hulls, "rigid", thing.poses[0])])
        for instant, (joints, pose) in enumerate(zip(q, thing.poses, strict=True)):
            pairs = scene.with_pose(_HELD, pose).check(joints, TOUCH)
            if fingers <= {pair["bodies"][0] for pair in pairs if pair["bodies"][1] == _HELD}:
                found.append(instant)
        return np.array(found, dtype=np.int64)

    def _bodies(self, recording: Recording, name: str) -> dict[str, _Body]:
        """Pieces of an object, by ``<object>/<link>``."""
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
    """Spans of (T, B, 4, 4) instants over which nothing moves by more than ``STILL`` from where it was first."""
    begin = 0
    for instant in range(1, len(poses)):
        if np.abs(poses[instant] - poses[begin]).max(initial=0.0) > STILL:
            yield slice(begin, instant)
            begin = instant
    yield slice(begin, len(poses))
