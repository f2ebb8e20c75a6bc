"""Options that say who designs, and the designer that they stand for."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gensim2.cli import options

if TYPE_CHECKING:
    from gensim2.design import Designer
    from gensim2.scenes.config import SceneOptions
    from gensim2.tasks.spec import TaskSpec

OFFLINE = "offline"

_FILE = click.Path(path_type=Path)
_OPTIONS = (
    click.option(
        "--mode",
        type=click.Choice(("explore", "topdown", "bottomup")),
        help="Tasks of one motion; long ones taken apart; long ones put together from verified ones.  "
        "[default: explore; the offline designer: all that it knows]",
    ),
    click.option("--trials", type=options.count(50), help="Configs of a step written at once.  [default: 3]"),
    click.option(
        "--max-rounds",
        type=options.count(20),
        help="Answers to a question before it is dropped, and rounds of better configs after physics.  [default: 3]",
    ),
    click.option("--visual", is_flag=True, help="Show the model pictures of object and actuation pose."),
    click.option("--code", is_flag=True, help="Ask for each task as code, too, which is interpreted."),
    click.option("--review", is_flag=True, help="Ask on the terminal of each proposal whether it is wanted."),
    click.option("--prompts", type=_FILE, metavar="DIR", help="Prompts of your own, by the names of ours."),
    click.option("--replay", type=_FILE, metavar="RUN", help="Use the answers of this run folder, and ask no model."),
    click.option("--model-config", "config", type=_FILE, metavar="FILE", help="How the model is asked (YAML)."),
    click.option(
        "--base-url", metavar="URL", help="OpenAI-compatible endpoint.  [default: $OPENAI_BASE_URL, else OpenAI's]"
    ),
    click.option("--temperature", type=click.FloatRange(0, 2), help="Temperature of the model's answers."),
    click.option(
        "--budget",
        type=click.FloatRange(0, min_open=True),
        metavar="USD",
        help="Largest cost of the model's answers; needs both prices.",
    ),
    click.option("--price-in", type=click.FloatRange(0), metavar="USD", help="Price of a million tokens of questions."),
    click.option("--price-out", type=click.FloatRange(0), metavar="USD", help="Price of a million tokens of answers."),
    click.option("--concurrency", type=options.count(64), help="Questions under way at once.  [default: 4]"),
)

#: Of these, those that mean something to the offline designer.
_FOR_ALL = ("mode", "review")
_ASKING = ("mode", "trials", "max_rounds", "visual", "code")

NAMES = (
    *_ASKING, "review", "prompts", "replay", "config", "base_url", "temperature", "budget", "price_in",
    "price_out", "concurrency",
)  # fmt: skip
"""Parameters of the options."""


def designer_options(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command the options of who designs; it takes them by the names in ``NAMES``."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def designer_of_command(
    designer: str | None,
    target_task: str | None,
    target_object: str | None,
    scene: SceneOptions,
    asked: dict[str, Any],
) -> tuple[Designer, str | None]:
    """The designer that the options stand for, and the task of the library that is to be designed anew.

    Raises:
        InputError: an option cannot be used, or means nothing to this designer.
        MissingExtraError: the extra ``llm`` is not installed.
    """
    from gensim2.core.errors import InputError
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
                raise InputError("means nothing to the offline designer", field=flag, remedy="give --designer MODEL")
        if asked["mode"] == "topdown":
            raise InputError("needs a language model", field="--mode topdown", remedy="give --designer MODEL")
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
    """Refuse a class that there is not, before anything is looked at or a model is asked.

    Raises:
        InputError: there is no such class, or the task is given, too.
    """
    from gensim2.core.errors import InputError, near
    from gensim2.objects import open_library
    from gensim2.tasks.library import task_names

    if target_task in task_names():
        raise InputError("is of no use beside a task that is there", field="--target-object", remedy="leave it out")
    library = open_library(scene.assets)
    if target_object not in library.classes():
        message = f"{library.location} has no class {target_object!r}"
        raise InputError(message, field="--target-object", remedy=near(target_object, library.classes()))


def _check_terminal() -> None:
    """Refuse to ask a person whom no terminal reaches: that is an error, not a no.

    Raises:
        InputError: standard input is no terminal.
    """
    import sys

    from gensim2.core.errors import InputError

    if not sys.stdin.isatty():
        raise InputError("standard input is no terminal, so no one can be asked", field="--review")


def _confirmed(task: TaskSpec) -> bool:
    """Ask the person at the terminal."""
    from gensim2.tasks.wording import criteria_in_words

    steps = "; ".join(step.name for step in task.steps)
    click.echo(
        f"\n{task.name}: {task.description}\n  steps: {steps}\n  goal: {criteria_in_words(task.success)}", err=True
    )
    return click.confirm("Design it?", default=True, err=True)
