"""Benchmark the planner, or evaluate a controller, on the tasks of the library."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gensim2.core.lazy import lazy_names

if TYPE_CHECKING:
    from gensim2.evaluation.benchmarking import benchmark, benchmark_both
    from gensim2.evaluation.evaluating import EvaluationResult, evaluate

__all__ = ["EvaluationResult", "benchmark", "benchmark_both", "evaluate"]

__getattr__ = lazy_names(__name__)
