"""Made-up planned scenes: a bar of points, and a hand that acts at its right end."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gensim2.core.files import write_json
from gensim2.perception import ObservationSpec
from gensim2.policy.keypose.data import RECORD, Planned, PlannedRecord
from gensim2.policy.keypose.program import KEYPOSES
from gensim2.robots import robot

SPEC = ObservationSpec.of({"points": 96, "candidates": 256, "robot": "none"})


def made_up(count: int = 16, seed: int = 0) -> Planned:
    """Return ``count`` examples that need an action and as many that do not, in which the bar stands upright."""
    draw = np.random.default_rng(seed)
    profile = robot("panda")
    record = PlannedRecord(
        task="PushBar",
        language="push the bar",
        robot="panda",
        steps=("push",),
        ways=(("one", "other"),),
        scene={},
        observation=SPEC.to_dict(),
        seed=seed,
        identity="made up",
    )
    rows: dict[str, list[object]] = {}
    for number in range(2 * count):
        done = number % 2
        centre = np.array([0.5, 0.0, 0.1]) + 0.1 * draw.uniform(-1, 1, 3)
        along = draw.uniform(-0.1, 0.1, 96)
        points = centre + np.outer(along, [0.0, 0.0, 1.0] if done else [0.0, 1.0, 0.0])
        place = centre - np.array([0.0, 0.1, 0.0])
        positions = np.tile(place, (KEYPOSES, 1))
        positions[0, 2] += 0.1
        positions[2:, 0] += np.linspace(0.01, 0.1, KEYPOSES - 2)
        down = np.diag([1.0, -1.0, -1.0])
        example = {
            "points": np.rint(points / 1e-4).astype(np.int16),
            "joints": np.array(profile.reset_qpos, dtype=np.float32),
            "fingers": np.array([0.08, 1.0], dtype=np.float32),
            "positions": (positions * (1 - done)).astype(np.float32),
            "rotations": np.tile(down if not done else np.eye(3), (KEYPOSES, 1, 1)).astype(np.float32),
            "gripper": np.full(KEYPOSES + 1, 0.0 if done else -1.0, dtype=np.float32),
            "seconds": np.full(KEYPOSES, 0.0 if done else 0.2, dtype=np.float32),
            "force": np.float32(0.0),
            "step": np.int16(done),
            "way": np.int16(-1 if done else number % 4 // 2),
            "seed": np.int64(number),
        }
        for name, value in example.items():
            rows.setdefault(name, []).append(value)
    return Planned(record, {name: np.stack(values) for name, values in rows.items()}, 2 * count, {}, 1.0)


def written(planned: Planned, folder: Path) -> Path:
    """Return a folder that contains them."""
    folder.mkdir(parents=True)
    write_json(folder / RECORD, planned.record.model_dump(mode="json"))
    about = '{"scenes": %d, "failed": {}, "cpu_s": 1.0}' % planned.scenes  # noqa: UP031
    np.savez(folder / "shard_00000.npz", about=np.array(about), **planned.arrays)
    return folder
