"""Run an experiment: train its policies with :func:`~gensim2.policy.learning.learn` and evaluate them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict

from gensim2.core.errors import InputError
from gensim2.core.files import write_json
from gensim2.core.progress import NULL_PROGRESS, NamedProgress, Progress
from gensim2.core.record_files import SCHEMA_VERSION, read_record
from gensim2.core.resumable import ResumableFolder, RunSettings
from gensim2.core.yaml_files import read_yaml
from gensim2.evaluation.evaluating import EvaluationResult
from gensim2.objects import open_library
from gensim2.objects.library.catalogue import BUILTIN
from gensim2.policy.devices import read_devices
from gensim2.policy.evaluating import evaluate_policy
from gensim2.policy.experiments.config import Arm, ExperimentConfig
from gensim2.policy.experiments.figures import KINDS, Kind, Rate, TaskFigures, summary
from gensim2.policy.keypose.adding import generated_input
from gensim2.policy.learning import Learned, learn
from gensim2.rollout.inputs import read_task_input, read_task_inputs
from gensim2.scenes.config import SceneArguments
from gensim2.tasks.criteria import ArticulatedClosed, ArticulatedOpen
from gensim2.tasks.library import load_task
from gensim2.tasks.spec import TaskSpec

EXPERIMENT_JSON, RESULT_JSON = "experiment.json", "result.json"


SENTENCES = Path(__file__).parent / "sentences.yaml"


def opposites(tasks: Sequence[TaskSpec]) -> dict[str, str]:
    """Return, for each instruction, the instruction of the task that moves the same joint in the opposite direction.

    Args:
        tasks: tasks of one policy. Scenes of two opposite tasks look alike, so only the instruction distinguishes them.
    """
    ends = {(name, opens): task.description for task in tasks for name, opens in [_end(task)] if name is not None}
    return {sentence: ends[name, not opens] for (name, opens), sentence in ends.items() if (name, not opens) in ends}


def _end(task: TaskSpec) -> tuple[str | None, bool]:
    """Return the class and whether the goal is to open (True) or close. Return (None, False) for any other task."""
    things, goal = list(task.objects.values()), task.success
    if len(things) == 1 and len(goal) == 1 and isinstance(goal[0], ArticulatedOpen | ArticulatedClosed):
        return things[0].asset_class, isinstance(goal[0], ArticulatedOpen)
    return None, False


def rephrased(tasks: Sequence[TaskSpec]) -> list[dict[str, str]]:
    """Return sets of paraphrases; each set maps every task's instruction to a paraphrase.

    The number of sets is the smallest number of paraphrases that a task has.

    Raises:
        InputError: the package has no paraphrase of an instruction.
    """
    known = read_yaml(SENTENCES)
    for task in tasks:
        if task.description not in known:
            message = f"the package has no other words for {task.description!r}"
            remedy = "sentences: false, or arms of the package's tasks"
            raise InputError(message, field=f"sentences.{task.name}", remedy=remedy)
    count = min(len(known[task.description]) for task in tasks)
    return [{task.description: known[task.description][number] for task in tasks} for number in range(count)]


class ExperimentRecord(RunSettings):
    """Content of ``experiment.json``: the settings. A resumed run must have the same settings.

    Attributes:
        seed: seed of the first training run of each policy.
        assets: folder of the real objects; ``"builtin"`` if the run has no real objects.
    """

    FREE = frozenset({"config.title", "config.about"})

    schema_version: Literal[1] = 1
    config: ExperimentConfig
    seed: int
    assets: str


class _Progressed(BaseModel):
    """Content of an experiment's result file, reduced to the number of training runs that are still to be done."""

    model_config = ConfigDict(extra="ignore")

    remaining: int = 0


