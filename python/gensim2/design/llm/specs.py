"""Build task specs from a model's answers. The answers name goals with the terms of the GenSim2 paper."""

from __future__ import annotations

from collections.abc import Sequence

from gensim2.design.affordance import Affordance
from gensim2.design.llm.catalog import role_of
from gensim2.tasks.criteria import (
    JOINT,
    ArticulatedClosed,
    ArticulatedOpen,
    Criterion,
    DistanceArticulatedRigid,
    DistanceGripperArticulated,
    DistanceGripperRigid,
)
from gensim2.tasks.spec import DESIGNED, ObjectSpec, Place, Provenance, Randomization, Step, TaskSpec

CRITERIA = (
    "articulated_open",
    "articulated_closed",
    "distance_articulated_rigidbody",
    "distance_gripper_rigidbody",
    "distance_gripper_articulated",
)
"""Types of success criteria in the paper."""

#: Position (x, y) in metres of a rigid object to pick up; it lies beside the robot, where no opening door can reach.
BESIDE = (-0.2, -0.45)

#: Time limit of a task in control cycles. Each step of a long task adds this number.
STEPS_A_STEP = 300

#: Mean openness at the start of a container that the task never opens, or closes before it opens it.
STANDS_OPEN = 0.95


def roles_of(articulated: Affordance, rigid: Affordance | None) -> tuple[str, str | None]:
    """Return the names of a task's one or two objects."""
    role = role_of(articulated)
    if rigid is None:
        return role, None
    other = role_of(rigid)
    return role, other if other != role else f"small_{other}"


def criterion(kind: str, articulated: str, rigid: str | None) -> Criterion:
    """Return the success criterion of one of the paper's types for the named objects."""
    if kind == "articulated_open":
        return ArticulatedOpen(object=articulated)
    if kind == "articulated_closed":
        return ArticulatedClosed(object=articulated)
    if kind == "distance_gripper_articulated":
        return DistanceGripperArticulated(articulated=articulated)
    assert rigid is not None
    if kind == "distance_gripper_rigidbody":
        return DistanceGripperRigid(rigid=rigid)
    return DistanceArticulatedRigid(articulated=articulated, rigid=rigid)


def next_step(steps: Sequence[Step], verb: str, on: str, tool: str, done: Criterion) -> Step:
    """Return a step to append to ``steps``. Its name is the verb, with a number if earlier steps have the same verb."""
    taken = sum(step.name.rstrip("_0123456789") == verb for step in steps)
    name = verb if not taken else f"{verb}_{taken + 1}"
    return Step(name=name, object=on, tool=tool, strategies=(f"designed_{name}",), done=(done,))


def single_step(name: str, sentence: str, thing: Affordance, kind: str, origin: str) -> TaskSpec:
    """Return a task of one motion on one articulated object."""
    role = role_of(thing)
    done = criterion(kind, role, None)
    return TaskSpec(
        name=name,
        description=sentence,
        objects={role: ObjectSpec(asset_class=thing.asset_class)},
        steps=(Step(name=_verb(kind), object=role, strategies=(DESIGNED,), done=(done,)),),
        provenance=Provenance(origin=origin[:100]),
    )


def long_task(
    name: str,
    sentence: str,
    articulated: Affordance,
    rigid: Affordance | None,
    steps: Sequence[Step],
    goal: Sequence[str],
    origin: str,
) -> TaskSpec:
    """Return a task of several steps; :func:`roles_of` names its objects."""
    role, other = roles_of(articulated, rigid)
    opens = any(isinstance(c, ArticulatedOpen) for step in steps for c in step.done)
    first = next((c for step in steps for c in step.done if isinstance(c, ArticulatedOpen | ArticulatedClosed)), None)
    mean = None
    if rigid is not None and articulated.is_container:
        mean = STANDS_OPEN if not opens or isinstance(first, ArticulatedClosed) else 0.5
    scene = Randomization(x=(-0.05, 0.05), y=(0.0, 0.05), openness_mean=mean) if rigid else Randomization()
    if mean == STANDS_OPEN:
        scene = scene.model_copy(update={"openness_spread": 1 - STANDS_OPEN})
    objects = {role: ObjectSpec(asset_class=articulated.asset_class, randomization=scene)}
    if rigid is not None and other is not None:
        objects[other] = ObjectSpec(asset_class=rigid.asset_class, place=Place(at=BESIDE))
    asked = [criterion(kind, role, other) for kind in goal]
    # A model often names only the place of an object as the goal and forgets the joint of the last step. Add its
    # criteria.
    lasting = [c for c in steps[-1].done if isinstance(c, JOINT)]
    return TaskSpec(
        name=name,
        description=sentence,
        objects=objects,
        steps=tuple(steps),
        goal=tuple(dict.fromkeys((*asked, *lasting))),
        max_episode_steps=max(400, STEPS_A_STEP * len(steps)),
        provenance=Provenance(origin=origin[:100]),
    )


def _verb(kind: str) -> str:
    return {"articulated_open": "open", "articulated_closed": "close"}.get(kind, "reach")
