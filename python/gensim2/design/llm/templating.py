"""Load and fill in the prompt templates (jinja2 files in ``prompts/``) and the bank of example tasks.

A file in the user's folder replaces the package's file of the same name.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from functools import cached_property
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jinja2
import jinja2.sandbox
import numpy as np
import yaml
from jinja2 import Template

from gensim2.core.errors import InputError, near
from gensim2.core.foreign.tree import read_input
from gensim2.core.yaml_files import parse_yaml
from gensim2.design.affordance import Affordance, KeypointFacts
from gensim2.objects.words import End, words
from gensim2.tasks.library import task_names
from gensim2.tasks.spec import ObjectSpec, TaskSpec
from gensim2.tasks.wording import place_in_words

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable


def motion(thing: Affordance) -> str:
    """Return the joint's motion in words, such as ``"a hinge of 110° about a vertical axis"``."""
    if thing.joint_type is None or thing.joint_range is None:
        return "rigid"
    low, high = thing.joint_range
    if thing.joint_type == "revolute":
        return f"a hinge of {math.degrees(high - low):.0f}° about a {thing.joint_axis} axis"
    return f"a {thing.joint_axis} slide of {100 * (high - low):.0f} cm"


def hinge(thing: Affordance) -> str:
    """Describe the direction of the axis of a hinge in the default placement.

    The description is empty if the object has no hinge.
    """
    if thing.hinge_axes is None:
        return ""
    mean = np.mean(thing.hinge_axes, axis=0)
    if np.linalg.norm(mean) < SAME_WAY:
        return "; the hinge's axis has opposite directions in different instances"
    x, y, z = (float(value) + 0.0 for value in np.round(mean / np.linalg.norm(mean), 2))
    return f"; the hinge's axis points along ({x:.2f}, {y:.2f}, {z:.2f})"


def reached(thing: Affordance, goal: End) -> str:
    """Return the quoted instruction that moves the joint to one end of its range, such as ``"open the drawer"``."""
    return quoted(words(thing.asset_class, goal, thing.joint_type or "revolute").sentence)


def place(thing: Affordance) -> str:
    """Describe where other objects can be put in or on an articulated object, with the free space there."""
    if thing.place is None:
        return "no place for another object"
    room = ""
    if thing.interior is not None:
        depth, width, height = (100 * value for value in thing.interior)
        room = f", with {depth:.0f} x {width:.0f} x {height:.0f} cm of free space (deep, wide, high)"
    return f"an object can be put at {quoted(thing.keypoints[thing.place])}{room}"


def at(thing: Affordance, name: str, geometry: Mapping[str, KeypointFacts]) -> str:
    """Return a phrase that describes one keypoint; a prompt adds the phrase to the keypoint's name.

    The phrase states the position of the keypoint, the size of its part, and the direction in which it moves as the
    joint opens.
    """
    facts = geometry.get(name)
    if facts is None:
        return ""
    x, y, z = facts.position
    depth, width, height = (100 * value for value in facts.part)
    said = (
        f", at ({x:.2f}, {y:.2f}, {z:.2f}) m, on a convex part of {depth:.0f} x {width:.0f} x {height:.0f} cm (x, y, z)"
    )
    if name not in thing.lever_arms:
        return f"{said}, which stands still"
    if thing.lever_arms[name]:
        said += f", {100 * thing.lever_arms[name]:.0f} cm from the hinge"
    if facts.opening is not None:
        said += ", moves along ({:.2f}, {:.2f}, {:.2f}) as the joint opens".format(*facts.opening)
    return said


def shift(spec: ObjectSpec) -> str:
    """Describe the random placement of an object, as the end of a sentence that begins "shifts it by up to".

    An example is "3 cm along x and y, and turns it by up to 11 degrees".
    """
    drawn = spec.randomization
    farthest = max(abs(value) for value in (*drawn.x, *drawn.y))
    return f"{100 * farthest:.0f} cm along x and y, and turns it by up to {math.degrees(abs(drawn.yaw)):.0f} degrees"


def size(thing: Affordance) -> str:
    """Return the object's extents in words."""
    depth, width, height = (100 * value for value in thing.size)
    return f"{depth:.0f} x {width:.0f} x {height:.0f} cm (deep, wide, high)"


def known_task(task: TaskSpec) -> str:
    """Return one line that describes a known task."""
    classes = ", ".join(dict.fromkeys(thing.asset_class for thing in task.objects.values()))
    goal = ", ".join(criterion.type for criterion in task.success)
    return f"{task.name}: {task.description} ({classes}; {goal})"


