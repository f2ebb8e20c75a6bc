"""Test success criteria. Count how often they hold in worlds in which the task is not done.

A successful end state is built from the steps and the shapes. One thing in it is changed: for example, a joint stays at
its start, or an object lies beside its goal. Each :class:`Mutation` states why the task is not done after the change.

The count shows whether the thresholds of the criteria are right, so the worlds must not depend on these thresholds.
Mutations use only the types of the criteria, such as whether a joint opens or closes, or the direction in which an
object moves.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from gensim2.core.arrays import Array
from gensim2.objects import RigidObject
from gensim2.objects.types import ArticulatedObject
from gensim2.rollout.checker_result import DONE, Mutation, WorldCount
from gensim2.rollout.no_op import no_op_baseline
from gensim2.rollout.turns import goal_reached, turns_by_criteria
from gensim2.scenes.footprint import gap_between, outline
from gensim2.scenes.geometry import is_container, measured_link
from gensim2.scenes.goal import DIRECTIONS, measure_initial_state, measured_pose
from gensim2.scenes.initial_state import InitialState, PlacedObject, set_down
from gensim2.scenes.table import corners as table_corners
from gensim2.tasks.criteria import (
    ArticulatedBetween,
    ArticulatedOpen,
    Criterion,
    JointCriterion,
    RigidLifted,
    RigidMoved,
    RigidOnRigid,
    all_hold,
)
from gensim2.tasks.measurement import Measurement
from gensim2.tasks.spec import HAND, Step

if TYPE_CHECKING:
    from gensim2.sim.headless import HeadlessEnv


FAR = 0.25
"""Minimum distance of a joint from the wanted openness in worlds in which the joint was not moved there."""

APART = 0.02
"""Gap (m) between the outlines of an object and of its goal, seen from above, in worlds with the object beside it."""

ABOVE = 0.03
"""Height (m) above the goal of an object in the air."""

SLIGHTLY = 0.01
"""Height (m) of an object that was hardly lifted."""

CARRIED, LIFTED = 0.2, 0.15
"""Displacement (m) of an object that was moved or lifted."""

LOWERED_FROM = (0.02, 0.0, -0.02)
"""Heights (m) above a container's point from which an object is lowered. The first free height is used."""

HAND_ABOVE = 0.15
"""Height (m) of the hand above an object that it has not reached."""

SETTLING = 1.0
"""Time (s) for which a world is simulated before it is judged, if something in it can fall."""


def judge(env: HeadlessEnv, seed: int) -> list[WorldCount]:
    """Evaluate the success criteria in the mutated worlds of one scene.

    Args:
        env: simulator of the task's scenes, in either engine.
        seed: seed of the scene.

    Returns:
        One count for each world.
    """
    return list(_Worlds(env, seed).judged())


@dataclass(frozen=True)
class _State:
    """State of a scene.

    Attributes:
        objects: objects with their poses.
        carried: rigid objects inside articulated objects, as a mapping from the name of the rigid to the name of the
            articulated object.
        hand: (3,) point between the fingertips, m; None at the start of the episode.
    """

    objects: Mapping[str, PlacedObject]
    carried: Mapping[str, str] = field(default_factory=dict)
    hand: Array | None = None

    def with_objects(self, **changed: PlacedObject) -> _State:
        return replace(self, objects={**self.objects, **changed})

    def with_openness(self, name: str, openness: float) -> _State:
        """Set the openness of an articulated object. Rigid objects in its moving part, such as a drawer, move along."""
        before = self.objects[name]
        after = replace(before, openness=openness)
        moved = {name: after}
        T = measured_pose(after) @ np.linalg.inv(measured_pose(before))
        for thing, container in self.carried.items():
            if container == name:
                moved[thing] = _transformed(self.objects[thing], T)
        return self.with_objects(**moved)


@dataclass(frozen=True)
class _Mutant:
    """A state of the scene in which one step of the task is not done.

    Attributes:
        mutation: kind of change that makes the step undone.
        subject: name of the object that the change concerns.
        state: changed state of the scene.
        settles: whether objects may fall. If so, the state is simulated before the criteria are evaluated.
    """

    mutation: Mutation
    subject: str
    state: _State
    settles: bool = False


