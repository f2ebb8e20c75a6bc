"""Collect demonstrations: episodes of fresh seeds in order, those that hold are kept, until there are enough."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from gensim2.assets import open_library
from gensim2.demos.trajectory import Provenance, TrajectoryStore
from gensim2.demos.video import film
from gensim2.errors import InputError
from gensim2.pipeline import worker
from gensim2.pipeline.evaluator import PoolEvaluator
from gensim2.pipeline.records import Attempt
from gensim2.pipeline.runfolder import RunFolder, TaskFolder, versions
from gensim2.pipeline.search import design_seeds
from gensim2.progress import NULL_PROGRESS, Progress
from gensim2.tasks.spec import TaskSpec

#: Episodes tried for each demonstration that was asked for, before the collection gives up.
TRIES_PER_DEMO = 5

#: Every attempt, one JSON object a line, so that a resumed collection repeats none.
ATTEMPTS = "attempts.jsonl"


def collect(
    task: TaskSpec,
    config: dict[str, Any],
    files: TaskFolder,
    run: RunFolder,
    evaluator: PoolEvaluator,
    *,
    episodes: int,
    seed: int,
    video: bool = True,
    progress: Progress = NULL_PROGRESS,
) -> int:
    """Record demonstrations until ``episodes`` have held, and merge them.

    Each is written when it is finished; a second call goes on behind the last attempt. Which episodes are kept
    depends on the seed alone, not on the number of workers.

    Returns:
        How many demonstrations there are; fewer than ``episodes`` where too many attempts failed.
    """
    store = TrajectoryStore(files.path)
    log = files.path / ATTEMPTS
    done = _read_attempts(log)
    missing = episodes - sum(attempt.success for attempt in done)
    progress.start(f"{task.name}: demonstrations", episodes)
    progress.advance(episodes - max(missing, 0))
    seeds = design_seeds(seed, task, "demos", TRIES_PER_DEMO * episodes)
    setting = evaluator.setting(task)
    files.path.mkdir(parents=True, exist_ok=True)
    with log.open("a", encoding="utf-8") as stream:
        while missing > 0 and len(done) < len(seeds):
            batch = range(len(done), min(len(done) + missing, len(seeds)))
            jobs = [(setting, config, seeds[index]) for index in batch]
            for index, outcome in zip(batch, evaluator.pool.map(worker.demonstrate, jobs), strict=True):
                if outcome.error is not None:
                    attempt, recording = worker.failed(seeds[index], outcome.error), None
                else:
                    attempt, recording = outcome.unwrap()
                if recording is not None:
                    store.add(index, recording, {"openness_goal": task.success[0].threshold})
                    missing -= 1
                    progress.advance()
                stream.write(json.dumps(attempt.to_dict()) + "\n")
                stream.flush()
                done.append(attempt)
    kept = store.indices()
    if not kept:
        return 0
    library = open_library(evaluator.assets)
    licenses = {}
    for attempt in done:
        if attempt.success:
            key = f"{task.asset_class}/{attempt.instance}"
            instance = library.load(task.asset_class, attempt.instance)
            licenses[key] = instance.license
            run.add_instance(key, instance.content_hash, instance.license)
    run.save()
    store.merge(
        Provenance(
            task=task,
            config=config,
            assets=evaluator.assets,
            licenses=licenses,
            seed=seed,
            details={"versions": versions(), "attempts": len(done)},
        )
    )
    if video and not (files.path / "video.mp4").exists():
        _film(files.path, task, evaluator, progress)
    return len(kept)


def _film(folder: Path, task: TaskSpec, evaluator: PoolEvaluator, progress: Progress) -> None:
    """Film the first demonstration in a worker; where no picture can be made, say so and go on."""
    from gensim2.sim import rendering

    if not rendering.can_render():
        progress.message(f"{task.name}: no video: {rendering.NO_DRIVER}")
        return
    progress.start(f"{task.name}: film", 1)
    job = (folder / "trajectory.h5", folder / "video.mp4", folder / "still.png")
    for outcome in evaluator.pool.map(film_job, [job]):
        if outcome.error is not None:
            progress.message(f"{task.name}: no video: {outcome.error}")
        progress.advance()


def film_job(trajectory: Path, video: Path, still: Path) -> int:
    """Film the first episode; return the number of frames."""
    return film(trajectory, video, still=still).frames


def _read_attempts(log: Path) -> list[Attempt]:
    """Return the attempts of an earlier run, dropping a last line that was cut off."""
    attempts = list(_lines(log))
    if log.exists():
        text = "".join(json.dumps(attempt.to_dict()) + "\n" for attempt in attempts)
        if log.read_text(encoding="utf-8") != text:
            log.write_text(text, encoding="utf-8")
    return attempts


def _lines(log: Path) -> Iterator[Attempt]:
    if not log.exists():
        return
    lines = log.read_text(encoding="utf-8").splitlines()
    for number, line in enumerate(lines, 1):
        try:
            yield Attempt(**json.loads(line))
        except (ValueError, TypeError) as error:
            if number == len(lines):
                return
            raise InputError(
                f"is not an attempt: {error}",
                file=log,
                field=f"line {number}",
                remedy="delete the task's folder",
            ) from error
