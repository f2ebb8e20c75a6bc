"""A run folder as a run leaves it, made by hand."""

from __future__ import annotations

import sys
from pathlib import Path

from constraints import point_to_point

sys.path.insert(0, str(Path(__file__).parents[1] / "kill"))

import fake_world

from gensim2.core.files import write_json
from gensim2.data.records import RUN_SCHEMA_VERSION, PipelineResult, RunRecord, Verification
from gensim2.data.runfolder import TaskFolder
from gensim2.design.base import Candidate, CandidateResult, StageResult
from gensim2.design.designs import Design, write_design
from gensim2.rollout.config import RolloutOptions
from gensim2.rollout.record import Cause
from gensim2.scenes.config import SceneOptions
from gensim2.tasks.criteria import ArticulatedOpen
from gensim2.tasks.spec import ObjectSpec, Step, TaskSpec
from gensim2.tasks.strategies import StepStrategies

CONFIG = {
    "task_name": "OpenDemo",
    "constraint_list": [point_to_point("tool_head", "articulated_object_head", 0.001, name="tip_on_handle")],
}


def task_spec(name: str) -> TaskSpec:
    """Return a task with one step on one box."""
    return TaskSpec(
        name=name,
        description="raise the <lid> until it stands open",
        objects={"box": ObjectSpec(asset_class="box_rotate")},
        steps=(Step(name="open", object="box", strategies=("designed",), done=(ArticulatedOpen(object="box"),)),),
    )


def add_task(run_dir: Path, name: str, held: int, *, parent: str = "tasks", episodes: int = 20) -> None:
    """Add a task of which ``held`` of ``episodes`` episodes succeeded."""
    files, task = TaskFolder(run_dir / parent / name), task_spec(name)
    files.write_task(task)
    files.write_strategies({"designed": CONFIG})
    slipped = Cause.CONTACT_SLIPPED
    fresh = tuple(
        fake_world.episode_of(task, 1000 + i, held=i < held, cause=slipped, instance=str(i % 4))
        for i in range(episodes)
    )
    files.write_verification(Verification(fresh, 0.7, "new"))
    write_design(files.path, design())
    environment = {"env_id": f"gensim2.sim:GenSim2-{name}-v1"}
    recorded = {"env_info": environment, "episodes": [{"episode_id": i} for i in range(3)]}
    write_json(files.path / "trajectory.json", recorded)


def design() -> Design:
    """Return a search with a winner, other candidates, and some that could not be planned."""
    steps: StepStrategies = {"open": {"designed": CONFIG}}
    results = []
    for index in range(20):
        stages = [StageResult("plan", 4, 1.0 if index < 10 else 0.0, {})]
        if index < 10:
            stages.append(StageResult("physics", 2, 1.0 if index < 3 else 0.0, {}))
        if index < 3:
            stages.append(
                StageResult("physics", 6, 1.0 - index / 3, {"object did not move": 2 * index} if index else {})
            )
        label = f"hook candidate {index}: tip along the joint's y, 0.1 m before"
        results.append(CandidateResult(Candidate(label, steps, {}), tuple(stages)))
    return Design(tuple(results), steps, ("10 of 20 plan",))


def run_folder(run_dir: Path) -> Path:
    """Make a finished run with two kept and two rejected tasks, of which one has no folder."""
    add_task(run_dir, "OpenDemo", 18)
    add_task(run_dir, "CloseDemo", 15)
    add_task(run_dir, "LiftDemo", 3, parent="rejected")
    result = PipelineResult(
        run_dir=str(run_dir),
        tasks=(),
        rejected=({"name": "TurnDemo", "class": "faucet", "reason": "no candidate could be planned"},),
        notes=("3 tasks were asked for; 4 were tried and 2 held",),
    )
    record = RunRecord(
        schema_version=RUN_SCHEMA_VERSION,
        arguments={
            "command": "run-pipeline",
            "seed": 0,
            **SceneOptions("builtin").to_record(),
            **RolloutOptions().to_record(),
        },
        identity={"objects": "0123456789abcdef"},
        command_line=["run-pipeline", "--num-tasks", "3"],
        started="2026-01-01T10:00:00+0000",
        finished="2026-01-01T10:04:00+0000",
        versions={"python": "3.11.7", "gensim2": "0.1.0"},
        platform="Linux",
        assets={"box_rotate/0": "ab12"},
        licenses={"box_rotate/0": "Apache-2.0"},
        result=result.to_dict(),
        resumed=0,
    )
    write_json(run_dir / "run.json", record.model_dump())
    return run_dir
