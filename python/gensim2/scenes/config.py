"""What episodes follow from beside their strategies and their seed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from gensim2.robots import DEFAULT_ROBOT
from gensim2.tasks.presets import DEFAULT_PRESET, PresetName
from gensim2.tasks.spec import TaskSpec

Physics = Literal["ours", "original"]
"""Whose joint friction, densities, materials and default poses episodes have (docs/simulation.md)."""

Drawn = str | tuple[str, ...] | frozenset[tuple[str, str]]
"""Which instances episodes draw from."""

Disturbance = Literal["push", "drop"]
"""By what an episode is disturbed, once, at a seeded moment."""

DISTURBANCES: tuple[Disturbance, ...] = get_args(Disturbance)
PHYSICS: tuple[Physics, ...] = get_args(Physics)


@dataclass(frozen=True)
class Circumstances:
    """What all episodes of a run have in common.

    Attributes:
        assets: a folder of objects or ``"builtin"``.
        physics: ``"ours"`` or ``"original"``.
        robot: name of its profile.
        open_loop: everything is planned at the start, with the first strategy of each step.
        disturbance: ``"push"`` or ``"drop"``, once an episode at a seeded moment; None: nothing is disturbed.
        randomization: ``"paper"``, ``"paper-half"`` or ``"wide"``: what becomes of the tasks' ranges.
        attempts: resets to the same start that an episode has at most, until one holds.
    """

    assets: str
    physics: Physics = "ours"
    robot: str = DEFAULT_ROBOT
    open_loop: bool = False
    disturbance: Disturbance | None = None
    randomization: PresetName = DEFAULT_PRESET
    attempts: int = 1

    @property
    def environment(self) -> dict[str, str]:
        """Arguments of the registered environment, where they are not its defaults."""
        given = {"physics": self.physics, "robot": self.robot, "randomization": self.randomization}
        defaults = {"physics": "ours", "robot": DEFAULT_ROBOT, "randomization": DEFAULT_PRESET}
        return {name: value for name, value in given.items() if value != defaults[name]}


@dataclass(frozen=True)
class Setting:
    """What all episodes of one task have in common.

    Attributes:
        task: what is to be done.
        instances: which instances are drawn from: one word, several ids, or (object's name, word) pairs.
        circumstances: of the run.
    """

    task: TaskSpec
    instances: Drawn
    circumstances: Circumstances

    def __hash__(self) -> int:
        """By the task's name: a spec holds mappings."""
        return hash((self.task.name, self.instances, self.circumstances))
