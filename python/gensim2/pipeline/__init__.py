"""Propose, solve, verify, keep: the loop, its run folder and its report.

The functions are imported when asked for: what refuses bad input needs none of what runs good input.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gensim2.pipeline.benchmark import benchmark
    from gensim2.pipeline.run import run_pipeline
    from gensim2.pipeline.single import demo
    from gensim2.pipeline.solving import solve

__all__ = ["benchmark", "demo", "run_pipeline", "solve"]

_MODULES = {"benchmark": "benchmark", "demo": "single", "run_pipeline": "run", "solve": "solving"}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_MODULES[name]}"), name)
