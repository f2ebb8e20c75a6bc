"""Keypoint solver: constraints in, joint motion out. Metres, radians, seconds; poses are (4, 4) row-major float64.

A :class:`KeypointProblem` holds a robot, a solver config, keypoints, the object's joint and obstacles; :func:`plan`
returns a :class:`Plan` that says what was solved, each constraint's residual, and what failed. Shapes and units are
in the docstrings and in ``__init__.pyi``; every error is a :class:`KpamError` that names file or field and remedy.
"""

from ._native import (
    Body,
    Cancel,
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
    Scene,
    SceneJoint,
    Shape,
    SolverConfig,
    Trajectory,
    UrdfError,
    __version__,
    ik,
    joint_travel,
    min_clearance,
    plan,
    plan_batch,
    refine,
    retime,
)
from .options import ContactWindow, GraspOptions, Gripper, Options

__all__ = [
    "Body",
    "Cancel",
    "ConfigError",
    "ContactWindow",
    "Grasp",
    "GraspOptions",
    "GraspPlan",
    "Gripper",
    "Joint",
    "KeypointProblem",
    "KpamError",
    "Options",
    "ParallelGripper",
    "Plan",
    "ProblemError",
    "Robot",
    "Scene",
    "SceneJoint",
    "Shape",
    "SolverConfig",
    "Trajectory",
    "UrdfError",
    "__version__",
    "ik",
    "joint_travel",
    "min_clearance",
    "plan",
    "plan_batch",
    "refine",
    "retime",
]
