"""Draft long tasks that put one or two objects on a plate or into a bowl."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from functools import partial

from gensim2.design.affordance import Affordance
from gensim2.design.base import Brief
from gensim2.design.drafting import ALIKE, BESIDE, CLOSE_ABOUT, OTHER_SIDE, Draft, Family, in_turn
from gensim2.design.proposals import holdable, role_of
from gensim2.objects.words import belongs, camel_case
from gensim2.tasks.criteria import RigidOnRigid
from gensim2.tasks.spec import ObjectSpec, Place

#: Position (x, y), m, of a single bowl or plate, and of each of two.
SUPPORT_AT = (-0.1, 0.1)
BOTH_AT = ((-0.05, 0.16), (-0.05, -0.16))
SUPPORTS = ("bowl", "plate")


def served(brief: Brief, count: int) -> Iterator[Draft]:
    """Draft tasks that put ``count`` objects on a plate or into a bowl."""
    queues = []
    for support in _supports(brief):
        things = fits(brief, support)
        groups = [tuple(things[start : start + count]) for start in range(0, len(things) - count + 1, count)]
        queues.append([(support, group) for group in groups[:ALIKE]])
    for support, group in itertools.islice(in_turn(queues), ALIKE):
        nouns = " and the ".join(thing.noun for thing in group)
        name = "And".join(camel_case(thing.noun) for thing in group)
        into = into_it(support)
        draft = Draft(
            f"Put{name}{into.capitalize()}{camel_case(support.noun)}", f"put the {nouns} {into} the {support.noun}"
        )
        place_support(draft, support, SUPPORT_AT)
        for thing, at in zip(group, (BESIDE, OTHER_SIDE), strict=False):
            carry(draft, support, thing, at)
        yield draft


def laid(brief: Brief) -> Iterator[Draft]:
    """Draft tasks that put one object into the bowl and another on the plate."""
    both = _supports(brief)
    if len(both) < len(SUPPORTS):
        return
    first, second = both
    courses = zip(fits(brief, first), fits(brief, second), strict=False)
    for one, other in itertools.islice((each for each in courses if each[0].noun != each[1].noun), ALIKE):
        draft = Draft(
            f"LayTableWith{camel_case(one.noun)}And{camel_case(other.noun)}",
            f"lay the table: put the {one.noun} {into_it(first)} the {first.noun} "
            f"and the {other.noun} {into_it(second)} the {second.noun}",
        )
        for support, where in zip(both, BOTH_AT, strict=True):
            place_support(draft, support, where)
        carry(draft, first, one, OTHER_SIDE)
        carry(draft, second, other, BESIDE)
        yield draft


FAMILIES: dict[str, Family] = {"serve": partial(served, count=1), "serve two": partial(served, count=2), "lay": laid}


def place_support(draft: Draft, support: Affordance, at: tuple[float, float]) -> str:
    """Add a bowl or a plate to a draft and return its name."""
    below = role_of(support.noun)
    draft.objects[below] = ObjectSpec(asset_class=support.asset_class, place=Place(at=at), randomization=CLOSE_ABOUT)
    return below


def carry(draft: Draft, support: Affordance, thing: Affordance, at: tuple[float, float]) -> None:
    """Add an object at the position ``at``, a step that grasps the object, and a step that puts it on a support."""
    role, below = role_of(thing.noun), role_of(support.noun)
    draft.objects[role] = ObjectSpec(asset_class=thing.asset_class, place=Place(at=at), randomization=CLOSE_ABOUT)
    draft.grasp(role)
    draft.put("put", role, below, on_it(support, thing, role, below))


def on_it(support: Affordance, thing: Affordance, role: str, below: str) -> RigidOnRigid:
    """Return the criterion that an object lies on a support, away from the support's edge and on no other object."""
    return RigidOnRigid(
        rigid=role,
        support=below,
        threshold=round(0.4 * min(support.size[:2]), 3),
        height=round(support.size[2] / 2 + 1.5 * max(thing.size), 3),
    )


def into_it(support: Affordance) -> str:
    """Return the preposition for the support: into a bowl, onto a plate."""
    return "in" if support.asset_class == "bowl" else "on"


def fits(brief: Brief, support: Affordance) -> list[Affordance]:
    """Return the graspable objects that people put on this support."""
    found = [brief.classes[name] for name in belongs(support.asset_class) if name in brief.classes]
    return [thing for thing in found if holdable(thing, brief.settings.stroke)]


def _supports(brief: Brief) -> list[Affordance]:
    return [brief.classes[name] for name in SUPPORTS if name in brief.classes]
