"""Order of a task's strategies for teaching: similar scenes should get similar plans."""

from __future__ import annotations

from dataclasses import replace

from gensim2.planning.strategies import PullStrategy
from gensim2.rollout.inputs import TaskInput
from gensim2.rollout.worker import parsed
from gensim2.tasks.spec import Step
from gensim2.tasks.strategies import with_strategies


def pulls_last(given: TaskInput) -> TaskInput:
    """A task whose steps try every other strategy before those that search for a grasp on what a joint moves.

    Such a grasp jumps between scenes that hardly differ, from a knob to an edge, and what a network makes of it lies in
    between. The order of the others stays.
    """
    known = parsed(given.strategies)

    def order(step: Step) -> list[str]:
        return sorted(step.strategies, key=lambda name: isinstance(known[name], PullStrategy))

    ways = {step.name: {name: given.strategies[name] for name in order(step)} for step in given.spec.steps}
    return replace(given, scene=replace(given.scene, task=with_strategies(given.spec, ways)))
