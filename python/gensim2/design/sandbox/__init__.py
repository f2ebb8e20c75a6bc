"""Generated task code: looked at and run in a process that can do nothing but compute and answer (docs/sandbox.md)."""

from gensim2.design.sandbox.box import NoSandboxError, Sandbox, sandbox
from gensim2.design.sandbox.code import TaskCodeError, run_task_code
from gensim2.design.sandbox.writing import task_code

__all__ = ["NoSandboxError", "Sandbox", "TaskCodeError", "run_task_code", "sandbox", "task_code"]
