"""A run folder as a run would leave it, made by hand."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "kill"))

import fake_world

from gensim2.data.records import Verification
from gensim2.data.runfolder import TaskFolder
from gensim2.files import write_json
from gensim2.rollout.record import Cause
from gensim2.tasks.criteria import ArticulatedOpen
from gensim2.tasks.spec import ObjectSpec, Step, TaskSpec

CONFIG = {
    "task_name": "OpenDemo",
    "constraint_list": [
        {
            "name": "tip_on_handle",
            "type": "point2point_constraint",
            "keypoint_name": "tool_head",
            "target_keypoint_name": "articulated_object_head",
            "tolerance": 0.001,
        }
    ],
}


def task_spec(name: str) -> TaskSpec:
    """A task of one step on one box."""
    return TaskSpec(
        name=name,
        description="raise the <lid> until it stands open",
        objects={"box": ObjectSpec(asset_class="box_rotate")},
        steps=(Step(name="open", object="box", strategies=("designed",), done=(ArticulatedOpen(object="box"),)),),
    )


def add_task(run_dir: Path, name: str, held: int, *, parent: str = "tasks", episodes: int = 20) -> None:
    """Add a task of which ``held`` of ``episodes`` held."""
    files, task = TaskFolder(run_dir / parent / name), task_spec(name)
    files.write_task(task)
    files.write_strategies({"designed": CONFIG})
    slipped = Cause.CONTACT_SLIPPED
    fresh = tuple(
        fake_world.episode_of(task, 1000 + i, held=i < held, cause=slipped, instance=str(i % 4))
        for i in range(episodes)
    )
    files.write_verification(Verification(fresh, 0.7, "new"))
    write_json(files.path / "design.json", design())
    environment = {"env_id": f"gensim2.sim:GenSim2-{name}-v1"}
    recorded = {"env_info": environment, "episodes": [{"episode_id": i} for i in range(3)]}
    write_json(files.path / "trajectory.json", recorded)


def design() -> dict[str, Any]:
    """A search with a winner, also-rans, and some that could not be planned."""
    candidates = []
    for index in range(20):
        stages: list[dict[str, Any]] = [
            {"name": "plan", "episodes": 4, "successes": 4 if index < 10 else 0, "causes": {}}
        ]
        if index < 10:
            stages.append({"name": "physics", "episodes": 2, "successes": 2 if index < 3 else 0, "causes": {}})
        if index < 3:
            stages.append({"name": "physics", "episodes": 6, "successes": 6 - 2 * index, "causes": {}})
        candidates.append(
            {
                "index": index,
                "label": f"hook candidate {index}: tip along the joint's y, 0.1 m before",
                "steps": {"open": {"designed": CONFIG}},
                "provenance": {},
                "stages": stages,
                "cause": None if index == 0 else "object did not move",
            }
        )
    return {
        "schema_version": 3,
        "candidates": candidates,
        "chosen": 0,
        "steps": {"open": {"designed": CONFIG}},
        "notes": ["10 of 20 plan"],
    }


def run_folder(run_dir: Path) -> Path:
    """A finished run with two kept tasks and two rejected ones, of which one never became a folder."""
    add_task(run_dir, "OpenDemo", 18)
    add_task(run_dir, "CloseDemo", 15)
    add_task(run_dir, "LiftDemo", 3, parent="rejected")
    result = {
        "tasks": [],
        "rejected": [{"name": "TurnDemo", "class": "faucet", "reason": "no candidate could be planned"}],
        "notes": ["3 tasks were asked for; 4 were tried and 2 held"],
    }
    write_json(
        run_dir / "run.json",
        {
            "schema_version": 4,
            "arguments": {
                "command": "run-pipeline",
                "seed": 0,
                "assets": "builtin",
                "physics": "default",
                "robot": "panda",
                "open_loop": False,
                "randomization": "paper",
            },
            "identity": {"objects": "0123456789abcdef"},
            "command_line": ["run-pipeline", "--num-tasks", "3"],
            "started": "2026-01-01T10:00:00+0000",
            "finished": "2026-01-01T10:04:00+0000",
            "versions": {"python": "3.11.7", "gensim2": "0.1.0"},
            "platform": "Linux",
            "assets": {"box_rotate/0": "ab12"},
            "licenses": {"box_rotate/0": "Apache-2.0"},
            "result": result,
            "resumed": 0,
        },
    )
    return run_dir
