"""Free mode: ask for a whole task with its objects, steps and criteria, without restricting its form."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError

from gensim2.core.validation import input_error
from gensim2.design.llm.catalog import NAMED_SCHEMA, Catalog, name_of, sentence_of
from gensim2.design.llm.conversations import Ask, Wrong
from gensim2.design.llm.extraction import Data
from gensim2.design.llm.specs import STEPS_A_STEP
from gensim2.design.llm.stages.decomposition import GRASP
from gensim2.design.llm.stages.proposal import Wish, kebab
from gensim2.design.llm.templating import Prompts
from gensim2.tasks.likeness import first_alike
from gensim2.tasks.spec import HAND, TABLE, TaskSpec

MAX_OBJECTS, MAX_STEPS = 4, 8

#: Fields of a success criterion that name an object, and the kind of object that each field must name.
_ROLES = {"object": "articulated", "articulated": "articulated", "rigid": "rigid", "support": "rigid"}

#: Random ranges of position (m) and yaw (rad) of an object in a task with several objects.
_CLOSE = {"x": [-0.03, 0.03], "y": [-0.03, 0.03], "yaw": 0.2}

#: Random ranges of position (m) and yaw (rad) of an object that starts in or on another object, where space is limited.
_WITHIN = {"x": [-0.01, 0.01], "y": [-0.01, 0.01], "yaw": 0.2}

_CRITERIA = {
    "type": "array",
    "items": {"type": "object", "properties": {"type": {"type": "string"}}, "required": ["type"]},
}

SCHEMA: dict[str, Any] = {
    "type": "object",
    "properties": {
        **NAMED_SCHEMA,
        "objects": {"type": "object", "additionalProperties": {"type": "object"}},
        "steps": {
            "type": "array",
            "items": {
                "type": "object",
                "properties": {
                    "name": {"type": "string"},
                    "description": {"type": "string"},
                    "object": {"type": "string"},
                    "tool": {"type": "string"},
                    "done": _CRITERIA,
                },
                "required": ["name", "description", "object"],
            },
        },
        "goal": _CRITERIA,
    },
    "required": ["task-name", "task-description", "objects", "steps", "goal"],
}


@dataclass(frozen=True)
class WholeTask:
    """A whole task, and the sentences with which the model describes its steps, by step name."""

    task: TaskSpec
    sentences: Mapping[str, str]


def whole_task(
    prompts: Prompts,
    catalog: Catalog,
    good: Sequence[TaskSpec],
    wish: Wish,
    refused: Sequence[str],
    number: int,
    origin: str,
) -> Ask[WholeTask]:
    """Return the question for a whole task; ``good`` are the tasks that the prompt shows as examples."""
    text = prompts.text(
        "free",
        **catalog.for_prompts(),
        good=[as_answer(task) for task in good],
        target_task=wish.task,
        target_object=wish.object,
        refused=list(refused),
        max_objects=MAX_OBJECTS,
        max_steps=MAX_STEPS,
    )
    about = f"proposal {number + 1}"
    return Ask(
        "free", "", about, text, SCHEMA, lambda data: read_whole_task(data, catalog, wish, good, origin), sample=number
    )


def as_answer(task: TaskSpec) -> dict[str, Any]:
    """Return a stored task in the format of the model's answers. The names of its steps serve as descriptions."""
    objects: dict[str, Any] = {}
    for name, thing in task.objects.items():
        objects[name] = {"class": thing.asset_class}
        if thing.place.at is not None:
            objects[name]["at"] = list(thing.place.at)
        if thing.place.on != TABLE:
            objects[name]["on"] = thing.place.on
        if thing.randomization.openness_mean is not None:
            objects[name]["openness"] = thing.randomization.openness_mean
    steps = [
        {
            "name": step.name,
            "description": step.name.replace("_", " "),
            "object": step.object,
            "tool": step.tool,
            "done": [criterion.model_dump(mode="json") for criterion in step.done],
        }
        for step in task.steps
    ]
    goal = [criterion.model_dump(mode="json") for criterion in task.success]
    return {
        "task-name": kebab(task.name),
        "task-description": task.description,
        "objects": objects,
        "steps": steps,
        "goal": goal,
    }


