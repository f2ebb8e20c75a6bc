"""Run the solver configs of the original GenSim2 in our copy of its physics (docs/results/calibration.md).

python benchmarks/original_configs.py plans.jsonl --assets DIR --json OUT.json                  # recorded scenes
python benchmarks/original_configs.py plans.jsonl --assets DIR --scenes drawn --episodes 30 --seed S --json OUT.json
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from hand_steps import MAX_STEPS, HandStepsController, control_steps
from scipy.stats import fisher_exact

from gensim2.bench.problems import PlanProblem, read_problems
from gensim2.core.errors import GenSim2Error, InputError, near
from gensim2.core.files import write_output
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.core.record_files import SCHEMA_VERSION
from gensim2.core.seeding import check_seed
from gensim2.evaluation.benchmark_table import by_instance
from gensim2.evaluation.running import TableExtent, finish_table, run_episodes
from gensim2.objects import ArticulatedObject, Library, open_library
from gensim2.robots import robot
from gensim2.rollout.config import EpisodeConfig
from gensim2.rollout.inputs import check_counts
from gensim2.rollout.motion import MAX_SETTLE_SECONDS
from gensim2.rollout.record import Episode
from gensim2.rollout.tally import Tally, interval
from gensim2.scenes.config import SceneOptions
from gensim2.scenes.footprint import lowest_of_moving_link
from gensim2.tasks.library import PAPER as PAPER_SUITE
from gensim2.tasks.library import load_task, task_names
from gensim2.tasks.published import MEASURED, MEASURED_IN_ALL
from gensim2.tasks.published import PAPER as PUBLISHED
from gensim2.tasks.spec import TaskSpec

Scenes = Literal["recorded", "drawn"]
"""``recorded``: the scenes in the file. ``drawn``: random scenes with all objects, sampled with our seeds."""
SCENES: tuple[Scenes, ...] = get_args(Scenes)

ROBOT = "panda_long"
"""Robot profile with the fingers, drives and tool keypoints with which the problems of the file were recorded."""

TOLERANCE = 1e-4
"""Maximum difference between a tool keypoint in the file and in the profile, m."""
START_TOLERANCE = 1e-3
"""Maximum difference between the recorded joint positions and the start of an episode, rad or m."""


@dataclass(frozen=True)
class Rate:
    """Success rate, as the number of successes among the trials.

    Attributes:
        count: number of successes.
        of: number of trials.
    """

    count: int
    of: int

    def __str__(self) -> str:
        low, high = interval(self.count, self.of)
        return f"{self.count}/{self.of} ({low:.2f} to {high:.2f})" if self.of else ""

    def to_dict(self) -> dict[str, Any]:
        """Return the rate as plain data, with its 95 % interval (Wilson 1927)."""
        share = self.count / self.of if self.of else None
        return {"count": self.count, "of": self.of, "rate": share, "interval": list(interval(self.count, self.of))}


def differ(one: Rate, other: Rate) -> float | None:
    """Return the two-sided p-value of equal rates (Fisher's exact test); None if one has no trials."""
    if not one.of or not other.of:
        return None
    table = [[one.count, one.of - one.count], [other.count, other.of - other.count]]
    return float(fisher_exact(table).pvalue)


@dataclass(frozen=True)
class ConfigEpisode:
    """Inputs of one episode besides the scene configuration and the seed. Instances can be pickled.

    Attributes:
        config: config of the keypoint solver, with the times of its keyframes.
        object_yaw: yaw of the object in the record, rad; None: sampled with the seed.
        options: reset options; empty: sampled with the seed.
        source: id of the record.
    """

    config: Mapping[str, Any]
    object_yaw: float | None = None
    options: Mapping[str, Any] | None = None
    source: str | None = None


@dataclass(frozen=True)
class ConfigRow:
    """One task with the original's config.

    Attributes:
        name: name of the task, or ``<long task>-<its first step>``.
        episodes: episodes in order.
        sources: id of each episode's record; None for a sampled scene.
        release: success rate of the original's release; None if unknown.
    """

    name: str
    episodes: tuple[Episode, ...]
    sources: tuple[str | None, ...]
    release: Rate | None

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        tally = Tally.of(self.episodes)
        ours = Rate(tally.paper, tally.episodes)
        records = [
            {"id": source, **episode.to_dict()} for source, episode in zip(self.sources, self.episodes, strict=True)
        ]
        return {
            "name": self.name,
            **{name: Rate(count, tally.episodes).to_dict() for name, count in tally.verdicts().items()},
            "release": None if self.release is None else self.release.to_dict(),
            "p_value": None if self.release is None else differ(ours, self.release),
            "published": None if self.release is None else PUBLISHED[self.name][0],
            "causes": tally.causes,
            "objects": tally.objects,
            "instances": by_instance(self.episodes),
            "records": records,
        }


@dataclass(frozen=True)
class ConfigBenchmark:
    """Result table of the benchmark.

    Attributes:
        run_dir: the run folder.
        arguments: arguments of the call.
        versions: versions of the packages that affect the outcome.
        rows: one row for each task.
        left_out: records and tasks of the file that were not run, each with the reason.
        warnings: parts of objects that could not be loaded, by object.
        cpu_s: CPU time of all processes in this call, s, excluding their start.
        provenance: commit, date and command.
    """

    run_dir: str
    arguments: dict[str, Any]
    versions: dict[str, str]
    rows: tuple[ConfigRow, ...]
    left_out: dict[str, str]
    warnings: dict[str, str]
    cpu_s: float
    provenance: dict[str, str]

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        compared = [row for row in self.rows if row.release is not None]
        tallies = [Tally.of(row.episodes) for row in compared]
        ours = Rate(sum(tally.paper for tally in tallies), sum(tally.episodes for tally in tallies))
        release = _release_of([row.name for row in compared])
        return {
            "schema_version": SCHEMA_VERSION,
            "run_dir": self.run_dir,
            "arguments": self.arguments,
            "versions": self.versions,
            "provenance": self.provenance,
            "tasks": [row.to_dict() for row in self.rows],
            "in_all": {
                "paper": ours.to_dict(),
                "release": None if release is None else release.to_dict(),
                "p_value": None if release is None else differ(ours, release),
            },
            "left_out": self.left_out,
            "warnings": self.warnings,
            "cpu_s": round(self.cpu_s, 3),
        }


def _release_of(names: Sequence[str]) -> Rate | None:
    """Return the success rate of the original's release in single-step tasks; None without names.

    For all tasks together, a larger number of episodes was published than for the single tasks.
    """
    if not names:
        return None
    if set(names) == set(MEASURED):
        return Rate(*MEASURED_IN_ALL["single-step"])
    counts = [MEASURED[name] for name in names]
    return Rate(sum(held for held, _ in counts), sum(of for _, of in counts))


def benchmark_configs(
    tasks: Sequence[str] = (),
    *,
    configs: Path,
    scenes: Scenes = "recorded",
    episodes: int = 30,
    seed: int = 0,
    assets: str | Path | None = None,
    physics: str = "original",
    out: Path | None = None,
    workers: int = 2,
    resume: bool = False,
    progress: Progress = NULL_PROGRESS,
) -> ConfigBenchmark:
    """Run the original's solver configs with its fingers, drives and execution in steps; plan once in each episode.

    Args:
        tasks: names of single-step tasks; empty: all tasks in the file.
        configs: JSON Lines file with planning problems and the original's configs (docs/reference/benchmarks.md).
        scenes: ``"recorded"``: every scene of the file once. ``"drawn"``: ``episodes`` random scenes of each task.
        episodes: number of episodes of each task with sampled scenes.
        seed: seed of the sampled scenes.
        assets: folder of the original's objects.
        physics: physics settings of the scenes.
        out: run folder; default ``runs/<date>-<time>``.
        workers, resume, progress: as for the benchmark.

    Raises:
        InputError: an argument is invalid, or the file contains no problem that can be run.
        NotRunError: some episodes could not be run. All others are finished; ``resume`` runs the missing ones.
    """
    check_counts(episodes=episodes)
    if scenes not in SCENES:
        raise InputError(f"no scenes {scenes!r}", field="scenes", remedy=f"choose from {', '.join(SCENES)}")
    problems = read_problems(configs)
    library = open_library(assets)
    groups, left_out = _groups(problems, library, tasks, Path(configs))
    if scenes == "drawn":
        unknown = [name for name, group in groups.items() if group.release is None]
        left_out |= dict.fromkeys(unknown, "the release's figure is not known: nothing to draw scenes for")
        groups = {name: group for name, group in groups.items() if name not in unknown}
        if not groups:
            message = "holds no task whose release figure is known: there are no scenes to draw"
            raise InputError(message, file=configs, field="scenes", remedy="use recorded scenes")
    options = SceneOptions.of(assets=assets, physics=physics, robot=ROBOT)
    # Import late: these imports are slow, and invalid arguments should be reported before them.
    from gensim2.core.processes import Execution
    from gensim2.data.runfolder import RunFolder, default_run_dir
    from gensim2.rollout.identity import digest, listing, provenance, versions
    from gensim2.rollout.runner import EpisodeRunner

    arguments = {
        "method": "original-configs",
        "configs": str(configs),
        "scenes": scenes,
        "seed": check_seed(seed),
        "episodes": episodes,
        **options.to_record(),
    }
    told = {"command": "benchmark", "stored_tasks": list(groups), **arguments, "workers": workers}
    identity = {
        "tasks": digest([group.spec.model_dump(mode="json") for group in groups.values()]),
        "configs": digest([[one.model_dump(mode="json") for one in group.problems] for group in groups.values()]),
        "objects": listing(
            library, sorted({p.objects.articulated.cls for group in groups.values() for p in group.problems})
        ),
    }
    rows, warnings = [], dict[str, str]()
    with (
        RunFolder(Path(out) if out is not None else default_run_dir(), told, identity, resume) as folder,
        EpisodeRunner(options, Execution(workers), progress, log=folder.errors_log) as evaluator,
    ):
        for name, group in groups.items():
            jobs = [_recorded(group.spec, problem, library) for problem in group.problems]
            if scenes == "drawn":
                jobs = [ConfigEpisode(jobs[0].config)] * episodes
            config = evaluator.config(group.spec, "all")
            found, _ = run_episodes(
                group.spec,
                folder.task(name).path,
                evaluator,
                episode,
                partial(_arguments, config, jobs),
                TableExtent(1, len(jobs), seed),
                progress,
            )
            folder.add_episodes(library, found, folder.path / "run.json")
            folder.save()
            rows.append(ConfigRow(name, tuple(found), tuple(job.source for job in jobs), group.release))
            warnings |= _losses(found, group, library)
        result = ConfigBenchmark(
            str(folder.path),
            arguments,
            versions(evaluator.scene.engine),
            tuple(rows),
            left_out,
            warnings,
            evaluator.cpu_s,
            provenance(),
        )
        finish_table(folder, result.to_dict())
    return result


def _arguments(
    config: EpisodeConfig, jobs: Sequence[ConfigEpisode], index: int, seed: int
) -> tuple[EpisodeConfig, ConfigEpisode, int]:
    return config, jobs[index], seed


def episode(config: EpisodeConfig, plan: ConfigEpisode, seed: int) -> Episode:
    """Run one episode in a worker process; success is tested at the end of each hand step, as in the original."""
    from gensim2.rollout.run import run
    from gensim2.rollout.worker import simulator

    profile = robot(config.scene.robot)
    controller = HandStepsController(config.task, profile, config=plan.config, object_yaw=plan.object_yaw)
    world = simulator(config.scene)
    return run(world, controller, seed=seed, options=plan.options, every=control_steps(profile)).episode


@dataclass
class _Group:
    """Recorded problems of one config, which belongs to a single-step task or to the first step of a long task."""

    spec: TaskSpec
    problems: list[PlanProblem] = field(default_factory=list)
    release: Rate | None = None


def _groups(
    problems: Sequence[PlanProblem], library: Library, tasks: Sequence[str], file: Path
) -> tuple[dict[str, _Group], dict[str, str]]:
    """Return the usable problems by row of the result, and the reason for each unusable problem by id.

    A problem is usable if its arm is at the start position of an episode, and if its object is available.
    """
    known = {name for name in task_names(PAPER_SUITE) if load_task(name).is_single_step}
    for name in tasks:
        if name not in known:
            message = f"{name!r} is not a single-step task of the paper"
            raise InputError(message, field="tasks", remedy=near(name, sorted(known)))
    found: dict[str, _Group] = {}
    left_out: dict[str, str] = {}
    lacking: list[str] = []
    for problem in problems:
        name, own = problem.sub_task, problem.task == problem.sub_task
        if tasks and name not in tasks:
            continue
        if name not in known:
            left_out[problem.id] = f"{name} is a step of {problem.task}, not a separate task"
        elif not _begins(problem):
            left_out[problem.id] = f"does not begin at the start of an episode of {problem.task}"
        elif (reason := _lacking(problem, library)) is not None:
            left_out[problem.id] = reason
            lacking.append(reason)
        else:
            _check_tool(problem, file)
            release = Rate(*MEASURED[name]) if own and name in MEASURED else None
            row = name if own else f"{problem.task}-{name}"
            found.setdefault(row, _Group(_with_time(load_task(name)), [], release)).problems.append(problem)
    if not found:
        if lacking:
            message = f"{library.location} has no object of {file}: {lacking[0]}"
            raise InputError(message, field="assets", remedy="give the folder of the original's objects")
        there = ", ".join(sorted({problem.sub_task for problem in problems} & known)) or "no single-step task"
        raise InputError("contains no config of these tasks", file=file, field="tasks", remedy=f"choose from {there}")
    return found, left_out


def _begins(problem: PlanProblem) -> bool:
    """Return whether the arm is at the start position of an episode."""
    start = robot(ROBOT).reset_qpos
    return max(abs(q - at) for q, at in zip(problem.q_current, start, strict=True)) < START_TOLERANCE


def _lacking(problem: PlanProblem, library: Library) -> str | None:
    """Return a message if the library lacks the object of a record, else None."""
    record = problem.objects.articulated
    if record.cls not in library.classes("articulated") or record.id not in library.instances(record.cls):
        return f"there is no {record.cls}/{record.id}"
    return None


def _check_tool(problem: PlanProblem, file: Path) -> None:
    """Check that a problem was recorded with the gripper of ``ROBOT``.

    Raises:
        InputError: a tool keypoint differs.
    """
    keypoints = robot(ROBOT).tool_keypoints
    for name, point in problem.tool_keypoints_hand.items():
        if name not in keypoints or max(abs(a - b) for a, b in zip(keypoints[name], point, strict=True)) > TOLERANCE:
            raise InputError(
                f"{problem.id}: the keypoint {name} differs from the profile {ROBOT}",
                file=file,
                field="tool_keypoints_hand",
                remedy="give problems that were recorded with the long-fingered gripper",
            )


def _with_time(spec: TaskSpec) -> TaskSpec:
    """Return a task with the time limit of an episode of the original."""
    profile = robot(ROBOT)
    most = MAX_STEPS * control_steps(profile) + profile.steps(MAX_SETTLE_SECONDS)
    return spec.model_copy(update={"max_episode_steps": most})


def _recorded(spec: TaskSpec, problem: PlanProblem, library: Library) -> ConfigEpisode:
    """Return the recorded scene; the object is raised if its moving link would be inside the table."""
    record = problem.objects.articulated
    model = library.load(record.cls, record.id)
    assert isinstance(model, ArticulatedObject)
    position, quaternion = np.array(record.root_p), np.array(record.root_q)
    quaternion = quaternion / np.linalg.norm(quaternion)
    sunk = max(0.0, -lowest_of_moving_link(model, position, quaternion))
    openness = (record.qpos[0] - record.close_qpos) / (record.open_qpos - record.close_qpos)
    name = spec.steps[0].object
    options = {
        "instance": {name: record.id},
        "pose": {name: [*position[:2], position[2] + sunk, *quaternion]},
        "openness": {name: float(np.clip(openness, 0.0, 1.0))},
    }
    return ConfigEpisode(problem.timed_config(), problem.object_yaw, options, problem.id)


def _losses(episodes: Sequence[Episode], group: _Group, library: Library) -> dict[str, str]:
    """Return messages about missing parts of the scenes of these episodes, by object."""
    found = {}
    for episode in episodes:
        for record in episode.objects.values():
            model = library.load(record.asset_class, record.id)
            if model.warnings:
                found[f"{record.asset_class}/{record.id}"] = "; ".join(model.warnings)
    for problem in group.problems:
        if problem.objects.rigid is not None:
            found[problem.objects.rigid.cls] = f"not in the scenes of {problem.task}, whose first step leaves it alone"
    return found


def main(arguments: list[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("configs", type=Path, help="JSON Lines file with planning problems and the original's configs")
    parser.add_argument(
        "--tasks", nargs="+", default=(), metavar="TASK", help="names of single-step tasks  [default: all]"
    )
    parser.add_argument(
        "--scenes",
        choices=SCENES,
        default="recorded",
        help="scenes: of the file, or random  [default: every scene of the file once]",
    )
    parser.add_argument(
        "--episodes", type=int, default=30, help="number of episodes of each task with --scenes drawn  [default: 30]"
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of --scenes drawn  [default: 0]")
    parser.add_argument("--assets", help="folder of the original's objects")
    parser.add_argument("--physics", default="original", help="preset of the physics  [default: original]")
    parser.add_argument("--out", type=Path, help="run folder  [default: runs/<date>-<time>]")
    parser.add_argument("--workers", type=int, default=2, help="number of worker processes  [default: 2]")
    parser.add_argument("--resume", action="store_true", help="continue the run in --out")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the table and all episodes to FILE")
    options = vars(parser.parse_args(arguments))
    file = options.pop("json")
    try:
        found = benchmark_configs(**options)
        if file is not None:
            write_output(file, json.dumps(found.to_dict()))
    except GenSim2Error as error:
        print(f"original_configs: {error}", file=sys.stderr)
        return 2
    for row in found.rows:
        tally = Tally.of(row.episodes)
        ours = Rate(tally.paper, tally.episodes)
        print(f"{row.name}: {ours}" + (f", its release {row.release}" if row.release is not None else ""))
    for name, reason in (*found.left_out.items(), *found.warnings.items()):
        print(f"{name}: {reason}")
    print(f"{found.cpu_s:.1f} s of CPU; episodes: {Path(found.run_dir) / 'tasks'}")
    return 0


if __name__ == "__main__":
    import original_configs  # workers must import the episode function from a module with this name, not from __main__

    sys.exit(original_configs.main())
