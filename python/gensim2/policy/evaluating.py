"""Evaluate a policy and its control experiments on the same scenes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Unpack, get_args

from gensim2.core.errors import InputError, near
from gensim2.core.progress import NULL_PROGRESS, NamedProgress, Progress
from gensim2.core.record_files import SCHEMA_VERSION
from gensim2.evaluation.evaluating import EvaluationResult, evaluate
from gensim2.policy.checkpoint import PolicyCheckpoint, checkpoint_folder
from gensim2.policy.control import Shuffled
from gensim2.policy.sentences import embeds, sentence_row, substitutes
from gensim2.rollout.config import EvaluationArguments
from gensim2.rollout.controller_spec import ControllerSpec, planner_spec
from gensim2.rollout.inputs import TaskInput, check_counts, read_all_task_inputs, scene_options
from gensim2.rollout.run import Stop

Control = Literal["blind", "shuffled", "no-op", "expert"]
"""Control experiments. ``"blind"`` puts all points at the origin, ``"shuffled"`` shows clouds of other scenes,
``"no-op"`` keeps the arm at rest, and ``"expert"`` is the planner with the true state.
"""
CONTROLS: tuple[Control, ...] = get_args(Control)

CONTROL_EPISODES = 30
"""Default number of episodes of each task in a control experiment; they use the first scenes of the evaluation."""

KEYPOSE = "gensim2.perception.estimation.keypose:PerceivingKeyposeController"
CHUNKS = "gensim2.policy.controller:PolicyController"
NO_OP = "gensim2.policy.no_op:NoOpPolicy"


def read_controls(given: str | Sequence[str]) -> tuple[Control, ...]:
    """Return control experiments by name.

    Args:
        given: names, or a string: ``all``, ``none``, or names separated by commas.

    Raises:
        InputError: a name is unknown.
    """
    if isinstance(given, str):
        if given in ("all", "none"):
            return CONTROLS if given == "all" else ()
        given = given.split(",")
    for name in given:
        if name not in CONTROLS:
            raise InputError(f"no control {name!r}", field="controls", remedy=f"choose from {', '.join(CONTROLS)}")
    return tuple(name for name in CONTROLS if name in given)


@dataclass(frozen=True)
class PolicyResult:
    """Results of a policy and its control experiments.

    Attributes:
        policy: results of the policy.
        controls: results of the controls by name. ``"expert"``, the planner, has results by task; other controls have
            one result for all tasks.
    """

    policy: EvaluationResult
    controls: Mapping[str, tuple[EvaluationResult, ...]]

    @property
    def cpu_s(self) -> float:
        """Total CPU time of the policy and of its control experiments, s."""
        others = (each for several in self.controls.values() for each in several)
        return self.policy.cpu_s + sum(each.cpu_s for each in others)

    def mean_of(self, control: str, task: str) -> float | None:
        """Return the success rate of a control experiment on a task; None if the experiment was not run."""
        found = self.rows(control).get(task)
        return None if found is None else float(found["held_mean"])

    def control_episodes(self, task: str) -> int:
        """Return the number of episodes of a task in each control experiment."""
        counts = (found[task]["episodes"] for found in map(self.rows, self.controls) if task in found)
        return max(counts, default=0)

    def rows(self, control: str) -> dict[str, dict[str, Any]]:
        """Return a control experiment's result for each task, without the records of its episodes."""
        found = {}
        for each in self.controls.get(control, ()):
            for row in each.rows:
                told = row.to_dict()
                del told["records"]
                found[row.task.name] = told
        return found

    def to_dict(self) -> dict[str, Any]:
        """Return the results as plain data; ``controls`` maps each control experiment to its results for each task."""
        controls = {name: list(self.rows(name).values()) for name in self.controls}
        told = {**self.policy.to_dict(), "schema_version": SCHEMA_VERSION}
        return {**told, "controls": controls, "cpu_s": round(self.cpu_s, 3)}


def policy_controller(checkpoint: Path | str, **arguments: Any) -> ControllerSpec:
    """Return the specification of the controller that runs a checkpoint.

    Args:
        checkpoint: folder of the checkpoint, or ``"builtin"``.
        arguments: additional arguments of the controller.

    Raises:
        InputError: the checkpoint cannot be used.
    """
    folder = checkpoint_folder(checkpoint)
    return _controller(PolicyCheckpoint.load(folder), folder, arguments)


def _controller(policy: PolicyCheckpoint, folder: Path, arguments: Mapping[str, Any]) -> ControllerSpec:
    target = KEYPOSE if policy.action.kind == "keypose" else CHUNKS
    return ControllerSpec(target, {"checkpoint": str(folder.resolve()), **arguments})


