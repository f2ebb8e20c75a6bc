"""Options that select and configure the designer of a pipeline run."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Annotated, Any, Literal

import click

from gensim2.cli.typed import File, Folder, Option, Real, count
from gensim2.core.errors import InputError, near

if TYPE_CHECKING:
    from gensim2.design import Designer
    from gensim2.scenes.config import SceneOptions
    from gensim2.tasks.spec import TaskSpec

OFFLINE = "offline"

Price = Annotated[float | None, Real(0), Option(metavar="USD")]


class Designing:
    """Options that select and configure the designer.

    Attributes:
        mode: explore designs single-step tasks. topdown decomposes long tasks into steps. bottomup combines verified
            tasks into long tasks. free designs whole tasks, which may use several objects, grasped tools and all types
            of success criteria.  [default: explore. Default of the offline designer: single-step and long tasks]
        trials: Number of alternative configs to request at once for a step.  [default: 3]
        max_rounds: Maximum number of answers to one request, including corrected answers. It is also the maximum number
            of rounds that improve configs after simulation.  [default: 3]
        visual: Send pictures of the object and of the actuation pose to the model.
        code: Also request each task as Python code. The command parses this code but never runs it.
        review: Ask on the terminal whether to accept each proposed task.
        prompts: Folder with your prompts. A file replaces the built-in prompt of the same name.
        replay: Run folder whose recorded answers are used instead of a model.
        config: YAML file with settings of the model.
        base_url: URL of an OpenAI-compatible endpoint.  [default: $OPENAI_BASE_URL, else OpenAI's]
        temperature: Sampling temperature of the model.
        budget: Maximum cost of the model's answers in USD; requires --price-in and --price-out.
        price_in: Price in USD of a million prompt tokens.
        price_out: Price in USD of a million answer tokens.
        concurrency: Maximum number of simultaneous requests.  [default: 4]
    """

    mode: Literal["explore", "topdown", "bottomup", "free"] | None = None
    trials: Annotated[int | None, count(50)] = None
    max_rounds: Annotated[int | None, count(20)] = None
    visual: bool = False
    code: bool = False
    review: bool = False
    prompts: Folder | None = None
    replay: Annotated[Folder | None, Option(metavar="RUN")] = None
    config: Annotated[File | None, Option("--model-config", "FILE")] = None
    base_url: Annotated[str | None, Option(metavar="URL")] = None
    temperature: Annotated[float | None, Real(0, 2)] = None
    budget: Annotated[float | None, Real(0, min_open=True), Option(metavar="USD")] = None
    price_in: Price = None
    price_out: Price = None
    concurrency: Annotated[int | None, count(64)] = None


NAMES = tuple(Designing.__annotations__)
#: Options that also apply to the offline designer.
_FOR_ALL = ("mode", "review")
_ASKING = ("mode", "trials", "max_rounds", "visual", "code")


def designer_of_command(
    designer: str | None, target_task: str | None, target_object: str | None, scene: SceneOptions, asked: dict[str, Any]
) -> tuple[Designer, str | None]:
    """Return the designer that the options select, and the name of the library task to redesign.

    The name is None if ``target_task`` is None, or if a language model designs ``target_task`` as a new task.

    Raises:
        InputError: an option is invalid or does not apply to this designer.
        MissingExtraError: the extra ``llm`` is not installed.
    """
    from gensim2.design.designing import model_designer, offline_designer
    from gensim2.tasks.library import task_names

    if target_object is not None:
        _check_object(target_object, target_task, scene)
    review = _confirmed if asked.pop("review") else None
    if review is not None:
        _check_terminal()
    if designer in (None, OFFLINE) and asked["replay"] is None and asked["config"] is None:
        for name, value in asked.items():
            if value and name not in _FOR_ALL:
                flag = f"--{'model-config' if name == 'config' else name.replace('_', '-')}"
                raise InputError("does not apply to the offline designer", field=flag, remedy="give --designer MODEL")
        if asked["mode"] in ("topdown", "free"):
            raise InputError("needs a language model", field=f"--mode {asked['mode']}", remedy="give --designer MODEL")
        return offline_designer(asked["mode"], target_object, review), target_task
    from gensim2.design.llm import Asking

    asking = {name: asked.pop(name) for name in _ASKING}
    new = target_task is not None and target_task not in task_names()
    wished = {"target_task": target_task if new else None, "target_object": target_object}
    found = model_designer(
        None if designer == OFFLINE else designer,
        Asking(**{name: value for name, value in {**asking, **wished}.items() if value is not None}),
        scene,
        review=review,
        **asked,
    )
    return found, None if new else target_task


def _check_object(target_object: str, target_task: str | None, scene: SceneOptions) -> None:
    """Refuse an unknown class before any object is loaded or a model is asked."""
    from gensim2.objects import open_library
    from gensim2.tasks.library import task_names

    if target_task in task_names():
        wrong = "cannot be combined with an existing task"
        raise InputError(wrong, field="--target-object", remedy="leave out --target-object")
    library = open_library(scene.assets)
    if target_object not in library.classes():
        message = f"{library.location} has no class {target_object!r}"
        raise InputError(message, field="--target-object", remedy=near(target_object, library.classes()))


def _check_terminal() -> None:
    """Refuse ``--review`` if there is no terminal, because a missing answer would count as "no"."""

    if not sys.stdin.isatty():
        raise InputError("standard input is not a terminal, so no question can be asked", field="--review")


def _confirmed(task: TaskSpec) -> bool:
    """Ask at the terminal whether to accept a task."""
    from gensim2.tasks.wording import criteria_in_words

    steps = "; ".join(step.name for step in task.steps)
    click.echo(
        f"\n{task.name}: {task.description}\n  steps: {steps}\n  goal: {criteria_in_words(task.success)}", err=True
    )
    return click.confirm("Design it?", default=True, err=True)
