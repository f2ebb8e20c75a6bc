"""Define tasks (objects, steps and a goal), and read the library of tasks and strategies, which are YAML files."""

from gensim2.tasks.criteria import Criterion
from gensim2.tasks.library import load_strategies, load_task, task_names
from gensim2.tasks.measurement import Measurement
from gensim2.tasks.spec import ObjectSpec, Place, Provenance, Randomization, Step, TaskSpec, Verified

__all__ = [
    "Criterion",
    "Measurement",
    "ObjectSpec",
    "Place",
    "Provenance",
    "Randomization",
    "Step",
    "TaskSpec",
    "Verified",
    "load_strategies",
    "load_task",
    "task_names",
]
