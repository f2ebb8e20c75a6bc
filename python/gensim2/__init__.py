"""Turn articulated objects into verified manipulation tasks, demonstrations and policies.

This module provides the most common functions. Each function is imported on first use, so ``import gensim2`` is fast.

    library = gensim2.open_library("builtin")     # open a library of objects (gensim2.objects)
    task = gensim2.load_task("OpenDrawer")        # load a task with its strategies (gensim2.tasks)
    env = gensim2.make_env(task)                  # simulate one scene (gensim2.sim); make_vec_env simulates several
    result = gensim2.demo("OpenDrawer")           # verify the task and record demonstrations (gensim2.design)
    result = gensim2.do("close the box")          # carry out an instruction in plain English (gensim2.doing)
    result = gensim2.run_pipeline(num_tasks=1)    # propose a task, search strategies, verify and record the task
    found = gensim2.design_task("MyTask")         # search strategies for your own task
    result = gensim2.solve("OpenDrawer")          # plan the motions in one scene
    gensim2.collect(["OpenDrawer"], episodes=100, out="night")     # collect a data set (gensim2.data)
    gensim2.render("night")                                        # add camera observations to the data set
    frames = gensim2.DataSet.open("night").frames()                # read the data set; frames.torch() is for PyTorch
    result = gensim2.evaluate("mine.py:Policy", ["OpenDrawer"])    # evaluate a controller: docs/guides/controllers.md
    result = gensim2.benchmark(["OpenDrawer"])                     # evaluate the planner in the same scenes
    panda = gensim2.robot("panda")                # load a robot (gensim2.robots)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from gensim2.core.lazy import lazy_names

if TYPE_CHECKING:
    from gensim2.data import DataSet, collect, render
    from gensim2.design import demo, design_task, run_pipeline
    from gensim2.doing import do
    from gensim2.evaluation import benchmark, evaluate
    from gensim2.objects import Library, open_library
    from gensim2.perception import Observation, ObservationSpec
    from gensim2.robots import load_robot, register_robot, robot, robot_names
    from gensim2.rollout import solve
    from gensim2.sim import HeadlessEnv, make_env, make_vec_env
    from gensim2.tasks import TaskSpec, load_strategies, load_task, task_names

    __version__: str

__all__ = [
    "DataSet",
    "HeadlessEnv",
    "Library",
    "Observation",
    "ObservationSpec",
    "TaskSpec",
    "__version__",
    "benchmark",
    "collect",
    "demo",
    "design_task",
    "do",
    "evaluate",
    "load_robot",
    "load_strategies",
    "load_task",
    "make_env",
    "make_vec_env",
    "open_library",
    "register_robot",
    "render",
    "robot",
    "robot_names",
    "run_pipeline",
    "solve",
    "task_names",
]

_of_rooms = lazy_names(__name__)


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("gensim2")
    return _of_rooms(name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
