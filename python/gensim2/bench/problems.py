"""Read planning problems from JSON Lines files and validate them.

Lengths are in m, and angles are in rad. Poses are 4x4 matrices in row-major order, and quaternions are (w, x, y, z).
Times are in s, counted from the start of the problem's motion. The reader ignores fields that are not named in this
module, such as ``reference``.
"""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, FiniteFloat, TypeAdapter, model_validator

from gensim2.core.arrays import Array
from gensim2.core.errors import InputError
from gensim2.core.foreign.limits import MAX_RECORD
from gensim2.core.foreign.tree import read_input
from gensim2.core.record_files import parse_record

#: Maximum deviation of a rotation matrix in single precision from an orthonormal matrix.
ROTATION_TOLERANCE = 1e-4


#: Names of the frames in which a config may give an axis.
AXIS_FRAMES = ("world", "object", "joint")


def _is_pose(rows: list[list[float]]) -> list[list[float]]:
    if len(rows) != 4 or any(len(row) != 4 for row in rows):
        raise ValueError("a pose must have 4 rows of 4 numbers")
    pose = np.asarray(rows)
    rotation = pose[:3, :3]
    # a rotation has no entry above 1; a very large entry would overflow in ``rotation @ rotation.T`` below
    small = np.abs(rotation).max() <= 2.0
    if (
        not small
        or np.abs(rotation @ rotation.T - np.eye(3)).max() > ROTATION_TOLERANCE
        or np.linalg.det(rotation) < 0.0
    ):
        raise ValueError("the upper left 3x3 block of the pose is not a rotation matrix")
    if np.abs(pose[3] - [0.0, 0.0, 0.0, 1.0]).max() > 0.0:
        raise ValueError("the last row of the pose must be 0 0 0 1")
    return rows


def _is_quaternion(values: list[float]) -> list[float]:
    if abs(math.hypot(*values) - 1.0) > ROTATION_TOLERANCE:
        raise ValueError("the norm of the quaternion must be 1")
    return values


def _is_odd(entry: Any) -> bool:
    frame = entry.get("target_axis_frame", "world") if isinstance(entry, dict) else "world"
    return isinstance(frame, str) and frame not in AXIS_FRAMES


def _is_increasing(values: list[float]) -> list[float]:
    if any(later <= earlier for earlier, later in pairwise(values)):
        raise ValueError("times must increase")
    return values


Vector3 = Annotated[list[FiniteFloat], Field(min_length=3, max_length=3)]
Quaternion = Annotated[list[FiniteFloat], Field(min_length=4, max_length=4), AfterValidator(_is_quaternion)]
Pose = Annotated[list[list[FiniteFloat]], AfterValidator(_is_pose)]
Times = Annotated[list[FiniteFloat], AfterValidator(_is_increasing)]


