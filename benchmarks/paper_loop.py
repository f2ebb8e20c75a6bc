"""Number of candidates until a config works, with diagnoses and without.

    python benchmarks/paper_loop.py --out loop.jsonl --draws 2              # both ways, up to 300 candidates a task
    python benchmarks/paper_loop.py --out loop.jsonl --table                # the table, on standard output

The paper has a model write 3 configs, and a person say whether one does. Here candidates are drawn at random from all
alignments of the class's keypoints (`design/joint_search.py`, no rules by hand), and physics says. "Blindly": in
drawn order. "Told": after each round the draw is weighted by the diagnoses of those before (`design/steering.py`),
as the offline designer does it; the best are varied beside. Rounds end after 1, 2, 3, 6, 10, ... candidates, the same
both ways, and the first candidate is the same.

A candidate is tried when it went through the solver, on 2 scenes. Where any part of a motion was found it gets up to 5
episodes, and is dropped at the second that does not hold. Who is left works if it holds in 16 of 20 episodes on fresh
seeds and on objects that no trial saw; then the draw ends. CPU time is of this process, and what both ways come to is
run once. One line a task, way and draw; what the file has is not run again. The table has draws of which all tasks are
there.
"""

from __future__ import annotations

import argparse
import importlib
import itertools
import json
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from gensim2.core import seeding
from gensim2.data.records import merge_causes
from gensim2.design import joint_search, steering
from gensim2.design.affordance import Affordance
from gensim2.design.base import Candidate, CandidateResult, StageResult
from gensim2.design.diagnosis import diagnoses
from gensim2.design.manipulation import Manipulation
from gensim2.design.offline import OPENING
from gensim2.design.proposals import redesigned
from gensim2.design.unseen import seen_by_search
from gensim2.objects import open_library
from gensim2.rollout import worker
from gensim2.rollout.config import EpisodeConfig
from gensim2.rollout.tally import interval
from gensim2.scenes.config import SceneOptions
from gensim2.tasks.library import load_task, task_names
from gensim2.tasks.likeness import joint_goal
from gensim2.tasks.spec import TaskSpec

CIRCUMSTANCES = SceneOptions("builtin")

#: Candidates after which a round ends.
ROUNDS = (1, 2, 3, 6, 10, 15, 20, 30, 45, 60, 90, 120, 160, 200, 250, 300)
SHOWN = (3, 30, 300)
WAYS = ("blindly", "told")

SCENES, TRIAL, DROPPED_AT = 2, 5, 2
FRESH, WORKS = 20, 16

#: Of the best of a round, how many are varied, and how often each.
PARENTS, CHILDREN = 3, 10

#: Instances from which what a class affords is read.
LOOKED_AT = 3


@dataclass
class Cost:
    """Cost of the runs: candidates planned and tried, their episodes, and CPU seconds."""

    planned: int = 0
    tried: int = 0
    episodes: int = 0
    plan: float = 0.0
    physics: float = 0.0
    fresh: float = 0.0


