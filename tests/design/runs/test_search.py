"""The search in a fake world whose best config is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import fake_world

from gensim2.core import seeding
from gensim2.design import Affordance, Brief, Candidate, CandidateResult, RobotSummary, StageResult
from gensim2.design.search import Budget, Search
from gensim2.rollout.record import Cause, Episode
from gensim2.rollout.worker import Screened
from gensim2.rollout.config import EpisodeConfig
from gensim2.scenes.config import SceneOptions
from gensim2.core.seeding import scene_seeds
from gensim2.tasks.criteria import ArticulatedOpen
from gensim2.tasks.spec import ObjectSpec, Step, TaskSpec
from gensim2.tasks.strategies import StepStrategies

TASK = TaskSpec(
    name="OpenThing",
    description="open the thing",
    objects={"thing": ObjectSpec(asset_class="thing")},
    steps=(Step(name="open", object="thing", strategies=("designed",), done=(ArticulatedOpen(object="thing"),)),),
)
CONFIG = EpisodeConfig(SceneOptions("builtin").with_task(TASK, "train"))
THING = Affordance(
    "thing", "articulated", "thing", "", (0.3, 0.3, 0.3), 1.0, {"head": "edge"}, {"head": 0.2}, "revolute"
)
BRIEF = Brief(RobotSummary("panda", (-0.615, 0.0), 0.75, 0.08, {}), {"thing": THING})


def candidate(label: str, n: float) -> Candidate:
    return Candidate(label, {"open": {"designed": {"n": n}}}, {})


def number(steps: StepStrategies) -> float:
    n: float = steps["open"]["designed"]["n"]
    return n


class FakeDesigner:
    """Proposes the numbers 0..19 as configs, and one refinement of the best."""

    name = "fake"
    notes = ()
    patience = 1

    def open(self, folder: Path) -> None: ...

    def propose(self, brief: Brief, seed: int) -> list[TaskSpec]:
        return [TASK]

    def candidates(self, task: TaskSpec, brief: Brief, seed: int) -> list[Candidate]:
        return [candidate(f"number {n}", n) for n in range(20)]

    def refine(
        self,
        task: TaskSpec,
        brief: Brief,
        results: Sequence[CandidateResult],
        seed: int,
        round: int,
    ) -> list[Candidate]:
        if round > 0:
            return []
        return [candidate("refined", number(results[0].candidate.steps) + 0.5)]


class FakeWorld:
    """Plans odd numbers only; a config succeeds with probability n / 20, and adding 0.5 makes it certain."""

    def __init__(self) -> None:
        self.seeds: set[int] = set()

    def screen(
        self, config: EpisodeConfig, candidates: Sequence[StepStrategies], seeds: Sequence[int]
    ) -> list[list[Screened]]:
        assert config == CONFIG
        blocked = (0.0, "unreachable", {"step": "open", "plan": {"unreached": "pre_0"}})
        return [[(1.0, None, {}) if number(c) % 2 > 0 else blocked] * len(seeds) for c in candidates]

    def trials(self, config: EpisodeConfig, jobs: Sequence[tuple[StepStrategies, int]]) -> list[Episode]:
        assert config == CONFIG
        self.seeds.update(seed for _, seed in jobs)
        return [self._one(number(strategies), seed) for strategies, seed in jobs]

    def _one(self, n: float, seed: int) -> Episode:
        held = n % 1 > 0 or bool(seeding.rng(seed, str(n)).random() < n / 20)
        return fake_world.episode_of(TASK, seed, held=held, cause=Cause.STOPPED_SHORT)


def test_it_finds_the_best_and_refines_it() -> None:
    design = Search(CONFIG, BRIEF, FakeDesigner(), FakeWorld(), seed=0).run()
    assert design.chosen is not None
    assert number(design.chosen) % 1 == 0.5
    assert number(design.chosen) > 10
    assert len(design.results) == 21
    planless = [result for result in design.results if result.plan_score == 0]
    assert len(planless) == 10
    assert all(len(result.stages) == 1 for result in planless)


def test_a_few_lucky_episodes_do_not_end_the_search() -> None:
    class Lucky(FakeWorld):
        """Every first candidate succeeds in its first eight episodes and hardly ever afterwards."""

        def __init__(self) -> None:
            super().__init__()
            self.runs: dict[float, int] = {}

        def _one(self, n: float, seed: int) -> Episode:
            self.runs[n] = self.runs.get(n, 0) + 1
            held = n % 1 > 0 or self.runs[n] <= 8
            return fake_world.episode_of(TASK, seed, held=held, cause=Cause.STOPPED_SHORT)

    design = Search(CONFIG, BRIEF, FakeDesigner(), Lucky(), seed=0).run()
    assert design.chosen is not None
    assert number(design.chosen) % 1 == 0.5
    assert sum(stage.trials for stage in design.results[0].stages if stage.name == "physics") >= 14


def test_of_what_holds_equally_often_the_strict_one_wins() -> None:
    class Rough(FakeWorld):
        """All candidates but one always succeed; only number 7 meets the strict criterion."""

        def _one(self, n: float, seed: int) -> Episode:
            episode = fake_world.episode_of(TASK, seed, held=n != 3)
            return replace(episode, strict=episode.held and n == 7)

    design = Search(CONFIG, BRIEF, FakeDesigner(), Rough(), seed=0).run()
    assert design.chosen is not None
    assert number(design.chosen) == 7
    stages = [stage for stage in design.to_dict()["candidates"][0]["stages"] if stage["name"] == "physics"]
    assert stages
    assert all(stage["strict"] == stage["episodes"] for stage in stages)


def test_what_holds_far_more_often_comes_before_what_is_strict() -> None:
    def known(label: str, held: float, strict: float) -> CandidateResult:
        return CandidateResult(candidate(label, 1), (StageResult("physics", 20, held, {}, strict),))

    often, strict, nearly = known("often", 1.0, 0.1), known("strict", 0.6, 0.6), known("nearly", 0.95, 0.9)
    assert Search._sorted([strict, often]) == [often, strict]
    assert Search._sorted([often, nearly, strict]) == [nearly, often, strict]


def test_it_is_repeatable() -> None:
    first, second = (Search(CONFIG, BRIEF, FakeDesigner(), FakeWorld(), seed=4).run() for _ in range(2))
    assert first == second


def test_design_and_verification_share_no_seed() -> None:
    world = FakeWorld()
    Search(CONFIG, BRIEF, FakeDesigner(), world, seed=0).run()
    assert len(world.seeds) > 10
    assert not world.seeds & set(scene_seeds(0, TASK.name, "verify", 200))
    assert not world.seeds & set(scene_seeds(0, TASK.name, "demos", 200))


def test_nothing_planned_is_said() -> None:
    class Blocked(FakeWorld):
        def screen(
            self, config: EpisodeConfig, candidates: Sequence[StepStrategies], seeds: Sequence[int]
        ) -> list[list[Screened]]:
            return [[(0.0, "collision", {})] * len(seeds) for _ in candidates]

    design = Search(CONFIG, BRIEF, FakeDesigner(), Blocked(), seed=0).run()
    assert design.chosen is None
    assert "no candidate could be planned" in design.notes


def test_nothing_held_is_said() -> None:
    class Stuck(FakeWorld):
        def _one(self, n: float, seed: int) -> Episode:
            return fake_world.episode_of(TASK, seed, held=False, cause=Cause.NO_CONTACT)

    design = Search(CONFIG, BRIEF, FakeDesigner(), Stuck(), seed=0, budget=Budget(rounds=((8, 1),))).run()
    assert design.chosen is None
    assert "no candidate held in physics" in design.notes
    assert design.to_dict()["candidates"][0]["cause"] == "object did not move"


def test_what_stood_in_the_way_is_told_in_words() -> None:
    design = Search(CONFIG, BRIEF, FakeDesigner(), FakeWorld(), seed=0).run()
    blocked = next(result for result in design.results if result.plan_score == 0)
    (told,) = blocked.diagnoses
    assert (told.step, told.cause, told.count) == ("open", "unreachable", blocked.stages[0].trials)
    assert told.words == "step 'open': unreachable; the keyframe pre_0 is not reached"


def test_a_designer_may_learn_from_plans_alone() -> None:
    class Hopeless(FakeDesigner):
        """No first candidate can be planned, but its refinements can."""

        def candidates(self, task: TaskSpec, brief: Brief, seed: int) -> list[Candidate]:
            return [candidate("number 2", 2)]

    design = Search(CONFIG, BRIEF, Hopeless(), FakeWorld(), seed=0).run()
    assert design.chosen is not None
    assert number(design.chosen) == 2.5


def test_leaders_within_the_noise_get_more_episodes_until_they_are_called_equal() -> None:
    class Even(FakeWorld):
        """Two candidates succeed in four of five episodes, in turn; the others never do."""

        def _one(self, n: float, seed: int) -> Episode:
            held = n in (7, 9) and bool(seeding.rng(seed, str(n)).random() < 0.8)
            return fake_world.episode_of(TASK, seed, held=held, cause=Cause.STOPPED_SHORT)

    budget = Budget()
    design = Search(CONFIG, BRIEF, FakeDesigner(), Even(), seed=0, budget=budget).run()
    first, second = design.results[:2]
    assert {number(first.candidate.steps), number(second.candidate.steps)} == {7, 9}
    assert min(first.episodes, second.episodes) >= budget.max_episodes
    assert "equal within the noise" in design.notes[-1]


def test_what_holds_every_time_is_found_out_in_a_few_episodes() -> None:
    class Easy(FakeWorld):
        """Everything succeeds."""

        def _one(self, n: float, seed: int) -> Episode:
            return replace(fake_world.episode_of(TASK, seed, held=True), strict=True)

    design = Search(CONFIG, BRIEF, FakeDesigner(), Easy(), seed=0).run()
    assert design.chosen is not None
    assert design.results[0].episodes == Budget().enough_episodes
    assert sum(result.episodes for result in design.results) <= 40


def test_a_hopeless_task_is_given_up() -> None:
    class Eager(FakeDesigner):
        """Always has another candidate."""

        rounds = 0

        def refine(
            self, task: TaskSpec, brief: Brief, results: Sequence[CandidateResult], seed: int, round: int
        ) -> list[Candidate]:
            self.rounds += 1
            return [candidate(f"number {100 + round}", 101 + 2 * round)]

    class Hard(FakeWorld):
        """Nothing ever succeeds."""

        def _one(self, n: float, seed: int) -> Episode:
            return fake_world.episode_of(TASK, seed, held=False, cause=Cause.NO_CONTACT)

    designer = Eager()
    assert Search(CONFIG, BRIEF, designer, Hard(), seed=0).run().chosen is None
    assert designer.rounds == 1
    patient = Eager()
    patient.patience = 3
    assert Search(CONFIG, BRIEF, patient, Hard(), seed=0).run().chosen is None
    assert patient.rounds == 3, "a model that learns from failures gets all its rounds"
