"""Keypoint solver: constraints in, joint motion out. Metres, radians, seconds; poses are (4, 4) row-major float64."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

class KpamError(Exception):
    """Base class. Its subclasses name the file or field and the remedy."""

class UrdfError(KpamError): ...
class ConfigError(KpamError): ...
class ProblemError(KpamError): ...

class Robot:
    """A URDF arm. Pickles."""

    @staticmethod
    def from_urdf(
        path: str, *, srdf: str | None = None, hand_link: str = "panda_hand", base_link: str | None = None
    ) -> Robot: ...
    @property
    def joint_names(self) -> list[str]: ...
    @property
    def lower(self) -> Array: ...
    @property
    def upper(self) -> Array: ...
    def forward_kinematics(self, q: Array, link: str | None = None) -> Array:
        """Pose of ``link`` (default: the hand) in the base frame: (n,) -> (4, 4), (N, n) -> (N, 4, 4)."""
    def jacobian(self, q: Array, link: str | None = None) -> Array:
        """(6, n): linear, then angular velocity of the link's origin, in base axes. (N, n) -> (N, 6, n)."""

class SolverConfig:
    """A validated solver config. Unknown fields, unknown types and non-finite numbers raise ConfigError naming the field."""

    def __init__(self, config: Mapping[str, Any]) -> None: ...
    def to_dict(self) -> dict[str, Any]: ...
    @property
    def gripper(self) -> Literal["open", "closed", "grasp"]: ...

class Shape:
    @staticmethod
    def box(half_extents: Array, pose: Array | None = None) -> Shape: ...
    @staticmethod
    def sphere(radius: float, center: Array | None = None) -> Shape: ...
    @staticmethod
    def convex_hull(points: Array) -> Shape:
        """Hull of (N, 3) points in the body frame."""
    @staticmethod
    def mesh(vertices: Array, triangles: npt.NDArray[np.uint32]) -> Shape: ...

class Body:
    def __init__(
        self,
        name: str,
        role: Literal["table", "object_body", "moving_link", "rigid"],
        shapes: Sequence[Shape],
        pose: Array,
    ) -> None:
        """``pose``: (4, 4) body in the robot base frame."""

class Joint:
    def __init__(
        self,
        kind: Literal["revolute", "prismatic"],
        origin: Array,
        axis: Array,
        value: float,
        lower: float,
        upper: float,
    ) -> None:
        """The object's moving joint; ``origin`` and ``axis`` are (3,) in the robot base frame."""

class KeypointProblem:
    def __init__(
        self,
        robot: Robot,
        config: SolverConfig,
        q_start: Array,
        *,
        tool_keypoints: Mapping[str, Array],
        object_keypoints: Mapping[str, Array],
        T_base_object: Array,
        joint: Joint | None = None,
        object_axis: Literal["x", "y", "z"] = "y",
        object_yaw: float = 0.0,
        T_base_world: Array | None = None,
        bodies: Sequence[Body] = (),
        options: Mapping[str, Any] | None = None,
    ) -> None:
        """``tool_keypoints`` in the hand frame, ``object_keypoints`` in the base frame, each (3,)."""

class Trajectory:
    """Timed joint motion. Pickles."""

    @property
    def times(self) -> Array:
        """(N,) seconds; every keyframe time is among them."""
    @property
    def positions(self) -> Array:
        """(N, n) joint positions at ``times``."""
    @property
    def duration(self) -> float: ...
    def sample(self, t: float) -> tuple[Array, Array, Array]:
        """Position, velocity, acceleration at t, each (n,)."""
    def sample_every(self, dt: float) -> Array:
        """(ceil(duration / dt) + 1, n) positions."""

class Plan:
    """What was solved, each residual, what failed. Pickles."""

    @property
    def status(self) -> str:
        """``"solved"``, ``"partial"`` (a part of the motion), or why not: ``"actuation_infeasible"``, ``"unreachable"``, ``"collision"``, ..."""
    @property
    def reason(self) -> str:
        """One sentence for a person: which constraint misses by how much, which keyframe, which two bodies where."""
    @property
    def q_actuation(self) -> Array | None: ...
    @property
    def cost(self) -> float | None: ...
    @property
    def residuals(self) -> list[dict[str, Any]]:
        """One a constraint: ``name``, ``residual`` (m or rad), ``tolerance``, ``satisfied``."""
    @property
    def keyframes(self) -> list[dict[str, Any]]:
        """One a keyframe: ``label`` ("pre_0", "actuation", "post_0"), ``time``, ``T_base_hand``, ``reached``."""
    @property
    def trajectory(self) -> Trajectory | None: ...
    @property
    def collisions(self) -> list[dict[str, Any]]:
        """``bodies`` (two names), ``time``, ``distance`` (m, negative when overlapping)."""
    def to_dict(self) -> dict[str, Any]: ...

def plan(problem: KeypointProblem) -> Plan: ...
def plan_batch(problems: Sequence[KeypointProblem], threads: int | None = None) -> list[Plan]: ...
