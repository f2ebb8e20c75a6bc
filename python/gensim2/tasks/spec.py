"""What a task is: one frozen, validated value that serializes to YAML and JSON."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

SCHEMA_VERSION = 1


class Criterion(BaseModel):
    """One condition of success.

    ``articulated_open``: openness above ``threshold``. ``articulated_closed``: openness below it.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    type: Literal["articulated_open", "articulated_closed"]
    threshold: Annotated[float, Field(gt=0, lt=1)]


class Randomization(BaseModel):
    """Ranges of the initial scene; lengths in metres (the table ends at 0.65), angles in radians.

    The yaw is drawn from [0, yaw] where the drawn y offset is positive and from [-yaw, 0] where it is not.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    x: Annotated[float, Field(ge=0, le=1)] = 0.1
    y: Annotated[float, Field(ge=0, le=1)] = 0.1
    yaw: Annotated[float, Field(ge=0, le=6.2832)] = 0.5235987755982988
    openness_mean: Annotated[float, Field(ge=0, le=1)] | None = None
    openness_spread: Annotated[float, Field(ge=0, le=1)] = 0.15


class TaskSpec(BaseModel):
    """A task on one articulated object.

    Attributes:
        name: CamelCase; the environment is ``GenSim2-<name>-v1``.
        description: one phrase, lower case.
        asset_class: folder name of the object class.
        success: all must hold at once.
        randomization: of the initial scene; ``openness_mean=None`` takes the instance's default.
        max_episode_steps: control steps (20 a second) after which an episode is truncated.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    schema_version: Literal[1] = 1
    name: Annotated[str, Field(pattern=r"^[A-Z][A-Za-z0-9]*$", max_length=100)]
    description: Annotated[str, Field(max_length=1000)]
    asset_class: Annotated[str, Field(max_length=100)]
    success: Annotated[tuple[Criterion, ...], Field(min_length=1, max_length=20)]
    randomization: Randomization = Randomization()
    max_episode_steps: Annotated[int, Field(gt=0, le=10_000)] = 400

    @property
    def env_id(self) -> str:
        """Id for ``gymnasium.make``."""
        return f"GenSim2-{self.name}-v1"
