"""Long tasks made of what is known by its pre- and post-conditions, in the words of people.

A piece is a known task on one joint: it needs the joint to stand otherwise than it leaves it. Taking something up needs
an empty hand and leaves it full; putting it down needs a full hand and what it is put into open, and leaves the hand
empty. Whatever chain is made holds to this (:func:`chains`).
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import TypeVar

from gensim2.designers.affordance import Affordance
from gensim2.designers.base import DESIGNED, Brief, Known, Strategies
from gensim2.designers.proposals import OPEN_AT, camel_case, holdable, joint_goal, role_of
from gensim2.objects.words import belongs, noun, room, words
from gensim2.tasks.criteria import (
    ArticulatedClosed,
    ArticulatedOpen,
    Criterion,
    DistanceArticulatedRigid,
    DistanceGripperRigid,
    RigidOnRigid,
)
from gensim2.tasks.spec import HAND, ObjectSpec, Place, Provenance, Randomization, Step, TaskSpec

Item = TypeVar("Item")

#: Tasks that differ in nothing but the rigid object.
ALIKE = 3

#: Control steps that a step of a long task is given.
STEPS_EACH = 300

#: Where a rigid object waits beside what it is put into, x and y in the world, and what is drawn about it.
BESIDE, OTHER_SIDE = (-0.2, -0.45), (-0.2, 0.45)
ABOUT = Randomization(x=(-0.1, 0.1), y=(-0.1, 0.1))
CLOSE_ABOUT = Randomization(x=(-0.05, 0.05), y=(-0.05, 0.05))

#: Where two things with joints stand beside each other, x and y in the world, and by how much they are turned.
PAIRED = (((-0.05, 0.3), -0.4), ((-0.05, -0.3), 0.4))

#: Verbs that nothing follows but what they are done to.
SAID_ONCE = ("open", "close", "press")

#: Pairs that one piece is in at most.
PAIRS_OF_ONE = 3

#: Where a bowl or a plate stands.
SUPPORT_AT = (-0.1, 0.1)
SUPPORTS = ("bowl", "plate")


@dataclass
class Draft:
    """A task in the making.

    Attributes:
        name, sentence: of the task.
        objects: by name, in the order in which they are placed.
        steps: in order.
        goal: what must hold in the end.
    """

    name: str
    sentence: str
    objects: dict[str, ObjectSpec] = field(default_factory=dict)
    steps: list[Step] = field(default_factory=list)
    goal: list[Criterion] = field(default_factory=list)

    def joint(self, verb: str, role: str, criterion: Criterion, lasting: bool = True) -> None:
        """A step that works a joint."""
        self._step(f"{verb}_{role}", role, HAND, (criterion,))
        if lasting:
            self.goal.append(criterion)

    def grasp(self, role: str) -> None:
        """A step that takes something up."""
        self._step(f"grasp_{role}", role, HAND, (DistanceGripperRigid(rigid=role),))

    def put(self, verb: str, role: str, where: str, criterion: Criterion) -> None:
        """A step that puts down what is held."""
        self._step(f"{verb}_{role}", where, role, (criterion,))
        self.goal.append(criterion)

    def task(self) -> TaskSpec:
        """As a value."""
        return TaskSpec(
            name=self.name,
            description=self.sentence,
            objects=self.objects,
            steps=tuple(self.steps),
            goal=tuple(self.goal),
            max_episode_steps=STEPS_EACH * len(self.steps),
            provenance=Provenance(origin="offline"),
        )

    def _step(self, name: str, role: str, tool: str, done: tuple[Criterion, ...]) -> None:
        self.steps.append(Step(name=name[:60], object=role, tool=tool, strategies=(DESIGNED,), done=done))


def propose(brief: Brief) -> Iterator[TaskSpec | None]:
    """Yield long tasks that can be made of what is known, families in turn, none of a name that is there.

    What is known is looked at when a task's turn has come, so that what a run keeps meanwhile counts. None: there is
    nothing new for now.
    """
    proposed: set[str] = set()
    while True:
        fresh = False
        for family in FAMILIES:
            taken = proposed | {known.task.name for known in brief.known}
            draft = next((each for each in family(brief) if each.name not in taken), None)
            if draft is None:
                continue
            fresh = True
            proposed.add(draft.name)
            task = draft.task()
            assert not chains(task), f"{task.name}: {chains(task)}"
            yield task
        if not fresh:
            yield None


def chains(task: TaskSpec) -> list[str]:
    """What stands in the way of a chain of steps: conditions that a step needs and those before it do not leave."""
    held: str | None = None
    openness: dict[str, str] = {}
    wrong = []
    for step in task.steps:
        if step.tool != (held or HAND):
            wrong.append(f"{step.name}: the hand holds {held or 'nothing'}")
        rigid = {name for criterion in step.done for name in criterion.objects if name not in openness}
        if step.tool != HAND:
            if openness.get(step.object) == "closed":
                wrong.append(f"{step.name}: {step.object} is closed")
            held = None
        for criterion in step.done:
            if isinstance(criterion, ArticulatedOpen | ArticulatedClosed):
                state = "open" if isinstance(criterion, ArticulatedOpen) else "closed"
                if openness.get(criterion.object) == state:
                    wrong.append(f"{step.name}: {criterion.object} is {state} already")
                openness[criterion.object] = state
            elif isinstance(criterion, DistanceGripperRigid) and step.object in rigid:
                held = step.object
    if held is not None:
        wrong.append(f"the hand still holds {held}")
    return wrong


def verbs(task: TaskSpec) -> tuple[str, ...]:
    """The chain of verbs of a task: the first word of each step."""
    return tuple(step.name.split("_")[0] for step in task.steps)


def piece_ways(brief: Brief, asset_class: str, goal: str) -> Strategies:
    """How a known task brings a joint to ``goal``, its strategies under telling names; empty where none is known."""
    for known in brief.known:
        if joint_goal(known.task) == (asset_class, goal):
            wanted = known.task.steps[0].strategies
            return {_own_name(name, known.task): known.strategies[name] for name in wanted}
    return {}


def _own_name(strategy: str, task: TaskSpec) -> str:
    """A name that no other piece has, where a designer gave none."""
    (thing,) = task.objects.values()
    number = strategy.removeprefix(DESIGNED)
    return f"{task.steps[0].name}_{thing.asset_class}{number}" if number != strategy else strategy


def _pieces(brief: Brief) -> list[tuple[str, str, Known]]:
    """What is known of one joint: class, goal, task; of the ends, the most useful first."""
    found = [(*goal, known) for known in brief.known if (goal := joint_goal(known.task)) is not None]
    ends = [each for each in found if each[1] in ("articulated_open", "articulated_closed")]
    return sorted(ends, key=lambda each: -words(each[0], each[1]).usefulness)  # type: ignore[arg-type]


def _is_known(brief: Brief, asset_class: str, goal: str) -> bool:
    return any((each, end) == (asset_class, goal) for each, end, _ in _pieces(brief))


def _containers(brief: Brief) -> Iterator[Affordance]:
    yield from (thing for thing in brief.classes.values() if thing.is_container)


def _things(brief: Brief, asset_class: str) -> list[Affordance]:
    """Rigid objects that people keep there and that a hand can hold."""
    found = [brief.classes[name] for name in belongs(asset_class) if name in brief.classes]
    return [thing for thing in found if holdable(thing, brief.settings.stroke)]


def _tidied(brief: Brief, how: str) -> Iterator[Draft]:
    """Something is put into a container that is opened before or closed after, both or neither; all in turn."""
    opens, shuts = how in ("stow", "put"), how in ("stow", "shut")
    queues = [
        [(container, thing) for thing in _things(brief, container.asset_class)] for container in _containers(brief)
    ]
    # Each way of doing it begins with another thing, so that more of them are handled.
    turn = ("stow", "put", "shut", "drop").index(how)
    queues = [queue[turn % len(queue) :] + queue[: turn % len(queue)] for queue in queues if queue]
    for container, thing in _in_turn(queue[:ALIKE] for queue in queues):
        name = container.asset_class
        if (opens and not _is_known(brief, name, "articulated_open")) or (
            shuts and not _is_known(brief, name, "articulated_closed")
        ):
            continue
        yield _tidy(container, thing, how, opens, shuts)


def _tidy(container: Affordance, thing: Affordance, how: str, opens: bool, shuts: bool) -> Draft:
    box, role = role_of(container.noun), role_of(thing.noun)
    the, it = container.noun, thing.noun
    name = {"stow": "Stow{}In{}", "put": "Put{}In{}", "shut": "Put{}AwayIn{}", "drop": "Drop{}Into{}"}[how]
    sentence = {
        "stow": f"open the {the}, put the {it} in and close it again",
        "put": f"open the {the} and put the {it} in",
        "shut": f"put the {it} into the open {the} and close it",
        "drop": f"put the {it} into the open {the}",
    }[how]
    draft = Draft(name.format(camel_case(it), camel_case(the)), sentence)
    openness = {} if opens else {"openness_mean": OPEN_AT[0], "openness_spread": OPEN_AT[1]}
    about = Randomization(x=(-0.05, 0.05), y=(0.0, 0.05), **openness)
    draft.objects = {
        box: ObjectSpec(asset_class=container.asset_class, randomization=about),
        role: ObjectSpec(asset_class=thing.asset_class, place=Place(at=BESIDE), randomization=ABOUT),
    }
    if opens:
        draft.joint("open", box, ArticulatedOpen(object=box), lasting=False)
    draft.grasp(role)
    draft.put("put", role, box, DistanceArticulatedRigid(articulated=box, rigid=role))
    if shuts:
        draft.joint("close", box, ArticulatedClosed(object=box))
    return draft


def _served(brief: Brief, count: int) -> Iterator[Draft]:
    """So many things are put on a plate or into a bowl."""
    queues = []
    for name in SUPPORTS:
        if name in brief.classes:
            things = _things(brief, name)
            groups = [tuple(things[start : start + count]) for start in range(0, len(things) - count + 1, count)]
            queues.append([(brief.classes[name], group) for group in groups[:ALIKE]])
    for support, group in _in_turn(queues):
        into = "in" if support.asset_class == "bowl" else "on"
        nouns = " and the ".join(thing.noun for thing in group)
        where = camel_case(support.noun)
        name = "And".join(camel_case(thing.noun) for thing in group)
        draft = Draft(f"Put{name}{into.capitalize()}{where}", f"put the {nouns} {into} the {support.noun}")
        below = role_of(support.noun)
        draft.objects[below] = ObjectSpec(
            asset_class=support.asset_class, place=Place(at=SUPPORT_AT), randomization=CLOSE_ABOUT
        )
        for thing, at in zip(group, (BESIDE, OTHER_SIDE), strict=False):
            role = role_of(thing.noun)
            draft.objects[role] = ObjectSpec(
                asset_class=thing.asset_class, place=Place(at=at), randomization=CLOSE_ABOUT
            )
            draft.grasp(role)
            draft.put("put", role, below, _on(support, thing, role, below))
        yield draft


def _on(support: Affordance, thing: Affordance, role: str, below: str) -> RigidOnRigid:
    """Well within the edge of what it is on, no higher than lying there and on another."""
    return RigidOnRigid(
        rigid=role,
        support=below,
        threshold=round(0.4 * min(support.size[:2]), 3),
        height=round(support.size[2] / 2 + 1.5 * max(thing.size), 3),
    )


def _again(brief: Brief) -> Iterator[Draft]:
    """What is switched on and off, and what is opened for a look."""
    for asset_class, verb, back, name, sentence in (
        ("faucet", "turn_on", "turn_off", "RunTheWater", "turn the faucet on and off again"),
        ("switch", "flip_on", "flip_off", "FlashTheLight", "flip the light switch on and off again"),
        ("refrigerator", "open", "close", "LookIntoRefrigerator", "look into the refrigerator: open and close it"),
        ("drawer", "open", "close", "LookIntoDrawer", "look into the drawer: open and close it"),
        ("box_rotate", "open", "close", "LookIntoBox", "look into the box: open and close it"),
        ("window_rotate", "open", "close", "AirTheRoom", "air the room: open the window and close it again"),
        ("window_push", "open", "close", "LetSomeAirIn", "let some air in: slide the window open and shut again"),
        ("microwave", "open", "close", "LookIntoMicrowave", "look into the microwave: open and close it"),
    ):
        ends = ("articulated_open", "articulated_closed")
        if asset_class not in brief.classes or not all(_is_known(brief, asset_class, end) for end in ends):
            continue
        role = role_of(brief.classes[asset_class].noun)
        draft = Draft(name, sentence, {role: ObjectSpec(asset_class=asset_class)})
        draft.joint(verb, role, ArticulatedOpen(object=role), lasting=False)
        draft.joint(back, role, ArticulatedClosed(object=role))
        yield draft


def _pairs(brief: Brief) -> Iterator[Draft]:
    """Two pieces of one room, one after the other; each class in as few pairs as can be."""
    choices = [
        (first, second)
        for first, second in itertools.combinations(_small(brief), 2)
        if room(first[0]) == room(second[0]) and noun(first[0]) != noun(second[0])
    ]
    choices.sort(key=lambda pair: _verb(pair[0]) != _verb(pair[1]))  # "close the box and the laptop" comes first
    used: Counter[tuple[str, str]] = Counter()
    for most in range(PAIRS_OF_ONE):
        for first, second in choices:
            if used[first[:2]] <= most and used[second[:2]] <= most:
                used.update((first[:2], second[:2]))
                yield _pair(brief, first, second)
        choices = [pair for pair in choices if min(used[each[:2]] for each in pair) <= most]


def _small(brief: Brief) -> list[tuple[str, str, Known]]:
    """Pieces that people ask for on things that leave room for another beside them."""
    return [
        piece
        for piece in _pieces(brief)
        if words(piece[0], piece[1]).usefulness >= 0.7 and max(brief.classes[piece[0]].size[:2]) < 0.36  # type: ignore[arg-type]
    ]


def _verb(piece: tuple[str, str, Known]) -> str:
    return piece[2].task.description.split()[0]


def _pair(brief: Brief, first: tuple[str, str, Known], second: tuple[str, str, Known]) -> Draft:
    tasks = first[2].task, second[2].task
    one, other = tasks[0].description, tasks[1].description
    same = _verb(first) == _verb(second) and _verb(first) in SAID_ONCE
    sentence = f"{one} and {other.split(' ', 1)[1] if same else other}"
    draft = Draft(f"{tasks[0].name}And{tasks[1].name}", sentence)
    for (asset_class, _, known), (at, yaw) in zip((first, second), PAIRED, strict=True):
        (step,) = known.task.steps
        thing = known.task.objects[step.object]
        role = step.object if step.object not in draft.objects else f"other_{step.object}"[:60]
        about = thing.randomization.model_copy(update={"x": (-0.04, 0.04), "y": (-0.04, 0.04), "yaw": 0.15})
        draft.objects[role] = ObjectSpec(asset_class=asset_class, place=Place(at=at, yaw=yaw), randomization=about)
        criterion = step.done[0].model_copy(update={"object": role})
        draft.joint(step.name.split("_")[0], role, criterion)
    return draft


def _taken_out(brief: Brief) -> Iterator[Draft]:
    """Something is taken out of an open container and put on a plate or into a bowl."""
    yield from _carried(
        brief, "Take{}OutOf{}", "take the {thing} out of the {box} and put it {into} the {support}", False
    )


def _moved(brief: Brief) -> Iterator[Draft]:
    """The same of a container that is closed afterwards."""
    yield from _carried(
        brief,
        "Fetch{}From{}",
        "take the {thing} out of the {box}, put it {into} the {support} and close the {box}",
        True,
    )


def _carried(brief: Brief, name: str, sentence: str, shuts: bool) -> Iterator[Draft]:
    queues = []
    for container in _containers(brief):
        if not shuts or _is_known(brief, container.asset_class, "articulated_closed"):
            things = _things(brief, container.asset_class)[:ALIKE]
            queues.append([(container, thing) for thing in things])
    for number, (container, thing) in enumerate(_in_turn(queues)):
        support = brief.classes.get(SUPPORTS[number % len(SUPPORTS)])
        if support is None or max(thing.size[:2]) > 0.6 * min(support.size[:2]):
            continue
        box, role, below = role_of(container.noun), role_of(thing.noun), role_of(support.noun)
        into = "into" if support.asset_class == "bowl" else "on"
        nouns = {"thing": thing.noun, "box": container.noun, "support": support.noun, "into": into}
        draft = Draft(name.format(camel_case(thing.noun), camel_case(container.noun)), sentence.format(**nouns))
        opened = Randomization(x=(-0.05, 0.05), y=(0.0, 0.05), openness_mean=OPEN_AT[0], openness_spread=OPEN_AT[1])
        little = Randomization(x=(-0.01, 0.01), y=(-0.01, 0.01))
        draft.objects = {
            box: ObjectSpec(asset_class=container.asset_class, randomization=opened),
            role: ObjectSpec(asset_class=thing.asset_class, place=Place(on=box), randomization=little),
            below: ObjectSpec(asset_class=support.asset_class, place=Place(at=BESIDE), randomization=CLOSE_ABOUT),
        }
        draft.grasp(role)
        draft.put("put", role, below, _on(support, thing, role, below))
        if shuts:
            draft.joint("close", box, ArticulatedClosed(object=box))
        yield draft


def _in_turn(queues: Iterable[Iterable[Item]]) -> Iterator[Item]:
    """The first of each, then the second of each, and so on."""
    for row in itertools.zip_longest(*queues):
        yield from (item for item in row if item is not None)


#: Kinds of long tasks, each a function of what is known; they take turns.
FAMILIES: tuple[Callable[[Brief], Iterator[Draft]], ...] = (
    partial(_tidied, how="stow"),
    _pairs,
    partial(_served, count=1),
    partial(_tidied, how="put"),
    _again,
    partial(_tidied, how="shut"),
    partial(_served, count=2),
    partial(_tidied, how="drop"),
    _taken_out,
    _moved,
)
