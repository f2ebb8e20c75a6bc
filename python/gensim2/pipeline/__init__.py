"""Propose, solve, verify, keep: the loop, its run folder and its report."""

from gensim2.pipeline.run import run_pipeline
from gensim2.pipeline.single import demo, solve

__all__ = ["demo", "run_pipeline", "solve"]