class _Worlds:
    """The mutated worlds of one scene."""

    def __init__(self, env: HeadlessEnv, seed: int) -> None:
        self._env, self._seed, self._task = env, seed, env.task
        self._nothing = no_op_baseline(env, seed)
        self._start: InitialState = env.initial_state
        objects = self._start.objects
        inside = {name: spec.place.on for name, spec in self._task.objects.items() if spec.place.on in objects}
        carried = {name: on for name, on in inside.items() if objects[on].openness is not None}
        self._first = _State(objects, carried)

    def judged(self) -> Iterator[WorldCount]:
        task = self._task
        yield self._goal(Mutation.NOTHING, "", [self._measured(self._first), self._nothing.end])
        states = self._course(task.steps)
        if states is None:
            return
        course = [self._measured(state) for state in states]
        yield self._goal(DONE, "", course)
        for name in sorted(task.transient):
            if (left_out := self._without(name, states)) is not None:
                yield self._goal(Mutation.LEFT_OUT, name, left_out)
        for step in self._final_steps():
            for mutant in self._mutants(step, self._first, states[-1]):
                yield self._goal(mutant.mutation, mutant.subject, [*course[:-1], self._of(mutant)])
        if task.is_single_step:
            return
        for step, before, after in zip(task.steps, states[:-1], states[1:], strict=True):
            if step.done:
                yield self._count(step.name, DONE, step.object, step.done, all_hold(step.done, self._measured(after)))
                for mutant in self._mutants(step, before, after):
                    holds = all_hold(step.done, self._of(mutant))
                    yield self._count(step.name, mutant.mutation, mutant.subject, step.done, holds)

    def _goal(self, mutation: str, subject: str, course: Sequence[Measurement]) -> WorldCount:
        reached = goal_reached(self._task, course[-1], turns_by_criteria(self._task, course))
        return self._count(None, mutation, subject, self._task.success, reached)

    def _count(
        self, step: str | None, mutation: str, subject: str, criteria: Sequence[Criterion], holds: bool
    ) -> WorldCount:
        about = [criterion for criterion in criteria if subject in criterion.objects] or criteria
        kinds = tuple(dict.fromkeys(criterion.type for criterion in about))
        return WorldCount(step, str(mutation), subject, kinds, 1, int(holds))

    # The following methods build the states of an episode in which every step succeeds.

    def _course(self, steps: Sequence[Step]) -> list[_State] | None:
        """Return the states before the first step and after each one; None if they cannot be built."""
        states = [self._first]
        for step in steps:
            after = self._after(states[-1], step)
            if after is None:
                return None
            states.append(after)
        return states

    def _after(self, state: _State, step: Step) -> _State | None:
        """Return the state after a successful step; None if it cannot be built."""
        state = replace(state, hand=None)
        motion = self._task.motion_of(step)
        if motion is not None:
            return state.with_openness(step.object, _wanted(motion))
        if (put := self._put_of(step)) is not None:
            return _put(state, *put)
        if step.object not in state.objects or not isinstance(state.objects[step.object].model, RigidObject):
            return state
        if self._is_grasp(step):
            return replace(state, hand=_middle(state.objects[step.object]))
        way = self._way(step)
        return _carried(state, step.object, way) if way is not None else state

    def _put_of(self, step: Step) -> tuple[str, str] | None:
        """Return the rigid object that a step places, and the object on or in which the step places it.

        Return None for other steps.
        """
        if step.tool != HAND:
            return (step.tool, step.object) if self._task.motion_of(step) is None else None
        on = [c for c in self._criteria(step) if isinstance(c, RigidOnRigid) and c.rigid == step.object]
        return (step.object, on[0].support) if on and not self._is_grasp(step) else None

    def _is_grasp(self, step: Step) -> bool:
        """Return whether a step grasps an object that a later step uses as its tool."""
        later = self._task.steps[self._task.steps.index(step) + 1 :]
        return step.tool == HAND and any(each.tool == step.object for each in later)

    def _criteria(self, step: Step) -> Sequence[Criterion]:
        return step.done or (self._task.success if step is self._task.steps[-1] else ())

    def _way(self, step: Step) -> Array | None:
        """Return the displacement (3,) of a rigid object that meets the criteria, metres.

        Return None if the criteria require none.
        """
        about = [c for c in self._criteria(step) if step.object in c.objects]
        way = np.zeros(3)
        for criterion in about:
            if isinstance(criterion, RigidMoved):
                way[:2] += CARRIED * np.array(DIRECTIONS[criterion.direction])
            elif isinstance(criterion, RigidLifted):
                way[2] = LIFTED
        return way if way.any() else None

    def _final_steps(self) -> list[Step]:
        """Return the last step that determines each object's state, without openings for putting in or taking out."""
        final: dict[str, Step] = {}
        for step in self._task.steps:
            put = self._put_of(step)
            if put is not None:
                final[put[0]] = step
                final.pop(put[1], None)
            elif self._is_grasp(step):
                final.pop(self._task.objects[step.object].place.on, None)
            else:
                final[step.object] = step
        return list(final.values())

    def _without(self, name: str, states: Sequence[_State]) -> list[Measurement] | None:
        """Return the measurements without step ``name``; None if it moves no joint or states cannot be built."""
        steps = self._task.steps
        step = next(step for step in steps if step.name == name)
        motion = self._task.motion_of(step)
        opennesses = [state.objects[step.object].openness for state in states[: steps.index(step) + 1]]
        if motion is None or min(abs((q or 0.0) - _wanted(motion)) for q in opennesses) < FAR:
            return None
        course = self._course([each for each in steps if each is not step])
        return None if course is None else [self._measured(state) for state in course]

    def _mutants(self, step: Step, before: _State, after: _State) -> Iterator[_Mutant]:
        """Yield states that equal ``after``, except that a step is not done.

        Args:
            step: the step that is not done.
            before: state before the step, in which the object has its original position.
            after: state in which the step is done.
        """
        if (motion := self._task.motion_of(step)) is not None:
            yield from self._joint_mutants(step.object, _wanted(motion), before, after)
        elif (put := self._put_of(step)) is not None:
            yield from self._put_mutants(*put, before, after)
        elif self._is_grasp(step):
            yield from self._grasp_mutants(step.object, after)
        elif (way := self._way(step)) is not None:
            yield from self._carry_mutants(step.object, way, before, after)
        elif step.object in before.objects:
            at_start = after.with_objects(**{step.object: before.objects[step.object]})
            yield _Mutant(Mutation.AT_START, step.object, replace(at_start, hand=None))

    def _joint_mutants(self, name: str, wanted: float, before: _State, after: _State) -> Iterator[_Mutant]:
        begin = before.objects[name].openness
        assert begin is not None
        tried = {
            Mutation.AT_START: [begin],
            Mutation.A_LITTLE: [begin + (wanted - begin) / 4],
            Mutation.WRONG_WAY: [0.0, 1.0],
        }
        for mutation, opennesses in tried.items():
            for openness in opennesses:
                if abs(openness - wanted) >= FAR:
                    yield _Mutant(mutation, name, after.with_openness(name, openness))
        if abs(begin - wanted) < FAR:
            return
        for other, thing in after.objects.items():
            if other != name and isinstance(thing.model, ArticulatedObject):
                swapped = after.with_openness(name, begin).with_openness(other, wanted)
                yield _Mutant(Mutation.WRONG_OBJECT, name, swapped)

    def _put_mutants(self, name: str, goal: str, before: _State, after: _State) -> Iterator[_Mutant]:
        was, now = before.objects[name], after.objects[name]
        at_start = replace(after.with_objects(**{name: was}), carried={}, hand=None)
        yield _Mutant(Mutation.AT_START, name, at_start)
        for place in self._beside(now, goal, after):
            let_go = replace(after.with_objects(**{name: place}), hand=None)
            yield _Mutant(Mutation.BESIDE, name, let_go, settles=True)
        target = after.objects[goal]
        if is_container(target.model):
            closed = after.with_openness(goal, 0.0)
            on_top = _standing(now, closed.objects[goal].point()[:2], _top(closed.objects[goal]))
            let_go = replace(closed.with_objects(**{name: on_top}), hand=None)
            yield _Mutant(Mutation.ON_TOP, name, let_go, settles=True)
        over = _standing(now, _middle(now)[:2], self._top_of_measured_link(after, goal) + ABOVE)
        yield _Mutant(Mutation.IN_THE_AIR, name, replace(after.with_objects(**{name: over}), hand=_middle(over)))
        for other, thing in after.objects.items():
            if other not in (name, goal) and isinstance(thing.model, RigidObject):
                low = _bounds(now)[0, 2]
                swapped = at_start.with_objects(**{other: _standing(thing, _middle(now)[:2], low)})
                yield _Mutant(Mutation.WRONG_OBJECT, name, swapped)
        if isinstance(target.model, RigidObject):
            on_it = _standing(target, _middle(was)[:2], _bounds(was)[1, 2])
            yield _Mutant(Mutation.GOAL_MOVED, name, at_start.with_objects(**{goal: on_it}))

    def _carry_mutants(self, name: str, way: Array, before: _State, after: _State) -> Iterator[_Mutant]:
        was = before.objects[name]
        at_start = replace(after.with_objects(**{name: was}), hand=None)
        yield _Mutant(Mutation.AT_START, name, at_start)
        sideways, lift = np.array([*way[:2], 0.0]), np.array([0.0, 0.0, way[2]])
        if sideways.any():
            across = np.array([-sideways[1], sideways[0], 0.0])
            for wrong in (-sideways, across, -across):
                yield _Mutant(Mutation.WRONG_WAY, name, _carried(before, name, wrong + lift))
            slightly = SLIGHTLY * sideways / float(np.linalg.norm(sideways))
            yield _Mutant(Mutation.A_LITTLE, name, _carried(before, name, slightly + lift))
        if lift.any():
            slightly = np.array([0.0, 0.0, SLIGHTLY])
            yield _Mutant(Mutation.A_LITTLE, name, _carried(before, name, sideways + slightly))
            for slid in [sideways] if sideways.any() else [CARRIED * np.array([*d, 0.0]) for d in DIRECTIONS.values()]:
                yield _Mutant(Mutation.ON_THE_TABLE, name, at_start.with_objects(**{name: _shifted(was, slid)}))
            for axis in ("x", "y"):
                turned = Rotation.from_euler(axis, np.pi / 2) * Rotation.from_quat(was.quaternion, scalar_first=True)
                tipped = replace(was, quaternion=turned.as_quat(scalar_first=True))
                lying = _standing(tipped, _middle(was)[:2] + sideways[:2], 0.0)
                yield _Mutant(Mutation.ON_THE_TABLE, name, at_start.with_objects(**{name: lying}), settles=True)
        for other, thing in before.objects.items():
            if other != name and isinstance(thing.model, RigidObject):
                yield _Mutant(Mutation.WRONG_OBJECT, name, _carried(at_start, other, way))

    def _grasp_mutants(self, name: str, after: _State) -> Iterator[_Mutant]:
        above = _middle(after.objects[name])
        above[2] = _bounds(after.objects[name])[1, 2] + HAND_ABOVE
        hands: list[Array | None] = [None, above]
        for other, thing in after.objects.items():
            apart = float(np.linalg.norm((_middle(thing) - _middle(after.objects[name]))[:2]))
            if other != name and isinstance(thing.model, RigidObject) and apart > CARRIED / 2:
                hands.append(_middle(thing))
        for hand in hands:
            yield _Mutant(Mutation.HAND_AWAY, name, replace(after, hand=hand))

    def _beside(self, thing: PlacedObject, goal: str, state: _State) -> Iterator[PlacedObject]:
        """Yield places for an object on the table beside its goal, in four directions, where there is space."""
        outlines = {name: _outline(other) for name, other in state.objects.items() if other.model is not thing.model}
        low, high = table_corners()[:, :2].min(axis=0), table_corners()[:, :2].max(axis=0)
        middle = state.objects[goal].point()[:2]
        for direction in DIRECTIONS.values():
            for distance in np.arange(0.0, 1.0, 0.01):
                place = _standing(thing, middle + distance * np.array(direction), 0.0)
                shape = _outline(place)
                if gap_between(shape, outlines[goal]) < APART:
                    continue
                others = all(gap_between(shape, other) > 0.0 for other in outlines.values())
                if others and (shape >= low).all() and (shape <= high).all():
                    yield place
                break

    def _top_of_measured_link(self, state: _State, name: str) -> float:
        thing = state.objects[name]
        if isinstance(thing.model, RigidObject):
            return _top(thing)
        hulls = np.concatenate(thing.model.hulls[measured_link(thing.model)])
        pose = measured_pose(thing)
        return float((hulls @ pose[:3, :3].T + pose[:3, 3])[:, 2].max())

    def _measured(self, state: _State) -> Measurement:
        found = measure_initial_state(replace(self._start, objects=state.objects), self._env.profile)
        return self._with_start(found, state.hand)

    def _of(self, mutant: _Mutant) -> Measurement:
        """Return the measurement of a mutated state. If an object may fall, the state is simulated first."""
        if not mutant.settles:
            return self._measured(mutant.state)
        things = mutant.state.objects
        options = {
            "pose": {name: [*thing.position, *thing.quaternion] for name, thing in things.items()},
            "openness": {name: thing.openness for name, thing in things.items() if thing.openness is not None},
        }
        self._env.reset(self._seed, options, robot=False)
        for _ in range(self._env.profile.steps(SETTLING)):
            self._env.wait()
        return self._with_start(self._env.measure(), mutant.state.hand)

    def _with_start(self, found: Measurement, hand: Array | None) -> Measurement:
        """Return a copy of ``found`` with the initial positions of objects and hand (or ``hand``) as the start."""
        starts = {name: self._first.objects[name].position for name in found.start_positions}
        gripper = self._env.profile.gripper_with(self._start.start)
        if hand is not None:
            shift = hand - next(iter(gripper.values()))
            gripper = {name: at + shift for name, at in gripper.items()}
        return replace(found, start_positions=starts, gripper=gripper)


