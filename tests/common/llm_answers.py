"""Answers of a good language model: configs of the library in the formats that the prompts request."""

from __future__ import annotations

import copy
import json
import re
from collections.abc import Sequence
from typing import Any

import yaml
from llm_server import Asked

from gensim2.tasks.library import load_strategies, shared_strategy

#: For each object class and effect of a step, a library task and its strategy for it.
WAYS = {
    ("box_rotate", "open"): ("DropAppleIntoBox", "open_box"),
    ("box_rotate", "close"): ("CloseBox", "close_box"),
    ("drawer", "open"): ("OpenDrawer", "open_drawer_from_inside"),
    ("drawer", "close"): ("PlaceGolfBallIntoDrawer", "close_drawer_from_the_front"),
    ("drawer", "place"): ("PlaceGolfBallIntoDrawer", "place_in_drawer"),
}

MOTION_FIELDS = ("pre_actuation_motions", "post_actuation_motions", "gripper", "let_go", "contact_speed")

BOX = {
    "task-name": "fling-box-open",
    "task-description": "Fling the box open.",
    "assets-used": ["box_rotate"],
    "success-criteria": ["articulated_open"],
}
DRAWER = {
    "task-name": "shove-drawer-shut",
    "task-description": "shove the drawer shut",
    "assets-used": ["drawer"],
    "success-criteria": ["articulated_closed"],
}
LONG = {
    "task-name": "stow-golf-ball",
    "task-description": "open the drawer, lay the golf ball into it and close it",
    "assets-used": ["drawer", "golf_ball"],
    "success-criteria": ["distance_articulated_rigidbody"],
}
SUBTASKS = [
    {
        "task-name": "open-drawer",
        "task-description": "pull the drawer open",
        "assets-used": ["drawer"],
        "success-criteria": ["articulated_open"],
    },
    {"task-name": "grasp"},
    {
        "task-name": "move-ball",
        "task-description": "move the ball into the drawer",
        "assets-used": ["drawer"],
        "success-criteria": ["distance_articulated_rigidbody"],
    },
    {"task-name": "ungrasp"},
    {
        "task-name": "close-drawer",
        "task-description": "push the drawer closed",
        "assets-used": ["drawer"],
        "success-criteria": ["articulated_closed"],
    },
]
COMPOSED = {
    "task-name": "stow-ball-away",
    "task-description": "open the drawer and lay the golf ball into it",
    "steps": [
        {"skill": "OpenDrawer", "object": "drawer"},
        {"skill": "grasp", "object": "golf_ball"},
        {"skill": "place", "object": "golf_ball", "into": "drawer"},
    ],
}


#: A whole task: two articulated objects and a rigid one, with criteria beyond the paper's.
WHOLE = {
    "task-name": "tidy-desk",
    "task-description": "close the box, leave the drawer ajar and put the apple into it",
    "objects": {
        "box": {"class": "box_rotate", "at": [0.0, 0.28], "openness": 0.6},
        "drawer": {"class": "drawer", "at": [0.05, -0.28]},
        "apple": {"class": "apple", "at": [-0.2, 0.0]},
    },
    "steps": [
        {
            "name": "close_box",
            "description": "push the lid of the box down",
            "object": "box",
            "done": [{"type": "articulated_closed", "object": "box"}],
        },
        {
            "name": "open_drawer",
            "description": "pull the drawer out halfway",
            "object": "drawer",
            "tool": "hand",
            "done": [{"type": "articulated_between", "object": "drawer", "low": 0.4, "high": 0.8}],
        },
        {"name": "grasp_apple", "description": "pick up the apple", "object": "apple"},
        {
            "name": "place_apple",
            "description": "lower the apple into the drawer",
            "object": "drawer",
            "tool": "apple",
            "done": [{"type": "distance_articulated_rigidbody", "articulated": "drawer", "rigid": "apple"}],
        },
    ],
    "goal": [
        {"type": "articulated_closed", "object": "box"},
        {"type": "articulated_between", "object": "drawer", "low": 0.4, "high": 0.8},
        {"type": "distance_articulated_rigidbody", "articulated": "drawer", "rigid": "apple"},
    ],
}


def config_for(prompt: str) -> dict[str, Any]:
    """Return a library config for the step in a solver prompt."""
    asset_class = re.findall(r"^The keypoints of `(\w+)`", prompt, re.MULTILINE)[-1]
    (_, step) = re.findall(r'^(".*") \(task `\w+`, step `(\w+)`\)', prompt, re.MULTILINE)[0]
    verb = step.split("_")[0]
    task, strategy = WAYS[asset_class, verb]
    return load_strategies(task)[strategy]


def _call(criterion: dict[str, Any]) -> str:
    """Return a criterion as generated code writes it."""
    given = {name: value for name, value in criterion.items() if name != "type"}
    words = [f"{name}=self.{value}" if isinstance(value, str) else f"{name}={value}" for name, value in given.items()]
    return f"{criterion['type']}({', '.join(words)})"