class _Record(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore")


class ArticulatedRecord(_Record):
    """State of an articulated object.

    The state has the root pose in the world frame, the joint value, and the scale of the lengths in the object's files.
    """

    cls: str
    id: str
    root_p: Vector3
    root_q: Quaternion
    qpos: Annotated[list[FiniteFloat], Field(min_length=1, max_length=1)]
    close_qpos: FiniteFloat
    open_qpos: FiniteFloat
    scale: Annotated[FiniteFloat, Field(gt=0.0)]

    @model_validator(mode="after")
    def _has_a_range(self) -> Self:
        if self.open_qpos == self.close_qpos:
            raise ValueError("open_qpos and close_qpos are the same: the joint has no range")
        return self


class RigidRecord(_Record):
    """State of the rigid object: pose in the world frame, and scale of its mesh file."""

    cls: str
    p: Vector3
    q: Quaternion
    scale: Annotated[FiniteFloat, Field(gt=0.0)]


class ObjectsRecord(_Record):
    articulated: ArticulatedRecord
    rigid: RigidRecord | None = None


class PlanProblem(_Record):
    """A planning problem, which is one line of a problem file. The module's docstring lists units and frames.

    ``task`` and ``sub_task`` are the names of the recorded task and step. A name is empty if it was not recorded.
    """

    id: Annotated[str, Field(min_length=1)]
    task: str = ""
    sub_task: str = ""
    objects: ObjectsRecord
    config: dict[str, Any]
    start_time: FiniteFloat
    actuation_time: FiniteFloat
    pre_actuation_times: Times
    post_actuation_times: Times
    q_current: Annotated[list[FiniteFloat], Field(min_length=9, max_length=9)]
    T_world_base: Pose
    T_base_object: Pose
    tool_keypoints_hand: dict[str, Vector3]
    object_keypoints_base: dict[str, Vector3]
    object_yaw: FiniteFloat
    object_axis: Literal["x", "y", "z"] | None

    def pose(self, name: Literal["T_world_base", "T_base_object"]) -> Array:
        """Return a pose (4, 4). Stored poses have single precision, so the rotation is made orthonormal again."""
        pose = np.asarray(getattr(self, name), dtype=np.float64)
        left, _, right = np.linalg.svd(pose[:3, :3])
        pose[:3, :3] = left @ right
        return pose

    def keyframe_times(self) -> list[float]:
        """Return the times of all keyframes, s, in the order of the keyframes."""
        return [*self.pre_actuation_times, self.actuation_time, *self.post_actuation_times]

    def odd_frames(self) -> list[str]:
        """Return the invalid frame names in the config's constraints. A constraint gives the frame of its target axis
        in ``target_axis_frame``, which must be one of ``AXIS_FRAMES``. The original solver of GenSim2 treats an invalid
        name as the world frame.
        """
        return [str(entry["target_axis_frame"]) for entry in self._constraints() if _is_odd(entry)]

    def _constraints(self) -> list[Any]:
        entries = self.config.get("constraint_list")
        return entries if isinstance(entries, list) else []

    def timed_config(self) -> dict[str, Any]:
        """Return the solver config with this problem's keyframe times, and ``"world"`` in place of invalid frames."""
        constraints = [
            {**entry, "target_axis_frame": "world"} if _is_odd(entry) else entry for entry in self._constraints()
        ]
        return {
            **self.config,
            "constraint_list": constraints,
            "actuation_time": self.actuation_time,
            "pre_actuation_times": list(self.pre_actuation_times),
            "post_actuation_times": list(self.post_actuation_times),
        }

    @model_validator(mode="after")
    def _has_times_for_its_motions(self) -> Self:
        for kind, times in (("pre", self.pre_actuation_times), ("post", self.post_actuation_times)):
            motions = self.config.get(f"{kind}_actuation_motions", [])
            if not isinstance(motions, list) or len(motions) != len(times):
                raise ValueError(
                    f"{kind}_actuation_times: there must be one time for each motion in config.{kind}_actuation_motions"
                )
        clock = [self.start_time, *self.keyframe_times()]
        if any(later <= earlier for earlier, later in pairwise(clock)):
            wrong = "actuation_time: every keyframe must be later than start_time and than the keyframe before"
            raise ValueError(wrong)
        return self


_PROBLEM = TypeAdapter(PlanProblem)
_REMEDY = "see docs/reference/benchmarks.md for the fields"


def read_problems(path: Path) -> list[PlanProblem]:
    """Read all problems of a file, in the order of the lines; blank lines are skipped.

    Raises:
        InputError: the file is missing, unreadable or empty, or has an invalid line or a repeated id.

    Example:
        ```python
        problems = read_problems(Path("problems.jsonl"))
        ```
    """
    problems: list[PlanProblem] = []
    lines: dict[str, int] = {}
    for number, line in enumerate(read_input(path, MAX_RECORD, "give a JSON Lines file").split(b"\n"), start=1):
        if not line.strip():
            continue
        problem = parse_record(line, _PROBLEM, path, _REMEDY, f"line {number}")
        if problem.id in lines:
            wrong = f"the id {problem.id!r} is already used on line {lines[problem.id]}"
            raise InputError(wrong, file=path, field=f"line {number}: id", remedy="give every problem its own id")
        lines[problem.id] = number
        problems.append(problem)
    if not problems:
        raise InputError("contains no problems", file=path, remedy="write one JSON object on each line")
    return problems