@dataclass(frozen=True)
class ArmResult:
    """Result of one policy of an experiment, over all its training runs.

    Attributes:
        arm: configuration of the policy.
        tasks: success rates on the tasks of the policy.
        checkpoints: checkpoint folders, one for each training run.
        demonstrations: number of demonstrations in all training runs.
        cpu_s: CPU time of data and training in all training runs, s.
        before_s: CPU time spent on the policy that training starts from, s.
    """

    arm: Arm
    tasks: tuple[TaskFigures, ...]
    checkpoints: tuple[str, ...]
    demonstrations: int
    cpu_s: float
    before_s: float = 0.0

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data; ``cpu_s`` includes the CPU time of the starting policy."""
        return {
            **self.arm.model_dump(mode="json"),
            **summary(self.tasks),
            "checkpoints": list(self.checkpoints),
            "demonstrations": self.demonstrations,
            "cpu_s": round(self.cpu_s + self.before_s, 3),
        }


@dataclass(frozen=True)
class ExperimentResult:
    """Result of an experiment.

    Attributes:
        out: output folder.
        record: settings of the run.
        arms: results of the policies, in the order in which the configuration lists them.
        skipped: reason for each skipped policy (key ``policy``), each skipped task (key ``policy/task``), and each task
            whose evaluation on real objects was skipped (key ``policy/task on real objects``).
        remaining: number of training runs still to be done.
    """

    out: str
    record: ExperimentRecord
    arms: tuple[ArmResult, ...]
    skipped: Mapping[str, str]
    remaining: int

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data: means over all tasks of all policies, and rows for tasks and policies.

        ``tasks`` has one row for each task of each policy, ``arms`` one row for each policy.
        """
        return {
            "schema_version": SCHEMA_VERSION,
            "out": self.out,
            **self.record.model_dump(mode="json", exclude={"schema_version", "config"}),
            "title": self.record.config.title,
            "about": self.record.config.about,
            "seeds": self.record.config.seeds,
            "remaining": self.remaining,
            **summary([task for each in self.arms for task in each.tasks]),
            "tasks": [task.to_dict(each.arm.name) for each in self.arms for task in each.tasks],
            "arms": [each.to_dict() for each in self.arms],
            "skipped": dict(self.skipped),
            "cpu_s": round(sum(each.cpu_s for each in self.arms), 3),
        }


def run_experiment(
    config: ExperimentConfig,
    *,
    out: Path,
    seed: int = 0,
    assets: str | Path | None = None,
    workers: int = 2,
    resume: bool = False,
    device: str = "auto",
    progress: Progress = NULL_PROGRESS,
) -> ExperimentResult:
    """Train and evaluate every policy of an experiment, and update its report after each training run.

    Args:
        config: the experiment.
        out: output folder. ``<policy>/seed-<n>`` has the files of :func:`~gensim2.policy.learning.learn`.
        seed: seed of the first training run of each policy; each further run uses the next integer.
        assets: folder of real objects. None: the folder in ``GENSIM2_ASSETS``. Without a folder, policies for real
            objects are skipped.
        workers: number of processes that plan and simulate.
        resume: continue the run in ``out``.
        device: device for training, as for :func:`~gensim2.policy.devices.read_devices`.

    Raises:
        InputError: an argument is invalid, ``out`` contains something else, or no policy can be trained.
        NotRunError: some scenes or episodes could not be run.
    """
    read_devices(device)
    library = open_library(assets)
    record = ExperimentRecord(config=config, seed=seed, assets=str(library.location))
    arms, skipped = runnable(record)
    if not arms:
        name, reason = next(iter(skipped.items()))
        wrong = f"no policy of the experiment can be trained with these objects; for example, {name}: {reason}"
        raise InputError(wrong, field="assets")
    with ResumableFolder(out, EXPERIMENT_JSON, record, holds="an experiment", resume=resume, alone=False):
        from gensim2.policy.experiments.page import write_page

        trained: dict[str, list[_Training]] = defaultdict(list)
        total = config.seeds * len(arms)
        there = (
            read_record(out / RESULT_JSON, _Progressed, "remove it").remaining
            if (out / RESULT_JSON).exists()
            else total
        )
        # The outer loop is over seeds and the inner loop over policies. A long experiment thus soon has a first result
        # of each policy.
        for done in range(total):
            number, arm = done // len(arms), arms[done % len(arms)]
            progress.message(f"training {done + 1} of {total}: {arm.name}, seed {seed + number}")
            start = None if arm.start is None else trained[arm.start][number]
            trained[arm.name].append(_train(arm, start, record, number, out, workers, device, progress))
            found = tuple(_arm_result(each, trained, record) for each in arms if trained[each.name])
            result = ExperimentResult(str(out), record, found, skipped, total - done - 1)
            if result.remaining <= there:  # do not overwrite a more complete earlier result
                told, there = result.to_dict(), result.remaining
                write_json(out / RESULT_JSON, told)
                write_page(told)
        return result


