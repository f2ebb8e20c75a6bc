"""A half-open drawer on a table with a cube beside it, and independent code that measures distances along a motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import coal
import numpy as np
import numpy.typing as npt
from constraints import parallel, point_to_point
from parts import Moved, Part, least_distance, part
from peers import Arm

import gensim2_kpam as kpam

Array = npt.NDArray[np.float64]

TOOL = {"head": [0.0, 0.0, 0.103], "tail": [0.0, 0.0, 0.073], "side": [0.0, 0.05, 0.103]}
HALF_OPEN, SHUT = 0.13, 0.0
CUBE = 0.02
#: Start of the cube, in front of the drawer.
START = (0.37, 0.0)
#: Name, half extents and centre; the cabinet is open to the front, with the drawer above.
CABINET = [
    ("bottom", [0.11, 0.13, 0.005], [0.71, 0.0, 0.005]),
    ("back", [0.005, 0.13, 0.065], [0.815, 0.0, 0.075]),
    ("left", [0.11, 0.005, 0.065], [0.71, 0.125, 0.075]),
    ("right", [0.11, 0.005, 0.065], [0.71, -0.125, 0.075]),
    ("top", [0.11, 0.13, 0.005], [0.71, 0.0, 0.145]),
]
#: Position of the closed drawer.
DRAWER = [
    ("floor", [0.095, 0.11, 0.004], [0.705, 0.0, 0.02]),
    ("front", [0.005, 0.12, 0.0675], [0.595, 0.0, 0.0825]),
    ("sides", [0.095, 0.004, 0.03], [0.705, 0.11, 0.05]),
    ("other side", [0.095, 0.004, 0.03], [0.705, -0.11, 0.05]),
]


def at(*xyz: float) -> Array:
    """Return a pose (4, 4) without rotation."""
    pose = np.eye(4)
    pose[:3, 3] = xyz
    return pose


def scene(panda: kpam.Robot) -> kpam.Scene:
    """Table, cabinet, half-open drawer and cube."""

    def boxes(entries: list[tuple[str, list[float], list[float]]]) -> list[kpam.Shape]:
        return [kpam.Shape.box(half, at(*center)) for _, half, center in entries]

    slide = kpam.Joint("prismatic", [0.6, 0.0, 0.07], [-1.0, 0.0, 0.0], SHUT, SHUT, 0.18)
    bodies = [
        kpam.Body("table", "table", [kpam.Shape.box([0.65, 0.65, 0.025])], at(0.615, 0.0, -0.0255)),
        kpam.Body("cabinet", "object_body", boxes(CABINET), np.eye(4)),
        kpam.Body(
            "drawer",
            "rigid",
            boxes(DRAWER),
            np.eye(4),
            keypoints={"inside": [0.65, 0.0, 0.024 + CUBE + 0.004], "front": [0.577, 0.0, 0.125]},
        ),
        kpam.Body(
            "cube",
            "rigid",
            [kpam.Shape.box([CUBE] * 3)],
            at(*START, CUBE),
            keypoints={"center": [0.0, 0.0, 0.0], "grip": [0.0, 0.0, 0.012]},
        ),
    ]
    shut = kpam.Scene(panda, bodies, [kpam.SceneJoint("slide", slide, ["drawer"])])
    return shut.with_joint("slide", HALF_OPEN)


def config(tool: str, target: str, pre: list[Any], post: list[Any]) -> kpam.SolverConfig:
    """Return a config that puts a tool point on a target, with the hand down and the fingers closing along y."""
    constraints: list[dict[str, Any]] = [point_to_point(tool, target, 0.001)]
    axes = {"tail": [0, 0, 1], "side": [0, 1, 0]}
    constraints += [parallel("head", name, axis, 0.02) for name, axis in axes.items()]
    return kpam.SolverConfig(
        {"constraint_list": constraints, "pre_actuation_motions": pre, "post_actuation_motions": post}
    )


@dataclass
class Walk:
    """Joints of a plan at times so dense that nothing moves far between them."""

    times: Array
    q: Array


def walk(plan: kpam.Plan, step: float = 0.004) -> Walk:
    """Return samples of a plan's motion."""
    assert plan.trajectory is not None
    times = np.append(np.arange(0.0, plan.trajectory.duration, step), plan.trajectory.duration)
    return Walk(times, np.array([plan.trajectory.sample(t)[0] for t in times]))


class World:
    """The same bodies for coal, and the arm by other code."""

    def __init__(self) -> None:
        self.arm = Arm()
        self.table = [part(coal.Box(1.3, 1.3, 0.05), at(0.615, 0.0, -0.0255))]
        self.cabinet = self._parts(CABINET)
        self.drawer = self._parts(DRAWER)
        self.cube = [part(coal.Box(*[2 * CUBE] * 3), np.eye(4))]

    @staticmethod
    def _parts(entries: list[tuple[str, list[float], list[float]]]) -> list[Part]:
        return [part(coal.Box(*(2.0 * h for h in half)), at(*center)) for _, half, center in entries]

    def hand(self, q: Array) -> Array:
        """Return the hand's poses (M, 4, 4)."""
        poses: Array = self.arm.hand_poses(q)
        return poses

    def least(self, q: Array, cube: Array, opening: Array, *, held: bool) -> tuple[float, str]:
        """Return the smallest distance (m) along a motion of all pairs that may not touch, with the names of the pair.

        Args:
            q: (M, 9).
            cube: (M, 4, 4) or (1, 4, 4), its poses.
            opening: (M,) or (1,), that of the drawer.
            held: whether the cube moves with the hand. Hand and fingers may always touch it and the drawer.
        """
        placed = self.arm.place(q)
        drawer = np.array([at(-value, 0.0, 0.0) for value in opening])
        things = [
            Moved("table", self.table, np.eye(4)[None]),
            Moved("cabinet", self.cabinet, np.eye(4)[None]),
            Moved("drawer", self.drawer, drawer),
        ]
        hand = {"panda_hand", "panda_leftfinger", "panda_rightfinger"}
        links = [Moved(name, self.arm.parts[name], placed[name]) for name in self.arm.moving_links]
        block = Moved("cube", self.cube, cube)
        pairs = [(link, thing) for link in links for thing in things if link.name not in hand or thing.name != "drawer"]
        pairs += [(link, block) for link in links if link.name not in hand]
        if held:
            pairs += [(block, thing) for thing in things]
        samples = np.arange(len(q))
        best, what = 0.05, "nothing"
        for one, two in pairs:
            found = least_distance(one, two, samples, best)
            if found is not None:
                best, what = found[0], f"{one.name} and {two.name} at sample {found[1]}"
        return best, what