class GoodModel:
    """A fake model that answers each stage correctly.

    Args:
        proposals: the proposed tasks, in order, with the paper's keys.
    """

    def __init__(self, *proposals: dict[str, Any]) -> None:
        self.proposals: Sequence[dict[str, Any]] = proposals or (BOX, DRAWER)
        self._proposed = 0

    def __call__(self, asked: Asked) -> str:
        return str(getattr(self, asked.stage)(asked))

    def proposal(self, asked: Asked) -> str:
        found = self.proposals[self._proposed % len(self.proposals)]
        self._proposed += 1
        return f"I thought about it. A lid is fun.\n```json\n{json.dumps(found)}\n```\nIs it good?"

    def reflection(self, asked: Asked) -> str:
        return '{"verdict": "good", "reasons": ["clear goal"], "usefulness": 0.9}'

    def decomposition(self, asked: Asked) -> str:
        return json.dumps({"sub-tasks": SUBTASKS})

    def composition(self, asked: Asked) -> str:
        self._proposed += 1
        return json.dumps(COMPOSED)

    def free(self, asked: Asked) -> str:
        self._proposed += 1
        return f"Two containers are new.\n{json.dumps(WHOLE)}"

    def code(self, asked: Asked) -> str:
        name = re.findall(r"^Write the class of the task `(\w+)`", asked.prompt, re.MULTILINE)[0]
        told = yaml.safe_load(asked.prompt.split("## The task")[1].split("## Answer")[0])
        called = {criterion["type"] for step in told["steps"] for criterion in step["done"]}
        objects = [f"        self.{role} = Object({found!r})" for role, found in told["objects"].items()]
        steps = [
            f"        self.step({step['name']!r}, self.{step['object']}"
            + ("" if step["tool"] == "hand" else f", tool=self.{step['tool']}")
            + f", done=[{', '.join(_call(criterion) for criterion in step['done'])}])"
            for step in told["steps"]
        ]
        goal = ", ".join(_call(criterion) for criterion in told["goal"])
        lines = [
            f"from task_code import Object, Task, {', '.join(sorted(called))}",
            f"class {name}(Task):",
            f"    description = {told['description']!r}",
            "    def __init__(self):",
            *objects,
            *steps,
            f"        self.goal({goal})",
        ]
        return "Here it is.\n```python\n" + "\n".join(lines) + "\n```"

    def constraints(self, asked: Asked) -> str:
        return yaml.safe_dump({"constraint_list": config_for(asked.prompt)["constraint_list"]})

    def motions(self, asked: Asked) -> str:
        config = config_for(asked.prompt)
        good = {name: config[name] for name in MOTION_FIELDS if name in config}
        late = {**good, "pre_actuation_motions": [["translate_z", -0.06]]}
        return "```yaml\n" + yaml.safe_dump({"trials": [good, late]}) + "```"

    def regeneration(self, asked: Asked) -> str:
        config = config_for(asked.prompt)
        kept = {name: config[name] for name in ("constraint_list", *MOTION_FIELDS) if name in config}
        return yaml.safe_dump({"configs": [{**kept, "let_go": 0.05}]})


#: Answers of a learner for each step of ``LONG``: the first one, and one for each reported failure.
FIRST = {
    "open": "open_drawer_from_inside",
    "place": "drop_into_drawer_from_above",
    "close": "close_drawer_from_the_front",
}
BETTER = {
    "open": ("open_drawer_over_the_front", "open_drawer_from_deep_inside"),
    "place": ("place_in_drawer_from_the_front", "drop_into_drawer_from_the_front", "place_in_drawer"),
    "close": ("close_drawer_from_the_side",),
}


TOO_DEEP = 0.1
"""Distance (m) by which the first answer places a held object too low, so that every hand pose collides with the
drawer.
"""


class Learner(GoodModel):
    """A fake model that first writes one shared strategy for a step, and others after reported failures."""

    def __init__(self, *proposals: dict[str, Any]) -> None:
        super().__init__(*proposals)
        self._told: dict[str, int] = {}

    def constraints(self, asked: Asked) -> str:
        step = _step(asked)
        constraints = copy.deepcopy(shared_strategy(FIRST[step])["constraint_list"])
        if step == "place":
            constraints[0]["target_offset"][2] -= TOO_DEEP
        return yaml.safe_dump({"constraint_list": constraints})

    def motions(self, asked: Asked) -> str:
        config = shared_strategy(FIRST[_step(asked)])
        return yaml.safe_dump({"trials": [{name: config[name] for name in MOTION_FIELDS if name in config}]})

    def regeneration(self, asked: Asked) -> str:
        step = _step(asked)
        told = self._told[step] = self._told.get(step, 0) + 1
        found = shared_strategy(BETTER[step][min(told, len(BETTER[step])) - 1])
        fields = ("constraint_list", *MOTION_FIELDS)
        return yaml.safe_dump({"configs": [{name: found[name] for name in fields if name in found}]})


def _step(asked: Asked) -> str:
    """Return the name of the step in a solver prompt."""
    return next(name for name in FIRST if f"step `{name}`" in asked.prompt)
