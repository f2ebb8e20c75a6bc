"""Build tasks from code that a model wrote in a small task language (docs/reference/sandbox.md).

This package reads the syntax tree of the code and evaluates it. Python itself never executes the code.
"""

from gensim2.design.sandbox.interpreter import TaskCodeError, run_task_code
from gensim2.design.sandbox.writing import task_code

__all__ = ["TaskCodeError", "run_task_code", "task_code"]
