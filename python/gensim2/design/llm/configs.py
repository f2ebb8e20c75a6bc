"""Validate solver configs that a model wrote: single constraints and complete configs. Configs are data, not code."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import gensim2_kpam as kpam
from gensim2.core.errors import InputError
from gensim2.design.affordance import Affordance
from gensim2.planning.config import ObjectNames, check_strategies
from gensim2.planning.strategies import PLANNER_FIELDS, parse_strategy
from gensim2.robots import RobotProfile
from gensim2.tasks.spec import Step, TaskSpec
from gensim2.tasks.strategies import Strategies

CONSTRAINTS = "constraint_list"
MOTIONS = ("pre_actuation_motions", "post_actuation_motions")
FINGERS = ("gripper", "let_go")

ALLOWED = (CONSTRAINTS, *MOTIONS, *FINGERS, *PLANNER_FIELDS)
"""Fields of a config that a model may write."""

DROPPED = ("task_name", "category_name", "tool_keypoint_name_list", "object_keypoint_name_list")
"""Redundant fields of the paper's configs, which are dropped silently."""

#: Maximum absolute value of a translation (m), a rotation (rad) and an offset (m) in a config.
LONGEST_WAY, WIDEST_TURN, LONGEST_OFFSET = 0.6, 2 * math.pi, 0.3

#: Range of openness that a motion may target.
OPENNESS = (-0.5, 1.5)

MAX_CONSTRAINTS, MAX_MOTIONS = 12, 8

#: Placeholder motion for checking constraints, because the parser refuses configs without a motion.
_ANY_MOTION = {"pre_actuation_motions": [["translate_z", -0.08]]}


def problems_of_constraints(data: Any) -> list[str]:
    """Return the faults of a constraint list; keypoint names are not checked."""
    if not isinstance(data, list) or not data:
        return [f'"{CONSTRAINTS}" must be a list of constraints']
    if len(data) > MAX_CONSTRAINTS:
        return [f'"{CONSTRAINTS}" has more than {MAX_CONSTRAINTS} constraints']
    return [*_problems_of_language({CONSTRAINTS: data, **_ANY_MOTION}), *_odd_offsets(data)]


def problems_of_config(config: Mapping[str, Any]) -> list[str]:
    """Return the faults of a solver config; keypoint names are not checked."""
    unknown = [name for name in config if name not in ALLOWED]
    if unknown:
        return [
            f"there is no field {', '.join(str(name)[:40] for name in unknown)}; the fields are {', '.join(ALLOWED)}"
        ]
    if CONSTRAINTS not in config:
        return [f'the field "{CONSTRAINTS}" is missing']
    return [*problems_of_constraints(config[CONSTRAINTS]), *_problems_of_language(config), *_odd_motions(config)]


def cleaned(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return a config without redundant fields, null values and retreats of zero metres."""
    return {
        name: value
        for name, value in data.items()
        if name not in DROPPED and value is not None and not (name == "let_go" and value == 0)
    }


def problems_of_names(
    task: TaskSpec, step: Step, config: Mapping[str, Any], things: Mapping[str, Affordance], profile: RobotProfile
) -> list[str]:
    """Return the first keypoint of a solver config that neither the tool nor the object has, as a list.

    The list is empty if there is no such keypoint.

    Args:
        task: task that contains the step.
        config: config to check.
        things: facts about each object's class, by the object's name in the task.
    """
    name = step.strategies[0]
    alone = task.model_copy(update={"steps": _until(task, step)})
    ways: Strategies = {each: dict(config) for each in step.strategies}
    for before in alone.steps[:-1]:
        ways.update({each: {"grasp": "antipodal"} for each in before.strategies})
    names = {role: ObjectNames(tuple(thing.keypoints), thing.joint_type) for role, thing in things.items()}
    try:
        check_strategies(alone, {each: parse_strategy(data) for each, data in ways.items()}, names, profile, {name: ""})
    except InputError as error:
        return [f"{error.field}: {error.message}" if error.field else error.message]
    return []


def _until(task: TaskSpec, step: Step) -> tuple[Step, ...]:
    """Return ``step``, preceded by the step that grasps its tool if there is one."""
    before = [each for each in task.steps if each.object == step.tool and each.name != step.name]
    return (*before[:1], step)


def _problems_of_language(config: Mapping[str, Any]) -> list[str]:
    try:
        parse_strategy(config)
    except InputError as error:
        return [f"{error.field}: {error.message}" if error.field else error.message]
    except (kpam.KpamError, TypeError, ValueError, RecursionError) as error:
        return [str(error)[:300]]
    return []


def _odd_offsets(constraints: Sequence[Any]) -> list[str]:
    found = []
    for index, each in enumerate(constraints):
        offset = each.get("target_offset", ()) if isinstance(each, dict) else ()
        numbers = _numbers(offset)
        if numbers and math.hypot(*numbers) > LONGEST_OFFSET:
            found.append(f"{CONSTRAINTS}[{index}].target_offset: is longer than {LONGEST_OFFSET} m")
        tolerance = each.get("tolerance") if isinstance(each, dict) else None
        if isinstance(tolerance, int | float) and tolerance > WIDEST_TURN / 2:
            found.append(f"{CONSTRAINTS}[{index}].tolerance: {tolerance:g} allows anything")
    return found


def _odd_motions(config: Mapping[str, Any]) -> list[str]:
    found = []
    for field in MOTIONS:
        motions = config.get(field, [])
        if not isinstance(motions, list):
            continue  # this motion is invalid and was already reported
        if len(motions) > MAX_MOTIONS:
            found.append(f"{field}: has more than {MAX_MOTIONS} motions")
        for index, motion in enumerate(motions):
            found += [f"{field}[{index}]: {problem}" for problem in _odd_motion(motion)]
    return found


def _odd_motion(motion: Any) -> Iterator[str]:
    if not (isinstance(motion, list) and len(motion) == 2 and isinstance(motion[1], int | float)):
        return
    name, value = str(motion[0]), float(motion[1])
    if name.startswith("translate") and abs(value) > LONGEST_WAY:
        yield f"{value:g} m is further than the arm reaches; numbers are metres, at most {LONGEST_WAY}"
    if name in ("rotate", "follow_joint", "trace_joint") and abs(value) > WIDEST_TURN:
        yield f"{value:g} is no angle in radians"
    if name in ("follow_joint_to", "trace_joint_to") and not OPENNESS[0] <= value <= OPENNESS[1]:
        yield f"{value:g} is no openness; 0 is closed and 1 open"


def _numbers(value: Any) -> list[float]:
    if not isinstance(value, list | tuple):
        return []
    return [float(each) for each in value if isinstance(each, int | float) and not isinstance(each, bool)]
