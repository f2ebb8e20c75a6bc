"""Draft long tasks about containers: put one or two objects away, take one out, or move one between containers."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from functools import partial

from gensim2.design.affordance import Affordance
from gensim2.design.base import Brief
from gensim2.design.drafting import (
    ABOUT,
    ALIKE,
    BESIDE,
    CLOSE_ABOUT,
    OTHER_SIDE,
    PAIRED,
    Draft,
    Family,
    in_turn,
    is_known,
)
from gensim2.design.proposals import OPEN_AT, SHUT_AT, holdable, role_of
from gensim2.design.serving import SUPPORTS, on_it
from gensim2.objects.words import belongs, camel_case
from gensim2.tasks.criteria import ArticulatedClosed, ArticulatedOpen, DistanceArticulatedRigid
from gensim2.tasks.spec import ObjectSpec, Place, Randomization

#: Variants of putting an object away: task name, instruction, and whether the task opens the container first.
_TIDYING = {
    "stow": ("Stow{thing}In{box}", "open the {box}, put the {thing} in and close it again", True),
    "put": ("Put{thing}In{box}", "open the {box} and put the {thing} in", True),
    "shut": ("Put{thing}AwayIn{box}", "put the {thing} into the open {box} and close it", False),
    "drop": ("Drop{thing}Into{box}", "put the {thing} into the open {box}", False),
}
CLOSED_AFTER = ("stow", "shut")

#: Maximum width (m) of a container that leaves space on the table for a second container beside it.
NARROW = 0.36

#: Containers longer than this (m) get only one object, because they have a shelf or a turntable inside.
LARGE = 0.34


def tidied(brief: Brief, how: str) -> Iterator[Draft]:
    """Draft tasks that put an object into a container.

    Args:
        brief: classes and tasks that the drafts may use.
        how: key of ``_TIDYING``, which determines whether the task first opens the container and closes it at the end.
    """
    # Each value of ``how`` starts with a different object, so that the drafts together use more objects.
    turn = list(_TIDYING).index(how)
    queues = []
    for container in _containers(brief):
        things = _things(brief, container.asset_class)
        first = turn % max(len(things), 1)
        queues.append([(container, thing) for thing in [*things[first:], *things[:first]][:ALIKE]])
    for container, thing in in_turn(queues):
        name = container.asset_class
        opens, shuts = _TIDYING[how][2], how in CLOSED_AFTER
        if (opens and not is_known(brief, name, "articulated_open")) or (
            shuts and not is_known(brief, name, "articulated_closed")
        ):
            continue
        draft = _named(*_TIDYING[how][:2], container, thing)
        box, role = role_of(container.noun), role_of(thing.noun)
        draft.objects = {
            box: ObjectSpec(asset_class=name, randomization=_about() if opens else _about(OPEN_AT)),
            role: ObjectSpec(asset_class=thing.asset_class, place=Place(at=BESIDE), randomization=ABOUT),
        }
        if opens:
            draft.joint("open", box, ArticulatedOpen(object=box), lasting=False)
        draft.grasp(role)
        draft.put("put", role, box, DistanceArticulatedRigid(articulated=box, rigid=role))
        if shuts:
            draft.joint("close", box, ArticulatedClosed(object=box))
        yield draft


def filled(brief: Brief, shuts: bool) -> Iterator[Draft]:
    """Draft tasks that put two objects into an open container and close it if ``shuts``."""
    queues = []
    for container in _containers(brief):
        known = not shuts or is_known(brief, container.asset_class, "articulated_closed")
        if not known or max(container.size) > LARGE:
            continue
        things = [thing for thing in _things(brief, container.asset_class) if max(thing.size) < 0.1]
        groups = list(zip(things[::2], things[1::2], strict=False))
        queues.append([(container, group) for group in (groups if shuts else groups[::-1])[:1]])
    for container, (one, other) in in_turn(queues):
        box, the = role_of(container.noun), container.noun
        name = f"{camel_case(one.noun)}And{camel_case(other.noun)}"
        sentence = f"put the {one.noun} and the {other.noun} into the open {the}"
        draft = Draft(
            f"Put{name}AwayIn{camel_case(the)}" if shuts else f"Collect{name}In{camel_case(the)}",
            f"{sentence} and close it" if shuts else sentence,
            {box: ObjectSpec(asset_class=container.asset_class, randomization=_about(OPEN_AT))},
        )
        for thing, at in ((one, BESIDE), (other, OTHER_SIDE)):
            role = role_of(thing.noun)
            draft.objects[role] = ObjectSpec(
                asset_class=thing.asset_class, place=Place(at=at), randomization=CLOSE_ABOUT
            )
            draft.grasp(role)
            draft.put("put", role, box, DistanceArticulatedRigid(articulated=box, rigid=role))
        if shuts:
            draft.joint("close", box, ArticulatedClosed(object=box))
        yield draft


def taken_out(brief: Brief, opens: bool, shuts: bool) -> Iterator[Draft]:
    """Draft tasks that take an object out of a container and put it on a plate or into a bowl."""
    name, sentence = {
        (False, False): ("Take{thing}OutOf{box}", "take the {thing} out of the {box} and put it {into} the {support}"),
        (False, True): (
            "Fetch{thing}From{box}",
            "take the {thing} out of the {box}, put it {into} the {support} and close the {box}",
        ),
        (True, False): ("Get{thing}OutOf{box}", "open the {box}, take the {thing} out and put it {into} the {support}"),
    }[opens, shuts]
    queues = []
    for container in _roomy(brief):
        needed = [goal for goal, need in (("articulated_open", opens), ("articulated_closed", shuts)) if need]
        if all(is_known(brief, container.asset_class, goal) for goal in needed):
            queues.append([(container, thing) for thing in _things(brief, container.asset_class)[:ALIKE]])
    for number, (container, thing) in enumerate(in_turn(queues)):
        support = brief.classes.get(_support_for(thing, number))
        if support is None or max(thing.size[:2]) > 0.6 * min(support.size[:2]):
            continue
        box, role, below = role_of(container.noun), role_of(thing.noun), role_of(support.noun)
        into = "into" if support.asset_class == "bowl" else "on"
        draft = _named(name, sentence, container, thing, into=into, support=support.noun)
        draft.objects = {
            box: ObjectSpec(asset_class=container.asset_class, randomization=_about(SHUT_AT if opens else OPEN_AT)),
            role: _inside(thing, box),
            below: ObjectSpec(asset_class=support.asset_class, place=Place(at=BESIDE), randomization=CLOSE_ABOUT),
        }
        if opens:
            draft.joint("open", box, ArticulatedOpen(object=box), lasting=False)
        draft.grasp(role)
        draft.put("put", role, below, on_it(support, thing, role, below))
        if shuts:
            draft.joint("close", box, ArticulatedClosed(object=box))
        yield draft


def moved_over(brief: Brief, shuts: bool) -> Iterator[Draft]:
    """Draft tasks that move an object between two open containers, and close the first container if ``shuts``."""
    narrow = [each for each in _containers(brief) if max(each.size[:2]) < NARROW]
    queues = []
    for source, target in itertools.permutations(narrow, 2):
        if source not in _roomy(brief):
            continue
        if shuts and not is_known(brief, source.asset_class, "articulated_closed"):
            continue
        kept = set(belongs(source.asset_class))
        things = [thing for thing in _things(brief, target.asset_class) if thing.asset_class in kept]
        queues.append([(source, target, thing) for thing in things[:ALIKE]])
    for source, target, thing in in_turn(queues):
        first, second, role = role_of(source.noun), role_of(target.noun), role_of(thing.noun)
        comma, end = (",", f" and close the {source.noun}") if shuts else (" and", "")
        draft = Draft(
            f"Move{camel_case(thing.noun)}From{camel_case(source.noun)}To{camel_case(target.noun)}"
            + ("AndCloseIt" if shuts else ""),
            f"take the {thing.noun} out of the {source.noun}{comma} put it into the {target.noun}{end}",
        )
        for box, where, (at, yaw) in zip((first, second), (source, target), PAIRED, strict=True):
            about = Randomization(
                x=(-0.04, 0.04), y=(-0.04, 0.04), yaw=0.15, openness_mean=OPEN_AT[0], openness_spread=OPEN_AT[1]
            )
            draft.objects[box] = ObjectSpec(
                asset_class=where.asset_class, place=Place(at=at, yaw=yaw), randomization=about
            )
        draft.objects[role] = _inside(thing, first)
        draft.grasp(role)
        draft.put("put", role, second, DistanceArticulatedRigid(articulated=second, rigid=role))
        if shuts:
            draft.joint("close", first, ArticulatedClosed(object=first))
        yield draft


FAMILIES: dict[str, Family] = {
    "stow": partial(tidied, how="stow"),
    "put": partial(tidied, how="put"),
    "shut": partial(tidied, how="shut"),
    "drop": partial(tidied, how="drop"),
    "fill and close": partial(filled, shuts=True),
    "fill": partial(filled, shuts=False),
    "take out": partial(taken_out, opens=False, shuts=False),
    "take out and close": partial(taken_out, opens=False, shuts=True),
    "open and take out": partial(taken_out, opens=True, shuts=False),
    "move over": partial(moved_over, shuts=False),
    "move over and close": partial(moved_over, shuts=True),
}


def _named(name: str, sentence: str, container: Affordance, thing: Affordance, **more: str) -> Draft:
    return Draft(
        name.format(box=camel_case(container.noun), thing=camel_case(thing.noun)),
        sentence.format(box=container.noun, thing=thing.noun, **more),
    )


def _support_for(thing: Affordance, number: int) -> str:
    """Return the support (plate or bowl) that suits an object; if both or neither suit, alternate with ``number``."""
    places = [name for name in SUPPORTS if thing.asset_class in belongs(name)] or SUPPORTS
    return places[number % len(places)]


def _about(openness: tuple[float, float] | None = None) -> Randomization:
    """Return the ranges of a container's position and ``openness`` (mean and spread).

    None stands for its default openness.
    """
    if openness is None:
        return Randomization(x=(-0.05, 0.05), y=(0.0, 0.05))
    return Randomization(x=(-0.05, 0.05), y=(0.0, 0.05), openness_mean=openness[0], openness_spread=openness[1])


def _inside(thing: Affordance, box: str) -> ObjectSpec:
    little = Randomization(x=(-0.01, 0.01), y=(-0.01, 0.01))
    return ObjectSpec(asset_class=thing.asset_class, place=Place(on=box), randomization=little)


def _containers(brief: Brief) -> Iterator[Affordance]:
    yield from (thing for thing in brief.classes.values() if thing.is_container)


def _roomy(brief: Brief) -> list[Affordance]:
    """Return containers in which an object can start without touching a wall: drawers and top-opening boxes."""
    return [each for each in _containers(brief) if each.joint_type == "prismatic" or each.joint_axis == "level"]


def _things(brief: Brief, asset_class: str) -> list[Affordance]:
    """Return the graspable rigid objects that people keep in containers of this class."""
    found = [brief.classes[name] for name in belongs(asset_class) if name in brief.classes]
    return [thing for thing in found if holdable(thing, brief.settings.stroke)]
