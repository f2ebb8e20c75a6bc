"""Make a task from the steps of an instruction: a task of the library, or a new combination of known tasks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from gensim2.design.affordance import Affordance
from gensim2.design.base import Brief, Known
from gensim2.design.briefing import AFFORDANCE_INSTANCES, robot_summary
from gensim2.design.chores import ASIDE
from gensim2.design.containers import NARROW
from gensim2.design.drafting import ABOUT, BESIDE, CLOSE_ABOUT, OTHER_SIDE, PAIRED, Draft, chains
from gensim2.design.offline import OfflineDesigner
from gensim2.design.proposals import OPEN_AT, SHUT_AT, criterion_of, hand_over, holdable, lift, role_of, spec
from gensim2.design.serving import BOTH_AT, SUPPORT_AT, on_it
from gensim2.design.unseen import seen_by_search
from gensim2.instructions.meanings import solved
from gensim2.instructions.steps import SUPPORTS, HandOver, Lift, MoveJoint, Put, Refusal, SentenceError, Step
from gensim2.objects import Library
from gensim2.objects.words import camel_case
from gensim2.tasks.criteria import Criterion, DistanceArticulatedRigid, RigidOnRigid
from gensim2.tasks.library import load_strategies, load_task, task_names
from gensim2.tasks.likeness import normal_form
from gensim2.tasks.spec import ObjectSpec, Place, Randomization, TaskSpec
from gensim2.tasks.strategies import Strategies, with_strategies

#: Position (x, y) in metres between the robot and two objects that stand side by side.
IN_FRONT = (-0.28, 0.0)

#: Position (x, y) in metres and yaw of a container beside a bowl or a plate. Its front is turned towards the robot, so
#: that the hand reaches its contents.
BESIDE_SUPPORT = ((-0.05, 0.3), 0.4)

#: Ranges of the start poses of articulated objects that share the table with other large objects.
NARROW_ABOUT = Randomization(x=(-0.04, 0.04), y=(-0.04, 0.04), yaw=0.15)

#: Mean and maximum deviation of the initial openness of a joint that is moved to one end and back.
HALFWAY = (0.5, 0.15)

MAX_STEPS = 8
"""Maximum number of steps of an instruction."""


@dataclass(frozen=True)
class Composed:
    """A task that carries out an instruction.

    Attributes:
        task: the task.
        strategies: strategies of its steps, by name.
        is_from_library: whether the task library contains this task.
    """

    task: TaskSpec
    strategies: Strategies
    is_from_library: bool


def compose(steps: Sequence[Step], library: Library, robot_name: str) -> Composed:
    """Return the task for the steps of an instruction.

    If the library has a task with the same objects, steps and goal, the result is this task. Otherwise the task is
    combined from the library's tasks of single joints and from the rules of the offline designer. A container that the
    first step does not open is open at the start.

    Args:
        steps: steps of the instruction, as :func:`~gensim2.instructions.grammar.parse` returns them.
        library: objects of the scene.
        robot_name: name of the robot.

    Raises:
        SentenceError: the steps do not follow from each other, the objects have no room on the table, or the gripper
            cannot hold an object.
        InputError: the library lacks a class of objects.
    """
    if len(steps) > MAX_STEPS:
        raise SentenceError(Refusal.ORDER, "", f"an instruction can have {MAX_STEPS} steps, but this one has more")
    only = steps[0]
    if len(steps) == 1 and isinstance(only, MoveJoint) and only in solved():
        return _stored(solved()[only])
    classes = dict.fromkeys(each for step in steps for each in step.classes)
    things = {name: _affordance(library, name) for name in classes}
    _check_objects(steps, things, robot_name)
    task = _Composition(steps, things).task()
    if wrong := chains(task):
        raise SentenceError(Refusal.ORDER, wrong[0], "name the steps in the order in which they are possible")
    form = normal_form(task)
    for name in task_names():
        known = normal_form(load_task(name))
        if (known.classes, known.goal, known.chain) == (form.classes, form.goal, form.chain):
            return _stored(name)
    return _solved_by_rules(task, things, robot_name)


def _stored(name: str) -> Composed:
    return Composed(load_task(name), load_strategies(name), is_from_library=True)


def _solved_by_rules(task: TaskSpec, things: dict[str, Affordance], robot_name: str) -> Composed:
    """Return a task with the strategies of known tasks, and with the strategies of the offline designer's rules for
    grasping and placing.
    """
    known = [Known(load_task(name), load_strategies(name)) for name in dict.fromkeys(solved().values())]
    brief = Brief(robot_summary(robot_name), things, known)
    best = OfflineDesigner().candidates(task, brief, seed=0)[0]
    named: Strategies = {}
    ways: dict[str, Strategies] = {}
    for step, own in best.steps.items():
        ways[step] = {}
        for name, data in own.items():
            # Tasks of the library may use the same name for different strategies.
            unique = name if named.get(name, data) == data else f"{step}_{name}"[:60]
            named[unique] = ways[step][unique] = data
    return Composed(with_strategies(task, ways), named, is_from_library=False)


def _affordance(library: Library, name: str) -> Affordance:
    """Return the summary of a class, from the first objects that a search may use."""
    ids = seen_by_search(library, name)[:AFFORDANCE_INSTANCES]
    return Affordance.of([library.load(name, each) for each in ids], library.describe(name))


def _check_objects(steps: Sequence[Step], things: dict[str, Affordance], robot_name: str) -> None:
    """Check that each noun stands for one class of objects, and that the gripper can hold the rigid objects.

    Raises:
        SentenceError: one of the conditions is not met.
    """
    by_noun: dict[str, str] = {}
    for name, thing in things.items():
        if (other := by_noun.setdefault(thing.noun, name)) != name:
            remedy = f"the library has no {thing.noun} that does both; split the instruction ({other}, {name})"
            raise SentenceError(Refusal.IMPOSSIBLE, thing.noun, remedy)
    for step in steps:
        if isinstance(step, Put) and not _fits_in(things[step.thing], things[step.destination]):
            remedy = f"the {things[step.thing].noun} is too large for the {things[step.destination].noun}"
            raise SentenceError(Refusal.IMPOSSIBLE, step.text, remedy)
    stroke = robot_summary(robot_name).stroke
    held = {step.thing for step in steps if not isinstance(step, MoveJoint)}
    for name in held:
        if not holdable(things[name], stroke):
            raise SentenceError(
                Refusal.IMPOSSIBLE, things[name].noun, f"the gripper of {robot_name} cannot hold this object"
            )


def _subject(criterion: Criterion) -> str:
    """Return the name of the object whose joint or place a criterion is about."""
    if isinstance(criterion, RigidOnRigid | DistanceArticulatedRigid):
        return criterion.rigid
    return criterion.objects[0]


def _fits_in(thing: Affordance, goal: Affordance) -> bool:
    """Return whether a rigid object is small enough for the place where it is put."""
    if goal.kind == "rigid":
        return max(thing.size[:2]) < max(goal.size[:2])
    return goal.interior is None or all(a <= b for a, b in zip(sorted(thing.size), sorted(goal.interior), strict=True))


class _Composition:
    """Draft of the task for the steps of an instruction."""

    def __init__(self, steps: Sequence[Step], things: dict[str, Affordance]) -> None:
        self._steps, self._things = steps, things
        self._roles = {name: role_of(thing.noun) for name, thing in things.items()}
        text = " and ".join(step.text for step in steps)
        self._draft = Draft("Do" + camel_case(" ".join(each for each in text.split() if each != "the"))[:90], text)

    def task(self) -> TaskSpec:
        """Return the task.

        Raises:
            SentenceError: the objects have no room on the table.
        """
        only = self._steps[0]
        if len(self._steps) == 1 and not isinstance(only, Put):
            return self._single(only)
        self._place_objects()
        for number, wanted in enumerate(self._steps, 1):
            self._add(wanted, self._steps[number:])
        # Of several criteria on the same joint, or on the place of the same object, only the last can hold at the end.
        last = {_subject(each): each for each in self._draft.goal}
        self._draft.goal = [each for each in self._draft.goal if last[_subject(each)] is each]
        seen = Counter[str]()
        for index, step in enumerate(self._draft.steps):
            seen[step.name] += 1
            if seen[step.name] > 1:
                name = f"{step.name[:56]}_{seen[step.name]}"
                self._draft.steps[index] = step.model_copy(update={"name": name})
        return self._draft.task()

    def _single(self, step: MoveJoint | Lift | HandOver) -> TaskSpec:
        if isinstance(step, MoveJoint):
            return spec(self._things[step.asset_class], step.goal)
        thing = self._things[step.thing]
        return lift(thing) if isinstance(step, Lift) else hand_over(thing, step.direction)

    def _add(self, step: Step, later: Sequence[Step]) -> None:
        """Add a step of the instruction, which ``later`` steps follow."""
        if isinstance(step, MoveJoint):
            role = self._roles[step.asset_class]
            opens = step.goal in ("articulated_open", "half_open")
            # Opening a container is not part of the goal if a later step puts something into it or takes it out.
            lasting = not opens or not any(isinstance(each, Put) and step.asset_class in each.classes for each in later)
            self._draft.joint(step.text.split()[0], role, criterion_of(role, step.goal), lasting)
            return
        if not isinstance(step, Put):
            raise SentenceError(Refusal.ORDER, step.text, "say it alone, without other steps")
        thing, goal = self._things[step.thing], self._things[step.destination]
        role, below = self._roles[step.thing], self._roles[step.destination]
        self._draft.grasp(role)
        criterion = (
            on_it(goal, thing, role, below)
            if step.destination in SUPPORTS
            else DistanceArticulatedRigid(articulated=below, rigid=role)
        )
        self._draft.put("put", role, below, criterion)

    def _place_objects(self) -> None:
        """Choose the start poses of all objects.

        Raises:
            SentenceError: there is no room.
        """
        articulated = [name for name, thing in self._things.items() if thing.kind == "articulated"]
        # A bowl or plate that is itself put somewhere is a loose object.
        moved = {step.thing for step in self._steps if isinstance(step, Put)}
        supports = [name for name in self._things if name in SUPPORTS and name not in moved]
        sources = {step.thing: step.source for step in reversed(self._steps) if isinstance(step, Put)}
        loose = [name for name, source in sources.items() if source is None][::-1]
        wide = [name for name in articulated if max(self._things[name].size[:2]) > NARROW]
        room = f"{len(articulated)} articulated objects, {len(supports)} bowls or plates and {len(loose)} loose objects"
        fits = len(articulated) + len(supports) <= 2 and len(loose) <= 2 and not (wide and len(articulated) > 1)
        if not fits:
            raise SentenceError(Refusal.NO_ROOM, room, "split the instruction into parts with fewer objects")
        first, spots = self._places(articulated, supports, loose)
        for name in articulated:
            is_alone = len(articulated) == 1 and not (supports and loose)
            about = Randomization(x=(-0.05, 0.05), y=(0.0, 0.05)) if is_alone else NARROW_ABOUT
            if (openness := self._openness(name)) is not None:
                about = about.model_copy(update={"openness_mean": openness[0], "openness_spread": openness[1]})
            self._draft.objects[self._roles[name]] = ObjectSpec(
                asset_class=name, place=first[name], randomization=about
            )
        for name in supports:
            self._draft.objects[self._roles[name]] = ObjectSpec(
                asset_class=name, place=first[name], randomization=CLOSE_ABOUT
            )
        for name, source in sources.items():
            if source is not None:
                place, spread = Place(on=self._roles[source]), Randomization(x=(-0.01, 0.01), y=(-0.01, 0.01))
            else:
                place, spread = Place(at=spots[loose.index(name)]), ABOUT if len(loose) == 1 else CLOSE_ABOUT
            self._draft.objects[self._roles[name]] = ObjectSpec(asset_class=name, place=place, randomization=spread)

    def _places(
        self, articulated: list[str], supports: list[str], loose: list[str]
    ) -> tuple[dict[str, Place], list[tuple[float, float]]]:
        """Return the places of the large objects, and the positions of the loose objects."""
        beside = [BESIDE, OTHER_SIDE]
        if len(articulated) == 2:
            return {name: Place(at=at, yaw=yaw) for name, (at, yaw) in zip(articulated, PAIRED, strict=True)}, [
                IN_FRONT,
                BESIDE,
            ]
        if len(supports) == 2:
            return {name: Place(at=at) for name, at in zip(supports, BOTH_AT, strict=True)}, beside[::-1]
        if not supports:
            return {articulated[0]: Place()}, beside
        if not articulated:
            return {supports[0]: Place(at=SUPPORT_AT)}, beside
        at, yaw = BESIDE_SUPPORT
        return {articulated[0]: Place(at=at, yaw=yaw), supports[0]: Place(at=ASIDE)}, [BESIDE, IN_FRONT]

    def _openness(self, name: str) -> tuple[float, float] | None:
        """Return mean and spread of the initial openness of an object; None for the default openness. A joint starts
        away from the goal of the first step that moves it. If the last step brings the joint back, the joint starts
        halfway, because no goal may be met at the start. A container that is used before it is moved starts open.
        """
        goals = [step.goal for step in self._steps if isinstance(step, MoveJoint) and step.asset_class == name]
        if len(goals) > 1 and not any(isinstance(step, Put) for step in self._steps):
            return HALFWAY
        for step in self._steps:
            if isinstance(step, MoveJoint) and step.asset_class == name:
                return SHUT_AT if step.goal in ("articulated_open", "half_open") else OPEN_AT
            if isinstance(step, Put) and name in (step.source, step.destination):
                return OPEN_AT
        return None
