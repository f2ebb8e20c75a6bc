"""A designer that needs no key: it searches over alignments, keypoints and motions in the joint's own frame.

It knows nothing of any class. What it tries follows from the joint's type, from which keypoints the moving link has and
how far they lie from the axis, and from where the joint stands; physics says what holds.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

from gensim2 import seeding
from gensim2.designers import proposals
from gensim2.designers.base import Affordance, Candidate, CandidateResult
from gensim2.designers.manipulation import Axis, Direction, Manipulation, Motion
from gensim2.errors import InputError
from gensim2.tasks.criteria import ArticulatedOpen
from gensim2.tasks.spec import TaskSpec

#: First-round candidates a task; more are drawn only in refinement.
FIRST_ROUND = 240

#: How many of the best are varied in a round of refinement, and how often each.
REFINE_PARENTS = 4
REFINE_CHILDREN = 6
REFINE_ROUNDS = 2

_HALF = math.sqrt(0.5)
_AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_NAMES = "xyz"


def _directions() -> list[Direction]:
    """Six axes of the joint frame, their twelve diagonals, and three directions that an arm on a table is good at."""
    found = []
    for index, axis in enumerate(_AXES):
        for sign in (1.0, -1.0):
            vector = (sign * axis[0], sign * axis[1], sign * axis[2])
            found.append(Direction(f"{'+' if sign > 0 else '-'}{_NAMES[index]}", "joint", vector))
    for i, j in itertools.combinations(range(3), 2):
        for a, b in itertools.product((1.0, -1.0), repeat=2):
            v = [0.0, 0.0, 0.0]
            v[i], v[j] = a * _HALF, b * _HALF
            name = f"{'+' if a > 0 else '-'}{_NAMES[i]}{'+' if b > 0 else '-'}{_NAMES[j]}"
            found.append(Direction(name, "joint", (v[0], v[1], v[2])))
    found.append(Direction("straight down", "world", (0.0, 0.0, -1.0)))
    found.append(Direction("forward and down", "world", (_HALF, 0.0, -_HALF)))
    found.append(Direction("forward", "world", (1.0, 0.0, 0.0)))
    return found


DIRECTIONS = tuple(_directions())


def _pushes_from_the_wrong_side(direction: Direction, opening: bool) -> bool:
    """True where the fingers would point against the motion, so the palm would have to pass through the part."""
    along = direction.vector[1] if direction.frame == "joint" else 0.0
    return (along if opening else -along) < -0.5


class OfflineDesigner:
    """Proposes what the library lacks and searches for how to do it."""

    name = "offline"

    def propose(self, affordances: Iterable[Affordance], known: Sequence[TaskSpec], seed: int) -> Iterator[TaskSpec]:
        """Yield tasks that ``known`` lacks, in the order in which the affordances come."""
        return proposals.propose(affordances, known)

    def candidates(self, task: TaskSpec, affordance: Affordance, seed: int) -> list[Candidate]:
        """Return the first round: every alignment, thinned by a seeded draw where there are too many."""
        if proposals.affordance_of(task) is None:
            raise InputError(
                f"{task.name} is not one step that opens or closes one joint",
                field="target_task",
                remedy="the offline designer designs such tasks only",
            )
        opening = isinstance(task.success[0], ArticulatedOpen)
        manipulations = list(self._grid(affordance, opening))
        if len(manipulations) > FIRST_ROUND:
            generator = seeding.rng(seed, f"{task.name}/candidates")
            chosen = sorted(generator.choice(len(manipulations), FIRST_ROUND, replace=False).tolist())
            manipulations = [manipulations[index] for index in chosen]
        return [self._candidate(task, manipulation) for manipulation in manipulations]

    def refine(
        self,
        task: TaskSpec,
        affordance: Affordance,
        results: Sequence[CandidateResult],
        seed: int,
        round: int,
    ) -> list[Candidate]:
        """Vary the offsets, the reach and the tolerance of the best so far."""
        if round >= REFINE_ROUNDS:
            return []
        generator = seeding.rng(seed, f"{task.name}/refine", round)
        seen = {str(result.candidate.steps) for result in results}
        children: list[Candidate] = []
        for result in results[:REFINE_PARENTS]:
            parent = manipulation_from(result.candidate.provenance)
            for _ in range(REFINE_CHILDREN):
                step = 1.0 if parent.opening else -1.0
                child = replace(
                    parent,
                    behind=round_to(max(0.0, parent.behind + generator.uniform(-0.02, 0.03))),
                    inset=round_to(max(-0.01, parent.inset + generator.uniform(-0.02, 0.03))),
                    retreat=round_to(min(0.16, max(0.05, parent.retreat + generator.uniform(-0.04, 0.04)))),
                    goal_openness=round_to(parent.goal_openness + step * generator.uniform(-0.1, 0.2), 0.05),
                    tolerance=float(generator.choice([0.05, 0.15, 0.3, 0.5])),
                    motion="trace_joint_to" if generator.random() < 0.3 else parent.motion,
                )
                candidate = self._candidate(task, child)
                if str(candidate.steps) not in seen:
                    seen.add(str(candidate.steps))
                    children.append(candidate)
        return children

    def _grid(self, affordance: Affordance, opening: bool) -> Iterator[Manipulation]:
        reach = 1.05 if opening else -0.1
        longest = max(affordance.lever_arms.values(), default=0.0)
        for keypoint in affordance.keypoints:
            if longest and affordance.lever_arms[keypoint] < 0.3 * longest:
                continue  # too near the hinge to move it
            for direction in DIRECTIONS:
                yield from self._pushes(keypoint, direction, opening, reach)
                yield from self._grasps(keypoint, direction, opening, reach)

    @staticmethod
    def _pushes(keypoint: str, direction: Direction, opening: bool, goal: float) -> Iterator[Manipulation]:
        """Closed fingers, which are nearly round: their roll is left to the solver."""
        if _pushes_from_the_wrong_side(direction, opening):
            return
        motions: tuple[Motion, ...] = ("follow_joint_to", "trace_joint_to")
        for (behind, inset), motion in itertools.product(((0.0, 0.0), (0.03, 0.0), (0.03, 0.03)), motions):
            yield Manipulation(
                keypoint=keypoint,
                gripper="closed",
                approach=direction,
                roll=None,
                behind=behind,
                inset=inset,
                retreat=0.1,
                motion=motion,
                goal_openness=goal,
                tolerance=0.3,
                opening=opening,
            )

    @staticmethod
    def _grasps(keypoint: str, direction: Direction, opening: bool, goal: float) -> Iterator[Manipulation]:
        """Fingers that close across one axis of the joint frame: without it they would miss thin parts."""
        axes: tuple[Axis, ...] = ("x", "y", "z")
        for roll, inset in itertools.product(axes, (0.0, 0.015)):
            if direction.frame == "joint" and abs(direction.vector["xyz".index(roll)]) > 0.9:
                continue  # orthogonal already
            yield Manipulation(
                keypoint=keypoint,
                gripper="grasp",
                approach=direction,
                roll=roll,
                behind=0.0,
                inset=inset,
                retreat=0.1,
                motion="follow_joint_to",
                goal_openness=goal,
                tolerance=0.15,
                opening=opening,
            )

    @staticmethod
    def _candidate(task: TaskSpec, manipulation: Manipulation) -> Candidate:
        step = task.steps[0]
        strategies = {step.strategies[0]: manipulation.config(task.name)}
        return Candidate(manipulation.label, {step.name: strategies}, manipulation.provenance())


def manipulation_from(provenance: dict[str, Any]) -> Manipulation:
    """Return the manipulation whose ``provenance()`` this is."""
    values = dict(provenance)
    approach = values.pop("approach")
    return Manipulation(approach=Direction(approach["name"], approach["frame"], tuple(approach["vector"])), **values)


def round_to(value: float, step: float = 0.005) -> float:
    """Round to a multiple of ``step``, so that configs stay legible."""
    return round(round(value / step) * step, 6)
