"""Several attempts from one start: the same scene again, other strategies first and another seed of the solver."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import gensim2_kpam as kpam
from gensim2.planning.steps import PLAN_OPTIONS
from gensim2.rollout.controller_spec import ControllerSpec
from gensim2.rollout.record import AttemptRecord, Cause, Episode
from gensim2.rollout.recording import EpisodeResult
from gensim2.tasks.spec import Step, TaskSpec

NUM_SEEDS = 12
"""Start values of an actuation pose in all attempts but the first: with the default 48 nearly every seed of the solver
finds the same cheapest pose, and another attempt would be the same motion."""


@dataclass(frozen=True)
class Attempt:
    """One attempt: the solver's seed, and the strategies that are tried first.

    Attributes:
        seed: of the solver.
        first: strategy that a step begins with, by step; the others begin with their own first one.
    """

    seed: int = 0
    first: dict[str, str] = field(default_factory=dict)

    def task(self, task: TaskSpec) -> TaskSpec:
        """``task`` with its strategies in this attempt's order."""
        return task.model_copy(update={"steps": tuple(self._step(step) for step in task.steps)})

    def _step(self, step: Step) -> Step:
        first = self.first.get(step.name)
        if first is None:
            return step
        return step.model_copy(update={"strategies": (first, *(name for name in step.strategies if name != first))})

    def controller(self, spec: ControllerSpec) -> ControllerSpec:
        """The chain of steps with this attempt's seed and start values of the solver."""
        if self.seed == 0:
            return spec
        options: kpam.Options = {**PLAN_OPTIONS, "seed": self.seed, "num_seeds": NUM_SEEDS}
        return replace(spec, arguments={**spec.arguments, "options": options})

    def after(self, episode: Episode, task: TaskSpec) -> Attempt:
        """The next attempt: the step to blame begins with its next strategy, and the solver has its next seed."""
        begun = [step.name for step in episode.steps]
        blamed = episode.diagnosis.get("step") or (begun or [task.steps[0].name])[-1]
        ways = next(step.strategies for step in task.steps if step.name == blamed)
        now = self.first.get(blamed, ways[0])
        return Attempt(self.seed + 1, {**self.first, blamed: ways[(ways.index(now) + 1) % len(ways)]})


def attempted(task: TaskSpec, run: Callable[[Attempt], EpisodeResult], max_attempts: int) -> EpisodeResult:
    """Make attempts until one holds, and return the one that counts.

    That is the one that holds; where none does, the first with the paper's verdict, else the first. So all verdicts of
    an episode are of one attempt. A goal that comes about in the no-op baseline does so in every attempt: then
    there is no other.

    Args:
        task: what is to be done.
        run: makes an attempt from the start, always the same one.
        max_attempts: attempts.
    """
    attempt = Attempt()
    counts: EpisodeResult | None = None
    made: list[AttemptRecord] = []
    for _ in range(max_attempts):
        result = run(attempt)
        episode = result.episode
        made.append(
            AttemptRecord(attempt.seed, attempt.first, episode.paper, episode.held, episode.strict, episode.cause)
        )
        if counts is None or episode.held or (episode.paper and not counts.episode.paper):
            counts = result
        if episode.held or episode.cause == Cause.HAPPENS_BY_ITSELF:
            break
        attempt = attempt.after(episode, task)
    assert counts is not None
    return replace(counts, episode=replace(counts.episode, attempts=made)) if max_attempts > 1 else counts
