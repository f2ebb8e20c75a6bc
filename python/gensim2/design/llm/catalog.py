"""Collect the robot, the object classes and the tasks that prompts describe and answers may refer to."""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from gensim2.core.errors import InputError
from gensim2.design.affordance import Affordance
from gensim2.design.base import Brief, RobotSummary
from gensim2.design.llm.templating import known_task
from gensim2.tasks.spec import HAND, TABLE, TaskSpec

_KEBAB = re.compile(r"^[a-z][a-z0-9]*(-[a-z0-9]+)*$")
LONGEST_NAME = 60
LONGEST_SENTENCE = 160

NAMED_SCHEMA: dict[str, Any] = {name: {"type": "string"} for name in ("reasoning", "task-name", "task-description")}
"""Properties in the JSON schema of every answer that proposes a task."""


@dataclass(frozen=True)
class Catalog:
    """Facts about the robot, the object classes and the existing tasks that fill in the prompts.

    Attributes:
        settings: facts about the robot.
        articulated, rigid: facts by name of the class. Classes with unreadable objects are left out.
        known: tasks that exist already.
    """

    settings: RobotSummary
    articulated: dict[str, Affordance]
    rigid: dict[str, Affordance]
    known: tuple[TaskSpec, ...]

    @staticmethod
    def of(brief: Brief, articulated_only: bool = False) -> Catalog:
        """Build the catalog from a designer's input. This function is slow, because it loads objects of every class."""
        found: dict[str, Affordance] = {}
        for name in brief.classes:
            try:
                found[name] = brief.classes[name]
            except InputError:
                continue  # the notes of the run already contain the class and the error
            if articulated_only and found[name].kind == "rigid":
                break
        return Catalog(
            brief.settings,
            {name: each for name, each in found.items() if each.kind == "articulated"},
            {name: each for name, each in found.items() if each.kind == "rigid"},
            tuple(known.task for known in brief.known),
        )

    def about(self, *classes: str) -> Catalog:
        """Return the catalog restricted to the given classes."""
        return Catalog(
            self.settings,
            {name: each for name, each in self.articulated.items() if name in classes},
            {name: each for name, each in self.rigid.items() if name in classes},
            self.known,
        )

    def for_prompts(self) -> dict[str, Any]:
        """Return the values that fill in the shared prompt template ``_world``."""
        return {
            "settings": self.settings,
            "articulated": list(self.articulated.values()),
            "rigid": list(self.rigid.values()),
            "known": [known_task(task) for task in self.known],
        }

    def unknown(self, name: object) -> str:
        """Return the message that a class is unknown, with similar names as suggestions."""
        near = difflib.get_close_matches(str(name), [*self.articulated, *self.rigid], n=3)
        return f"there is no object {str(name)[:80]!r}" + (f"; did you mean {', '.join(near)}?" if near else "")


def name_of(kebab: object, problems: list[str], known: Sequence[TaskSpec], field: str = "task-name") -> str:
    """Convert a name such as ``open-safe`` to CamelCase. Append a message if the name is invalid or already exists."""
    text = str(kebab).strip().lower().replace("_", "-").replace(" ", "-")
    if not isinstance(kebab, str) or not _KEBAB.match(text) or len(text) > LONGEST_NAME:
        problems.append(f'"{field}" must be lower-case words joined by hyphens, at most {LONGEST_NAME} characters')
        return ""
    name = "".join(word.capitalize() for word in text.split("-"))
    if name.lower() in {task.name.lower() for task in known}:
        problems.append(f"there is a task {name} already; propose another")
    return name


def sentence_of(text: object, problems: list[str], field: str = "task-description") -> str:
    """Return the text as a sentence in lower-case English letters; append any faults to ``problems``."""
    if not isinstance(text, str) or not text.strip():
        problems.append(f'"{field}" must be a sentence')
        return ""
    found = " ".join(text.split()).rstrip(".")
    if not (found.isascii() and found.isprintable()):
        problems.append(f'"{field}" must be in English, in plain letters')
    if len(found) > LONGEST_SENTENCE:
        problems.append(f'"{field}" must be one short sentence, at most {LONGEST_SENTENCE} characters')
    return found[:1].lower() + found[1:]


def role_of(thing: Affordance) -> str:
    """Return the name that an object of a class has in tasks, for example ``washing_machine``."""
    role = re.sub(r"[^a-z0-9]+", "_", thing.noun.lower()).strip("_")[:50]
    return f"the_{role}" if role in (HAND, TABLE) or not role[:1].isalpha() else role