class Judge:
    """Tests the candidates of one task with one seed. A candidate that both searches propose is tested once.

    Args:
        task: task with one step and one joint.
        seed: seed of its scenes.
    """

    def __init__(self, task: TaskSpec, seed: int) -> None:
        library = open_library("builtin")
        self.task, self.seed, self.cost = redesigned(task), seed, Cost()
        self._planned: dict[Manipulation, CandidateResult] = {}
        self._tried: dict[str, CandidateResult] = {}
        self._held: dict[str, int] = {}
        goal = joint_goal(task)
        assert goal is not None, task.name
        name, self.opening = goal[0], OPENING[goal[1]]
        order = seeding.rng(seed, f"{task.name}/affordance").permutation(len(ids := seen_by_search(library, name)))
        self.thing = Affordance.of([library.load(name, ids[index]) for index in order[:LOOKED_AT]])
        self.seen = self._setting("train")
        self.fresh = self._setting(tuple(library.sample(name, FRESH, seed)))

    @property
    def every(self) -> list[Manipulation]:
        """All alignments of the class."""
        end = joint_search.OPENED if self.opening else joint_search.CLOSED_UP
        return list(joint_search.alignments(self.thing, self.opening, end))

    def screen(self, drawn: Sequence[Manipulation]) -> list[CandidateResult]:
        """Plan them, the best first."""
        begin, new = time.process_time(), [each for each in drawn if each not in self._planned]
        candidates = [self._candidate(each) for each in new]
        stages = [
            worker.screen_scene(self.seen, seed, [each.steps for each in candidates])
            for seed in seeding.scene_seeds(self.seed, self.task.name, "screen", SCENES)
        ]
        for one, candidate, outcomes in zip(new, candidates, zip(*stages, strict=True), strict=True):
            score = sum(each[0] for each in outcomes) / SCENES
            told = diagnoses((cause, numbers) for _, cause, numbers in outcomes if cause is not None)
            causes = merge_causes([cause for _, cause, _ in outcomes])
            stage = StageResult("plan", SCENES, score, causes, 0.0, told)
            self._planned[one] = CandidateResult(candidate, (stage,))
        self.cost.planned += len(new)
        self.cost.plan += time.process_time() - begin
        return sorted((self._planned[each] for each in drawn), key=lambda each: -each.plan_score)

    def trial(self, result: CandidateResult) -> CandidateResult:
        """Up to 5 episodes, until two have not held."""
        key = str(result.candidate.steps)
        if key in self._tried:
            return self._tried[key]
        begin, episodes = time.process_time(), []
        for seed in seeding.scene_seeds(self.seed, self.task.name, "design", TRIAL):
            episodes.append(worker.trial(self.seen, result.candidate.steps, seed))
            if sum(not each.held for each in episodes) == DROPPED_AT:
                break
        self.cost.tried += 1
        self.cost.episodes += len(episodes)
        self.cost.physics += time.process_time() - begin
        held = sum(each.held for each in episodes) / len(episodes)
        failed = [each for each in episodes if each.cause is not None]
        stage = StageResult(
            "physics",
            len(episodes),
            held,
            merge_causes([str(each.cause) for each in failed]),
            diagnoses=diagnoses((str(each.cause), each.diagnosis) for each in failed),
        )
        self._tried[key] = replace(result, stages=(*result.stages, stage))
        return self._tried[key]

    def held(self, candidate: Candidate) -> int:
        """Count the fresh episodes of 20 that hold; ends where 16 can no longer be had."""
        key = str(candidate.steps)
        if key not in self._held:
            begin, held = time.process_time(), 0
            for run, seed in enumerate(seeding.scene_seeds(self.seed, self.task.name, "fresh", FRESH), 1):
                held += worker.trial(self.fresh, candidate.steps, seed).held
                if held + FRESH - run < WORKS:
                    break
            self.cost.fresh += time.process_time() - begin
            self._held[key] = held
        return self._held[key]

    def _setting(self, instances: str | tuple[str, ...]) -> EpisodeConfig:
        return EpisodeConfig(CIRCUMSTANCES.with_task(self.task, instances))

    def _candidate(self, each: Manipulation) -> Candidate:
        step = self.task.steps[0]
        return Candidate(each.label, {step.name: {step.strategies[0]: each.config()}}, each.provenance())


def rounds(judge: Judge, way: str, max_candidates: int, results: list[CandidateResult]) -> Iterator[list[Manipulation]]:
    """Yield what each round tries, given what ``results`` has by then."""
    every = judge.every
    order = seeding.rng(judge.seed, f"{judge.task.name}/order").permutation(len(every))
    generator = seeding.rng(judge.seed, f"{judge.task.name}/told")
    done = 0
    for upto in (each for each in ROUNDS if each <= max_candidates):
        if way == "blindly" or not results:
            drawn = [every[index] for index in order[done:upto]]
        else:
            best = sorted(results, key=lambda each: (-each.physics_score, -each.plan_score))[:PARENTS]
            parents = [joint_search.manipulation_from(each.candidate.provenance) for each in best if each.plan_score]
            varied = [joint_search.vary(each, False, generator) for each in parents for _ in range(CHILDREN)]
            pool = list(dict.fromkeys([*every, *varied]))
            drawn = steering.draw(pool, results, upto - done, generator)
        done += len(drawn)
        if drawn:
            yield drawn


def loop(judge: Judge, way: str, draw: int, max_candidates: int) -> dict[str, Any]:
    """One draw for one task: after how many candidates one was found that works."""
    results: list[CandidateResult] = []
    judge.cost = Cost()
    told: dict[str, Any] = {
        "task": judge.task.name,
        "way": way,
        "draw": draw,
        "max_candidates": max_candidates,
        "found": None,
    }
    told |= {"alignments": len(judge.every), "planned": 0, "moving": 0, "passed": 0}
    for drawn in rounds(judge, way, max_candidates, results):
        screened = judge.screen(drawn)
        told["planned"] += len(screened)
        told["moving"] += sum(each.plan_score > 0 for each in screened)
        for index, result in enumerate(screened):
            if not result.plan_score:
                continue
            screened[index] = judge.trial(result)
            if screened[index].held <= TRIAL - DROPPED_AT:
                continue
            told["passed"] += 1
            held = judge.held(result.candidate)
            if held >= WORKS:
                told |= {"found": told["planned"], "label": result.candidate.label, "fresh": held}
                return {**told, "cost": asdict(judge.cost)}
        results += screened
    return {**told, "cost": asdict(judge.cost)}


