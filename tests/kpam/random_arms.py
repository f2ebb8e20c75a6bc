"""Random arms as URDF text: 2 to 9 revolute, prismatic and continuous joints, mimic joints, hands with or without
shapes.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

Array = np.ndarray


@dataclass
class RandomArm:
    """A URDF, its hand link, and the tool point (in the hand frame, m).

    ``file`` is the location of the URDF with meshes, None for one without; ``srdf`` disables pairs of links.
    """

    urdf: str
    hand: str
    tip: Array
    file: Path | None = None
    srdf: Path | None = None


@dataclass
class _Joint:
    name: str
    kind: str
    parent: str
    child: str
    xyz: Array
    rpy: Array
    axis: Array
    lower: float
    upper: float
    velocity: float
    mimic: tuple[str, float, float] | None = None

    def text(self) -> str:
        """Return the URDF text."""
        limit = f'<limit lower="{self.lower!r}" upper="{self.upper!r}" velocity="{self.velocity!r}" effort="1"/>'
        if self.kind == "continuous":
            limit = f'<limit velocity="{self.velocity!r}" effort="1"/>'
        if self.kind == "fixed":
            limit = ""
        mimic = ""
        if self.mimic is not None:
            source, factor, offset = self.mimic
            mimic = f'<mimic joint="{source}" multiplier="{factor!r}" offset="{offset!r}"/>'
        return (
            f'<joint name="{self.name}" type="{self.kind}"><parent link="{self.parent}"/><child link="{self.child}"/>'
            f'<origin xyz="{triple(self.xyz)}" rpy="{triple(self.rpy)}"/><axis xyz="{triple(self.axis)}"/>'
            f"{limit}{mimic}</joint>"
        )


def triple(values: Array) -> str:
    """Return three numbers as the value of an XML attribute."""
    return " ".join(repr(float(value)) for value in values)


def solid(draw: np.random.Generator, to: Array, thick: float) -> str:
    """Return a collision shape between a link's frame and the next joint."""
    length = float(np.linalg.norm(to))
    if length < 0.05:
        return f'<collision><geometry><sphere radius="{thick!r}"/></geometry></collision>'
    direction = to / length
    pitch, yaw = float(np.arccos(np.clip(direction[2], -1.0, 1.0))), float(np.arctan2(direction[1], direction[0]))
    origin = f'<origin xyz="{triple(0.5 * to)}" rpy="0 {pitch!r} {yaw!r}"/>'
    kind = draw.choice(["box", "capsule", "cylinder"])
    inside = 0.7 * length
    if kind == "box":
        geometry = f'<box size="{2 * thick!r} {2 * thick!r} {inside!r}"/>'
    elif kind == "capsule":
        geometry = f'<capsule radius="{thick!r}" length="{inside - thick!r}"/>'
    else:
        geometry = f'<cylinder radius="{thick!r}" length="{inside!r}"/>'
    return f"<collision>{origin}<geometry>{geometry}</geometry></collision>"


