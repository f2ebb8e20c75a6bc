"""Interpret task code that a model wrote in a small language (docs/reference/sandbox.md); Python never executes it."""

from gensim2.design.sandbox.interpreter import TaskCodeError, run_task_code
from gensim2.design.sandbox.writing import task_code

__all__ = ["TaskCodeError", "run_task_code", "task_code"]
