"""Plan one step in a scene.

The result is the arm's motion, its control steps, and the predicted scene after the step.
"""

from gensim2.planning.config import ObjectNames, check_strategies
from gensim2.planning.scene import JointState, Scene, SceneBody, SceneObject
from gensim2.planning.step_plan import StepPlan
from gensim2.planning.steps import PLAN_OPTIONS, StepPlanner
from gensim2.planning.strategies import GraspStrategy, KeypointStrategy, PullStrategy, Strategy, parse_strategy

__all__ = [
    "PLAN_OPTIONS",
    "GraspStrategy",
    "JointState",
    "KeypointStrategy",
    "ObjectNames",
    "PullStrategy",
    "Scene",
    "SceneBody",
    "SceneObject",
    "StepPlan",
    "StepPlanner",
    "Strategy",
    "check_strategies",
    "parse_strategy",
]
