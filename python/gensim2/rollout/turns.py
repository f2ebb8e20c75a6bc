"""Assign measurements to the steps of a task."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from gensim2.rollout.controller_spec import ControllerError
from gensim2.rollout.record import StepRecord
from gensim2.tasks.criteria import all_hold, all_hold_in_paper
from gensim2.tasks.measurement import Measurement
from gensim2.tasks.spec import Step, TaskSpec


@dataclass(frozen=True)
class Turn:
    """Interval of an episode in which one step of the task was executed.

    Attributes:
        step: executed step.
        first, last: indices of the first and last measurement in the interval, which may be equal.
        paper: whether ``step.done`` was met at any measurement in the interval, as the ``paper`` verdict requires.
        done: whether ``step.done`` was met at the last measurement.
    """

    step: Step
    first: int
    last: int
    paper: bool
    done: bool


def told_turns(
    task: TaskSpec, trace: Sequence[Measurement], begun: Sequence[tuple[str, int]], every: int = 1
) -> tuple[Turn, ...]:
    """Return the interval in which each step of the task was executed, for a controller that reports its current step.

    Args:
        trace: measurements before the first control step and after each one.
        begun: name of each started step, and the index of the step's first measurement in ``trace``.
        every: number of control steps between evaluations of the criteria.

    Raises:
        ControllerError: the controller reported the name of a step that the task does not have.
    """
    steps = {step.name: step for step in task.steps}
    for name, _ in begun:
        if name not in steps:
            wrong = f"{name!r} is not a step of the task; the steps are: {', '.join(steps)}"
            raise ControllerError(wrong, field="turn")
    ends = [first for _, first in begun[1:]] + [len(trace) - 1]
    return tuple(_turn(steps[name], trace, first, last, every) for (name, first), last in zip(begun, ends, strict=True))


def turns_by_criteria(task: TaskSpec, trace: Sequence[Measurement], every: int = 1) -> tuple[Turn, ...]:
    """Return the turns of a controller that does not report steps; a turn ends when the step's criterion is met.

    Args:
        trace: measurements before the first control step and after each one.
        every: control steps between evaluations of the criteria.
    """
    turns: list[Turn] = []
    first = 0
    for step in task.steps:
        looks = _looks(first, len(trace) - 1, every)
        last = next((i for i in looks if all_hold_in_paper(step.done, trace[i])), len(trace) - 1)
        turns.append(_turn(step, trace, first, last, every))
        if not turns[-1].paper:
            break
        first = last
    return tuple(turns)


def goal_reached(task: TaskSpec, end: Measurement, turns: Sequence[Turn]) -> bool:
    """Return whether the goal is reached at the end of the episode.

    The final state does not show steps that a later step undoes, such as the opening of a drawer that is closed later.
    Such steps must have been done when they were executed.
    """
    done = {turn.step.name for turn in turns if turn.paper}
    return all_hold(task.success, end) and task.transient <= done


def paper_verdict(task: TaskSpec, turns: Sequence[Turn]) -> bool:
    """Return whether each step's criterion was met at some control step while the step was executed."""
    accomplished = {turn.step.name for turn in turns if turn.paper}
    return all(step.name in accomplished for step in task.steps)


def judged_steps(history: Sequence[StepRecord], turns: Sequence[Turn]) -> list[StepRecord]:
    """Return a record of results for each started step. If there is no history, the records are made from the turns."""
    own: dict[str, list[Turn]] = {}
    for turn in turns:
        own.setdefault(turn.step.name, []).append(turn)
    records = history or [StepRecord(name, [], False, False) for name in own]
    return [
        # A step that lies within a single action has no interval of measurements.
        replace(record, paper=any(t.paper for t in own[record.name]), done=own[record.name][-1].done)
        if record.name in own
        else record
        for record in records
    ]


def _turn(step: Step, trace: Sequence[Measurement], first: int, last: int, every: int) -> Turn:
    paper = any(all_hold_in_paper(step.done, trace[look]) for look in _looks(first, last, every))
    return Turn(step, first, last, paper, all_hold(step.done, trace[last]))


def _looks(first: int, last: int, every: int) -> list[int]:
    """Return the indices of a turn's measurements at which its criterion is evaluated."""
    looks = [index for index in range(first, last + 1) if index % every == 0]
    return looks if looks and looks[-1] == last else [*looks, last]
