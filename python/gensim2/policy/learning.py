"""From nothing to a policy that is measured: data, training, evaluation beside its controls, one page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Unpack

from gensim2.core.errors import InputError
from gensim2.core.files import check_writable, write_json
from gensim2.core.processes import Execution
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.core.record_files import SCHEMA_VERSION
from gensim2.perception import DepthNoise
from gensim2.policy.checkpoint import checkpoint_folder
from gensim2.policy.config import HEADS
from gensim2.policy.devices import read_devices, share_of
from gensim2.policy.evaluating import (
    CONTROL_EPISODES,
    CONTROLS,
    Control,
    PolicyResult,
    evaluate_policy,
    read_controls,
)
from gensim2.policy.frames import check_turns
from gensim2.policy.keypose.adding import inputs_beside, tasks_to_plan_again, taught_before
from gensim2.policy.learn_record import LEARN_JSON, LearnFolder, LearnRecord, check_demonstrations, take_demonstrations
from gensim2.policy.learn_settings import learn_configs, observation_of
from gensim2.policy.objects import check_test_instances, shared_objects, unseen_instances, words
from gensim2.policy.starting import check_sentences, check_text, digest_of_start, known_tasks, read_start
from gensim2.policy.teachers import key_of, teach_by_episodes, teach_by_plans
from gensim2.policy.train import TrainResult
from gensim2.policy.training import read_flat
from gensim2.robots import robot
from gensim2.rollout.counted_objects import all_with_objects, can_be_counted
from gensim2.rollout.inputs import TaskInput, check_counts, read_all_task_inputs, scene_options
from gensim2.scenes.config import SceneArguments

SCENES = 2000
"""Of each task at most; more make hands no more exact in a training of minutes."""
OBJECTS = 200
"""Generated ones of each class that a keypose policy learns from, where there are as many as are wanted."""
RESULT_JSON = "result.json"
VIDEOS = 3
"""Episodes of each task that are filmed."""


@dataclass(frozen=True)
class Learned:
    """One policy.

    Attributes:
        folder: of its checkpoint.
        demonstrations: that it was taught by, by task: plans, or episodes.
        data_cpu_s: CPU seconds that they took.
        trained: how it went.
        measured: it and its controls.
    """

    folder: Path
    demonstrations: Mapping[str, int]
    data_cpu_s: float
    trained: TrainResult
    measured: PolicyResult

    @property
    def cpu_s(self) -> float:
        """CPU seconds of data and training."""
        return self.data_cpu_s + self.trained.cpu_s


@dataclass(frozen=True)
class LearnResult:
    """Result of ``learn``.

    Attributes:
        out: folder.
        record: what was asked for.
        test_instances: word for the objects that it was measured on.
        seen_objects: those of them, ``class/id``, that it was taught on, too.
        learned: one policy a task, or one for all.
    """

    out: str
    record: LearnRecord
    test_instances: str
    seen_objects: tuple[str, ...]
    learned: tuple[Learned, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data: ``tasks`` has one entry a task."""
        return {
            "schema_version": SCHEMA_VERSION,
            "out": self.out,
            **self.record.model_dump(mode="json", exclude={"tasks", "schema_version", "data_cpu_s", "episodes"}),
            "test_instances": self.test_instances,
            "seen_objects": list(self.seen_objects),
            "tasks": [row for each in self.learned for row in _rows(each, self.record.policy)],
            "cpu_s": round(sum(each.cpu_s for each in self.learned), 3),
        }