def controller_for(checkpoint: Path | str, given: TaskInput) -> ControllerSpec:
    """Check that a checkpoint fits a task and its robot, and return a controller that runs the checkpoint.

    Args:
        checkpoint: folder, or ``"builtin"``.

    Raises:
        InputError: the checkpoint cannot be used, or was trained for another robot or with different instructions.
    """
    folder = checkpoint_folder(checkpoint)
    policy = PolicyCheckpoint.load(folder)
    policy.require_robot(given.scene.robot, folder)
    sentence_row(policy, given.spec.description, folder, embed=False)
    return _controller(policy, folder, {})


def evaluate_policy(
    checkpoint: Path | str,
    tasks: str | Sequence[str],
    *,
    controls: str | Sequence[Control] = CONTROLS,
    control_episodes: int = CONTROL_EPISODES,
    episodes: int = 50,
    stop: Stop = "goal",
    data: Path | None = None,
    videos: int = 0,
    seed: int = 0,
    arguments: Mapping[str, Any] | None = None,
    runs: int = 1,
    out: Path | None = None,
    resume: bool = False,
    progress: Progress = NULL_PROGRESS,
    **scene: Unpack[EvaluationArguments],
) -> PolicyResult:
    """Evaluate a policy and its control experiments.

    Args:
        checkpoint: folder, or ``"builtin"``.
        controls: control experiments, as for :func:`read_controls`.
        control_episodes: number of episodes of each task in a control experiment, at most ``episodes``.
        arguments: additional arguments of the policy's controller.
        out: output folder, with a subfolder for each control experiment.
        tasks, episodes, stop, data, videos, seed, runs, resume, progress, scene: as for
            :func:`~gensim2.evaluation.evaluate`.

    Raises:
        CheckpointError: the checkpoint cannot be used with this robot or these tasks.
        InputError: a control is unknown, or the checkpoint has no point clouds of other scenes, which the control
            ``"shuffled"`` shows to the policy. Also raised as for :func:`~gensim2.evaluation.evaluate`.
        NotRunError: as for :func:`~gensim2.evaluation.evaluate`.
    """
    controls, names = read_controls(controls), [tasks] if isinstance(tasks, str) else list(tasks)
    check_counts(control_episodes=control_episodes)
    checkpoint = checkpoint_folder(checkpoint)
    policy = PolicyCheckpoint.load(checkpoint)
    policy.require_robot(scene_options(**scene).robot, checkpoint)
    given = read_all_task_inputs(names, seed=seed, **scene)
    if "shuffled" in controls:
        # Check now that the checkpoint has the clouds of this control. Otherwise it would fail only after other
        # evaluations.
        Shuffled.of(checkpoint)
    told = dict(arguments or {})
    for name in ("checkpoint", "sees"):
        if name in told:
            wrong = "must not be given, because the evaluation sets this argument itself"
            raise InputError(wrong, field=f"arguments.{name}")
    embed, says = embeds(told.get("unknown_sentences", "parse")), substitutes(told.get("says"))
    sentences = {one.spec.description for one in given}
    for sentence in says:
        if sentence not in sentences:
            message = f"no task has the sentence {sentence!r}"
            raise InputError(message, field="arguments.says", remedy=near(sentence, sorted(sentences)))
    if says and policy.config.text == "none":
        wrong = "instructions cannot be replaced, because this policy ignores instructions"
        raise InputError(wrong, field="arguments.says", remedy="leave this argument out")
    for one in given:
        sentence = says.get(one.spec.description, one.spec.description)
        sentence_row(policy, sentence, checkpoint, embed=embed, text_model=told.get("text_model"))
    from gensim2.data.runfolder import default_run_dir

    out = default_run_dir() if out is None else out
    shared: dict[str, Any] = {"seed": seed, "resume": resume, **scene}
    found = evaluate(
        policy_controller(checkpoint, **told),
        names,
        runs=runs,
        stop=stop,
        data=data,
        videos=videos,
        episodes=episodes,
        out=out,
        progress=progress,
        **shared,
    )
    few = {**shared, "episodes": min(episodes, control_episodes)}
    beside: dict[str, tuple[EvaluationResult, ...]] = {}
    for control in controls:
        folder, listener = out / "controls" / control, NamedProgress(control, progress)
        if control == "expert":
            beside[control] = tuple(
                evaluate(
                    planner_spec(one.spec, one.strategies, one.rollout, one.scene.robot),
                    name,
                    stop=stop,
                    out=folder / one.spec.name,
                    progress=listener,
                    **few,
                )
                for name, one in zip(names, given, strict=True)
            )
        else:
            spec = (
                ControllerSpec(NO_OP, {"arm": policy.action.arm})
                if control == "no-op"
                else policy_controller(checkpoint, **{**told, "sees": "nothing" if control == "blind" else "other"})
            )
            beside[control] = (evaluate(spec, names, stop=stop, out=folder, progress=listener, **few),)
    return PolicyResult(found, beside)
