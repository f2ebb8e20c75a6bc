"""The solver on files of recorded planning problems: read, convert, solve, write."""

from gensim2.bench.problems import PlanProblem, read_problems
from gensim2.bench.solver import BenchSummary, bench_solver, json_lines, solve_problems, summary_of

__all__ = [
    "BenchSummary",
    "PlanProblem",
    "bench_solver",
    "json_lines",
    "read_problems",
    "solve_problems",
    "summary_of",
]
