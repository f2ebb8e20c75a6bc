"""Put strategies to the test on fresh seeds; each episode is kept as soon as it is finished."""

from __future__ import annotations

from gensim2.designers.base import Strategies
from gensim2.errors import InputError
from gensim2.objects import Library
from gensim2.pipeline import worker
from gensim2.pipeline.attempts import AttemptLog, LoggedEpisode
from gensim2.pipeline.evaluator import PoolEvaluator
from gensim2.pipeline.records import Verification
from gensim2.pipeline.runfolder import RunFolder, TaskFolder
from gensim2.pipeline.unseen import Apart
from gensim2.processes import Job
from gensim2.progress import NULL_PROGRESS, Progress
from gensim2.seeding import scene_seeds
from gensim2.tasks.spec import TaskSpec

#: Share of fresh episodes that must hold for a task to be kept.
KEEP_THRESHOLD = 0.7

#: Fresh episodes of a verification, unless more demonstrations than that are asked for.
VERIFY_EPISODES = 20

#: Episodes of a verification that is under way.
UNDER_WAY = "verification.jsonl"


def verify(
    task: TaskSpec,
    strategies: Strategies,
    files: TaskFolder,
    run: RunFolder,
    evaluator: PoolEvaluator,
    library: Library,
    apart: Apart,
    *,
    episodes: int,
    seed: int,
    progress: Progress = NULL_PROGRESS,
) -> Verification:
    """Run fresh episodes and write ``verification.json``; a second call reads it.

    Args:
        apart: which instances the episodes draw from.
        episodes: demonstrations asked for; where they are more than ``VERIFY_EPISODES``, as many are run.

    Raises:
        NotRunError: episodes could not be run; all others are finished.
        InputError: what an earlier run left cannot be used.
    """
    seeds = scene_seeds(seed, task.name, "verify", max(VERIFY_EPISODES, episodes))
    log_path = files.path / UNDER_WAY
    verification = files.verification()
    if verification is not None:
        if [episode.seed for episode in verification.episodes] != seeds:
            raise InputError(
                "is not of this run", file=files.verification_path, field="episodes", remedy="delete it and resume"
            )
    else:
        log = AttemptLog(log_path, seeds)
        progress.start(f"{task.name}: verify", len(seeds))
        progress.advance(len(log.done))
        settings = [evaluator.setting(task, words) for words in apart.verification(len(seeds), seed)]
        jobs = [Job(i, (settings[i], strategies, seeds[i])) for i in range(len(seeds)) if i not in log.done]
        for index, episode in evaluator.run(worker.episode, jobs, f"{task.name}: verification"):
            log.add(LoggedEpisode.of(episode, index))
            progress.advance()
        found = tuple(log.done[index].episode for index in range(len(seeds)))
        verification = Verification(found, KEEP_THRESHOLD, apart.kind)
        files.write_verification(verification)
    log_path.unlink(missing_ok=True)
    run.add_episodes(library, verification.episodes, files.verification_path)
    run.save()
    return verification
