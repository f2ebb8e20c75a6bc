"""Create training data, train a policy, evaluate it, and write a report (``gensim2 learn``)."""

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
from gensim2.policy.evaluating import CONTROL_EPISODES, CONTROLS, Control, PolicyResult, evaluate_policy, read_controls
from gensim2.policy.frames import check_turns
from gensim2.policy.keypose.adding import inputs_beside, tasks_to_plan_again, taught_before
from gensim2.policy.learn_record import LEARN_JSON, LearnFolder, LearnRecord, check_demonstrations, take_demonstrations
from gensim2.policy.learn_settings import learn_configs, observation_of
from gensim2.policy.starting import check_sentences, check_text, digest_of_start, known_tasks, read_start
from gensim2.policy.teachers import key_of, teach_by_episodes, teach_by_plans
from gensim2.policy.train import TrainResult
from gensim2.policy.training import read_flat
from gensim2.robots import robot
from gensim2.rollout.config import RolloutArguments
from gensim2.rollout.counted_objects import all_with_objects, can_be_counted
from gensim2.rollout.inputs import TaskInput, check_counts, has_instances, read_all_task_inputs, scene_options, taken
from gensim2.scenes.config import SceneArguments
from gensim2.scenes.physics import Engines

SCENES = 2000
"""Default maximum number of scenes of a task. Training runs of a few minutes gain nothing from more scenes."""
OBJECTS = 200
"""Default number of generated training objects of each class for keypose policies."""
RESULT_JSON = "result.json"
VIDEOS = 3
"""Default number of recorded episodes of each task."""


@dataclass(frozen=True)
class Learned:
    """A learned policy.

    Attributes:
        folder: folder of the checkpoint.
        demonstrations: number of training plans or episodes by task.
        data_cpu_s: CPU time that collecting the data took, s.
        measured: evaluation of the policy and of its control experiments.
    """

    folder: Path
    demonstrations: Mapping[str, int]
    data_cpu_s: float
    trained: TrainResult
    measured: PolicyResult

    @property
    def cpu_s(self) -> float:
        """CPU time of data and training, s."""
        return self.data_cpu_s + self.trained.cpu_s


