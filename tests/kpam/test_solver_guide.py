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