def _wanted(motion: JointCriterion) -> float:
    """Return the target openness of a criterion about a joint."""
    if isinstance(motion, ArticulatedBetween):
        return (motion.low + motion.high) / 2
    return float(isinstance(motion, ArticulatedOpen))


def _put(state: _State, name: str, goal: str) -> _State | None:
    """Put a rigid object on, in or below another, with the hand at it; None if a container is too small."""
    thing, target = state.objects[name], state.objects[goal]
    opened = replace(target, openness=1.0) if target.openness is not None else target
    for turn in (Rotation.identity(), Rotation.from_euler("x", np.pi / 2), Rotation.from_euler("y", np.pi / 2)):
        turned = turn * Rotation.from_quat(thing.quaternion, scalar_first=True)
        lying = replace(thing, quaternion=turned.as_quat(scalar_first=True))
        standing = _standing(lying, opened.point()[:2], 0.0)
        lowered = (set_down(standing, opened, above) for above in LOWERED_FROM)
        if (found := next((each for each in lowered if each is not None), None)) is not None:
            T = measured_pose(target) @ np.linalg.inv(measured_pose(opened))
            carried = {**state.carried, name: goal} if target.openness is not None else state.carried
            placed = _transformed(found, T)
            return replace(state.with_objects(**{name: placed}), carried=carried, hand=_middle(placed))
    if is_container(target.model):
        return None
    standing = _standing(thing, target.point()[:2], 0.0)
    return replace(state.with_objects(**{name: standing}), hand=_middle(standing))


