"""Put strategies to the test on fresh seeds; each episode is kept as soon as it is finished."""

from __future__ import annotations

from gensim2.core.errors import InputError
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.core.seeding import scene_seeds
from gensim2.data.records import Verification
from gensim2.data.runfolder import RunFolder, TaskFolder
from gensim2.design.unseen import Apart
from gensim2.objects import Library
from gensim2.rollout.episode_log import EpisodeLog
from gensim2.rollout.runner import EpisodeRunner
from gensim2.tasks.spec import TaskSpec
from gensim2.tasks.strategies import Strategies

#: Share of fresh episodes that must hold for a task to be kept: of one step, of several.
KEEP_THRESHOLD, KEEP_LONG = 0.8, 0.6

#: Fresh episodes of a verification by default.
VERIFY_EPISODES = 20

#: Episodes after which it is looked at whether the threshold can still be reached.
STRIDE = 10

#: Episodes of a verification that is under way.
UNDER_WAY = "verification.jsonl"


def verify(
    task: TaskSpec,
    strategies: Strategies,
    files: TaskFolder,
    run: RunFolder,
    evaluator: EpisodeRunner,
    library: Library,
    apart: Apart,
    *,
    episodes: int,
    seed: int,
    progress: Progress = NULL_PROGRESS,
) -> Verification:
    """Run fresh episodes and write ``verification.json``; a second call reads it.

    A task that can no longer reach its threshold is not run to the end: what it has then is all of its verification.

    Args:
        apart: which instances the episodes draw from.
        episodes: how many.

    Raises:
        NotRunError: episodes could not be run; all others are finished.
        InputError: what an earlier run left cannot be used.
    """
    seeds = scene_seeds(seed, task.name, "verify", episodes)
    log_path = files.path / UNDER_WAY
    verification = files.verification()
    if verification is not None:
        had = [episode.seed for episode in verification.episodes]
        if had != seeds[: len(had)] or (verification.kept and len(had) != len(seeds)):
            raise InputError(
                "is not of this run", file=files.verification_path, field="episodes", remedy="delete it and resume"
            )
    else:
        log = EpisodeLog(log_path, seeds)
        threshold = KEEP_THRESHOLD if task.is_single_step else KEEP_LONG
        progress.start(f"{task.name}: verify", len(seeds))
        progress.advance(len(log.done))
        configs = [evaluator.config(task, drawn) for drawn in apart.verification(len(seeds), seed)]
        for first in range(0, len(seeds), STRIDE):
            upto = min(first + STRIDE, len(seeds))
            jobs = [(configs[i], strategies, seeds[i]) for i in range(upto)]
            found = evaluator.episodes(f"{task.name}: verification", jobs, log=log)
            failed = sum(not episode.held for episode in found)
            if len(seeds) - failed < threshold * len(seeds):
                break
        verification = Verification(tuple(found), threshold, apart.kind)
        files.write_verification(verification)
    log_path.unlink(missing_ok=True)
    run.add_episodes(library, verification.episodes, files.verification_path)
    run.save()
    return verification
