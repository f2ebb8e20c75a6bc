"""Prompts: one template a file in ``prompts/`` (jinja2), and the bank of good and bad tasks beside them.

A folder of one's own may hold files of the same names, which take the place of ours.
"""

from __future__ import annotations

import hashlib
import json
from functools import cached_property
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jinja2
import jinja2.sandbox
import yaml
from jinja2 import Template

from gensim2.core.errors import InputError, near
from gensim2.core.special_files import is_special
from gensim2.core.yaml_files import parse_yaml

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable


import math

from gensim2.design.affordance import Affordance
from gensim2.tasks.spec import TaskSpec


def motion(thing: Affordance) -> str:
    """Describe the motion of its joint: ``"a hinge of 110°"``."""
    if thing.joint_type is None or thing.joint_range is None:
        return "rigid"
    low, high = thing.joint_range
    if thing.joint_type == "revolute":
        return f"a hinge of {math.degrees(high - low):.0f}°"
    return f"a slide of {100 * (high - low):.0f} cm"


def size(thing: Affordance) -> str:
    """Its extents as it stands."""
    depth, width, height = (100 * value for value in thing.size)
    return f"{depth:.0f} x {width:.0f} x {height:.0f} cm (deep, wide, high)"


def known_task(task: TaskSpec) -> str:
    """A task that is there, in one line."""
    classes = ", ".join(dict.fromkeys(thing.asset_class for thing in task.objects.values()))
    goal = ", ".join(criterion.type for criterion in task.success)
    return f"{task.name}: {task.description} ({classes}; {goal})"


SUFFIX = ".md.j2"
BANK = "tasks.yaml"

#: What expressions of a template raise beside jinja2's own errors.
_OF_ITS_OWN = (ArithmeticError, AttributeError, LookupError, MemoryError, RecursionError, TypeError, ValueError)

#: Characters of the longest text out of an object's files that goes into a prompt.
LONGEST_QUOTE = 300


class Prompts:
    """The templates of all stages.

    Args:
        folder: with files that take the place of the package's; None: there is none.

    Raises:
        InputError: the folder is none, or a file in it has a name that no prompt has, or cannot be read.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._texts = _texts(files("gensim2.design.llm") / "prompts")
        if folder is not None:
            self._texts.update(_own(folder, set(self._texts)))
        self._environment = jinja2.sandbox.SandboxedEnvironment(
            loader=jinja2.DictLoader(self._texts),
            undefined=jinja2.StrictUndefined,
            trim_blocks=True,
            lstrip_blocks=True,
            keep_trailing_newline=True,
            autoescape=False,
        )
        self._environment.filters["quoted"] = quoted
        self._environment.filters.update(yaml=as_yaml, motion=motion, size=size)
        self._folder = folder

    @cached_property
    def digest(self) -> str:
        """Of all texts."""
        return hashlib.sha256(json.dumps(self._texts, sort_keys=True).encode()).hexdigest()[:16]

    @cached_property
    def bank(self) -> dict[str, Any]:
        """Good and bad tasks, each with its reason."""
        return parse_yaml(self._texts[BANK].encode(), BANK)

    def text(self, prompt: str, /, **values: Any) -> str:
        """A prompt with its values filled in.

        Raises:
            InputError: the template cannot be filled in; possible only with one of the user's own.
        """
        try:
            template: Template = self._environment.get_template(prompt + SUFFIX)
            return template.render(**values).strip() + "\n"
        except (jinja2.TemplateError, *_OF_ITS_OWN) as error:
            file = (self._folder or Path("prompts")) / (prompt + SUFFIX)
            raise InputError(f"cannot be filled in: {str(error) or type(error).__name__}", file=file) from error


def quoted(text: str) -> str:
    """Words out of an object's files as one line of quoted data: whatever they say, they end where the quote ends."""
    line = " ".join(text.split())
    line = line if len(line) <= LONGEST_QUOTE else f"{line[:LONGEST_QUOTE]} ..."
    return json.dumps(line, ensure_ascii=True).replace("`", "'").replace("<", "(").replace(">", ")")


def as_yaml(value: Any) -> str:
    """Plain data as YAML."""
    return yaml.safe_dump(value, sort_keys=False, default_flow_style=None, width=100, allow_unicode=True).strip()


def _texts(folder: Traversable) -> dict[str, str]:
    return {
        entry.name: entry.read_text(encoding="utf-8")
        for entry in sorted(folder.iterdir(), key=lambda entry: entry.name)
        if entry.name.endswith(SUFFIX) or entry.name == BANK
    }


def _own(folder: Path, known: set[str]) -> dict[str, str]:
    if not folder.is_dir():
        raise InputError("is no folder", file=folder, field="prompts")
    found: dict[str, str] = {}
    for path in sorted(folder.iterdir()):
        if path.name.startswith(".") or path.name == "README.md":
            continue
        if path.name not in known:
            raise InputError("is no prompt", file=path, remedy=near(path.name, sorted(known)))
        try:
            if is_special(path):
                raise InputError("is not a regular file", file=path)
            found[path.name] = path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"cannot read: {error}", file=path) from error
    return found