def table(lines: Sequence[dict[str, Any]]) -> str:
    """Markdown of all draws that are whole."""
    sizes = Counter(line["draw"] for line in lines)
    whole = [line for line in lines if sizes[line["draw"]] == max(sizes.values())]
    rows = ["| | " + " | ".join(f"{count} candidates" for count in SHOWN) + " |", "|---|" + "---|" * len(SHOWN)]
    for way in WAYS:
        cells = (_cell([line for line in whole if line["way"] == way], count) for count in SHOWN)
        rows.append(f"| {way} | " + " | ".join(cells) + " |")
    return "\n".join([*rows, "", *_efforts(whole), "", *_by_task(whole)])


def _cell(lines: Sequence[dict[str, Any]], count: int) -> str:
    """Tasks that have a config that works after so many candidates, mean of the draws, with a 95 % interval."""
    if not lines or min(line["max_candidates"] for line in lines) < count:
        return "-"
    works = sum(line["found"] is not None and line["found"] <= count for line in lines)
    tasks = len({line["task"] for line in lines})
    mean, low, high = (tasks * share for share in (works / len(lines), *interval(works, len(lines))))
    return f"{mean:.3g} of {tasks} ({low:.1f}–{high:.1f})"


def _efforts(lines: Sequence[dict[str, Any]]) -> Iterator[str]:
    cost = Cost(**{name: sum(line["cost"][name] for line in lines) for name in asdict(Cost())})
    yield (
        f"{cost.planned} candidates went through the solver on {SCENES} scenes each, "
        f"{60 * cost.planned / cost.plan:.0f} a minute of CPU; {cost.tried} through physics with "
        f"{cost.episodes / cost.tried:.1f} episodes each, {60 * cost.tried / cost.physics:.0f} a minute of CPU; "
        f"verification took {cost.fresh:.0f} s of CPU beside {cost.plan + cost.physics:.0f} for all of that."
    )
    for way in WAYS:
        of = [line for line in lines if line["way"] == way]
        found = [line["found"] for line in of if line["found"] is not None]
        planned, moving, passed = (sum(line[name] for line in of) for name in ("planned", "moving", "passed"))
        yield (
            f"- {way}: {moving} of {planned} candidates moved, {passed} passed their trial, {len(found)} of these "
            f"work; found after {np.median(found):.0f} candidates (median), {np.mean(found):.1f} (mean)"
        )


def _by_task(lines: Sequence[dict[str, Any]]) -> Iterator[str]:
    yield "| task | alignments | blindly: found after | told: found after |"
    yield "|---|---|---|---|"
    for name in dict.fromkeys(line["task"] for line in lines):
        own = [line for line in lines if line["task"] == name]
        cells = []
        for way in WAYS:
            of = sorted((line for line in own if line["way"] == way), key=lambda line: line["draw"])
            cells.append(", ".join(str(line["found"] or f"not in {line['planned']}") for line in of))
        yield f"| {name} | {own[0]['alignments']} | {' | '.join(cells)} |"


def main(arguments: list[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--draws", type=int, default=2, help="how many; they are numbered, which is their seed")
    parser.add_argument("--first", type=int, default=1, help="number of the first draw")
    parser.add_argument("--max-candidates", type=int, default=ROUNDS[-1], choices=ROUNDS, help="candidates of a draw")
    single = [each for each in task_names("paper") if load_task(each).is_single_step]
    parser.add_argument("--tasks", nargs="*", default=single)
    parser.add_argument("--table", action="store_true", help="run nothing")
    options = parser.parse_args(arguments)
    lines = [json.loads(line) for line in options.out.read_text().splitlines()] if options.out.exists() else []
    numbers = range(options.first, options.first + options.draws)
    done = {(line["task"], line["way"], line["draw"]) for line in lines}
    if not options.table:
        for module in worker.PRELOAD["sapien"]:
            importlib.import_module(module)
        worker.prepare([CIRCUMSTANCES])
    for draw, name in () if options.table else itertools.product(numbers, options.tasks):
        if missing := [way for way in WAYS if (name, way, draw) not in done]:
            judge = Judge(load_task(name), draw)
            for way in missing:
                lines.append(loop(judge, way, draw, options.max_candidates))
                with options.out.open("a", encoding="utf-8") as stream:
                    stream.write(json.dumps(lines[-1]) + "\n")
                print(json.dumps(lines[-1]), file=sys.stderr, flush=True)
    print(table(lines))
    return 0


if __name__ == "__main__":
    sys.exit(main())