def read_whole_task(
    data: Sequence[Data], catalog: Catalog, wish: Wish, good: Sequence[TaskSpec], origin: str
) -> WholeTask:
    """Return the task in an answer.

    Args:
        data: mappings in the answer.
        catalog: robot, objects and known tasks.
        wish: restrictions on the task.
        good: good examples of the prompt, which the task must not repeat.
        origin: name of the designer.

    Raises:
        Wrong: the task breaks rules; the message names all of them.
    """
    given = next((each for each in reversed(data) if "objects" in each and "steps" in each), None)
    if given is None:
        raise Wrong(
            ['there is no JSON object with the keys "task-name", "task-description", "objects", "steps", "goal"']
        )
    problems: list[str] = []
    known = () if wish.task is not None else catalog.known
    name = name_of(given.get("task-name") if wish.task is None else kebab(wish.task), problems, known)
    sentence = sentence_of(given.get("task-description"), problems)
    objects = _objects(given["objects"], catalog, wish, problems)
    steps, sentences = _steps(given["steps"], objects, catalog, problems)
    goal = given.get("goal")
    for where, criteria in (("goal", goal), *((f"steps.{each.get('name')}.done", each["done"]) for each in steps)):
        _check_criteria(where, criteria, objects, catalog, problems)
    if problems:
        raise Wrong(problems)
    try:
        task = TaskSpec.model_validate(
            {
                "name": name,
                "description": sentence,
                "objects": objects,
                "steps": steps,
                "goal": goal,
                "max_episode_steps": max(400, STEPS_A_STEP * len(steps)),
                "provenance": {"origin": origin[:100]},
            }
        )
    except ValidationError as error:
        raise Wrong([str(input_error(error))]) from error
    if wish.task is None and (same := first_alike(task, [*catalog.known, *good])) is not None:
        raise Wrong([f"the task {same[0].name} is the same; propose another object or another goal"])
    return WholeTask(task, sentences)


def _objects(given: Any, catalog: Catalog, wish: Wish, problems: list[str]) -> dict[str, Any]:
    if not isinstance(given, dict) or not 1 <= len(given) <= MAX_OBJECTS:
        raise Wrong([f'"objects" must be an object with 1 to {MAX_OBJECTS} names'])
    found: dict[str, Any] = {}
    for name, fields in given.items():
        asset_class = fields.get("class") if isinstance(fields, dict) else None
        if asset_class not in catalog.articulated and asset_class not in catalog.rigid:
            problems.append(f"objects.{name}: {catalog.unknown(asset_class)}")
            continue
        if unknown := sorted(fields.keys() - {"class", "at", "on", "openness"}):
            problems.append(f"objects.{name}: there is no field {unknown[0]}; the fields are class, at, on, openness")
        place = {key: fields[key] for key in ("at", "on") if fields.get(key) is not None}
        within = place.get("on", TABLE) != TABLE
        scene = dict(_WITHIN if within else _CLOSE if len(given) > 1 else {})
        if fields.get("openness") is not None:
            scene["openness_mean"] = fields["openness"]
        found[name] = {"class": asset_class, "place": place, "randomization": scene}
        if asset_class in catalog.rigid and not place:
            problems.append(f'objects.{name}: a rigid object needs "at" or "on"')
    if wish.object is not None and wish.object not in {each["class"] for each in found.values()}:
        problems.append(f"the task must use {wish.object}")
    return found


def _steps(
    given: Any, objects: Mapping[str, Any], catalog: Catalog, problems: list[str]
) -> tuple[list[dict[str, Any]], dict[str, str]]:
    """Return the fields and the description of each step. Append a fault for each tool that is not in the hand."""
    if not isinstance(given, list) or not all(isinstance(each, dict) for each in given):
        raise Wrong(['"steps" must be a list of objects'])
    if not 1 <= len(given) <= MAX_STEPS:
        raise Wrong([f'"steps" must be 1 to {MAX_STEPS}, not {len(given)}'])
    found, sentences, held = [], {}, None
    for number, each in enumerate(given):
        name, tool, on = str(each.get("name", "")).replace("-", "_"), each.get("tool") or HAND, each.get("object")
        where = f"steps[{number}]"
        rigid = on in objects and objects[on]["class"] in catalog.rigid
        if name.startswith(GRASP):
            if not rigid or tool != HAND:
                problems.append(f"{where}: a step named {GRASP} picks up a rigid object with the tool {HAND}")
            held = on
        elif tool not in (HAND, held):
            problems.append(f"{where}: the hand does not hold {tool}; a step before must be named {GRASP}_{tool}")
        sentences[name] = sentence_of(each.get("description"), problems, f"{where}.description")
        done = each.get("done") or []
        found.append({"name": name, "object": on, "tool": tool, "strategies": [f"designed_{name}"], "done": done})
    return found, sentences


def _check_criteria(where: str, given: Any, objects: Mapping[str, Any], catalog: Catalog, problems: list[str]) -> None:
    """Append a fault for each criterion about the wrong kind of object or a missing place for objects."""
    if not isinstance(given, list) or not all(isinstance(each, dict) for each in given):
        problems.append(f"{where}: must be a list of criteria")
        return
    for each in given:
        for role, kind in _ROLES.items():
            name = each.get(role)
            if name is None:
                continue
            asset_class = objects.get(name, {}).get("class") if isinstance(name, str) else None
            if asset_class is not None and asset_class not in getattr(catalog, kind):
                problems.append(f"{where}: {name} is no {kind} object, as {each.get('type')} needs")
        if each.get("type") == "distance_articulated_rigidbody":
            asset_class = objects.get(str(each.get("articulated")), {}).get("class")
            if asset_class in catalog.articulated and catalog.articulated[asset_class].place is None:
                problems.append(f"{where}: {asset_class} has no place for an object")
