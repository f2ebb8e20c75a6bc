"""Draft tasks of several steps that move joints.

There are three types: two joints that serve one purpose, such as tidying a desk; a joint and a rigid object that serve
one purpose; and one joint that moves to an end of its range and back.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator

from gensim2.design.base import Brief
from gensim2.design.containers import NARROW
from gensim2.design.drafting import BESIDE, ENDS, PAIRED, Draft, Family, Piece, in_turn, is_known, pieces
from gensim2.design.proposals import holdable, role_of
from gensim2.design.serving import carry, into_it, place_support
from gensim2.objects.words import Purpose, camel_case, noun, purposes, to_and_fro
from gensim2.tasks.criteria import ArticulatedClosed, ArticulatedOpen
from gensim2.tasks.spec import ObjectSpec, Place

#: Maximum number of drafts of long tasks that contain the same single-joint task as a step.
OF_ONE = 3

#: Position (x, y) in metres of a plate or bowl beside an articulated object.
ASIDE = (-0.12, -0.22)


def again(brief: Brief) -> Iterator[Draft]:
    """Draft tasks that switch an object on and off, or open and close it again."""
    for each in to_and_fro():
        if each.asset_class not in brief.classes or not all(is_known(brief, each.asset_class, end) for end in ENDS):
            continue
        role = role_of(brief.classes[each.asset_class].noun)
        draft = Draft(each.name, each.sentence, {role: ObjectSpec(asset_class=each.asset_class)})
        draft.joint(each.there, role, ArticulatedOpen(object=role), lasting=False)
        draft.joint(each.back, role, ArticulatedClosed(object=role))
        yield draft


def pairs(brief: Brief) -> Iterator[Draft]:
    """Draft tasks that move two joints for one purpose. The purposes take turns."""
    there = _narrow(brief)
    choices = list(in_turn(_pairs_for(purpose, there) for purpose in purposes()))
    used: Counter[tuple[str, str]] = Counter()
    told: set[tuple[tuple[str, str], tuple[str, str]]] = set()
    for most in range(OF_ONE):
        for purpose, first, second in choices:
            one, other = first[:2], second[:2]
            if (one, other) not in told and used[one] <= most and used[other] <= most:
                told.update(((one, other), (other, one)))
                used.update((one, other))
                yield _pair(purpose, first, second)


def errands(brief: Brief) -> Iterator[Draft]:
    """Draft tasks that move a joint and then put an object on a plate or into a bowl, both for one purpose."""
    there = {piece[:2]: piece for piece in _narrow(brief)}
    queues = [[(purpose, there[goal], put) for goal, put in purpose.errands if goal in there] for purpose in purposes()]
    used: Counter[tuple[str, str]] = Counter()
    for purpose, piece, (below, thing) in in_turn(queues):
        support, held = brief.classes.get(below), brief.classes.get(thing)
        if support is None or held is None or not holdable(held, brief.settings.stroke) or used[piece[:2]] >= OF_ONE:
            continue
        used[piece[:2]] += 1
        task = piece.known.task
        put = f"put the {held.noun} {into_it(support)} the {support.noun}"
        name = f"{task.name}AndPut{camel_case(held.noun)}{into_it(support).capitalize()}{camel_case(support.noun)}"
        draft = Draft(name, purpose.say.format(f"{task.description} and {put}"))
        _work(draft, piece, *PAIRED[0])
        place_support(draft, support, ASIDE)
        carry(draft, support, held, BESIDE)
        yield draft


FAMILIES: dict[str, Family] = {"pairs": pairs, "to and fro": again, "errands": errands}


def wanted_ends() -> set[tuple[str, str]]:
    """Return the joint goals (object class and end state) that long tasks use as steps."""
    goals = {goal for purpose in purposes() for goal in (*purpose.goals, *(goal for goal, _ in purpose.errands))}
    return goals | {(each.asset_class, end) for each in to_and_fro() for end in ENDS}


def _narrow(brief: Brief) -> list[Piece]:
    """Return the joint tasks whose object is narrow enough to leave space on the table for a second object."""
    return [piece for piece in pieces(brief) if max(brief.classes[piece.asset_class].size[:2]) < NARROW]


def _pairs_for(purpose: Purpose, there: list[Piece]) -> list[tuple[Purpose, Piece, Piece]]:
    known = {piece[:2]: piece for piece in there}
    serving = [known[goal] for goal in purpose.goals if goal in known]
    return [
        (purpose, first, second)
        for first, second in itertools.combinations(serving, 2)
        if noun(first.asset_class) != noun(second.asset_class)
    ]


def _pair(purpose: Purpose, first: Piece, second: Piece) -> Draft:
    tasks = first.known.task, second.known.task
    draft = Draft(f"{tasks[0].name}And{tasks[1].name}", purpose.say.format(_both(first, second)))
    for piece, (at, yaw) in zip((first, second), PAIRED, strict=True):
        _work(draft, piece, at, yaw)
    return draft


def _both(first: Piece, second: Piece) -> str:
    """Join two descriptions. A common verb appears only once, as in "open the drawer and the box"."""
    said = [piece.known.task.description for piece in (first, second)]
    parts = [
        sentence.partition(f" the {noun(piece.asset_class)}")
        for sentence, piece in zip(said, (first, second), strict=True)
    ]
    if parts[0][::2] == parts[1][::2]:
        return f"{parts[0][0]}{parts[0][1]} and{parts[1][1]}{parts[0][2]}"
    return " and ".join(said)


def _work(draft: Draft, piece: Piece, at: tuple[float, float], yaw: float) -> None:
    """Add the object and the step of the joint task ``piece`` to a draft.

    The pose is ``at`` (x, y in m) and ``yaw`` (rad).
    """
    (step,) = piece.known.task.steps
    thing = piece.known.task.objects[step.object]
    role = step.object if step.object not in draft.objects else f"other_{step.object}"[:60]
    about = thing.randomization.model_copy(update={"x": (-0.04, 0.04), "y": (-0.04, 0.04), "yaw": 0.15})
    draft.objects[role] = ObjectSpec(asset_class=piece.asset_class, place=Place(at=at, yaw=yaw), randomization=about)
    draft.joint(step.name.split("_")[0], role, step.done[0].model_copy(update={"object": role}))
