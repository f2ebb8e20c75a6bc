"""Search for strategies that work: plan all candidates, simulate the promising candidates, and refine the best.

1. The search first plans every candidate on a few scenes, because planning is cheap.
2. It simulates each candidate with a plan for a few episodes. It then simulates the better half of the candidates for
   more episodes, and so on (successive halving).
3. If the best candidate has failed in very few episodes, the search simulates only this candidate further, and ends
   once the candidate has succeeded in enough episodes. Otherwise the search simulates all candidates whose success
   rates do not differ significantly from the best rate. This comparison stops when only one such candidate is left, or
   when the candidates have reached their maximum number of episodes. In the second case the candidates count as equally
   good.
4. If no candidate succeeds often enough, the designer makes variants of the best candidates, and the search compares
   the variants in the same way. The search repeats this refinement until a candidate succeeds often enough, all success
   rates stay too low, the designer has no more variants, or the budget is spent.

Candidates are ranked by success rate. If the leaders do not differ significantly, their rates by `strict` decide, which
requires the hand to retreat.
"""

from __future__ import annotations

import itertools
import math
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

from gensim2.core import seeding
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.data.records import merge_causes
from gensim2.design.base import Brief, Candidate, CandidateResult, Designer, StageResult
from gensim2.design.designs import Design
from gensim2.design.diagnosis import diagnoses
from gensim2.rollout.config import EpisodeConfig
from gensim2.rollout.record import Episode
from gensim2.rollout.tally import interval
from gensim2.rollout.worker import Screened
from gensim2.tasks.spec import TaskSpec
from gensim2.tasks.strategies import StepStrategies

LEADERS = 1.96
"""Two candidates count as equal if their success rates differ by less than this number of standard errors."""


class Evaluator(Protocol):
    """Interface through which the search plans and simulates, in one process or many."""

    def screen(
        self, config: EpisodeConfig, candidates: Sequence[StepStrategies], seeds: Sequence[int]
    ) -> list[list[Screened]]:
        """Plan each candidate on the scene of each seed; return one list of results for each candidate."""
        ...

    def trials(self, config: EpisodeConfig, jobs: Sequence[tuple[StepStrategies, int]]) -> list[Episode]:
        """Simulate one episode for each job (strategies of each step, seed); return the episodes in this order."""
        ...


@dataclass(frozen=True)
class Budget:
    """Budget of a search, in counts rather than seconds so that results do not depend on the machine.

    Attributes:
        screen_scenes: number of scenes on which every candidate is planned.
        rounds: size of each round before refinements, as (number of candidates, episodes of each).
        refined: size of the simulation round after each refinement, as in ``rounds``.
        comparison: size of each round in which the leading candidates are compared, as in ``rounds``.
        max_episodes: maximum number of episodes of a candidate. Leaders without a significant difference then count as
            equal.
        enough, enough_strict: success rates at which the search ends, with at least ``enough_episodes`` episodes. If
            only the strict rate is too low, there is one refinement at most.
        enough_episodes: minimum number of episodes of a candidate that ends the search or is chosen.
        hopeless: success rate up to which refinements end after the designer's ``patience``.
        max_physics_episodes: total number of simulated episodes after which the search stops comparing and refining.
    """

    screen_scenes: int = 3
    rounds: tuple[tuple[int, int], ...] = ((10, 1), (5, 2))
    refined: tuple[int, int] = (10, 2)
    comparison: tuple[int, int] = (3, 6)
    max_episodes: int = 24
    enough: float = 0.9
    enough_strict: float = 0.75
    enough_episodes: int = 14
    hopeless: float = 0.3
    max_physics_episodes: int = 150


#: Budget for long tasks. Their episodes take ten times as long, and they have few candidates.
LONG_BUDGET = Budget(
    screen_scenes=2,
    rounds=((3, 1), (2, 2)),
    refined=(3, 2),
    comparison=(2, 4),
    max_episodes=16,
    enough=0.9,
    enough_strict=0.0,
    enough_episodes=10,
    max_physics_episodes=60,
)


def budget_for(task: TaskSpec) -> Budget:
    """Return the default budget of a search for this task."""
    return Budget() if task.is_single_step else LONG_BUDGET


