"""Read the strategies of a step. A strategy is a solver config, or a search for a grasp on the object's shape."""

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
"""Numeric config fields that the planner reads and the solver does not know, with their ranges."""

MAKES_ROOM = "makes_room"
"""Config field that names another object, which the strategy moves out of the way instead of doing the step."""

CENTERED = 0.25
"""Factor of :func:`centered`."""


@dataclass(frozen=True)
class KeypointStrategy:
    """Strategy given by a solver config.

    docs/reference/solver.md describes the config, and docs/architecture.md how the planner uses it.

    Keypoints of the step's object and tool have no prefix. Keypoints of other objects are named
    ``"<object>/<keypoint>"``.

    Attributes:
        config: plain data with the fields of the solver and three fields of the planner. ``contact_speed`` is the
            maximum speed (m/s) of the contact point after the actuation pose. ``opening`` is the distance (m) of the
            pads during the approach to a grasp. ``makes_room`` names an obstacle that the strategy moves away; the step
            then needs another strategy to do its own motion.
    """

    config: Mapping[str, Any]

    @cached_property
    def solver_config(self) -> kpam.SolverConfig:
        """The validated solver fields."""
        others = {*PLANNER_FIELDS, MAKES_ROOM}
        return kpam.SolverConfig({name: value for name, value in self.config.items() if name not in others})

    @property
    def contact_speed(self) -> float | None:
        """Maximum speed of the contact point, m/s; None if only the arm limits the speed."""
        speed: float | None = self.config.get("contact_speed")
        return speed

    @property
    def makes_room(self) -> str | None:
        """Name of the object that this strategy moves out of the way; None if the strategy does the step itself."""
        name: str | None = self.config.get(MAKES_ROOM)
        return name

    def as_step(self) -> KeypointStrategy:
        """Return this strategy without ``makes_room``.

        The motion of the obstacle is then planned as a step of its own.
        """
        return KeypointStrategy({name: value for name, value in self.config.items() if name != MAKES_ROOM})

    @property
    def opening(self) -> float | None:
        """Distance between the pads on the way to a grasp, m; None: fully open."""
        opening: float | None = self.config.get("opening")
        return opening

    @property
    def fingers(self) -> kpam.Gripper:
        """Finger mode of the strategy."""
        return self.solver_config.gripper

    @property
    def let_go(self) -> float | None:
        """Distance in metres by which the hand retreats after the release; None: no release."""
        return self.solver_config.let_go

    def to_dict(self) -> dict[str, Any]:
        """Return the config."""
        return dict(self.config)

    def __getstate__(self) -> dict[str, Any]:
        return {"config": self.config}  # the validated fields are not pickled: they are computed again from ``config``


class _FoundGrasp(BaseModel):
    """Base class of strategies that search for a grasp on an object's shape."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    grasp: Literal["antipodal"]

    @property
    def makes_room(self) -> None:
        """None, because these strategies move no obstacle."""

    @property
    def fingers(self) -> kpam.Gripper:
        """Finger mode of the strategy."""
        return "grasp"

    def to_dict(self) -> dict[str, Any]:
        """Return plain data."""
        return self.model_dump(mode="json")


class GraspStrategy(_FoundGrasp):
    """Strategy that grasps the step's object with two fingers. The grasp is searched for on the shape of the object.

    The first usable grasp is executed. A grasp is usable if a motion reaches it and lifts the object. If a later step
    uses the object as its tool, the grasp must also allow a motion of that step.

    Attributes:
        grasp: search method.
        approach: length of the straight motion with which the open hand approaches the object, m.
        lift: height of the lift, m. The config contains one ``move-up`` motion for every 6 cm.
        tilt: maximum angle (rad) between the direction of the approach and straight down.
        least_tilt: minimum angle (rad) between the approach and straight down, for an object that is laid on its side
            later.
        friction: friction coefficient between pads and object.
        candidates: maximum number of grasps. Each grasp is also tried with swapped fingers.
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
        # If the value of ``tilt`` is invalid, ``info.data`` has no ``tilt``, and pydantic reports the invalid value.
        most = info.data.get("tilt", least)
        if least > most:
            raise ValueError(f"must be at most the value of the field 'tilt', which is {most} rad")
        return least

    @property
    def let_go(self) -> None:
        """None, because this strategy does not release the grasped object."""


