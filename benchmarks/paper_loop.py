"""How many candidates does it take to a config that works, blindly and with what went wrong told to who draws?

    python benchmarks/paper_loop.py --out loop.jsonl --draws 2             # both ways, up to 300 candidates a task
    python benchmarks/paper_loop.py --out loop.jsonl --draws 8 --most 30   # further draws of 30
    python benchmarks/paper_loop.py --out loop.jsonl --table               # the table, on standard output

The paper has a model write 3 configs, and a person say whether one does. Here candidates are drawn at random from all
alignments of the class's keypoints (`designers/joint_search.py`, no rules by hand), and physics says. "Blindly": in
drawn order. "Told": after each round the draw is weighted by the diagnoses of those before (`designers/steering.py`),
as the offline designer does it; the best are varied beside. Rounds end after 1, 2, 3, 6, 10, ... candidates, the same
both ways, and the first candidate is the same.

A candidate is tried when it went through the solver, on 2 scenes. Where any part of a motion was found it gets up to 5
episodes, and is dropped at the second that does not hold. Who is left works if it holds in 16 of 20 episodes on fresh
seeds and on objects that no trial saw; then the draw ends. What works is run 20 times more, on other seeds and objects;
nothing depends on that. CPU time is of this process. One line a task, way and draw; what the file has is not run again.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from gensim2 import seeding
from gensim2.designers import joint_search, steering
from gensim2.designers.affordance import Affordance
from gensim2.designers.base import Candidate, CandidateResult, StageResult
from gensim2.designers.diagnosis import diagnoses
from gensim2.designers.manipulation import Manipulation
from gensim2.designers.offline import OPENING
from gensim2.designers.proposals import joint_goal, redesigned
from gensim2.objects import open_library
from gensim2.pipeline import worker
from gensim2.pipeline.records import merge_causes
from gensim2.pipeline.setting import Circumstances, Setting
from gensim2.pipeline.tally import interval
from gensim2.pipeline.unseen import seen_by_search
from gensim2.tasks.library import load_task, task_names
from gensim2.tasks.spec import TaskSpec

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
class Spent:
    """What a draw took so far."""

    planned: int = 0
    planned_scenes: int = 0
    tried: int = 0
    episodes: int = 0
    cpu: dict[str, float] = field(default_factory=lambda: {"plan": 0.0, "physics": 0.0, "fresh": 0.0})

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        rounded = {f"cpu_{name}": round(value, 2) for name, value in self.cpu.items()}
        counts = {"planned": self.planned, "planned_scenes": self.planned_scenes, "tried": self.tried}
        return {**counts, "episodes": self.episodes, **rounded}


class Judge:
    """Tries the candidates of one task; one draw.

    Args:
        task: of one step and one joint.
        seed: of its scenes.
    """

    def __init__(self, task: TaskSpec, seed: int) -> None:
        library = open_library("builtin")
        self.task, self.seed, self.spent = redesigned(task), seed, Spent()
        goal = joint_goal(task)
        assert goal is not None, task.name
        name, self.opening = goal[0], OPENING[goal[1]]
        order = seeding.rng(seed, f"{task.name}/affordance").permutation(len(ids := seen_by_search(library, name)))
        self.thing = Affordance.of([library.load(name, ids[index]) for index in order[:LOOKED_AT]])
        fresh = tuple(library.sample(name, 2 * FRESH, seed))
        self.seen = self._setting("train")
        self.fresh, self.other = self._setting(fresh[:FRESH]), self._setting(fresh[FRESH:])

    @property
    def every(self) -> list[Manipulation]:
        """All alignments of the class."""
        end = joint_search.OPENED if self.opening else joint_search.CLOSED_UP
        return list(joint_search.alignments(self.thing, self.opening, end))

    def screen(self, drawn: Sequence[Manipulation]) -> list[CandidateResult]:
        """Plan them, the best first."""
        begin = time.process_time()
        candidates = [self._candidate(each) for each in drawn]
        stages = [
            worker.screen_scene(self.seen, seed, [each.steps for each in candidates])
            for seed in seeding.scene_seeds(self.seed, self.task.name, "screen", SCENES)
        ]
        found = []
        for candidate, outcomes in zip(candidates, zip(*stages, strict=True), strict=True):
            score = sum(each[0] for each in outcomes) / SCENES
            told = diagnoses((cause, numbers) for _, cause, numbers in outcomes if cause is not None)
            causes = merge_causes([cause for _, cause, _ in outcomes])
            found.append(CandidateResult(candidate, (StageResult("plan", SCENES, score, causes, 0.0, told),)))
        self.spent.planned += len(found)
        self.spent.planned_scenes += sum(each.plan_score > 0 for each in found)
        self.spent.cpu["plan"] += time.process_time() - begin
        return sorted(found, key=lambda each: -each.plan_score)

    def trial(self, result: CandidateResult) -> CandidateResult:
        """Up to 5 episodes, until two have not held."""
        begin, episodes = time.process_time(), []
        for seed in seeding.scene_seeds(self.seed, self.task.name, "design", TRIAL):
            episodes.append(worker.trial(self.seen, result.candidate.steps, seed))
            if sum(not each.held for each in episodes) == DROPPED_AT:
                break
        self.spent.tried += 1
        self.spent.episodes += len(episodes)
        self.spent.cpu["physics"] += time.process_time() - begin
        held = sum(each.held for each in episodes) / len(episodes)
        failed = [each for each in episodes if each.cause is not None]
        stage = StageResult(
            "physics",
            len(episodes),
            held,
            merge_causes([str(each.cause) for each in failed]),
            diagnoses=diagnoses((str(each.cause), each.diagnosis) for each in failed),
        )
        return replace(result, stages=(*result.stages, stage))

    def held(self, candidate: Candidate, setting: Setting, purpose: str, least: int) -> tuple[int, int]:
        """How many fresh episodes hold, and of how many; ends where ``least`` can no longer be had."""
        begin, held, run = time.process_time(), 0, 0
        for seed in seeding.scene_seeds(self.seed, self.task.name, purpose, FRESH):
            run += 1
            held += worker.trial(setting, candidate.steps, seed).held
            if held + FRESH - run < least:
                break
        self.spent.cpu["fresh"] += time.process_time() - begin
        return held, run

    def _setting(self, instances: str | tuple[str, ...]) -> Setting:
        return Setting(self.task, instances, Circumstances("builtin"))

    def _candidate(self, each: Manipulation) -> Candidate:
        step = self.task.steps[0]
        return Candidate(each.label, {step.name: {step.strategies[0]: each.config()}}, each.provenance())


def rounds(judge: Judge, way: str, most: int, results: list[CandidateResult]) -> Iterator[list[Manipulation]]:
    """Yield what each round tries, given what ``results`` has by then."""
    every = judge.every
    order = seeding.rng(judge.seed, f"{judge.task.name}/order").permutation(len(every))
    generator = seeding.rng(judge.seed, f"{judge.task.name}/told")
    done = 0
    for upto in (each for each in ROUNDS if each <= most):
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


def loop(name: str, way: str, draw: int, most: int) -> dict[str, Any]:
    """One draw for one task: after how many candidates one was found that works."""
    judge = Judge(load_task(name), draw)
    results: list[CandidateResult] = []
    told = {"task": name, "way": way, "draw": draw, "most": most, "alignments": len(judge.every), "found": None}
    passed = 0
    for drawn in rounds(judge, way, most, results):
        screened = judge.screen(drawn)
        for index, result in enumerate(screened):
            if not result.plan_score:
                continue
            screened[index] = judge.trial(result)
            if screened[index].held <= TRIAL - DROPPED_AT:
                continue
            passed += 1
            held, _ = judge.held(result.candidate, judge.fresh, "fresh", WORKS)
            if held >= WORKS:
                again, _ = judge.held(result.candidate, judge.other, "other", 0)
                told |= {"found": judge.spent.planned, "label": result.candidate.label, "fresh": held, "again": again}
                return {**told, "passed": passed, **judge.spent.to_dict()}
        results += screened
    return {**told, "passed": passed, **judge.spent.to_dict()}


def table(lines: Sequence[dict[str, Any]]) -> str:
    """Markdown of all draws."""
    rows = ["| | " + " | ".join(f"{count} candidates" for count in SHOWN) + " |", "| --- |" + " --- |" * len(SHOWN)]
    for way in WAYS:
        cells = []
        for count in SHOWN:
            of = [line for line in lines if line["way"] == way and line["most"] >= count]
            works = sum(line["found"] is not None and line["found"] <= count for line in of)
            tasks, low_high = len({line["task"] for line in of}), interval(works, len(of))
            if not of:
                cells.append("-")
                continue
            low, high = (tasks * each for each in low_high)
            cells.append(f"{tasks * works / len(of):.1f} of {tasks} ({low:.1f} to {high:.1f}; {works}/{len(of)} draws)")
        rows.append(f"| {way} | " + " | ".join(cells) + " |")
    return "\n".join([*rows, "", *_efforts(lines), "", *_by_task(lines)])


def _efforts(lines: Sequence[dict[str, Any]]) -> Iterator[str]:
    for way in WAYS:
        of = [line for line in lines if line["way"] == way]
        if not of:
            continue
        plan, physics = (sum(line[f"cpu_{name}"] for line in of) for name in ("plan", "physics"))
        planned, tried = sum(line["planned"] for line in of), sum(line["tried"] for line in of)
        moved, episodes = sum(line["planned_scenes"] for line in of), sum(line["episodes"] for line in of)
        found = [line for line in of if line["found"] is not None]
        again = np.mean([line["again"] / FRESH for line in found]) if found else float("nan")
        yield (
            f"{way}: {planned} candidates through the solver on {SCENES} scenes each, {60 * planned / plan:.0f} a "
            f"minute of CPU; {moved / planned:.0%} of them move; {tried} through physics, {60 * tried / physics:.0f} a "
            f"minute of CPU ({episodes / tried:.1f} episodes each); {sum(line['passed'] for line in of)} passed their "
            f"trial, {len(found)} of these work; what works held in {again:.1%} of {FRESH} more episodes each."
        )


def _by_task(lines: Sequence[dict[str, Any]]) -> Iterator[str]:
    yield "| task | alignments | blindly: found after | told: found after |"
    yield "| --- | --- | --- | --- |"
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
    parser.add_argument("--draws", type=int, default=2, help="draws are numbered from 1 on, which is their seed")
    parser.add_argument("--most", type=int, default=ROUNDS[-1], choices=ROUNDS, help="candidates of a draw")
    parser.add_argument("--tasks", nargs="*", default=[each for each in task_names("paper") if _is_single(each)])
    parser.add_argument("--table", action="store_true", help="run nothing")
    options = parser.parse_args(arguments)
    lines = [json.loads(line) for line in options.out.read_text().splitlines()] if options.out.exists() else []
    jobs = [(name, way, draw) for draw in range(1, options.draws + 1) for name in options.tasks for way in WAYS]
    done = {(line["task"], line["way"], line["draw"]) for line in lines}
    for job in () if options.table else (job for job in jobs if job not in done):
        line = loop(*job, options.most)
        lines.append(line)
        with options.out.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(line) + "\n")
        print(json.dumps(line), file=sys.stderr, flush=True)
    print(table(lines))
    return 0


def _is_single(name: str) -> bool:
    return load_task(name).is_single_step


if __name__ == "__main__":
    sys.exit(main())