def learn(
    tasks: str | Sequence[str],
    *,
    policy: str = "keypose",
    minutes: float = 15.0,
    multi_task: bool = False,
    scenes: int = SCENES,
    episodes: int = 50,
    control_episodes: int = CONTROL_EPISODES,
    controls: str | Sequence[Control] | None = None,
    videos: int = VIDEOS,
    objects: int | None = None,
    generated: int | None = None,
    verify: bool = False,
    start: Path | str | None = None,
    demonstrations: Path | None = None,
    noise: DepthNoise | None = None,
    text: str | None = None,
    text_model: str | None = None,
    settings: Mapping[str, Any] | Path | None = None,
    test_instances: str | None = None,
    seed: int = 0,
    out: Path,
    workers: int = 2,
    resume: bool = False,
    device: str = "auto",
    progress: Progress = NULL_PROGRESS,
    **scene: Unpack[SceneArguments],
) -> LearnResult:
    """Teach tasks to a policy by the planner, and measure it on objects and seeds that it never saw.

    Args:
        tasks: names of library tasks, or folders that hold task.yaml and strategies/.
        policy: name of the head: ``"keypose"``, taught by plans, or one of action chunks, taught by episodes.
        minutes: of CPU for the data and the training of each task; where a GPU trains, what the data leave of them is
            time by the clock. Evaluation is not bounded.
        multi_task: one policy for all tasks; its ``--minutes`` are those of all of them together.
        scenes: most of each task that are planned.
        episodes, control_episodes: of each task that the policy and each control are measured by.
        controls: which, as :func:`~gensim2.policy.evaluating.read_controls` takes them; None: all.
        videos: episodes of each task that are filmed.
        objects: generated ones of each class to learn from, beyond those that the library lists, drawn by the seed;
            None: ``instances``, and where that is not given ``OBJECTS``, of real objects those of ``train``.
        generated: number of generated ones of each class to learn from beside a folder's, by whose numbers the
            data's time is divided; of plans.
        verify: leave scenes out whose plans physics refutes; of plans, which are not simulated otherwise.
        start: folder of a keypose policy of several tasks that ``learn`` left, or ``"builtin"``: the new one begins
            with its weights and plans, ``tasks`` are added to its own, and all of them are measured. The package's has
            no plans beside it: some scenes of each of its tasks are planned again, at the cost of ``minutes``.
        demonstrations: folder of another run of ``learn`` on the same tasks, objects and seed, whose demonstrations are
            taken along; more are made where their share of ``minutes`` is not spent.
        noise: of the cameras in all data, with errors of pose, depth and clock drawn each episode; the policy is
            measured with it, too. None: depth is exact.
        text: encoder of the sentences, of a policy of several tasks; None: that of ``start``, else ``"small"``.
        text_model: folder or hub name of its weights, where it is pretrained; None: CLIP's on the hub.
        settings: of the network and of the training that are to be otherwise than usual, by name
            (:mod:`gensim2.policy.config`), or a YAML file of them; of a policy that begins with no other's weights.
        test_instances: objects that the policy is measured on; None: ``new`` where it learns from ``objects``, else,
            and where ``start`` was taught on listed ones, ``test`` where all classes have such a split, else ``new``.
        seed: of everything.
        out: folder; of one policy it is the checkpoint's, of several each has one in it by its task's name.
        workers: processes that plan and simulate.
        resume: go on with what the folder holds.
        device: of the training, as :func:`~gensim2.policy.devices.read_devices` takes it.
        progress: listener.
        scene: see :class:`~gensim2.scenes.config.SceneArguments`.

    Raises:
        InputError: an argument cannot be used, or the folder holds something else.
        NotRunError: some scenes or episodes could not be run.
    """
    check_counts(scenes=scenes, episodes=episodes, control_episodes=control_episodes)
    for name, count in (("objects", objects), ("generated", generated)):
        if count is not None:
            check_counts(**{name: count})
    execution = Execution(workers)
    devices = read_devices(device)
    controls = CONTROLS if controls is None else read_controls(controls)
    if policy not in HEADS:
        raise InputError(f"must be one of {', '.join(HEADS)}, is {policy!r}", field="policy")
    if not 0 < minutes <= 1e5:
        raise InputError(f"must lie in 0..1e5, is {minutes}", field="minutes")
    file = str(settings) if isinstance(settings, Path) else None
    settings = read_flat(settings) if isinstance(settings, Path) else dict(settings or {})
    config, training = learn_configs(policy, settings, file=file)
    share_of(training.batch, devices)
    if settings and start is not None:
        message = "is of a policy that goes on from no other, and --from has its own settings"
        raise InputError(message, file=file, field="--config", remedy="leave it out")
    if verify and policy != "keypose":
        raise InputError("is of plans, and chunks are taught by episodes, which physics has judged", field="verify")
    if generated is not None and policy != "keypose":
        raise InputError("is of plans, and chunks are taught by episodes", field="generated", remedy="leave it out")
    if objects is not None and "instances" in scene:
        raise InputError("says other objects than instances", field="objects", remedy="give either")
    train_on: dict[str, Any] = {**scene, "instances": scene.get("instances", "train")}
    if not tasks:
        raise InputError("names no task", field="tasks")
    given = read_all_task_inputs((tasks,) if isinstance(tasks, str) else tuple(tasks), seed=seed, **train_on)
    named = words(given, tasks)
    if objects is None and "instances" not in scene and any(map(can_be_counted, given)):
        objects = OBJECTS
    if objects is not None:
        given = all_with_objects(given, objects, seed)
    beside = list[TaskInput]()
    if generated is not None:
        beside = inputs_beside(list(named.values()), given, generated, progress, seed=seed, **scene)
    start = None if start is None else checkpoint_folder(start)
    begun = None if start is None else read_start(start, policy, given, noise)
    how = config, training, observation_of(config, noise) if begun is None else begun.observation, device
    known = [] if begun is None else known_tasks(begun, scene_options(**scene).assets, progress)
    again: list[TaskInput] = []
    if start is not None and begun is not None:
        again = tasks_to_plan_again(start, begun, objects or OBJECTS, seed=seed, **scene)
    together = multi_task or begun is not None
    several = together and (begun is not None or len(given) > 1)
    check_text(text, text_model, [one.spec.description for one in given] if several else (), begun)
    # Those that it was taught before are measured, too: on none of the objects that it was taught them on.
    before = [] if start is None else taught_before(start, known, seed=seed, **scene)
    listed = [*(given if objects is None else ()), *before]
    if test_instances is None:
        test_instances = unseen_instances(listed) if listed else "new"
    tested_on: dict[str, Any] = {**scene, "instances": test_instances}
    check_test_instances([*known, *named.values()], seed, **tested_on)
    seen = shared_objects(listed, test_instances)
    if multi_task or begun is not None:
        check_sentences([*(begun.sentences if begun is not None else ()), *(one.spec.description for one in given)])
    check_turns(robot(given[0].scene.robot), config)
    record = LearnRecord(
        tasks=tuple(one.spec.name for one in given),
        policy=policy,
        minutes=minutes,
        multi_task=multi_task,
        seed=seed,
        scenes=scenes,
        objects=objects,
        generated=generated,
        verify=verify,
        scene={**given[0].scene.options.to_record(), "instances": train_on["instances"]},
        noise=None if noise is None else asdict(noise),
        text=text,
        text_model=text_model,
        settings=settings,
        start=None if start is None else digest_of_start(start),
        demonstrations_of=None if demonstrations is None else str(demonstrations.resolve()),
    )
    if demonstrations is not None:
        check_demonstrations(demonstrations, record)
    out.mkdir(parents=True, exist_ok=True)
    check_writable(out / LEARN_JSON)
    with LearnFolder(out, record, resume) as opened:
        record = opened.record
        groups = [tuple(given)] if together or len(given) == 1 else [(one,) for one in given]
        learned = []
        for group in groups:
            folder = out if len(groups) == 1 else out / group[0].spec.name
            take_demonstrations(record, key_of(folder, out), folder, out)
            asked = [named[one.spec.name] for one in group]
            if record.is_of_plans:
                own = [one for one in beside if one.spec.name in [each.spec.name for each in group]]
                taught, trained = teach_by_plans(
                    group, own, begun, again, folder, out, record, how, execution, progress
                )
            else:
                taught, trained = teach_by_episodes(group, asked, folder, out, record, how, execution, progress)
            measured = evaluate_policy(
                folder,
                [*known, *asked],
                controls=controls,
                control_episodes=control_episodes,
                episodes=episodes,
                videos=videos,
                seed=seed,
                out=folder / "evaluation",
                workers=workers,
                resume=True,
                progress=progress,
                **tested_on,
            )
            spent = record.data_cpu_s[key_of(folder, out)]
            learned.append(Learned(folder, taught, spent, trained, measured))
        result = LearnResult(str(out), record, test_instances, tuple(seen), tuple(learned))
        write_json(out / RESULT_JSON, result.to_dict())
        from gensim2.policy.page import write_page

        write_page(result)
        return result