#: The hinge axes of a class are similar if the mean of their unit vectors is at least this long.
SAME_WAY = 0.9

SUFFIX = ".md.j2"
BANK = "tasks.yaml"

#: Exceptions that the expressions of a template can raise, in addition to the exceptions of jinja2.
_OF_ITS_OWN = (ArithmeticError, AttributeError, LookupError, MemoryError, RecursionError, TypeError, ValueError)

#: Maximum number of characters quoted from an object's files in a prompt.
LONGEST_QUOTE = 300

#: Maximum size of a prompt file in bytes.
MAX_PROMPT = 2**20


class Prompts:
    """Prompt templates of all stages.

    Args:
        folder: the user's folder, whose files replace files of the package; None: no folder.

    Raises:
        InputError: the folder is missing, a file in it is unreadable, or a file does not have the name of a prompt.
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
        self._environment.filters.update(
            yaml=as_yaml,
            json=as_json,
            motion=motion,
            hinge=hinge,
            size=size,
            reached=reached,
            place=place,
            at=at,
            shift=shift,
            placement=place_in_words,
        )
        self._folder = folder

    @cached_property
    def digest(self) -> str:
        """Digest of all templates and example tasks."""
        return hashlib.sha256(json.dumps(self._texts, sort_keys=True).encode()).hexdigest()[:16]

    @cached_property
    def bank(self) -> dict[str, Any]:
        """Examples of good and bad tasks, each with its reason."""
        return parse_yaml(self._texts[BANK].encode(), BANK)

    def good_tasks(self, long: bool) -> list[str]:
        """Return the names of good example tasks of the library.

        With ``long`` they are long tasks, otherwise single-step tasks.
        """
        kebab = [str(each["task-name"]) for each in self.bank["long" if long else "single"]]
        names = ["".join(map(str.capitalize, each.split("-"))) for each in kebab]
        return [name for name in names if name in task_names()]

    def text(self, prompt: str, /, **values: Any) -> str:
        """Fill in a prompt template and return the prompt.

        Raises:
            InputError: a template from the user's folder cannot be filled in.
        """
        try:
            template: Template = self._environment.get_template(prompt + SUFFIX)
            return template.render(**values).strip() + "\n"
        except (jinja2.TemplateError, *_OF_ITS_OWN) as error:
            file = (self._folder or Path("prompts")) / (prompt + SUFFIX)
            wrong = f"the template cannot be filled in: {str(error) or type(error).__name__}"
            raise InputError(wrong, file=file) from error


def quoted(text: str) -> str:
    """Quote a text from an object's files on one line, with escapes, so that the text cannot end the quotation."""
    line = " ".join(text.split())
    line = line if len(line) <= LONGEST_QUOTE else f"{line[:LONGEST_QUOTE]} ..."
    return json.dumps(line, ensure_ascii=True).replace("`", "'").replace("<", "(").replace(">", ")")


def as_yaml(value: Any) -> str:
    """Format plain data as YAML."""
    return yaml.safe_dump(value, sort_keys=False, default_flow_style=None, width=100, allow_unicode=True).strip()


def as_json(value: dict[str, Any]) -> str:
    """Format a config as JSON, with each field, and each entry of a list of objects, on a line of its own."""
    lines = []
    for name, given in value.items():
        if isinstance(given, list) and any(isinstance(each, dict) for each in given):
            entries = ",\n  ".join(json.dumps(each, ensure_ascii=False) for each in given)
            lines.append(f"{json.dumps(name)}: [\n  {entries}]")
        else:
            lines.append(f"{json.dumps(name)}: {json.dumps(given, ensure_ascii=False)}")
    return "{" + ",\n".join(lines) + "}"


def _texts(folder: Traversable) -> dict[str, str]:
    return {
        entry.name: entry.read_text(encoding="utf-8")
        for entry in sorted(folder.iterdir(), key=lambda entry: entry.name)
        if entry.name.endswith(SUFFIX) or entry.name == BANK
    }


def _own(folder: Path, known: set[str]) -> dict[str, str]:
    if not folder.is_dir():
        raise InputError("the path is not a folder", file=folder, field="prompts")
    found: dict[str, str] = {}
    for path in sorted(folder.iterdir()):
        if path.name.startswith(".") or path.name == "README.md":
            continue
        if path.name not in known:
            wrong = "the file does not have the name of a prompt"
            raise InputError(wrong, file=path, remedy=near(path.name, sorted(known)))
        try:
            found[path.name] = read_input(path, MAX_PROMPT).decode()
        except UnicodeDecodeError as error:
            raise InputError(f"cannot read: {error}", file=path) from error
    return found
