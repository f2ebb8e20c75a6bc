"""Six arms for random problems: two from ManiSkill's wheel, and four that are written here."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
from mechanism import Mechanism

from .random_arms import RandomArm

#: Six arms, by name.
ARMS = ("panda", "ur", "xarm7", "scara", "gantry", "mobile")
PALM = '<collision><origin xyz="0 0 0.02"/><geometry><box size="0.06 0.03 0.04"/></geometry></collision>'
TIP = np.array([0.0, 0.0, 0.045])


def six_joints() -> str:
    """An arm with six joints like those of Universal Robots, whose hand is the bare frame ``tool0``."""
    # Name, origin, axis, and the solid of the child link: radius, length, middle, whether along y instead of z.
    rows: list[tuple[str, str, str, float, float, str, bool]] = [
        ("shoulder_pan", "0 0 0.09", "0 0 1", 0.06, 0.12, "0 0 0", False),
        ("shoulder_lift", "0 0.13 0", "0 1 0", 0.05, 0.40, "0 0 0.21", False),
        ("elbow", "0 -0.12 0.425", "0 1 0", 0.045, 0.36, "0 0 0.2", False),
        ("wrist_1", "0 0 0.392", "0 1 0", 0.04, 0.1, "0 0.05 0", True),
        ("wrist_2", "0 0.11 0", "0 0 1", 0.04, 0.1, "0 0 0.02", False),
        ("wrist_3", "0 0 0.095", "0 1 0", 0.035, 0.05, "0 0.05 0", True),
    ]
    foot = '<collision><geometry><cylinder radius="0.07" length="0.04"/></geometry></collision>'
    text, parent = f'<link name="base_link">{foot}</link>', "base_link"
    for name, origin, axis, radius, length, middle, lying in rows:
        turn = "1.5707963 0 0" if lying else "0 0 0"
        text += (
            f'<link name="{name}_link"><collision><origin xyz="{middle}" rpy="{turn}"/>'
            f'<geometry><cylinder radius="{radius}" length="{length}"/></geometry></collision></link>'
            f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{name}_link"/>'
            f'<origin xyz="{origin}"/><axis xyz="{axis}"/>'
            '<limit lower="-6.2" upper="6.2" velocity="3.1" effort="1"/></joint>'
        )
        parent = f"{name}_link"
    text += (
        f'<link name="tool0"/><joint name="flange" type="fixed"><parent link="{parent}"/><child link="tool0"/>'
        '<origin xyz="0 0.082 0" rpy="-1.5707963 0 0"/></joint>'
    )
    return f'<robot name="six">{text}</robot>'


def link(name: str, shape: str = "") -> str:
    return f'<link name="{name}">{shape}</link>'


def box(size: str, at: str = "0 0 0") -> str:
    """Return a box at a position on its link."""
    return f'<collision><origin xyz="{at}"/><geometry><box size="{size}"/></geometry></collision>'


def joint(name: str, kind: str, parent: str, child: str, at: str, axis: str, limit: str, rpy: str = "0 0 0") -> str:
    """Return a joint; ``limit`` is its lower limit, upper limit and speed."""
    low, high, speed = limit.split()
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{at}" rpy="{rpy}"/><axis xyz="{axis}"/>'
        f'<limit lower="{low}" upper="{high}" velocity="{speed}" effort="1"/></joint>'
    )


def scara() -> str:
    """Return two links with vertical axes, and a quill that slides and turns."""
    text = link("base", box("0.14 0.14 0.3", "0 0 0.15"))
    text += link("upper", box("0.3 0.1 0.06", "0.16 0 0")) + link("fore", box("0.24 0.08 0.06", "0.13 0 0"))
    text += link("quill", box("0.03 0.03 0.2", "0 0 -0.06")) + link("hand", PALM)
    text += joint("shoulder", "revolute", "base", "upper", "0 0 0.34", "0 0 1", "-2.6 2.6 3.0")
    text += joint("elbow", "revolute", "upper", "fore", "0.35 0 0.07", "0 0 1", "-2.5 2.5 4.0")
    text += joint("quill", "prismatic", "fore", "quill", "0.29 0 -0.05", "0 0 -1", "0 0.18 1.0")
    text += joint("turn", "revolute", "quill", "hand", "0 0 -0.165", "0 0 1", "-3.1 3.1 6.0", "3.14159265 0 0")
    return f'<robot name="scara">{text}</robot>'


def gantry() -> str:
    """Return three prismatic joints above the table, and a revolute one."""
    text = link("base") + link("bridge", box("0.1 1.2 0.08")) + link("carriage", box("0.1 0.1 0.08"))
    text += link("post", box("0.05 0.05 0.4")) + link("hand", PALM)
    text += joint("x", "prismatic", "base", "bridge", "0 0 1.3", "1 0 0", "-0.8 0.8 0.8")
    text += joint("y", "prismatic", "bridge", "carriage", "0 0 -0.1", "0 1 0", "-0.55 0.55 0.8")
    text += joint("z", "prismatic", "carriage", "post", "0 0 -0.3", "0 0 1", "-0.55 0.02 0.6")
    text += joint("turn", "revolute", "post", "hand", "0 0 -0.215", "0 0 1", "-3.1 3.1 4.0", "3.14159265 0 0")
    return f'<robot name="gantry">{text}</robot>'


def mobile() -> str:
    """Return the arm with six joints on a cart that slides in two directions and turns."""
    arm = six_joints().removeprefix('<robot name="six">').removesuffix("</robot>")
    text = link("world") + link("along") + link("across") + link("cart", box("0.4 0.3 0.1", "0 0 0.12")) + arm
    text += joint("x", "prismatic", "world", "along", "0 0 0", "1 0 0", "-1 1 0.6")
    text += joint("y", "prismatic", "along", "across", "0 0 0", "0 1 0", "-1 1 0.6")
    text += '<joint name="yaw" type="continuous"><parent link="across"/><child link="cart"/><axis xyz="0 0 1"/>'
    text += '<limit velocity="1.0" effort="1"/></joint>'
    text += (
        '<joint name="top" type="fixed"><parent link="cart"/><child link="base_link"/><origin xyz="0 0 0.2"/></joint>'
    )
    return f'<robot name="mobile">{text}</robot>'


@cache
def six_arm(name: str, robots: Path) -> tuple[RandomArm, Mechanism]:
    """Return one of :data:`ARMS` and its mechanism; ``robots`` is the wheel's folder of them."""
    written = {
        "ur": (six_joints, "tool0"),
        "scara": (scara, "hand"),
        "gantry": (gantry, "hand"),
        "mobile": (mobile, "tool0"),
    }
    if name in written:
        make, hand = written[name]
        arm = RandomArm(make(), hand, TIP if hand == "hand" else np.zeros(3))
        return arm, Mechanism(arm.urdf, Path(), hand)
    file, hand = {"panda": ("panda/panda_v2.urdf", "panda_hand"), "xarm7": ("xarm7/xarm7.urdf", "link_eef")}[name]
    path = robots / file
    srdf = path.with_suffix(".srdf") if name == "panda" else None
    tip = np.array([0.0, 0.0, 0.105 if name == "panda" else 0.03])
    arm = RandomArm(path.read_text(), hand, tip, path, srdf)
    return arm, Mechanism(arm.urdf, path.parent, hand, None if srdf is None else srdf.read_text())