def _carried(state: _State, name: str, way: Array) -> _State:
    """Move a rigid object, and place the hand at the moved object."""
    moved = _shifted(state.objects[name], way)
    return replace(state.with_objects(**{name: moved}), hand=_middle(moved))


def _shifted(thing: PlacedObject, way: Array) -> PlacedObject:
    return replace(thing, position=np.asarray(thing.position + way, dtype=np.float64))


def _standing(thing: PlacedObject, at: Array, height: float) -> PlacedObject:
    """Shift an object so that its middle is over ``at`` (2,) and its lowest point at ``height``, m."""
    low, high = _bounds(thing)
    return _shifted(thing, np.array([*(at - (low + high)[:2] / 2), height - low[2]]))


def _transformed(thing: PlacedObject, T: Array) -> PlacedObject:
    turned = Rotation.from_matrix(T[:3, :3]) * Rotation.from_quat(thing.quaternion, scalar_first=True)
    position = np.asarray(T[:3, :3] @ thing.position + T[:3, 3], dtype=np.float64)
    return replace(thing, position=position, quaternion=turned.as_quat(scalar_first=True))


def _bounds(thing: PlacedObject) -> Array:
    """Return the lowest and the highest corner (2, 3) of an object, m."""
    corners = np.concatenate(thing.hulls_in_world())
    return np.stack([corners.min(axis=0), corners.max(axis=0)])


def _middle(thing: PlacedObject) -> Array:
    return np.asarray(_bounds(thing).mean(axis=0), dtype=np.float64)


def _top(thing: PlacedObject) -> float:
    return float(_bounds(thing)[1, 2])


def _outline(thing: PlacedObject) -> Array:
    return outline(np.concatenate(thing.hulls_in_world()), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
