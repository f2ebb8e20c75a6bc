"""Interpret generated task code, a small language without loops, without executing it (docs/reference/sandbox.md)."""

from gensim2.design.sandbox.interpreter import TaskCodeError, run_task_code
from gensim2.design.sandbox.writing import task_code

__all__ = ["TaskCodeError", "run_task_code", "task_code"]
