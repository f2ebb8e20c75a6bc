"""Read the configuration of an experiment: training data and evaluations of each policy."""

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
    """Configuration of one policy in an experiment (an experimental arm, not a robot arm), trained once for each seed.

    Attributes:
        name: name of the policy and of its folder.
        objects: training objects. ``"generated"``: generated objects; ``"real"``: objects from the asset folder of the
            run.
        count: number of generated objects of each class, which are used in addition to ``"real"`` objects. None: the
            training split.
        tasks: names of library tasks; one policy learns all of them.
        minutes_a_task: CPU time (min) for the data and training of each task. None: the value of the experiment.
        start: earlier policy of the experiment with the same training objects, whose weights and demonstrations are
            used. Data are generated only for new tasks. None: training from scratch.
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
            raise ValueError(f"{self.name} lists a task twice")
        return self

    @property
    def is_split(self) -> bool:
        """Return whether training uses only the training split.

        Evaluations on the other objects then use unseen objects.
        """
        return self.objects == "real" or self.count is None

    def added_to(self, start: Arm | None) -> tuple[str, ...]:
        """Return the tasks of this policy that the policy ``start`` was not trained on."""
        return tuple(name for name in self.tasks if start is None or name not in start.tasks)


class ExperimentConfig(BaseModel):
    """Configuration of an experiment.

    Attributes:
        title, about: title and description in the report.
        seeds: number of training runs of each policy, each with a different seed.
        minutes_a_task: CPU time in minutes for the data and the training of each task of a policy.
        scenes: maximum number of scenes that are planned as training data of each task.
        episodes, control_episodes: number of evaluation episodes of each task with the point cloud, and without it.
        unseen: name of the set of objects that no policy is trained on.
        tenth: number (0 to 9) of the tenth of each class's objects that the first training run leaves out, so that the
            policy can be evaluated on it. The second training run leaves out the following tenth, and so on.
        transfer: whether policies that were trained on generated objects are also evaluated on real objects.
        text, text_model: text encoder and its weights. None: the defaults of :func:`~gensim2.policy.learning.learn`.
        sentences: whether policies are also evaluated with the opposite instruction and with paraphrases.
        untaught: tasks for evaluation only: every policy is evaluated on these tasks, but no policy is trained on them.
        arms: policies to train, in the order in which the report lists them.
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
            raise ValueError("two entries of 'arms' have the same name")
        for name in self.untaught:
            if any(name in arm.tasks for arm in self.arms):
                raise ValueError(f"no policy may train on {name}, because 'untaught' lists this task")
        return self

    @model_validator(mode="after")
    def _starts_go_before(self) -> ExperimentConfig:
        for number, arm in enumerate(self.arms):
            if arm.start is None:
                continue
            start = next((each for each in self.arms[:number] if each.name == arm.start), None)
            if start is None:
                raise ValueError(f"{arm.name} starts from {arm.start}, which is not an earlier arm")
            if (start.objects, start.count) != (arm.objects, arm.count):
                raise ValueError(f"{arm.name} and {arm.start}, which it starts from, have different objects")
            if len(start.tasks) < 2 or not set(start.tasks) < set(arm.tasks):
                raise ValueError(
                    f"{arm.name} starts from {arm.start}, so {arm.start} must have at least two tasks, and {arm.name} "
                    "must have all these tasks and at least one more"
                )
        return self

    def words(self, arm: Arm, number: int) -> tuple[str, str]:
        """Return the names of the object sets for training and for the evaluation on unseen objects.

        Args:
            number: index of the training run, from 0.
        """
        tenth = (self.tenth + number) % TENTHS if arm.is_split else 0
        behind = f"-{tenth}" if tenth else ""
        return f"train{behind}" if arm.is_split else "all", self.unseen if self.unseen == "new" else f"test{behind}"

    def start_of(self, arm: Arm) -> Arm | None:
        """Return the configuration of the policy that ``arm`` starts from, if any."""
        return next((each for each in self.arms if each.name == arm.start), None)


def config_of(name: Name, *, small: bool = False) -> ExperimentConfig:
    """Return the configuration of an experiment that comes with the package.

    Args:
        name: name of the experiment.
        small: whether to return the small variant, which runs in a few minutes.
    """
    return read_experiment(CONFIGS / f"{name}{'_small' if small else ''}.yaml")


def read_experiment(path: Path) -> ExperimentConfig:
    """Read the configuration of an experiment from a YAML file.

    Raises:
        InputError: the file cannot be read, or a field is unknown or invalid; the message names file and field.
    """
    from gensim2.core.yaml_files import read_yaml

    try:
        return ExperimentConfig.model_validate(read_yaml(path))
    except ValidationError as error:
        raise input_error(error, file=path) from error
