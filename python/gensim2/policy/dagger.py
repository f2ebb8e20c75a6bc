"""DAgger: roll out the policy, let the planner label the visited states, and continue training with these labels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from gensim2.core.errors import InputError
from gensim2.core.progress import NULL_PROGRESS, NamedProgress, Progress
from gensim2.core.resumable import RunSettings, held_already
from gensim2.core.seeding import scene_seeds
from gensim2.data.dataset import DataSet
from gensim2.data.used_objects import ObjectCheck
from gensim2.policy.checkpoint import PolicyCheckpoint
from gensim2.policy.config import PolicyConfig, TrainConfig
from gensim2.policy.demonstrations import Demonstrations
from gensim2.policy.relabels import RelabelledSource, Relabels, relabel_episode
from gensim2.policy.train import TRAINING, TrainResult, holds_training, train_policy
from gensim2.policy.train_state import STATE_JSON
from gensim2.rollout.counted_objects import with_objects
from gensim2.rollout.inputs import TaskInput, read_task_inputs

PURPOSE = "policy/relabels"
"""Name from which the seeds of DAgger scenes are derived; other purposes, such as evaluations, have other names."""
ROUNDS = "rounds"
"""Name of the subfolder with the policies of earlier rounds and with all labels."""
EPISODES = 20
"""Default number of rollouts for each task and round."""


class _Rounds(RunSettings):
    dagger: int


def train_rounds(
    source: Demonstrations,
    folders: Sequence[Path],
    policy: PolicyConfig,
    training: TrainConfig,
    out: Path,
    *,
    rounds: int,
    episodes: int = EPISODES,
    start: PolicyCheckpoint | None = None,
    resume: bool = False,
    device: str = "auto",
    workers: int = 1,
    assets: Path | str | None = None,
    progress: Progress = NULL_PROGRESS,
) -> TrainResult:
    """Train on demonstrations, then in rounds on states that the policy visited, with the planner's actions (DAgger).

    Each round starts from the weights of the last one, and trains on the demonstrations and on all labelled states so
    far.

    Args:
        folders: data sets of the demonstrations. Rollouts use their tasks and objects, with new seeds.
        policy, training: as for :func:`~gensim2.policy.train.train_policy`. Every training takes the given number of
            steps.
        out: folder of the last checkpoint. Its subfolder ``rounds/`` has the earlier checkpoints and the labelled
            states.
        rounds: number of rounds of rollouts and training after the first training.
        episodes: number of rollouts for each task and round.
        start, resume, device: as for :func:`~gensim2.policy.train.train_policy`.
        workers: simulator processes.
        assets: folder of the objects; None: the folder recorded in the data sets.

    Returns:
        Result of the last training. Its steps and CPU time are the sums over all trainings, without the rollouts.

    Raises:
        InputError: a task has several steps or an object without a joint, ``out`` has a policy of other rounds, or
            :func:`~gensim2.policy.train.train_policy` refuses an argument.
        NotRunError: some episodes could not be run.
    """
    _check_free(out, resume, rounds)
    given = []
    for folder in folders:
        dataset = DataSet.open(folder, assets)
        ObjectCheck(dataset, progress).all()
        given += _inputs(dataset, source.record.tasks)
    for one in given:
        step = one.spec.steps[0]
        if len(one.spec.steps) > 1 or one.library.kind(one.spec.objects[step.object].asset_class) != "articulated":
            message = f"{one.spec.name} is not one step on one joint, and has no relabels"
            raise InputError(message, field="dagger", remedy="leave the task out, or train without --dagger")
    found: list[Relabels] = []
    before: list[TrainResult] = []
    mixed: Demonstrations | RelabelledSource = source
    for number in range(rounds):
        folder = out / ROUNDS / str(number)
        told = NamedProgress(f"round {number}", progress)
        before.append(
            train_policy(mixed, policy, training, folder, start=start, resume=resume, device=device, progress=told)
        )
        start = PolicyCheckpoint.load(folder)
        for place, one in enumerate(given):
            path = folder / "relabels" / f"{place}-{one.spec.name}-{episodes}.npz"
            purpose = f"{PURPOSE}/{number}/{place}"
            found.append(_relabel(one, path, folder, purpose, training.seed, episodes, workers, told))
        mixed = RelabelledSource(source, found)
        progress.message(f"round {number}: {mixed.record.relabels} relabelled states in total")
    last = train_policy(mixed, policy, training, out, start=start, resume=resume, device=device, progress=progress)
    every = [*before, last]
    return replace(last, steps=sum(each.steps for each in every), cpu_s=sum(each.cpu_s for each in every))


def _check_free(out: Path, resume: bool, rounds: int) -> None:
    """Check, before the first round starts, that the last round can write its checkpoint to the output folder."""
    if not holds_training(out):
        return
    begun = (out / ROUNDS / "0" / TRAINING / STATE_JSON).exists()
    if not (resume and begun):
        raise held_already(out, "a policy", *([] if begun else ["choose another --out"]))
    had = sum(path.is_dir() for path in (out / ROUNDS).glob("*"))
    _Rounds(dagger=had).require_same(_Rounds(dagger=rounds), out)


def _relabel(
    given: TaskInput, path: Path, folder: Path, purpose: str, seed: int, episodes: int, workers: int, progress: Progress
) -> Relabels:
    """Return the planner's labels for a task in a round.

    The labels come from the file ``path`` if it exists, or else from rollouts.
    """
    from gensim2.core.processes import Execution, Job, results
    from gensim2.rollout.runner import EpisodeRunner

    if path.exists():
        return Relabels.load(path)
    seeds = scene_seeds(seed, given.spec.name, purpose, episodes)
    jobs = [Job(n, (given.scene, given.strategies, str(folder), each)) for n, each in enumerate(seeds)]
    progress.start(f"{given.spec.name}: relabels", len(jobs))
    made: dict[int, Any] = {}
    with EpisodeRunner(given.scene.options, Execution(workers), progress) as evaluator:
        for index, arrays in results(evaluator.executor.map_unordered(relabel_episode, jobs), "relabels", None):
            made[index] = arrays
            progress.advance()
    relabels = Relabels.of(given.spec.description, [made[index] for index in sorted(made)])
    relabels.save(path)
    return relabels


def _inputs(dataset: DataSet, tasks: Sequence[str]) -> list[TaskInput]:
    """Return a data set's tasks, each with the strategies that planned its episodes."""
    record, found = dataset.record, []
    for name in dataset.tasks:
        if name in tasks:
            task = record.tasks[name]
            scene: dict[str, Any] = {**dataset.scene.to_record(), "instances": task.instances}
            given, _ = read_task_inputs([str(dataset.task(name).folder)], seed=record.seed, **scene)
            count = task.objects
            found += given if count is None else [with_objects(one, count, record.seed) for one in given]
    return found
