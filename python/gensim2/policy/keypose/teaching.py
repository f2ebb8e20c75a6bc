"""Order and tolerances of the strategies that make training plans, so that similar scenes get similar plans."""

from __future__ import annotations

from dataclasses import replace

from gensim2.planning.strategies import KeypointStrategy, PullStrategy, Strategy
from gensim2.rollout.inputs import TaskInput
from gensim2.rollout.worker import parsed
from gensim2.tasks.spec import Step
from gensim2.tasks.strategies import with_strategies

CENTERED = 0.25
"""Share of a strategy's tolerance within which a grasped object is placed first. The solver's poses need the least
motion and are mostly at an edge of the tolerance. An edge leaves no margin for a policy's errors, and the solver's
choice of the edge jumps between similar scenes.
"""

PATIENCE = 8
"""Number of failed grasps after which a scene is left out. A working grasp is nearly always the first one. To rule out
all grasps of a scene takes as long as sixty scenes with plans.
"""


def pulls_last(given: TaskInput) -> TaskInput:
    """Return the task with grasp-search strategies moved behind all other strategies of each step.

    A searched grasp jumps between similar scenes, for example from a knob to an edge, and a network predicts a useless
    average. The order of the other strategies stays.
    """
    known = parsed(given.strategies)

    def order(step: Step) -> list[str]:
        return sorted(step.strategies, key=lambda name: isinstance(known[name], PullStrategy))

    ways = {step.name: {name: given.strategies[name] for name in order(step)} for step in given.spec.steps}
    return replace(given, scene=replace(given.scene, task=with_strategies(given.spec, ways)))


def centered(strategy: Strategy) -> Strategy:
    """Return the strategy with its point tolerances multiplied by ``CENTERED``; other strategies stay as they are."""
    if not isinstance(strategy, KeypointStrategy):
        return strategy
    constraints = [
        {**each, "tolerance": CENTERED * each["tolerance"]} if each["type"] == "point2point_constraint" else each
        for each in strategy.config["constraint_list"]
    ]
    return KeypointStrategy({**strategy.config, "constraint_list": constraints})
