"""Order and tolerances of the strategies that plans are taught by, so that similar scenes get similar plans."""

from __future__ import annotations

from dataclasses import replace

from gensim2.planning.strategies import KeypointStrategy, PullStrategy, Strategy
from gensim2.rollout.inputs import TaskInput
from gensim2.rollout.worker import parsed
from gensim2.tasks.spec import Step
from gensim2.tasks.strategies import with_strategies

CENTERED = 0.25
"""Share of the tolerance of a strategy's points within which what the hand holds is put down first. The solver's poses
are those of least motion, mostly at the edge of the tolerance; an edge leaves a policy's own errors no room, and which
one it is jumps between scenes that hardly differ."""

PATIENCE = 8
"""Grasps that serve nothing before a scene is left out. Where one serves, it is nearly always the first; to know that
none does takes as long as sixty scenes of which there are plans."""


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


def centered(strategy: Strategy) -> Strategy:
    """A strategy whose points keep to ``CENTERED`` of their tolerances; one without points as it is."""
    if not isinstance(strategy, KeypointStrategy):
        return strategy
    constraints = [
        {**each, "tolerance": CENTERED * each["tolerance"]} if each["type"] == "point2point_constraint" else each
        for each in strategy.config["constraint_list"]
    ]
    return KeypointStrategy({**strategy.config, "constraint_list": constraints})
