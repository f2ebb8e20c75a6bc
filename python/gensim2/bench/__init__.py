"""The solver on files of recorded planning problems: read, convert, solve, write."""

from gensim2.bench.problems import PlanProblem, read_problems
from gensim2.bench.solver import BenchSummary, bench_solver

__all__ = ["BenchSummary", "PlanProblem", "bench_solver", "read_problems"]
