"""Configurations of experiments: which policies are taught on what, and what they are measured on."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from gensim2.core.validation import input_error
from gensim2.objects.library.catalogue import TENTHS

Name = Literal["generalization", "breadth", "scaling", "combinations", "designed"]
NAMES: tuple[Name, ...] = get_args(Name)

CONFIGS = Path(__file__).parent / "configs"

Count = Annotated[int, Field(ge=1, le=1_000_000)]
Minutes = Annotated[float, Field(gt=0, le=1e4)]


class Arm(BaseModel):
    """One policy of an experiment, trained once a seed.

    Attributes:
        name: of its folder.
        objects: ``"generated"``, or ``"real"``: those of the folder that the run is given.
        count: of generated objects of each class that it is taught on, in place of the training split's; where
            ``objects`` are real, beside it.
        tasks: names of library tasks, one policy for all of them.
        minutes_a_task: of CPU for data and training, in place of the experiment's.
        start: name of an arm before this one, on the same objects: this one's policy begins with its weights and plans,
            and is taught only the tasks that it does not know; None: from nothing.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: Annotated[str, Field(pattern=r"^[a-z0-9-]{1,60}$")]
    objects: Literal["generated", "real"]
    count: Count | None = None
    tasks: Annotated[tuple[str, ...], Field(min_length=1)]
    minutes_a_task: Minutes | None = None
    start: str | None = None

    @model_validator(mode="after")
    def _tasks_differ(self) -> Arm:
        if len(set(self.tasks)) < len(self.tasks):
            raise ValueError(f"{self.name} has a task twice")
        return self

    @property
    def is_split(self) -> bool:
        """Whether it is taught on a split of listed objects, so that seen ones can be told from others."""
        return self.objects == "real" or self.count is None

    def added_to(self, start: Arm | None) -> tuple[str, ...]:
        """Return the tasks that it is taught, which the arm that it begins with does not know."""
        return tuple(name for name in self.tasks if start is None or name not in start.tasks)


class ExperimentConfig(BaseModel):
    """An experiment.

    Attributes:
        title, about: words of its page.
        seeds: trainings of each arm.
        minutes_a_task: of CPU for data and training of a policy, for each of its tasks.
        scenes: most that are planned of each task.
        episodes, control_episodes: of each task that a policy and its blind control are measured by.
        unseen: word for the objects that a training does not see.
        tenth: of each class's objects, 0 to 9, that the first training of a split does not see; each further training
            leaves out the next one.
        transfer: measure policies that were taught on generated objects on real ones, too.
        text, text_model: encoder of the policies' sentences, and folder or hub name of its weights; None: as
            :func:`~gensim2.policy.learning.learn` has them.
        sentences: measure them told the opposite, and told the same in other words, too.
        untaught: tasks that no arm has, of other classes or of other combinations of these, which they are measured
            on, too, told what these ask for.
        arms: in the order of the page.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    title: str
    about: str
    seeds: Annotated[int, Field(ge=1, le=100)] = 1
    minutes_a_task: Minutes
    scenes: Count
    episodes: Count
    control_episodes: Count
    unseen: Literal["test", "new"] = "test"
    tenth: Annotated[int, Field(ge=0, le=9)] = 0
    transfer: bool = False
    text: Literal["small", "clip", "sentence"] | None = None
    text_model: str | None = None
    sentences: bool = False
    untaught: tuple[str, ...] = ()
    arms: Annotated[tuple[Arm, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _names_differ(self) -> ExperimentConfig:
        if len({arm.name for arm in self.arms}) < len(self.arms):
            raise ValueError("two arms have one name")
        for name in self.untaught:
            if any(name in arm.tasks for arm in self.arms):
                raise ValueError(f"{name} is untaught, and an arm has it")
        return self

    @model_validator(mode="after")
    def _starts_go_before(self) -> ExperimentConfig:
        for number, arm in enumerate(self.arms):
            if arm.start is None:
                continue
            start = next((each for each in self.arms[:number] if each.name == arm.start), None)
            if start is None:
                raise ValueError(f"{arm.name} starts from {arm.start}, which is no arm before it")
            if (start.objects, start.count) != (arm.objects, arm.count):
                raise ValueError(f"{arm.name} and {arm.start}, which it starts from, have different objects")
            if len(start.tasks) < 2 or not set(start.tasks) < set(arm.tasks):
                raise ValueError(f"{arm.name} has to have all tasks of {arm.start}, which are several, and others")
        return self

    def words(self, arm: Arm, number: int) -> tuple[str, str]:
        """Return the words for the objects that a training of an arm is taught on, and that it never saw.

        Args:
            arm: the arm.
            number: of its training, from 0 on.
        """
        tenth = (self.tenth + number) % TENTHS if arm.is_split else 0
        behind = f"-{tenth}" if tenth else ""
        return f"train{behind}" if arm.is_split else "all", self.unseen if self.unseen == "new" else f"test{behind}"

    def start_of(self, arm: Arm) -> Arm | None:
        """Return the arm that one begins with."""
        return next((each for each in self.arms if each.name == arm.start), None)


def config_of(name: Name, *, small: bool = False) -> ExperimentConfig:
    """The configuration that comes with the package.

    Args:
        small: that of a few minutes.
    """
    return read_experiment(CONFIGS / f"{name}{'_small' if small else ''}.yaml")


def read_experiment(path: Path) -> ExperimentConfig:
    """A configuration from a YAML file.

    Raises:
        InputError: it cannot be read, or a field is unknown or cannot be so; names file and field.
    """
    from gensim2.core.yaml_files import read_yaml

    try:
        return ExperimentConfig.model_validate(read_yaml(path))
    except ValidationError as error:
        raise input_error(error, file=path) from error
