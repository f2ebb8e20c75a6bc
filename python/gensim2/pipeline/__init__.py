"""Propose, solve, verify, keep: the loop, its run folder and its report.

The functions are imported when asked for: what refuses bad input needs none of what runs good input.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from gensim2.lazy import lazy_names

if TYPE_CHECKING:
    from gensim2.pipeline.benchmarking import benchmark
    from gensim2.pipeline.gallery import tasks_gallery
    from gensim2.pipeline.run import run_pipeline
    from gensim2.pipeline.single import demo
    from gensim2.pipeline.solving import solve

__all__ = ["benchmark", "demo", "run_pipeline", "solve", "tasks_gallery"]

__getattr__ = lazy_names(
    __name__,
    {
        "benchmark": "gensim2.pipeline.benchmarking",
        "demo": "gensim2.pipeline.single",
        "run_pipeline": "gensim2.pipeline.run",
        "solve": "gensim2.pipeline.solving",
        "tasks_gallery": "gensim2.pipeline.gallery",
    },
)
