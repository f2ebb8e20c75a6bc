"""Sample the initial states of one task."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Unpack

from gensim2.robots import robot as robot_profile
from gensim2.scenes.arguments import as_library, as_task, check_names, chosen_instances
from gensim2.scenes.config import SceneArguments, SceneConfig, SceneOptions
from gensim2.scenes.goal import check_false_at_start, check_reachable
from gensim2.scenes.initial_state import InitialState, PlacementError, sample_initial_state
from gensim2.scenes.physics import physics_switches
from gensim2.scenes.reset_options import ObjectOptions, read_options
from gensim2.tasks.presets import preset
from gensim2.tasks.spec import TaskSpec

GOAL_SEEDS = range(8)
"""Seeds of additional scenes in which the goal is checked if it is reached in the first scene."""


class SceneSampler:
    """Samples the initial states of one task by seed, in the same way in every environment.

    Args:
        task: library task, :class:`TaskSpec`, its fields, or a :class:`~gensim2.scenes.config.SceneConfig`. A
            ``SceneConfig`` allows no other argument.

    Attributes:
        task: spec of the task.
        library: library of the objects.
        robot: key with which worker processes find the robot.
        profile: profile of the robot.
        physics: name of the physics settings.
        engine: simulation engine.
        randomization: randomization preset.
        instances: ids from which a reset chooses, by object.

    Raises:
        InputError: an argument is invalid.
    """

    def __init__(self, task: str | TaskSpec | Mapping[str, Any] | SceneConfig, **scene: Unpack[SceneArguments]) -> None:
        if isinstance(task, SceneConfig):
            config, self.library, instances = task, as_library(task.assets), task.drawn
        else:
            self.library, instances = as_library(scene.get("assets")), scene.get("instances", "all")
            scene["assets"] = self.library
            config = SceneOptions.of(**scene).with_task(as_task(task))
        self.task, self.robot, self.physics, self.engine = config.task, config.robot, config.physics, config.engine
        self.profile = robot_profile(self.robot)
        self.randomization = preset(config.randomization)
        check_names(self.task, self.profile)
        self.instances = chosen_instances(self.library, self.task, instances)
        self._goal_is_checked = False

    def sample(self, seed: int, options: Mapping[str, Any] | None = None) -> InitialState:
        """Return the initial state of a seed; the first call also checks the task's goal.

        Args:
            seed: 0 to 2**32 - 1.
            options: reset options, which replace random values.

        Raises:
            InputError: an option or an object's file is invalid.
            PlacementError: the objects cannot be placed.
            GoalError: the goal is always reached at the start, or cannot be reached.
        """
        given = read_options(options, tuple(self.task.objects))
        state = self._draw(seed, given)
        if not self._goal_is_checked:
            placed = {name for name, own in given.items() if {"offset", "pose"} & set(own)}
            check_reachable(self.task, state, self.profile, placed)
            check_false_at_start(self.task, self._drawn(state), self.profile)
            self._goal_is_checked = True
        return state

    def _drawn(self, first: InitialState) -> Iterator[InitialState]:
        """Yield ``first``, then the states of ``GOAL_SEEDS``. Each state is sampled only on request."""
        yield first
        nothing = read_options(None, tuple(self.task.objects))
        for seed in GOAL_SEEDS:
            try:
                state = self._draw(seed, nothing)
            # A seed without a placement says nothing about the goal. A reset with this seed reports the error.
            except PlacementError:
                continue
            yield state

    def _draw(self, seed: int, options: Mapping[str, ObjectOptions]) -> InitialState:
        return sample_initial_state(
            self.task,
            self.library,
            self.instances,
            seed,
            options,
            self.profile,
            physics_switches(self.physics),
            self.randomization,
        )
