"""Assignment of measurements to the steps of a task."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from gensim2.rollout.controller_spec import ControllerError
from gensim2.rollout.record import StepRecord
from gensim2.tasks.criteria import all_hold
from gensim2.tasks.measurement import Measurement
from gensim2.tasks.spec import Step, TaskSpec


@dataclass(frozen=True)
class Turn:
    """One step's turn.

    Attributes:
        step: of the task.
        first, last: numbers of the measurements at which it began and ended; a turn that ended as it began has one.
        paper: ``step.done`` was true at one of them.
        done: it was true at the last.
    """

    step: Step
    first: int
    last: int
    paper: bool
    done: bool


def told_turns(
    task: TaskSpec, trace: Sequence[Measurement], begun: Sequence[tuple[str, int]], every: int = 1
) -> tuple[Turn, ...]:
    """The turns of a controller that says what it is at.

    Args:
        task: what was to be done.
        trace: measurements, before the first control step and after each.
        begun: name of each step that was begun, and the number of the measurement at which it was.
        every: control steps from one look at the criteria to the next.

    Raises:
        ControllerError: the task has no step of that name.
    """
    steps = {step.name: step for step in task.steps}
    for name, _ in begun:
        if name not in steps:
            raise ControllerError(f"{name!r} is no step of the task: {', '.join(steps)}", field="turn")
    ends = [first for _, first in begun[1:]] + [len(trace) - 1]
    return tuple(_turn(steps[name], trace, first, last, every) for (name, first), last in zip(begun, ends, strict=True))


def turns_by_criteria(task: TaskSpec, trace: Sequence[Measurement], every: int = 1) -> tuple[Turn, ...]:
    """The turns of a controller that knows nothing of steps: each ends as soon as its criterion is true.

    Args:
        task: what was to be done.
        trace: measurements, before the first control step and after each.
        every: control steps from one look at the criteria to the next.
    """
    turns: list[Turn] = []
    first = 0
    for step in task.steps:
        looks = _looks(first, len(trace) - 1, every)
        last = next((i for i in looks if all_hold(step.done, trace[i])), len(trace) - 1)
        turns.append(_turn(step, trace, first, last, every))
        if not turns[-1].done:
            break
        first = last
    return tuple(turns)


def paper_verdict(task: TaskSpec, turns: Sequence[Turn]) -> bool:
    """Whether every step of the task had a turn in which its criterion was true at some control step."""
    accomplished = {turn.step.name for turn in turns if turn.paper}
    return all(step.name in accomplished for step in task.steps)


def judged_steps(history: Sequence[StepRecord], turns: Sequence[Turn]) -> list[StepRecord]:
    """Return the record of each step that was begun, once whatever its turns; made up where there is no history."""
    own: dict[str, list[Turn]] = {}
    for turn in turns:
        own.setdefault(turn.step.name, []).append(turn)
    records = history or [StepRecord(name, [], False, False) for name in own]
    return [
        # A step that was over within one act had no turn.
        replace(record, paper=any(t.paper for t in own[record.name]), done=own[record.name][-1].done)
        if record.name in own
        else record
        for record in records
    ]


def _turn(step: Step, trace: Sequence[Measurement], first: int, last: int, every: int) -> Turn:
    paper = any(all_hold(step.done, trace[look]) for look in _looks(first, last, every))
    return Turn(step, first, last, paper, all_hold(step.done, trace[last]))


def _looks(first: int, last: int, every: int) -> list[int]:
    """Numbers of the measurements of a turn at which its criterion is read: every so many, and its last."""
    looks = [index for index in range(first, last + 1) if index % every == 0]
    return looks if looks and looks[-1] == last else [*looks, last]
