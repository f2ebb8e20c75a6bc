"""Sampler of initial states: a task, its objects and the presets, resolved once."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Unpack

from gensim2.robots import DEFAULT_ROBOT
from gensim2.robots import robot as robot_profile
from gensim2.scenes.arguments import as_library, as_task, check_names, check_words, chosen_instances
from gensim2.scenes.config import SceneArguments
from gensim2.scenes.initial_state import InitialState, sample_initial_state
from gensim2.scenes.physics import DEFAULT_PHYSICS, physics_name, physics_switches
from gensim2.scenes.reset_options import read_options
from gensim2.tasks.presets import DEFAULT_PRESET, preset
from gensim2.tasks.spec import TaskSpec


class SceneSampler:
    """Initial states of one task by seed, the same in every environment.

    Args:
        task: name of a library task, a :class:`TaskSpec`, or its fields.
        scene: see :class:`~gensim2.scenes.config.SceneArguments`.

    Attributes:
        task: what is to be done.
        library: of the objects.
        profile: of the robot.
        physics: the word for its switches.
        randomization: the preset.
        instances: ids that are drawn from, by object.

    Raises:
        InputError: an argument is wrong.
    """

    def __init__(self, task: str | TaskSpec | Mapping[str, Any], **scene: Unpack[SceneArguments]) -> None:
        words = {name: scene.get(name) for name in ("robot", "physics", "randomization")}
        check_words(**words)
        self.profile = robot_profile(scene.get("robot", DEFAULT_ROBOT))
        self.physics = physics_name(scene.get("physics", DEFAULT_PHYSICS))
        self.randomization = preset(scene.get("randomization", DEFAULT_PRESET))
        self.task = as_task(task)
        check_names(self.task, self.profile)
        self.library = as_library(scene.get("assets"))
        self.instances = chosen_instances(self.library, self.task, scene.get("instances", "all"))

    def sample(self, seed: int, options: Mapping[str, Any] | None = None) -> InitialState:
        """Return the initial state of a seed.

        Args:
            seed: 0 to 2**32 - 1.
            options: of a reset; each takes the place of what would have been drawn.

        Raises:
            InputError: an option cannot be used, or an object's files.
            PlacementError: there is no room for all objects.
        """
        given = read_options(options, tuple(self.task.objects))
        return sample_initial_state(
            self.task,
            self.library,
            self.instances,
            seed,
            given,
            self.profile,
            physics_switches(self.physics),
            self.randomization,
        )