def random_arm(draw: np.random.Generator) -> RandomArm:
    """Return an arm with a reach of about a metre."""
    count = int(draw.integers(2, 10))
    foot = '<origin xyz="0 0 0.05"/><geometry><cylinder radius="0.06" length="0.1"/></geometry>'
    shapes: dict[str, str] = {"base": f"<collision>{foot}</collision>"}
    joints: list[_Joint] = []
    at, parent = np.array([0.0, 0.0, 0.15]), "base"
    reach = 1.0 / count
    for index in range(count):
        name, child = f"joint{index}", f"link{index}"
        kind = str(draw.choice(["revolute", "continuous", "prismatic"], p=[0.65, 0.2, 0.15]))
        axis = np.eye(3)[draw.integers(3)] * draw.choice([-1.0, 1.0])
        if draw.random() < 0.15:
            axis = draw.normal(size=3)
            axis /= np.linalg.norm(axis)
        rpy = draw.uniform(-0.4, 0.4, 3) if draw.random() < 0.4 else np.zeros(3)
        middle = float(draw.uniform(-0.5, 0.5))
        spread = float(draw.uniform(1.0, 2.8)) if kind != "prismatic" else float(draw.uniform(0.1, 0.3))
        middle = 0.2 * middle if kind == "prismatic" else middle
        speed = float(draw.uniform(0.8, 3.0)) if kind != "prismatic" else float(draw.uniform(0.2, 1.0))
        joints.append(_Joint(name, kind, parent, child, at, rpy, axis, middle - spread, middle + spread, speed))
        at = draw.uniform(-0.3, 0.3, 3) * reach + np.array([0.0, 0.0, reach * draw.uniform(0.7, 1.4)])
        shapes[child] = solid(draw, at, float(draw.uniform(0.02, 0.04))) if draw.random() < 0.9 else ""
        parent = child
    add_mimics(draw, joints)
    hand, tip = add_hand(draw, joints, shapes, parent, at)
    order = draw.permutation(len(joints)) if draw.random() < 0.3 else range(len(joints))
    links = "".join(f'<link name="{name}">{shape}</link>' for name, shape in shapes.items())
    text = f'<robot name="random">{links}{"".join(joints[index].text() for index in order)}</robot>'
    return RandomArm(text, hand, tip)


def add_mimics(draw: np.random.Generator, joints: list[_Joint]) -> None:
    """Make some joints mimic others: of links nearer to or farther from the base, and mimics of mimics."""
    if len(joints) < 3 or draw.random() < 0.55:
        return
    chosen = [int(index) for index in draw.permutation(len(joints))]
    source, followers = chosen[0], chosen[1 : 2 + int(draw.random() < 0.4)]
    for follower in followers[: len(joints) - 2]:
        factor = float(draw.choice([-1.0, 0.5, 2.0, -0.7]))
        if (joints[follower].kind == "prismatic") != (joints[source].kind == "prismatic"):
            factor *= 0.1 if joints[follower].kind == "prismatic" else 3.0
        joints[follower].mimic = (joints[source].name, factor, float(draw.uniform(-0.1, 0.1)))
        # The next joint mimics this one.
        source = follower


def add_hand(
    draw: np.random.Generator, joints: list[_Joint], shapes: dict[str, str], parent: str, at: Array
) -> tuple[str, Array]:
    """Add a bare tool frame, a palm, or a gripper whose second finger mimics the first; return its name and the tip."""
    zero = np.zeros(3)
    style = draw.choice(["frame", "palm", "gripper"], p=[0.4, 0.3, 0.3])
    if style == "frame":
        shapes["tool0"] = ""
        joints.append(_Joint("flange", "fixed", parent, "tool0", at, draw.uniform(-1, 1, 3), zero, 0, 0, 0))
        return "tool0", draw.choice([0.0, 1.0]) * np.array([0.0, 0.0, 0.05])
    shapes["palm"] = '<collision><origin xyz="0 0 0.03"/><geometry><box size="0.08 0.04 0.04"/></geometry></collision>'
    joints.append(_Joint("wrist", "fixed", parent, "palm", at, zero, zero, 0, 0, 0))
    if style == "palm":
        return "palm", np.array([0.0, 0.0, 0.055])
    finger = '<collision><origin xyz="0 0 0.03"/><geometry><box size="0.01 0.02 0.05"/></geometry></collision>'
    for index, (side, mimic) in enumerate(((-1.0, None), (1.0, ("finger0", 1.0, 0.0)))):
        shapes[f"finger{index}_link"] = finger
        joints.append(
            _Joint(
                f"finger{index}",
                "prismatic",
                "palm",
                f"finger{index}_link",
                np.array([side * 0.01, 0.0, 0.06]),
                zero,
                np.array([side, 0.0, 0.0]),
                0.0,
                0.03,
                0.1,
                mimic,
            )
        )
    return "palm", np.array([0.0, 0.0, 0.1])