class PullStrategy(_FoundGrasp):
    """Strategy that grasps the moving link of the step's object and then moves the joint.

    The strategy executes the first grasp that is reached without early contact and allows the complete motion of the
    joint.

    Attributes:
        grasp: search method.
        follow_joint_to: target openness of the joint.
        approach: length of the straight approach of the open hand, m.
        let_go: distance by which the open hand retreats at the end, m.
        friction: friction coefficient between pads and object.
        contact_speed: maximum speed of the pads while they grip the link, m/s.
        candidates: maximum number of grasps. Each grasp is also tried with swapped fingers.
    """

    follow_joint_to: Annotated[float, Field(ge=0, le=1)]
    approach: Annotated[float, Field(gt=0, le=0.3)] = 0.06
    let_go: Annotated[float, Field(gt=0, le=0.3)] = 0.06
    friction: Annotated[float, Field(gt=0, le=5)] = 0.6
    contact_speed: Annotated[float, Field(ge=0.001, le=10)] = 0.08
    candidates: Annotated[int, Field(ge=1, le=1000)] = 12


Strategy = KeypointStrategy | GraspStrategy | PullStrategy


def centered(strategy: Strategy) -> Strategy:
    """Return the strategy with point tolerances multiplied by ``CENTERED``; unchanged if it has no such tolerance.

    With the full tolerance, the solver chooses poses at the edge of the tolerance. These poses have no margin and
    differ from the poses in similar scenes.
    """
    if not isinstance(strategy, KeypointStrategy):
        return strategy
    if all(each["type"] != "point2point_constraint" for each in strategy.config["constraint_list"]):
        return strategy
    constraints = [
        {**each, "tolerance": CENTERED * each["tolerance"]} if each["type"] == "point2point_constraint" else each
        for each in strategy.config["constraint_list"]
    ]
    return KeypointStrategy({**strategy.config, "constraint_list": constraints})


def parse_strategy(data: Mapping[str, Any], file: Path | str | None = None) -> Strategy:
    """Validate a strategy given as plain data.

    Args:
        data: fields of the strategy. Without ``grasp``, it is a solver config (:class:`KeypointStrategy`). With
            ``grasp``, it is a :class:`PullStrategy` if it has ``follow_joint_to``, and a :class:`GraspStrategy`
            otherwise.
        file: file that contains the data, for error messages.

    Raises:
        InputError: a field is unknown, missing or out of range; the message names the field.

    Example:
        ```python
        for data in gensim2.load_strategies("OpenDrawer").values():
            print(parse_strategy(data))
        ```
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
            raise InputError(f"must be a number in {least:g}..{most:g}, but is {value!r}", file=file, field=name)
    moved = data.get(MAKES_ROOM)
    if moved is not None and not (isinstance(moved, str) and moved):
        raise InputError(f"must be an object's name, but is {moved!r}", file=file, field=MAKES_ROOM)
    try:
        _ = strategy.solver_config
    except kpam.KpamError as error:
        raise named(error, file) from error
    except OverflowError as error:
        raise InputError("the strategy contains a number larger than 1e308", file=file) from error
    except UnicodeEncodeError as error:
        raise InputError("contains an unpaired UTF-16 surrogate, which is not a valid character", file=file) from error
    return strategy


def named(error: kpam.KpamError, file: Path | str | None) -> InputError:
    """Convert a solver error, which reads ``field: problem``, to an InputError."""
    field, colon, problem = str(error).partition(": ")
    return InputError(problem if colon else field, file=file, field=field if colon else None)
