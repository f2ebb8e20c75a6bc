"""Ways to do a step, as data: a config of the keypoint solver, or a grasp that is found on the object itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, ValidationInfo, field_validator

import gensim2_kpam as kpam
from gensim2.core.errors import InputError
from gensim2.core.validation import input_error

PLANNER_FIELDS = {"contact_speed": (0.001, 10.0), "opening": (0.001, 0.5)}
"""Numbers of a config that are the planner's, not the solver's, and the range of each."""

MAKES_ROOM = "makes_room"
"""Field of a config by which another object than the step's is moved."""


@dataclass(frozen=True)
class KeypointStrategy:
    """A solver config (docs/reference/solver.md, docs/architecture.md).

    Its names without a prefix are keypoints of the step's object and of its tool; ``"<object>/<keypoint>"`` is one of
    any other object.

    Attributes:
        config: plain data; beside the solver's fields ``contact_speed``, the greatest speed (m/s) of the point that
            touches, from the actuation on, ``opening``, the distance of the pads (m) on the way to a grasp, and
            ``makes_room``, the object that it moves in place of the step's.
    """

    config: Mapping[str, Any]

    @cached_property
    def solver_config(self) -> kpam.SolverConfig:
        """The solver's fields, validated."""
        others = {*PLANNER_FIELDS, MAKES_ROOM}
        return kpam.SolverConfig({name: value for name, value in self.config.items() if name not in others})

    @property
    def contact_speed(self) -> float | None:
        """Greatest speed of the point that touches, m/s; None: as fast as the arm may."""
        speed: float | None = self.config.get("contact_speed")
        return speed

    @property
    def makes_room(self) -> str | None:
        """Name of the object that it moves out of the way of the step, which it does not do; None: it does the step."""
        name: str | None = self.config.get(MAKES_ROOM)
        return name

    def as_step(self) -> KeypointStrategy:
        """The same as a way to do a step on the object that it moves."""
        return KeypointStrategy({name: value for name, value in self.config.items() if name != MAKES_ROOM})

    @property
    def opening(self) -> float | None:
        """Distance of the pads on the way to a grasp, m; None: as wide as they go."""
        opening: float | None = self.config.get("opening")
        return opening

    @property
    def fingers(self) -> kpam.Gripper:
        """Finger mode of the strategy."""
        return self.solver_config.gripper

    @property
    def let_go(self) -> float | None:
        """Metres by which the hand backs off at the end, once it has let go."""
        return self.solver_config.let_go

    def to_dict(self) -> dict[str, Any]:
        """The config."""
        return dict(self.config)

    def __getstate__(self) -> dict[str, Any]:
        return {"config": self.config}  # what is validated is made again


class _FoundGrasp(BaseModel):
    """Base of strategies whose grasp is found on an object's shape."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    grasp: Literal["antipodal"]

    @property
    def makes_room(self) -> None:
        """It does the step."""

    @property
    def fingers(self) -> kpam.Gripper:
        """Finger mode of the strategy."""
        return "grasp"

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return self.model_dump(mode="json")


class GraspStrategy(_FoundGrasp):
    """A grasp of the step's object between the two fingers, found on its shape; the first that serves is taken.

    A grasp serves where the arm reaches it and lifts the object, and where the next step that uses the object as its
    tool can then be planned.

    Attributes:
        grasp: how it is found.
        approach: straight way of the open hand to it, m.
        lift: way up with the object, m; in strides of 6 cm, the config language's ``move-up``.
        tilt: most (rad) by which the approach leans away from straight down.
        least_tilt: the least; to lay down what stands, the hand comes from the side.
        friction: coefficient between pads and object.
        candidates: most grasps that are tried, each with the fingers either way round.
    """

    approach: Annotated[float, Field(gt=0, le=0.3)] = 0.08
    lift: Annotated[float, Field(gt=0, le=0.5)] = 0.12
    tilt: Annotated[float, Field(ge=0, le=1.6)] = 1.1
    least_tilt: Annotated[float, Field(ge=0, le=1.6)] = 0.0
    friction: Annotated[float, Field(gt=0, le=5)] = 1.0
    candidates: Annotated[int, Field(ge=1, le=1000)] = 24

    @field_validator("least_tilt")
    @classmethod
    def _leaves_a_tilt(cls, least: float, info: ValidationInfo) -> float:
        most = info.data.get("tilt", least)  # not there where it is wrong itself
        if least > most:
            raise ValueError(f"must be at most tilt, {most} rad")
        return least

    @property
    def let_go(self) -> None:
        """A grasp keeps what it holds."""


class PullStrategy(_FoundGrasp):
    """Grasp the moving link of the step's object and move its joint.

    The first grasp is taken that the hand reaches without touching anything, and with which the whole motion of the
    joint can be planned.

    Attributes:
        grasp: how it is found.
        follow_joint_to: openness to which the joint goes.
        approach: straight way of the open hand to it, m.
        let_go: way back of the opened hand at the end, m.
        friction: coefficient between pads and object.
        contact_speed: greatest speed of the pads while they hold it, m/s.
        candidates: most grasps that are tried, each with the fingers either way round.
    """

    follow_joint_to: Annotated[float, Field(ge=0, le=1)]
    approach: Annotated[float, Field(gt=0, le=0.3)] = 0.06
    let_go: Annotated[float, Field(gt=0, le=0.3)] = 0.06
    friction: Annotated[float, Field(gt=0, le=5)] = 0.6
    contact_speed: Annotated[float, Field(ge=0.001, le=10)] = 0.08
    candidates: Annotated[int, Field(ge=1, le=1000)] = 12


Strategy = KeypointStrategy | GraspStrategy | PullStrategy


def parse_strategy(data: Mapping[str, Any], file: Path | str | None = None) -> Strategy:
    """Validate a strategy given as plain data.

    Args:
        data: fields of a solver config; where there is a field ``grasp``, of :class:`GraspStrategy`, or of
            :class:`PullStrategy` with ``follow_joint_to``.
        file: where it comes from.

    Raises:
        InputError: a field is unknown, missing or out of range; names it.
    """
    if "grasp" in data:
        kind = PullStrategy if "follow_joint_to" in data else GraspStrategy
        try:
            return kind.model_validate(data, strict=True)
        except ValidationError as error:
            raise input_error(error, file=file, known=kind.model_fields) from error
    strategy = KeypointStrategy(data)
    for name, (least, most) in PLANNER_FIELDS.items():
        value = data.get(name)
        if value is not None and not (isinstance(value, int | float) and least <= value <= most):
            raise InputError(f"must be a number in {least:g}..{most:g}, is {value!r}", file=file, field=name)
    moved = data.get(MAKES_ROOM)
    if moved is not None and not (isinstance(moved, str) and moved):
        raise InputError(f"must be an object's name, is {moved!r}", file=file, field=MAKES_ROOM)
    try:
        _ = strategy.solver_config
    except kpam.KpamError as error:
        raise named(error, file) from error
    except OverflowError as error:
        raise InputError("holds a number beyond 1e308", file=file) from error
    except UnicodeEncodeError as error:
        raise InputError("holds half a character (a lone surrogate)", file=file) from error
    return strategy


def named(error: kpam.KpamError, file: Path | str | None) -> InputError:
    """The solver's complaint as one of ours: it writes ``field: what is wrong``."""
    field, colon, problem = str(error).partition(": ")
    return InputError(problem if colon else field, file=file, field=field if colon else None)
