"""Evaluation: the benchmark of tasks, its table and its figures."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gensim2.lazy import lazy_names

if TYPE_CHECKING:
    from gensim2.evaluation.benchmarking import benchmark

__all__ = ["benchmark"]

__getattr__ = lazy_names(__name__, {"benchmark": "gensim2.evaluation.benchmarking"})
