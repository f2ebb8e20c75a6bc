"""Compute link poses of an articulation from its URDF, for all instants of an episode at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from gensim2.core.arrays import Array
from gensim2.core.errors import InputError
from gensim2.core.foreign.geometry import MAX_URDF
from gensim2.core.foreign.tree import read_input
from gensim2.objects.library.urdf import Urdf, UrdfJoint, parse_urdf, unit_axis
from gensim2.objects.types import joint_motion


@lru_cache(maxsize=256)
def read_urdf(file: Path) -> Urdf:
    """Read a URDF; later calls in the process use a cache.

    Raises:
        InputError: the file cannot be read, or its links do not form a tree.
    """
    return parse_urdf(read_input(file, MAX_URDF), file)


@dataclass(frozen=True)
class Tree:
    """Links of an articulation in SAPIEN's order: depth first, children in the order of the file.

    Attributes:
        names: names of the L links.
        parents: index of each link's parent; -1 for the root.
        joints: joint between each link and its parent; None for the root.
        coordinates: index of the value of each link's joint in ``q``; -1 for a fixed joint.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    joints: tuple[UrdfJoint | None, ...]
    coordinates: tuple[int, ...]
    file: Path

    @staticmethod
    def of(urdf: Urdf, active: Sequence[str]) -> Tree:
        """Build the kinematic tree of a URDF.

        Args:
            urdf: parsed URDF.
            active: names of the joints whose values are the coordinates ``q``, in order.

        Raises:
            InputError: a moving joint is not in ``active``, or is neither revolute nor prismatic.
        """
        below: dict[str, list[UrdfJoint]] = {name: [] for name in urdf.links}
        for joint in urdf.joints:
            below[joint.parent].append(joint)
        hanging = {joint.child for joint in urdf.joints}
        stack: list[tuple[str, int, UrdfJoint | None]] = [
            (next(name for name in urdf.links if name not in hanging), -1, None)
        ]
        names: list[str] = []
        parents: list[int] = []
        joints: list[UrdfJoint | None] = []
        while stack:
            name, parent, above = stack.pop()
            stack.extend((joint.child, len(names), joint) for joint in reversed(below[name]))
            names.append(name)
            parents.append(parent)
            joints.append(above)
        coordinates = tuple(_coordinate(joint, active, urdf.file) for joint in joints)
        return Tree(tuple(names), tuple(parents), tuple(joints), coordinates, urdf.file)

    @property
    def still(self) -> tuple[bool, ...]:
        """Whether each link is fixed relative to the root link."""
        found: list[bool] = []
        for parent, coordinate in zip(self.parents, self.coordinates, strict=True):
            found.append(coordinate < 0 and (parent < 0 or found[parent]))
        return tuple(found)

    def poses(self, root: Array, q: Array) -> Array:
        """Return the link poses (T, L, 4, 4) in the frame of ``root``.

        Args:
            root: (T, 4, 4) poses of the root link.
            q: (T, n) joint values, rad or m.
        """
        found = np.empty((len(root), len(self.names), 4, 4))
        for index, (parent, joint, coordinate) in enumerate(
            zip(self.parents, self.joints, self.coordinates, strict=True)
        ):
            if joint is None:
                found[:, index] = root
                continue
            found[:, index] = found[:, parent] @ joint.T
            if coordinate >= 0:
                found[:, index] = found[:, index] @ joint_motion(
                    joint.type, unit_axis(joint, self.file), q[:, coordinate]
                )
        return found


def pose_matrices(rows: npt.NDArray[np.floating]) -> Array:
    """Convert poses (T, 7) in the order x, y, z, qw, qx, qy, qz to matrices (T, 4, 4)."""
    rows = rows.astype(np.float64)
    found = np.tile(np.eye(4), (len(rows), 1, 1))
    found[:, :3, :3] = Rotation.from_quat(rows[:, 3:], scalar_first=True).as_matrix()
    found[:, :3, 3] = rows[:, :3]
    return found


def state_at(states: Mapping[str, Any], step: int) -> dict[str, Any]:
    """Select one instant of ManiSkill's ``env_states``. Each array of the result has a single row."""
    return {kind: {name: rows[step : step + 1] for name, rows in group.items()} for kind, group in states.items()}


def state_rows(states: Mapping[str, Any], kind: str, name: str, width: int) -> npt.NDArray[np.float32]:
    """Return the states (T, width) of one actor or articulation in ManiSkill's ``env_states``.

    Raises:
        InputError: the states are missing, do not have the given width, or are not finite.
    """
    try:
        rows = np.asarray(states[kind][name], dtype=np.float32)
    except KeyError as error:
        raise InputError("the states of this object are missing", field=f"env_states/{kind}/{name}") from error
    if rows.ndim != 2 or rows.shape[1] != width:
        raise InputError(f"must have the shape (T, {width}), but has {rows.shape}", field=f"env_states/{kind}/{name}")
    if not np.isfinite(rows).all():
        raise InputError("must be finite", field=f"env_states/{kind}/{name}")
    return rows


def _coordinate(joint: UrdfJoint | None, active: Sequence[str], file: Path) -> int:
    if joint is None or joint.type == "fixed":
        return -1
    field = f"joint {joint.name}"
    if joint.type not in ("revolute", "continuous", "prismatic"):
        raise InputError(f"the joint type {joint.type!r} is not supported", file=file, field=field)
    if joint.name not in active:
        raise InputError("the joint is movable, but its position was not recorded", file=file, field=field)
    return list(active).index(joint.name)
