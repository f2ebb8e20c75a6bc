"""Solver configs from files: refused by file and field before anything is planned."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

import gensim2_kpam as kpam
from gensim2.errors import InputError
from gensim2.robots import DEFAULT
from gensim2.robots import robot as robot_profile


def solver_config(config: Mapping[str, Any], file: Path | str | None = None) -> kpam.SolverConfig:
    """Plain data as a validated config.

    Args:
        config: fields as in docs/solver.md.
        file: where they come from.

    Raises:
        InputError: a field is unknown, missing or out of range.
    """
    try:
        return kpam.SolverConfig(config)
    except kpam.ConfigError as error:
        raise _named(error, file) from error
    except OverflowError as error:
        raise InputError("holds a number beyond 1e308", file=file) from error
    except UnicodeEncodeError as error:
        raise InputError("holds half a character (a lone surrogate)", file=file) from error


def check_keypoints(
    config: kpam.SolverConfig,
    keypoints: Iterable[str],
    joint: Literal["revolute", "prismatic"],
    file: Path | str | None = None,
    robot: str = DEFAULT,
) -> None:
    """Make sure that the robot's tool and an object have the keypoints that a config names.

    Args:
        config: the config.
        keypoints: names that the object has.
        joint: type of its moving joint.
        file: where the config comes from.
        robot: name of its profile.

    Raises:
        InputError: one of them has not.
    """
    profile = robot_profile(robot)
    model = profile.model
    try:
        kpam.KeypointProblem(
            model,
            config,
            (model.lower + model.upper) / 2,
            tool_keypoints=profile.tool_keypoints,
            # Anywhere off the joint's axis, no two in one place: names are what is checked.
            object_keypoints={name: np.array([1.0, 0.1 * n, 0.0]) for n, name in enumerate(keypoints)},
            T_base_object=np.eye(4),
            joint=kpam.Joint(joint, np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.5, 0.0, 1.0),
        )
    except kpam.ProblemError as error:
        raise _named(error, file) from error


def _named(error: kpam.KpamError, file: Path | str | None) -> InputError:
    """The solver writes ``field: what is wrong``."""
    field, colon, problem = str(error).partition(": ")
    return InputError(problem if colon else field, file=file, field=field if colon else None)
