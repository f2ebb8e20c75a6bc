"""The chosen actuation pose does not depend on the side of the objects."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from constraints import parallel, point_to_point

import gensim2_kpam as kpam

from .kpam_scenes import Q_START, TOOL, problem

Array = np.ndarray
FLIP = np.array([-1.0] * 7 + [1.0] * 2)
MIRROR = np.diag([1.0, -1.0, 1.0])


def mirrored(urdf: str) -> str:
    """The arm mirrored at y = 0, without shapes: revolute joints turn in the opposite direction."""
    for element in ("collision", "visual", "inertial"):
        urdf = re.sub(rf"<{element}.*?</{element}>", "", urdf, flags=re.DOTALL)

    def numbers(text: str, name: str, signs: list[int], default: str = "") -> str:
        found = re.search(rf'{name}="([^"]*)"', text)
        values = (found.group(1) if found else default).split()
        return " ".join(str(sign * float(value)) for sign, value in zip(signs, values, strict=True))

    def origin(match: re.Match[str]) -> str:
        text = match.group(0)
        xyz, rpy = numbers(text, "xyz", [1, -1, 1], "0 0 0"), numbers(text, "rpy", [-1, 1, -1], "0 0 0")
        return f'<origin xyz="{xyz}" rpy="{rpy}"/>'

    def joint(match: re.Match[str]) -> str:
        text = re.sub(r"<axis[^>]*/>", lambda m: f'<axis xyz="{numbers(m[0], "xyz", [1, -1, 1])}"/>', match.group(0))
        if 'type="revolute"' not in text:
            return text
        lower, upper = numbers(text, "upper", [-1]), numbers(text, "lower", [-1])
        return re.sub('upper="[^"]*"', f'upper="{upper}"', re.sub('lower="[^"]*"', f'lower="{lower}"', text))

    urdf = re.sub(r"<origin[^>]*/>", origin, urdf)
    return re.sub(r"<joint name.*?</joint>", joint, urdf, flags=re.DOTALL)


def question(
    robot: kpam.Robot, q: Array, goal: Array, axes: list[tuple[str, Array]], side: float
) -> kpam.KeypointProblem:
    constraints: list[dict[str, Any]] = [point_to_point("tool_head", "goal", 0.001)]
    constraints += [parallel("tool_head", name, list(axis * [1, side, 1]), 0.02) for name, axis in axes]
    return problem(
        robot,
        config={"constraint_list": constraints},
        q_start=q,
        tool_keypoints={name: np.asarray(p) * [1, side, 1] for name, p in TOOL.items()},
        object_keypoints={"goal": goal * [1, side, 1]},
        bodies=[],
        options={"avoid_collisions": False},
    )


def test_mirrored_problems_cost_the_same(panda: kpam.Robot, robots: Path, tmp_path: Path) -> None:
    file = tmp_path / "mirrored.urdf"
    file.write_text(mirrored((robots / "panda" / "panda_v2.urdf").read_text()))
    other = kpam.Robot.from_urdf(file, hand_link="panda_hand")
    there = panda.forward_kinematics(Q_START)
    np.testing.assert_allclose(other.forward_kinematics(Q_START * FLIP)[:3, 3], MIRROR @ there[:3, 3], atol=1e-12)
    draw = np.random.default_rng(5)
    pairs = agree = 0
    for index in range(150):
        q = Q_START + np.r_[draw.uniform(-0.4, 0.4, 7), 0.0, 0.0]
        goal = draw.uniform([0.3, -0.5, 0.05], [0.7, 0.5, 0.7])
        back = np.array([0, 0, 1.0]) + draw.normal(size=3) * [0.5, 0.5, 0.3]
        back /= np.linalg.norm(back)
        side = np.cross(back, draw.normal(size=3))
        axes = [("tool_tail", back), ("tool_side", side / np.linalg.norm(side))][: index % 3]
        one, two = kpam.plan_batch([question(panda, q, goal, axes, 1.0), question(other, q * FLIP, goal, axes, -1.0)])
        if one.cost is not None and two.cost is not None:
            pairs += 1
            agree += abs(one.cost - two.cost) <= 0.01 * min(one.cost, two.cost)
    assert pairs >= 100
    assert agree >= 0.96 * pairs, f"{agree} of {pairs}"