def runnable(record: ExperimentRecord) -> tuple[list[Arm], dict[str, str]]:
    """Return the policies and tasks that can be run, and a reason for every policy or task that cannot.

    This check takes little time and precedes all training.

    Raises:
        InputError: a task is unknown, or an instruction has no paraphrase.
    """
    found: list[Arm] = []
    skipped: dict[str, str] = {}
    for arm in record.config.arms:
        if arm.start is not None:
            start = next((each for each in found if each.name == arm.start), None)
            # only a policy that was trained on several tasks can be extended by further tasks
            if start is None or len(start.tasks) < 2:
                reasons = (reason for name, reason in skipped.items() if name.partition("/")[0] == arm.start)
                skipped[arm.name] = f"starts from {arm.start}, which cannot be run: {next(reasons, 'no task is left')}"
                continue
        if arm.objects == "real" and record.assets == BUILTIN:
            skipped[arm.name] = "needs a folder of real objects: --assets"
            continue
        left = list(arm.tasks)
        for word in dict.fromkeys(
            word for number in range(record.config.seeds) for word in record.config.words(arm, number)
        ):
            for name in list(left):
                _check_name(arm, name)
                try:
                    read_task_input(name, assets=_assets(arm, record), instances=word)
                except InputError as error:
                    skipped[f"{arm.name}/{name}"] = error.message
                    left.remove(name)
        arm = arm.model_copy(update={"tasks": tuple(left)})
        if left and arm.count is not None and not _has_generated(arm, record):
            beside = ", beside the real ones" if arm.is_split else ""
            skipped[arm.name] = f"has no task that generated objects do for{beside}"
            continue
        if arm.added_to(record.config.start_of(arm)):
            found.append(arm)
    for arm in found:
        _, lacking = _transferred(arm, record)
        skipped |= {f"{arm.name}/{name} on real objects": reason for name, reason in lacking.items()}
        # Check the objects of the evaluation before training. Other runs use the same classes.
        for one in _measurements(arm, record, 0):
            _, lacking = read_task_inputs(tuple(one.tasks), seed=0, assets=one.assets, instances=one.instances)
            for name, reason in lacking.items():
                raise InputError(f"{one.title}: {reason}", field=f"arms.{arm.name}.{name}")
    return found, skipped


def _has_generated(arm: Arm, record: ExperimentRecord) -> bool:
    """Return whether any task that the policy must newly learn can use generated objects."""
    assert arm.count is not None
    for name in arm.added_to(record.config.start_of(arm)):
        try:
            generated_input(name, arm.count, seed=record.seed)
        except InputError:
            continue
        return True
    return False


def without_others(arm: Arm, record: ExperimentRecord) -> frozenset[str]:
    """Return the tasks of a policy that use only rigid objects.

    These tasks have no unseen objects, because a class of rigid objects has only one instance.
    """
    library, tasks = open_library(_assets(arm, record)), map(load_task, arm.tasks)
    return frozenset(
        task.name
        for task in tasks
        if all(library.kind(thing.asset_class) == "rigid" for thing in task.objects.values())
    )


def _check_name(arm: Arm, name: str) -> None:
    try:
        load_task(name)
    except InputError as error:
        raise InputError(error.message, field=f"arms.{arm.name}.tasks", remedy=error.remedy) from error


def _assets(arm: Arm, record: ExperimentRecord) -> str:
    return BUILTIN if arm.objects == "generated" else record.assets


@dataclass(frozen=True)
class _Training:
    """One training run of a policy, with its evaluations.

    Attributes:
        learned: the trained policy.
        before_s: CPU time spent on the policy that this run starts from, s.
    """

    learned: Learned
    before_s: float
    tables: Mapping[Kind, Sequence[EvaluationResult]]


def _train(
    arm: Arm,
    start: _Training | None,
    record: ExperimentRecord,
    number: int,
    out: Path,
    workers: int,
    device: str,
    progress: Progress,
) -> _Training:
    config, assets = record.config, _assets(arm, record)
    taught = arm.added_to(config.start_of(arm))
    hears = len(arm.tasks) > 1  # with a single task the instruction does not matter
    taught_on: SceneArguments = {"assets": assets}
    train, unseen = config.words(arm, number)
    if arm.is_split:
        taught_on["instances"] = train
    seed = record.seed + number
    folder = out / arm.name / f"seed-{seed}"
    (learned,) = learn(
        taught,
        minutes=(arm.minutes_a_task or config.minutes_a_task) * len(taught),
        multi_task=True,
        scenes=config.scenes,
        objects=None if arm.is_split else arm.count,
        generated=arm.count if arm.is_split else None,
        episodes=config.episodes,
        control_episodes=config.control_episodes,
        controls=("blind",),
        videos=0,
        start=None if start is None else start.learned.folder,
        text=config.text if hears else None,
        text_model=config.text_model if hears and start is None else None,
        test_instances=unseen,
        seed=seed,
        out=folder,
        workers=workers,
        resume=True,
        device=device,
        progress=progress,
        **taught_on,
    ).learned
    tables: dict[Kind, list[EvaluationResult]] = defaultdict(list)
    tables["unseen"].append(learned.measured.policy)
    tables["blind"] += learned.measured.controls["blind"]
    for one in _measurements(arm, record, number):
        measured = evaluate_policy(
            folder,
            one.tasks,
            controls=(),
            episodes=one.episodes,
            arguments=one.arguments,
            seed=seed,
            out=folder / one.folder,
            workers=workers,
            resume=True,
            progress=NamedProgress(one.title, progress),
            assets=one.assets,
            instances=one.instances,
        )
        tables[one.kind].append(measured.policy)
    return _Training(learned, 0.0 if start is None else start.before_s + start.learned.cpu_s, tables)


