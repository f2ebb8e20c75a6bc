"""Keypoint solver: constraints in, joint motion out. Metres, radians, seconds; poses are (4, 4) row-major float64.

A :class:`KeypointProblem` holds a robot, a solver config, keypoints, the object's joint and obstacles; :func:`plan`
returns a :class:`Plan` that says what was solved, each constraint's residual, and what failed. Shapes and units are
in the docstrings and in ``__init__.pyi``; every error is a :class:`KpamError` that names file or field and remedy.
"""

from ._native import (
    Body,
    ConfigError,
    Grasp,
    GraspPlan,
    Joint,
    KeypointProblem,
    KpamError,
    ParallelGripper,
    Plan,
    ProblemError,
    Robot,
    Shape,
    SolverConfig,
    Trajectory,
    UrdfError,
    __version__,
    grasps,
    in_collision,
    min_clearance,
    plan,
    plan_batch,
    plan_grasp,
)

__all__ = [
    "Body",
    "ConfigError",
    "Grasp",
    "GraspPlan",
    "Joint",
    "KeypointProblem",
    "KpamError",
    "ParallelGripper",
    "Plan",
    "ProblemError",
    "Robot",
    "Shape",
    "SolverConfig",
    "Trajectory",
    "UrdfError",
    "__version__",
    "grasps",
    "in_collision",
    "min_clearance",
    "plan",
    "plan_batch",
    "plan_grasp",
]
