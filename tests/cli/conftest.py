"""A run folder as a run would leave it, made by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from gensim2.files import write_atomic, write_json

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


def episode(index: int, success: bool) -> dict[str, Any]:
    """One episode of a verification."""
    start = float(np.random.default_rng(index).uniform(0.1, 0.4))
    return {
        "seed": 1000 + index,
        "instance": str(index % 4),
        "content_hash": "ab12",
        "success": success,
        "still_success": False,
        "openness_start": start,
        "openness_end": 0.93 if success else start + 0.1,
        "steps": 90,
        "cause": None if success else "the hand slipped",
        "plan_status": "solved",
        "plan_reason": "",
    }


def add_task(run_dir: Path, name: str, successes: int, *, parent: str = "tasks") -> None:
    """Add a task of which ``successes`` of 20 episodes held."""
    folder = run_dir / parent / name
    task = {
        "schema_version": 1,
        "name": name,
        "description": "raise the <lid> until it stands open",
        "asset_class": "box_rotate",
        "success": [{"type": "articulated_open", "threshold": 0.8}],
        "max_episode_steps": 400,
    }
    write_atomic(folder / "task.yaml", yaml.safe_dump(task, sort_keys=False))
    write_atomic(folder / "solver.yaml", yaml.safe_dump(CONFIG, sort_keys=False))
    episodes = [episode(index, index < successes) for index in range(20)]
    write_json(
        folder / "verification.json",
        {
            "schema_version": 1,
            "threshold": 0.7,
            "kept": successes >= 14,
            "successes": successes,
            "causes": {"the hand slipped": 20 - successes} if successes < 20 else {},
            "episodes": episodes,
        },
    )
    write_json(folder / "design.json", design())
    environment = {"env_id": f"gensim2.sim:GenSim2-{name}-v1"}
    recorded = {"env_info": environment, "episodes": [{"episode_id": i} for i in range(3)]}
    write_json(folder / "trajectory.json", recorded)


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
                "config": CONFIG,
                "provenance": {},
                "stages": stages,
                "cause": None if index == 0 else "the object did not move",
            }
        )
    return {
        "schema_version": 1,
        "candidates": candidates,
        "chosen": 0,
        "config": CONFIG,
        "notes": ["10 of 20 plan"],
    }


@pytest.fixture
def run_dir(tmp_path: Path) -> Path:
    """A finished run with two kept tasks and two rejected ones, of which one never became a folder."""
    run_dir = tmp_path / "run"
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
            "schema_version": 2,
            "arguments": {"command": "run-pipeline", "seed": 0, "assets": "builtin"},
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
