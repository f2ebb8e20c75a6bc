"""Reorder the strategies that create training plans, so that the planner makes similar plans in similar scenes."""

from __future__ import annotations

from dataclasses import replace

from gensim2.planning.strategies import PullStrategy
from gensim2.rollout.inputs import TaskInput
from gensim2.rollout.worker import parsed
from gensim2.tasks.spec import Step
from gensim2.tasks.strategies import with_strategies

PATIENCE = 8
"""Number of failed grasps after which a scene is left out. If a scene has a usable grasp, the first one nearly always
works; trying all grasps takes as long as planning sixty scenes.
"""


def pulls_last(given: TaskInput) -> TaskInput:
    """Return the task with the strategies of each step reordered: pulls, which search for a grasp, come last.

    In two similar scenes, the grasp search can find very different grasps, for example at a knob and at an edge. A
    network trained on such examples predicts a useless average of the grasps.
    """
    known = parsed(given.strategies)

    def order(step: Step) -> list[str]:
        return sorted(step.strategies, key=lambda name: isinstance(known[name], PullStrategy))

    ways = {step.name: {name: given.strategies[name] for name in order(step)} for step in given.spec.steps}
    return replace(given, scene=replace(given.scene, task=with_strategies(given.spec, ways)))