class Search:
    """Strategy search for one task.

    Args:
        config: the task, and the instances that the search may use.
        brief: input of the designer.
        designer: designer that writes and refines candidates.
        evaluator: evaluator that plans and simulates candidates.
        seed: seed of all random choices.
        budget: budget of the search.
        progress: progress listener.

    Attributes:
        designer_s: time that the designer needed, s.
    """

    def __init__(
        self,
        config: EpisodeConfig,
        brief: Brief,
        designer: Designer,
        evaluator: Evaluator,
        seed: int,
        budget: Budget | None = None,
        progress: Progress = NULL_PROGRESS,
    ) -> None:
        self.config, self.task = config, config.task
        self.brief, self.designer, self.evaluator = brief, designer, evaluator
        self.seed, self.budget, self.progress = seed, budget or budget_for(config.task), progress
        self.designer_s = 0.0
        self._episodes_run: dict[str, int] = defaultdict(int)
        self._notes: list[str] = []

    def run(self) -> Design:
        """Run the search; ``chosen`` is None if no episode succeeded."""
        first = self._screen(self._asked(self.designer.candidates, self.task, self.brief, self.seed))
        everything = {self._key(result): result for result in first}
        standing = [result for result in first if result.plan_score > 0]
        self._notes = [f"{len(standing)} of {len(first)} first candidates plan on at least one scene"]

        def remember(results: Sequence[CandidateResult]) -> None:
            everything.update((self._key(result), result) for result in results)

        for count, episodes in self.budget.rounds if standing else ():
            standing = self._physics(standing[:count], episodes, f"physics, {count} candidates")
            remember(standing)
        for round_index in itertools.count():
            if standing:
                standing = self._compare(standing, round_index)
                remember(standing)
                if self._enough(standing[0], strictly=round_index == 0):
                    break
            if round_index and (self._spent or (round_index >= self.designer.patience and self._hopeless(standing))):
                break
            # Dropped candidates are included, because their failures show the designer which choices to avoid.
            learned = [*standing, *self._sorted([each for each in everything.values() if each not in standing])]
            children = self._asked(self.designer.refine, self.task, self.brief, learned, self.seed, round_index)
            if not children:
                break
            screened = self._screen(children)
            remember(screened)
            if planned := [result for result in screened if result.plan_score > 0]:
                count, episodes = self.budget.refined
                tried = self._physics(planned[:count], episodes, f"refinement {round_index + 1}")
                remember(tried)
                standing = self._sorted([*standing, *tried])
        ranked = [*standing, *self._sorted([r for r in everything.values() if r not in standing])]
        if not standing:
            return Design(tuple(ranked), None, (*self._notes, "no candidate could be planned"))
        if not standing[0].held:
            return Design(tuple(ranked), None, (*self._notes, "no candidate held in physics"))
        self._notes.append(_compared(standing))
        return Design(tuple(ranked), standing[0].candidate.steps, tuple(self._notes))

    def _asked(self, question: Callable[..., list[Candidate]], *given: Any) -> list[Candidate]:
        begin = time.perf_counter()
        try:
            return question(*given)
        finally:
            self.designer_s += time.perf_counter() - begin

    def _screen(self, candidates: Sequence[Candidate]) -> list[CandidateResult]:
        if not candidates:
            return []
        seeds = seeding.scene_seeds(self.seed, self.task.name, "screen", self.budget.screen_scenes)
        self.progress.start(f"{self.task.name}: plan {len(candidates)} candidates", len(seeds))
        outcomes = self.evaluator.screen(self.config, [c.steps for c in candidates], seeds)
        results = [
            CandidateResult(
                candidate,
                (
                    StageResult(
                        "plan",
                        len(seeds),
                        sum(score for score, _, _ in planned) / len(seeds),
                        merge_causes([cause for _, cause, _ in planned]),
                        diagnoses=diagnoses(
                            ((cause, numbers) for _, cause, numbers in planned if cause is not None),
                            candidate.described,
                        ),
                    ),
                ),
            )
            for candidate, planned in zip(candidates, outcomes, strict=True)
        ]
        return self._spread(results)

    def _spread(self, results: Sequence[CandidateResult]) -> list[CandidateResult]:
        """Sort by plan score and shuffle equals, because similar neighbours could take all places in a round."""
        order = seeding.rng(self.seed, f"{self.task.name}/spread").permutation(len(results))
        return sorted((results[index] for index in order), key=lambda result: -result.plan_score)

    def _physics(self, results: Sequence[CandidateResult], episodes: int, what: str) -> list[CandidateResult]:
        jobs, owners = [], []
        for index, result in enumerate(results):
            done = self._episodes_run[self._key(result)]
            for seed in seeding.scene_seeds(self.seed, self.task.name, "design", episodes, done):
                jobs.append((result.candidate.steps, seed))
                owners.append(index)
            self._episodes_run[self._key(result)] += episodes
        self.progress.start(f"{self.task.name}: {what}", len(jobs))
        episodes_run = self.evaluator.trials(self.config, jobs)
        grouped: dict[int, list[Episode]] = defaultdict(list)
        for owner, episode in zip(owners, episodes_run, strict=True):
            grouped[owner].append(episode)
        updated = [
            replace(result, stages=(*result.stages, _stage(result.candidate, grouped[index])))
            for index, result in enumerate(results)
        ]
        return self._sorted(updated)

    def _compare(self, standing: Sequence[CandidateResult], round_index: int) -> list[CandidateResult]:
        """Simulate the best candidate if good enough, or all leaders, until one leads or all have their maximum."""
        count, episodes = self.budget.comparison
        known = {self._key(result): result for result in standing}
        while True:
            ranked = self._sorted(list(known.values()))
            lacking = self.budget.enough_episodes - ranked[0].episodes
            if lacking > 0 and self._promises(ranked[0]):
                (result,) = self._physics(ranked[:1], min(episodes, lacking), f"the best, round {round_index + 1}")
                known[self._key(result)] = result
                continue
            leaders = [result for result in ranked if _is_tied(result, ranked[0], LEADERS)]
            proven = [result for result in leaders if result.episodes >= self.budget.enough_episodes]
            if proven and self._enough(proven[0], strictly=False):
                return [proven[0], *(result for result in ranked if result is not proven[0])]
            short = [result for result in leaders if result.episodes < self.budget.max_episodes][:count]
            if not short or (len(leaders) == 1 and proven) or self._spent:
                return ranked
            for result in self._physics(short, episodes, f"comparison {round_index + 1}"):
                known[self._key(result)] = result

    def _enough(self, result: CandidateResult, strictly: bool) -> bool:
        budget, trials = self.budget, result.episodes
        return (
            trials >= budget.enough_episodes
            and result.held >= budget.enough * trials
            and (not strictly or result.strict >= budget.enough_strict * trials)
        )

    def _promises(self, result: CandidateResult) -> bool:
        """Return whether the candidate can still reach the success rate that ends the search."""
        budget = self.budget
        return result.held > 0 and result.episodes - result.held <= (1 - budget.enough) * budget.enough_episodes

    def _hopeless(self, standing: Sequence[CandidateResult]) -> bool:
        """Return whether no candidate succeeds often enough to be worth another refinement."""
        best = max((result.held / result.episodes for result in standing if result.episodes), default=0.0)
        return best <= self.budget.hopeless

    @property
    def _spent(self) -> bool:
        return sum(self._episodes_run.values()) >= self.budget.max_physics_episodes

    @staticmethod
    def _sorted(results: list[CandidateResult]) -> list[CandidateResult]:
        by_held = sorted(results, key=lambda result: (-result.physics_score, -result.plan_score))
        tied = [result for result in by_held if _is_tied(result, by_held[0])]
        rest = [result for result in by_held if not _is_tied(result, by_held[0])]
        return [*sorted(tied, key=lambda result: -result.strict_score), *rest]

    @staticmethod
    def _key(result: CandidateResult) -> str:
        return str(result.candidate.steps)


