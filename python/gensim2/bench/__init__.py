"""Run the solver on files of recorded planning problems."""

from gensim2.bench.motion import MotionProblem, MotionSummary, motion_summary, read_motion_problems, solve_motions
from gensim2.bench.problems import PlanProblem, read_problems
from gensim2.bench.solver import BenchSummary, json_lines, solve_problems, summary_of

__all__ = [
    "BenchSummary",
    "MotionProblem",
    "MotionSummary",
    "PlanProblem",
    "json_lines",
    "motion_summary",
    "read_motion_problems",
    "read_problems",
    "solve_motions",
    "solve_problems",
    "summary_of",
]
