"""Design tasks and strategies without a language model.

The designer derives single-step tasks from the joints and sizes of objects, and combines these tasks to longer ones, in
which steps establish the preconditions of later steps. Strategies come from rules, and then from a search over
alignments, keypoints and motions. Simulation decides which strategies are used.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from gensim2.core import seeding
from gensim2.design import chores, containers, joint_search, proposals, serving, skills, steering
from gensim2.design.affordance import Affordance
from gensim2.design.base import Brief, Candidate, CandidateResult, Declined
from gensim2.design.drafting import ENDS, Family, chains, piece_ways
from gensim2.design.manipulation import Manipulation
from gensim2.objects.words import Goal, belongs
from gensim2.tasks.criteria import ArticulatedBetween, ArticulatedClosed, ArticulatedOpen, Criterion, RigidMoved
from gensim2.tasks.likeness import first_alike, joint_goal, starts_below
from gensim2.tasks.spec import HAND, Step, TaskSpec
from gensim2.tasks.strategies import Strategies

#: Generators of long tasks by kind; the designer uses the generators in turn, in this order.
FAMILIES: list[Family] = [
    chores.FAMILIES["pairs"],
    serving.FAMILIES["serve"],
    containers.FAMILIES["drop"],
    chores.FAMILIES["to and fro"],
    containers.FAMILIES["shut"],
    chores.FAMILIES["errands"],
    containers.FAMILIES["take out"],
    chores.FAMILIES["pairs"],
    serving.FAMILIES["serve two"],
    containers.FAMILIES["put"],
    containers.FAMILIES["take out and close"],
    containers.FAMILIES["stow"],
    chores.FAMILIES["pairs"],
    serving.FAMILIES["lay"],
    containers.FAMILIES["move over"],
    containers.FAMILIES["open and take out"],
    containers.FAMILIES["move over and close"],
    containers.FAMILIES["fill and close"],
    containers.FAMILIES["fill"],
]


def long_tasks(brief: Brief) -> Iterator[TaskSpec | None]:
    """Yield new long tasks that are composed of known tasks.

    The kinds of long tasks take turns, and each task has a new name.

    Known tasks include the tasks kept since the last proposal. None means that no task can be composed yet.
    """
    proposed: set[str] = set()
    while True:
        fresh = False
        for family in FAMILIES:
            taken = proposed | {known.task.name for known in brief.known}
            task = next((draft.task() for draft in family(brief) if draft.name not in taken), None)
            if task is None:
                continue
            fresh = True
            proposed.add(task.name)
            assert not chains(task), f"{task.name}: {chains(task)}"
            if first_alike(task, brief.familiar) is None:
                yield task
        if not fresh:
            yield None


def wanted_ends(brief: Brief) -> set[tuple[str, str]]:
    """Return the joint goals (class and end state) that long tasks use as steps."""
    kept_in = {name for name, thing in brief.classes.items() if thing.is_container and belongs(name)}
    return chores.wanted_ends() | {(name, end) for name in kept_in for end in ENDS}


#: Number of alignments that are sampled for a joint. ``FIRST_DRAW`` are sampled first, and ``SECOND_DRAW`` more if no
#: alignment succeeds often enough.
FIRST_DRAW, SECOND_DRAW = 8, 60

#: A refinement has at most ``REFINE_ROUNDS`` rounds. Each has ``REFINE_CHILDREN`` variants of the ``REFINE_PARENTS``
#: best alignments.
REFINE_PARENTS = 3
REFINE_CHILDREN = 4
REFINE_ROUNDS = 3

#: Number of single-step tasks proposed before the first long task, because long tasks are composed of them.
FIRST_SINGLE = 12

#: Maximum number of strategies combined for one step.
TEAM = 3

OPENING: dict[Goal, bool] = {
    "articulated_open": True,
    "half_open": True,
    "articulated_closed": False,
    "half_closed": False,
}


class OfflineDesigner:
    """Designer that proposes tasks by rules and searches for strategies, without a language model."""

    name = "offline"
    notes: Sequence[str] = ()
    patience = 1

    def open(self, folder: Path) -> None:
        """Do nothing: this designer keeps no records."""

    def propose(self, brief: Brief, seed: int) -> Iterator[TaskSpec]:
        """Yield single-step tasks. After the first few, alternate them with long tasks composed of known tasks."""
        known = [each.task for each in brief.known]
        wanted = wanted_ends(brief)
        single = proposals.propose(brief.classes, known, brief.settings.stroke, brief.familiar, wanted)
        yield from itertools.islice(single, FIRST_SINGLE)
        long = long_tasks(brief)
        while True:
            found = [task for task in (next(single, None), next(long, None)) if task is not None]
            if not found:
                return
            yield from found

    def candidates(self, task: TaskSpec, brief: Brief, seed: int) -> list[Candidate]:
        """Return the first candidates: all rules together, each rule alone and, for a joint, also random alignments."""
        if task.is_single_step and (goal := joint_goal(task)) is not None:
            step, thing = task.steps[0], brief.classes[goal[0]]
            if not thing.lever_arms:
                raise Declined("the objects of the class share no keypoint on the moving part")
            end = _end(task.success[0])
            rules = skills.joint_ways(
                thing, "open" if OPENING[goal[1]] else "close", end if goal[1].startswith("half") else None
            )
            teams = [_rules(step, rules), _rules(step, dict(reversed(rules.items())))]
            alone = [_rules(step, {name: data}) for name, data in rules.items()]
            likely = joint_search.likely(thing, OPENING[goal[1]], end)
            drawn = _drawn(task, thing, OPENING[goal[1]], end, FIRST_DRAW, seed)
            return [*teams, *alone, *(_candidate(task, each) for each in likely), *drawn]
        ways = {step.name: self._ways(task, step, brief) for step in task.steps}
        return _orders(ways)

    def refine(
        self, task: TaskSpec, brief: Brief, results: Sequence[CandidateResult], seed: int, round: int
    ) -> list[Candidate]:
        """Return combinations and variations of the best candidates, and untried alignments that are near successful
        ones.
        """
        if round >= REFINE_ROUNDS:
            return []
        seen = {str(result.candidate.steps) for result in results}
        if not task.is_single_step or (goal := joint_goal(task)) is None:
            return [each for each in _reordered(results) if str(each.steps) not in seen]
        found = [_team(task.steps[0], group) for group in _groups(results)]
        generator = seeding.rng(seed, f"{task.name}/refine", round)
        halfway = goal[1].startswith("half")
        drawn = [result for result in results if "approach" in result.candidate.provenance and result.held]
        parents = drawn[:REFINE_PARENTS]
        for parent in parents:
            manipulation = joint_search.manipulation_from(parent.candidate.provenance)
            for _ in range(REFINE_CHILDREN):
                found.append(_candidate(task, joint_search.vary(manipulation, halfway, generator)))
        if round == 0:
            every = list(joint_search.alignments(brief.classes[goal[0]], OPENING[goal[1]], _end(task.success[0])))
            found += [_candidate(task, each) for each in steering.draw(every, results, SECOND_DRAW, generator)]
        return list({str(each.steps): each for each in found if str(each.steps) not in seen}.values())

    @staticmethod
    def _ways(task: TaskSpec, step: Step, brief: Brief) -> Strategies:
        things = brief.of(task)
        thing = things[step.object]
        if step.tool == HAND and thing.kind == "rigid":
            moved = next((criterion for criterion in step.done if isinstance(criterion, RigidMoved)), None)
            return skills.grasps() if moved is None else skills.hand_overs(thing, moved.direction)
        if step.tool != HAND and things[step.tool].kind == "rigid":
            held = things[step.tool]
            if thing.kind == "rigid":
                return skills.places_on(thing, held)
            if thing.is_container:
                # Several objects in one container lie side by side.
                tools = [each.tool for each in task.steps if each.object == step.object and each.tool != HAND]
                aside = skills.ASIDE * (len(tools) - 1 - 2 * tools.index(step.tool))
                return skills.places_in(thing, held, aside)
        for criterion in step.done:
            if isinstance(criterion, ArticulatedOpen | ArticulatedClosed | ArticulatedBetween):
                if isinstance(criterion, ArticulatedBetween):
                    opens = starts_below(task, criterion)
                    return skills.joint_ways(thing, "open" if opens else "close", _end(criterion))
                return piece_ways(brief, thing.asset_class, criterion.type) or skills.joint_ways(
                    thing, "open" if isinstance(criterion, ArticulatedOpen) else "close"
                )
        raise Declined(f"the offline designer has no strategy for the step {step.name!r}")


def _rules(step: Step, rules: Strategies) -> Candidate:
    label = " or else ".join(name.replace("_", " ") for name in rules)
    return Candidate(label, {step.name: rules}, {"rules": list(rules)})


def _drawn(task: TaskSpec, thing: Affordance, opening: bool, end: float, count: int, seed: int) -> list[Candidate]:
    drawn = joint_search.sample(thing, opening, end, count, seed, f"{task.name}/candidates")
    return [_candidate(task, manipulation) for manipulation in drawn]


def _end(criterion: Criterion) -> float:
    """Return the openness at which a commanded motion must end so that the joint meets ``criterion``."""
    if isinstance(criterion, ArticulatedBetween):
        return 0.5 * (criterion.low + criterion.high)
    return joint_search.OPENED if isinstance(criterion, ArticulatedOpen) else joint_search.CLOSED_UP


def _candidate(task: TaskSpec, manipulation: Manipulation) -> Candidate:
    step = task.steps[0]
    name, label = step.strategies[0], manipulation.label
    return Candidate(label, {step.name: {name: manipulation.config()}}, manipulation.provenance(), {name: label})


def _groups(results: Sequence[CandidateResult]) -> list[list[CandidateResult]]:
    """Return groups of the best two and three candidates with a success and a single strategy, to be combined."""
    alone = [result for result in results if result.held and len(result.candidate.strategies) == 1]
    return [alone[:count] for count in range(2, TEAM + 1) if len(alone) >= count]


def _team(step: Step, group: Sequence[CandidateResult]) -> Candidate:
    """Return one candidate with all strategies of ``group``. In each scene, the first strategy with a plan is used."""
    ways: Strategies = {}
    labels = {}
    for number, result in enumerate(group, 1):
        ((name, data),) = result.candidate.strategies.items()
        own = name if name != step.strategies[0] else f"{name}_{number}"
        ways[own], labels[own] = data, result.candidate.label
    label = " or else ".join(labels.values())
    return Candidate(label, {step.name: ways}, {"team": [result.candidate.provenance for result in group]}, labels)


def _orders(ways: dict[str, Strategies]) -> list[Candidate]:
    """Return a candidate with all strategies, and variants with the first at the end, in a step or in all."""
    turned = {name: dict([*list(own.items())[1:], *list(own.items())[:1]]) for name, own in ways.items()}
    found = [Candidate("every step by its first rule that serves", ways, {"turned": []})]
    several = [name for name, own in ways.items() if len(own) > 1]
    for group in [*([name] for name in several), several]:
        steps = {name: turned[name] if name in group else own for name, own in ways.items()}
        label = f"another rule first for {', '.join(group)}"
        if all(str(steps) != str(other.steps) for other in found):
            found.append(Candidate(label, steps, {"turned": list(group)}))
    return found


def _reordered(results: Sequence[CandidateResult]) -> list[Candidate]:
    """Return the two best candidates with another order of strategies in the step that fails most often."""
    found = []
    for result in results[:2]:
        blamed = next((each.step for each in result.diagnoses if each.step in result.candidate.steps), None)
        if blamed is None or len(result.candidate.steps[blamed]) < 2:
            continue
        items = list(result.candidate.steps[blamed].items())
        for order in itertools.islice(itertools.permutations(items[:3]), 1, 4):
            steps: dict[str, Any] = {**result.candidate.steps, blamed: dict([*order, *items[3:]])}
            label = f"{result.candidate.label}; {blamed} reordered"
            found.append(Candidate(label, steps, {"blamed": blamed}, result.candidate.labels))
    return found