def _is_tied(result: CandidateResult, best: CandidateResult, errors: float = 1.0) -> bool:
    """Return whether a candidate's success rate lies within ``errors`` standard errors of the best one."""
    if not result.held:
        return False
    rate = (result.held + best.held + 1) / (result.episodes + best.episodes + 2)
    error = math.sqrt(rate * (1 - rate) * (1 / result.episodes + 1 / best.episodes))
    return best.held / best.episodes - result.held / result.episodes <= errors * error


def _compared(standing: Sequence[CandidateResult]) -> str:
    """Return a sentence that states how often the best candidate succeeded, and how many candidates count as equal."""
    best = standing[0]
    low, high = interval(round(best.held), best.episodes)
    equal = [other for other in standing[1:] if other.episodes and _is_tied(other, best, LEADERS)]
    told = f"the chosen one held in {best.held:.0f} of {best.episodes} episodes ({low:.2f} to {high:.2f})"
    if not equal:
        return f"{told}, ahead of all others"
    others = ", ".join(f"{other.held:.0f} of {other.episodes}" for other in equal[:4])
    return f"{told}; {len(equal)} more are equal within the noise ({others})"


def _stage(candidate: Candidate, episodes: Sequence[Episode]) -> StageResult:
    by_object: dict[str, tuple[int, int]] = {}
    for episode in episodes:
        instance = next(iter(episode.objects.values())).id
        held, count = by_object.get(instance, (0, 0))
        by_object[instance] = (held + episode.held, count + 1)
    return StageResult(
        "physics",
        len(episodes),
        sum(episode.held for episode in episodes) / len(episodes),
        merge_causes([str(episode.cause) for episode in episodes if episode.cause is not None]),
        sum(episode.strict for episode in episodes) / len(episodes),
        diagnoses(((str(e.cause), e.diagnosis) for e in episodes if e.cause is not None), candidate.described),
        by_object,
    )