def _arm_result(arm: Arm, trained: Mapping[str, Sequence[_Training]], record: ExperimentRecord) -> ArmResult:
    """Return the success rates of a policy over all finished training runs."""
    here = trained[arm.name]
    tables: dict[Kind, list[EvaluationResult]] = defaultdict(list)
    for each in here:
        for kind, found in each.tables.items():
            tables[kind] += found
    same = without_others(arm, record)

    def figures(name: str) -> TaskFigures:
        counts = {kind: rate for kind in KINDS if (rate := _rate(tables[kind], name)).episodes}
        return TaskFigures(name, counts).as_seen() if name in same else TaskFigures(name, counts)

    return ArmResult(
        arm,
        tuple(map(figures, (*arm.tasks, *record.config.untaught))),
        tuple(str(each.learned.folder) for each in here),
        sum(sum(each.learned.demonstrations.values()) for each in here),
        sum(each.learned.cpu_s for each in here),
        sum(each.before_s for each in here),
    )


@dataclass(frozen=True)
class _Measurement:
    """An evaluation that is run in addition to the evaluation on unseen objects."""

    kind: Kind
    folder: str
    title: str
    tasks: Sequence[str]
    episodes: int
    assets: str
    instances: str
    arguments: Mapping[str, Any] = field(default_factory=dict)


def _measurements(arm: Arm, record: ExperimentRecord, number: int) -> Iterator[_Measurement]:
    config, assets = record.config, _assets(arm, record)
    train, unseen = config.words(arm, number)
    # Evaluate the policy on seen objects only if its objects are split into training and test objects.
    if arm.is_split:
        yield _Measurement("seen", "seen", "seen objects", arm.tasks, config.episodes, assets, train)
    there, _ = _transferred(arm, record)
    if there:
        yield _Measurement("real", "real", "real objects", there, config.episodes, record.assets, "all")
    embedded = {"unknown_sentences": "embed"}
    # The controller loads only default text weights unless the name of other weights is given.
    if config.text_model is not None:
        embedded["text_model"] = config.text_model
    if config.untaught:
        tasks, few = config.untaught, config.control_episodes
        yield _Measurement("untaught", "untaught", "untaught tasks", tasks, few, BUILTIN, "all", embedded)
    if not config.sentences or len(arm.tasks) < 2:
        return
    specs = [load_task(name) for name in arm.tasks]
    other = opposites(specs)
    paired = [task.name for task in specs if task.description in other]
    few = config.control_episodes
    if paired:
        yield _Measurement("opposite", "opposite", "told the opposite", paired, few, assets, unseen, {"says": other})
    for number, says in enumerate(rephrased(specs), 1):
        told = {"says": says, **embedded}
        folder, title = f"rephrased-{number}", f"other words ({number})"
        yield _Measurement("rephrased", folder, title, arm.tasks, few, assets, unseen, told)


def _transferred(arm: Arm, record: ExperimentRecord) -> tuple[list[str], dict[str, str]]:
    """Return the tasks that are also evaluated on real objects, and the reason for each task that is not."""
    if not record.config.transfer or arm.objects != "generated" or record.assets == BUILTIN:
        return [], {}
    lacking: dict[str, str] = {}
    for name in arm.tasks:
        try:
            read_task_input(name, assets=record.assets)
        except InputError as error:
            lacking[name] = error.message
    return [name for name in arm.tasks if name not in lacking], lacking


def _rate(tables: Sequence[EvaluationResult], task: str) -> Rate:
    episodes = [each for table in tables for row in table.rows if row.task.name == task for each in row.episodes]
    return Rate(sum(each.held for each in episodes), len(episodes))