def _rows(learned: Learned, policy: str) -> list[dict[str, Any]]:
    rows, tasks = [], len(learned.measured.policy.rows)
    for row in learned.measured.policy.rows:
        told, name = row.to_dict(), row.task.name
        rows.append(
            {
                "name": name,
                "policy": policy,
                "checkpoint": str(learned.folder),
                "held_mean": float(told["held_mean"]),
                "interval": told["held_interval"],
                "strict_mean": told["strict_mean"],
                "blind_mean": learned.measured.mean_of("blind", name),
                "shuffled_mean": learned.measured.mean_of("shuffled", name),
                "no_op_mean": learned.measured.mean_of("no-op", name),
                "expert_mean": learned.measured.mean_of("expert", name),
                "episodes": told["episodes"],
                "control_episodes": learned.measured.control_episodes(name),
                "different_objects": told["different_objects"],
                "demonstrations": learned.demonstrations.get(name, 0),
                "steps": learned.trained.steps,
                "causes": told["causes"],
                "data_cpu_s": round(learned.data_cpu_s / tasks, 3),
                "training_cpu_s": round(learned.trained.cpu_s / tasks, 3),
                "cpu_s": round(learned.cpu_s / tasks, 3),
                "evaluation_cpu_s": round(learned.measured.cpu_s / tasks, 3),
            }
        )
    return rows