@dataclass(frozen=True)
class LearnResult:
    """Result of ``learn``.

    Attributes:
        out: output folder.
        record: arguments of the run.
        test_instances: name of the set of objects used for evaluation.
        seen_objects: evaluated objects (``class/id``) that were also used for training.
        learned: the learned policies: one policy for each task, or a single policy for all tasks.
    """

    out: str
    record: LearnRecord
    test_instances: str
    seen_objects: tuple[str, ...]
    learned: tuple[Learned, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data; ``tasks`` has one entry for each task."""
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
    engines: Engines = "one",
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
    """Train policies on demonstrations of the planner, and evaluate them on unseen objects and seeds.

    Args:
        tasks: names of library tasks, or folders with task.yaml and strategies/.
        policy: name of the policy's head. A ``"keypose"`` policy learns from plans. Policies with other heads predict
            action chunks and learn from simulated episodes.
        minutes: limit of the CPU time for the data and training of each task, min. On a GPU, the time that is left
            after data collection limits the wall time of training. Evaluation is not limited.
        multi_task: whether to train one policy for all tasks. ``minutes`` then limits the time for all tasks together.
        scenes: maximum number of planned scenes of each task.
        episodes, control_episodes: number of evaluation episodes of each task: ``episodes`` for the policy, and
            ``control_episodes`` for each control experiment.
        controls: control experiments, as for :func:`~gensim2.policy.evaluating.read_controls`. The default None runs
            all of them.
        videos: number of recorded episodes of each task.
        objects: number of generated objects of each class to train on. The seed selects these objects among all objects
            that the generator can create; objects that the library lists are not used. With None the policy trains on
            the objects that ``instances`` in ``scene`` selects. If ``instances`` is not given, it trains on ``OBJECTS``
            generated objects, or on the training split of real objects.
        generated: number of generated objects of each class to train on in addition to the objects of a folder, for
            ``"keypose"``. The objects of the folder and the generated objects get shares of the planning time in
            proportion to their numbers.
        verify: whether to simulate the plans for ``"keypose"``, and to leave out scenes in which the plans fail.
        engines: ``"both"`` also runs the training episodes or plans in the second physics engine, and uses only
            demonstrations that succeed in both engines. For ``"keypose"`` the value ``"both"`` requires ``verify``.
        start: folder of a keypose policy for several tasks that ``learn`` trained, or ``"builtin"``. The new policy
            starts from the weights of the given policy. It trains on the plans of the given policy and on new plans for
            ``tasks``, and it is evaluated on all tasks. The builtin policy comes without plans. Therefore scenes of its
            tasks are planned again, and the planning time counts towards ``minutes``.
        demonstrations: folder of another run of ``learn`` with the same tasks, objects and seed. The demonstrations of
            that run are copied, and more demonstrations are collected if ``minutes`` permits.
        noise: camera noise in training data and evaluation: each episode gets random errors of the cameras' poses,
            depth and clocks. With None the depth images are exact.
        text: text encoder of a policy for several tasks. The default is the encoder of ``start``, or ``"small"``
            without ``start``.
        text_model: folder or Hugging Face name of the weights of a pretrained text encoder. The default is CLIP from
            Hugging Face.
        settings: network and training settings that differ from the defaults, as a mapping from names
            (:mod:`gensim2.policy.config`) to values, or a YAML file. The argument cannot be combined with ``start``.
        test_instances: objects for the evaluation. The default is ``test`` if the policy or the policy in ``start`` was
            trained on objects that the library lists and each class has a test split. Otherwise the default is ``new``,
            generated objects that the library does not list.
        out: output folder. A single policy is written into this folder. If there are several policies, each is written
            into a subfolder with the name of its task.
        workers: number of processes that plan and simulate.
        resume: whether to continue the run in ``out``.
        device: device for training, as for :func:`~gensim2.policy.devices.read_devices`.

    Raises:
        InputError: an argument is invalid, or ``out`` contains files of another run or of another program.
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
        raise InputError(f"must be one of {', '.join(HEADS)}, but is {policy!r}", field="policy")
    if not 0 < minutes <= 1e5:
        raise InputError(f"must lie in 0..1e5, but is {minutes}", field="minutes")
    file = str(settings) if isinstance(settings, Path) else None
    settings = read_flat(settings) if isinstance(settings, Path) else dict(settings or {})
    config, training = learn_configs(policy, settings, file=file)
    share_of(training.batch, devices)
    if settings and start is not None:
        message = "cannot be given together with --from: the new policy has the settings of the policy it starts from"
        raise InputError(message, file=file, field="--config", remedy="leave it out")
    if verify and policy != "keypose":
        raise InputError(
            "this option applies only to keypose policies; action-chunk policies always learn from simulated episodes",
            field="verify",
        )
    if engines == "both" and policy == "keypose" and not verify:
        message = "applies to simulated demonstrations; a keypose policy learns from plans that are not simulated"
        raise InputError(message, field="engines", remedy="also simulate the plans (verify)")
    if generated is not None and policy != "keypose":
        wrong = "applies only to keypose policies, which learn from plans"
        raise InputError(wrong, field="generated", remedy="leave it out")
    if objects is not None and "instances" in scene:
        raise InputError("cannot be given together with instances", field="objects", remedy="give only one")
    train_on: dict[str, Any] = {**scene, "instances": scene.get("instances", "train")}
    if not tasks:
        raise InputError("names no task", field="tasks")
    given = read_all_task_inputs((tasks,) if isinstance(tasks, str) else tuple(tasks), seed=seed, **train_on)
    given[0].scene.second_engine(engines)  # Before any work starts, check that the second engine can be used.
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
    # The tasks of the starting policy are evaluated, too, but on other objects than those in its training.
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
        engines=engines,
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


def unseen_instances(given: Sequence[TaskInput]) -> str:
    """Return the name of a set of objects that training on the given tasks did not use.

    The first choice is ``test`` (``test-N`` after training on ``train-N``), then, if a class has no such objects,
    ``new``.

    Raises:
        InputError: neither set has objects of all classes.
    """
    others = (one.instances.replace("train", "test") for one in given if one.instances.startswith("train-"))
    for word in dict.fromkeys(("test", *others, "new")):
        found = [
            has_instances(one.library, thing.asset_class, word) for one in given for thing in one.spec.objects.values()
        ]
        if all(found) and not shared_objects(given, word):
            return word
    raise InputError(
        "no objects are left for evaluation, because training uses all objects of at least one class",
        field="test_instances",
        remedy="select the evaluation objects with --test-instances all, or with the id of an object",
    )


def check_test_instances(tasks: Sequence[str], seed: int, **given: Unpack[RolloutArguments]) -> None:
    """Check that tasks can be run with the evaluation objects.

    Args:
        tasks: names or folders of the tasks.
        given: scene and rollout arguments; ``instances`` is the name of the set of evaluation objects.

    Raises:
        InputError: a task cannot be run with these objects.
    """
    for task in tasks:
        try:
            read_all_task_inputs([task], seed=seed, **given)
        except InputError as error:
            told = error.message if task in error.message else f"{task}: {error.message}"
            remedy = "say other ones with --test-instances, or leave the task out"
            raise InputError(told, file=error.file, field="test_instances", remedy=remedy) from error


def shared_objects(given: Sequence[TaskInput], word: str) -> list[str]:
    """Return the articulated training objects (``class/id``) that are also in the object set named ``word``.

    Raises:
        InputError: a class has no objects in the set.
    """
    found = []
    for one in given:
        mine, others = (taken(one.spec, one.library, each) for each in (one.instances, word))
        for name, thing in one.spec.objects.items():
            # A class of rigid objects has only one instance.
            if one.library.kind(thing.asset_class) == "articulated":
                found += [f"{thing.asset_class}/{each}" for each in others[name] if each in mine[name]]
    return list(dict.fromkeys(found))


def words(given: Sequence[TaskInput], tasks: str | Sequence[str]) -> dict[str, str]:
    """Return a mapping from the name of each task to the user's argument for it, which is a name or a folder."""
    named = (tasks,) if isinstance(tasks, str) else tuple(tasks)
    return dict(zip((one.spec.name for one in given), named, strict=True))
