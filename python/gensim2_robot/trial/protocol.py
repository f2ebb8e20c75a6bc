"""Protocols of trials as files: what is laid out where, what is asked for, and what counts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from gensim2.core.errors import InputError, near
from gensim2.core.seeding import rng
from gensim2.core.validation import input_error
from gensim2.core.yaml_files import read_yaml
from gensim2.scenes.randomize import draw_object, openness_at_reset
from gensim2.tasks.presets import preset
from gensim2.tasks.spec import Name, Offset, Randomization, TaskSpec

FOLDER = Path(__file__).parents[1] / "protocols"
"""Of those that come with the package."""
Text = Annotated[str, Field(min_length=1, max_length=400)]
Metres = Annotated[float, Field(ge=-3, le=3)]
"""Distance from the robot's base that an arm may reach, m."""
Shares = tuple[Annotated[float, Field(ge=0, le=1)], Annotated[float, Field(ge=0, le=1)]]


class Placement(BaseModel):
    """Ranges in which one object stands.

    Attributes:
        at: m ahead of the robot's base and to its left, of the middle of the ranges.
        x, y: m by which it is shifted ahead and to the left; one number stands for the range from minus it to it.
        yaw: degrees by which it is turned at most, towards the robot from the side to which it was shifted.
        openness: share of its joint's range by which it is opened; None: it has no joint.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    at: tuple[Metres, Metres]
    x: Offset = (-0.1, 0.1)
    y: Offset = (-0.1, 0.1)
    yaw: Annotated[float, Field(ge=-180, le=180)] = 30.0
    openness: Shares | None = None

    @model_validator(mode="after")
    def _opens_in_order(self) -> Placement:
        if self.openness is not None and self.openness[0] > self.openness[1]:
            raise ValueError("the first number of openness must not be the greater")
        return self


@dataclass(frozen=True)
class Placed:
    """One object of one trial.

    Attributes:
        x, y: m ahead of the robot's base and to its left.
        offset: m and rad by which it is off the middle of its ranges: ahead, to the left, turned about the vertical.
        openness: share of its joint's range; None: it has no joint.
    """

    x: float
    y: float
    offset: tuple[float, float, float]
    openness: float | None

    def told(self, name: str) -> str:
        """One line for whoever lays it out."""
        side = "left" if self.y >= 0 else "right"
        degrees = math.degrees(self.offset[2])
        turn = "anticlockwise" if degrees >= 0 else "clockwise"
        opened = "" if self.openness is None else f", opened to {100 * self.openness:.0f} % of its range"
        return (
            f"{name}: middle {100 * self.x:.0f} cm ahead of the robot's base and {100 * abs(self.y):.0f} cm to the "
            f"{side}, turned {abs(degrees):.0f} degrees {turn} as seen from above{opened}"
        )


class Protocol(BaseModel):
    """``protocols/TASK.yaml``.

    Attributes:
        task: name of the task.
        objects: what to take for each, for people.
        placements: where each stands.
        sentence: that the policy is told.
        verdict: question whose answer yes is a success.
        causes: of failures, to choose from.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    schema_version: Literal[1] = 1
    task: Annotated[str, Field(min_length=1, max_length=100)]
    objects: dict[Name, Text]
    placements: dict[Name, Placement]
    sentence: Text
    verdict: Text
    causes: Annotated[tuple[Text, ...], Field(min_length=1, max_length=20)]

    @model_validator(mode="after")
    def _places_every_object(self) -> Protocol:
        if set(self.objects) != set(self.placements):
            raise ValueError("objects and placements must name the same")
        return self

    def require(self, task: TaskSpec) -> None:
        """Refuse another task's objects.

        Raises:
            InputError: the task has other objects.
        """
        if set(self.objects) != set(task.objects):
            said = f"the task has {', '.join(task.objects)}"
            raise InputError(said, file=f"protocol of {self.task}", field="objects")

    def place(self, seed: int, number: int) -> dict[str, Placed]:
        """Draw where everything stands in one trial."""
        generator, found = rng(seed, f"{self.task}/trial placements", number), {}
        for name, given in self.placements.items():
            low, high = given.openness or (0.0, 0.0)
            ranges = Randomization(
                x=given.x,
                y=given.y,
                yaw=math.radians(given.yaw),
                openness_mean=0.5 * (low + high),
                openness_spread=0.5 * (high - low),
            )
            drawn = draw_object(generator, ranges, preset("paper"), ("",))
            openness = None if given.openness is None else openness_at_reset(ranges, drawn, 0.0)
            at = given.at[0] + drawn.x, given.at[1] + drawn.y
            found[name] = Placed(*at, (drawn.x, drawn.y, drawn.yaw), openness)
        return found


def reset_options(placed: Mapping[str, Placed]) -> dict[str, Any]:
    """Options of a simulator's reset that lay out the same: offsets from each object's own default placement."""
    return {
        "offset": {name: list(each.offset) for name, each in placed.items()},
        "openness": {name: each.openness for name, each in placed.items() if each.openness is not None},
    }


def protocol_names() -> list[str]:
    """Names of the protocols that come with the package."""
    return sorted(path.stem for path in FOLDER.glob("*.yaml"))


def read_protocol(word: str) -> Protocol:
    """A protocol by its task's name, or from a file of your own.

    Raises:
        InputError: there is none, or it is not written so; names the file and the field.
    """
    own = word.endswith((".yaml", ".yml", ".json"))
    if not own and word not in protocol_names():
        remedy = f"{near(word, protocol_names())}, or give a file"
        raise InputError(f"there is no protocol {word!r}", field="protocol", remedy=remedy)
    path = Path(word) if own else FOLDER / f"{word}.yaml"
    try:
        return Protocol.model_validate(read_yaml(path))
    except ValidationError as error:
        raise input_error(error, file=path) from error
