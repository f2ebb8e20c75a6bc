"""The examples of the solver guide run, and do what their comments say."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[2]


def run(heading: str) -> dict[str, Any]:
    """Run the first Python example under a heading of the guide, and return its variables."""
    text = (ROOT / "docs/guides/solver.md").read_text(encoding="utf-8")
    section = re.split(r"^## ", text.partition(f"\n## {heading}\n")[2], maxsplit=1, flags=re.M)[0]
    example = re.search(r"^```python\n(.*?)^```", section, re.S | re.M)
    assert example is not None, heading
    names: dict[str, Any] = {}
    exec(compile(example[1], heading, "exec"), names)
    return names


def test_inverse_kinematics() -> None:
    names = run("Inverse kinematics")
    model, scene = names["panda"].model, names["scene"]
    found, home = names["found"], np.array(names["home"])
    assert 1 <= len(found) <= 4
    for q in found:
        np.testing.assert_allclose(model.forward_kinematics(q), names["target"], atol=1e-6)
        assert scene.check(q, 0.005) == []
    steps = ((found - home) ** 2).sum(axis=1)
    assert (np.diff(steps) >= 0).all()


def test_lines() -> None:
    names = run("Move the hand along lines")
    motion = names["motion"]
    assert motion.status == "solved"
    hands = names["panda"].model.forward_kinematics(motion.trajectory.sample_every(0.01))
    for hand in hands:
        x, y, z = hand[:3, 3] - names["first"][:3, 3]
        assert abs(z) <= 0.001
        assert min(np.hypot(x, y - np.clip(y, 0, 0.2)), np.hypot(x - np.clip(x, 0, 0.1), y - 0.2)) <= 0.001
        assert hand[:3, 2] @ names["first"][:3, 2] >= np.cos(0.01)
    np.testing.assert_allclose(hands[-1][:3, 3], names["corners"][1][:3, 3], atol=1e-5)


def test_many_motions() -> None:
    names = run("Go to joints or to a pose")
    assert [motion.status for motion in names["motions"]] == ["solved"] * 3
    ends = [motion.trajectory.positions[-1][0] for motion in names["motions"]]
    np.testing.assert_allclose(ends, [-1.0, 0.5, 1.5], atol=1e-9)
