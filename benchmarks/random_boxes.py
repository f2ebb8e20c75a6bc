"""Write objects of no particular class: boxes of random sizes with a door, a lid or drawers, and import them.

The class ``any_hinged`` has doors at the front, hinged at any edge, and lids on top; the class ``any_sliding`` has
cabinets with one to three drawers. An estimator that has learned these classes can use their estimates for objects of
unknown classes (``gensim2 perceive train --stand-in``).

    python benchmarks/random_boxes.py boxes --count 60
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from gensim2.objects.library.importer import import_object

Vector = Sequence[float] | npt.NDArray[np.float64]
Box = tuple[Vector, Vector]
"""Size (3,) and centre (3,) of a box, m; x points away from the robot, and z up."""

GAP, SLACK = 0.002, 0.003
"""Gap (m) between the body and a hinged part, and between the body and a drawer."""
OUT, UP, LEFT = np.eye(3)[0] * -1.0, np.eye(3)[2], np.eye(3)[1]
FREE = {"left": -LEFT, "right": LEFT, "bottom": UP, "top": -UP, "back": OUT}
"""Direction from the hinge to the free edge of a closed door or lid, by the side of the hinge."""
DOOR_AXES = {"left": -UP, "right": UP, "bottom": -LEFT, "top": LEFT}
LID_AXES = {"back": LEFT, "left": OUT, "right": -OUT}


@dataclass(frozen=True)
class Thing:
    """A random object with its boxes, its joint, and the point at which the hand moves the joint."""

    body: Sequence[Box]
    moving: Sequence[Box]
    joint: str
    origin: Vector
    axis: Vector
    upper: float
    head: npt.NDArray[np.float64]

    def urdf(self) -> str:
        """Return the object as a URDF, whose moving link has its origin on the joint axis."""
        moving = [(size, np.subtract(at, self.origin)) for size, at in self.moving]
        return (
            f'<robot name="thing"><link name="body">{_shapes(self.body)}</link>'
            f'<link name="part">{_shapes(moving)}</link>'
            f'<joint name="j" type="{self.joint}"><parent link="body"/><child link="part"/>'
            f'<origin xyz="{_numbers(self.origin)}"/><axis xyz="{_numbers(self.axis)}"/>'
            f'<limit lower="0" upper="{self.upper:.3f}" effort="10" velocity="3"/></joint></robot>\n'
        )


def hinged(generator: np.random.Generator) -> Thing:
    """Return a box with a door at the front or a lid on top."""
    board = generator.uniform(0.006, 0.012)
    thing = (_door if generator.random() < 0.6 else _lid)(generator, board)
    generator.random()  # not used: with this number, the objects are those of docs/results/perception.md
    return thing


def _door(generator: np.random.Generator, board: float) -> Thing:
    x, y, z = generator.uniform((0.12, 0.16, 0.14), (0.28, 0.36, 0.34))
    body = _hollow((x, y, z), board, is_open_on_top=False)
    side = str(generator.choice(["left", "right", "bottom", "top"], p=[0.3, 0.3, 0.25, 0.15]))
    width, height = y * generator.uniform(0.7, 1.0), z * generator.uniform(0.75, 1.0)
    free, is_upright = FREE[side], side in ("left", "right")
    # The hinge is at an edge of the box, also if the door covers only a part of the front.
    middle = np.array([-x / 2 - GAP - board / 2, 0.0, 0.0]) - free * ((y - width) if is_upright else (z - height)) / 2
    half = (width if is_upright else height) / 2
    edge = middle + OUT * board / 2 + free * (half - 0.02)
    knob = _handle(generator, edge, OUT, UP if is_upright else LEFT)
    upper = generator.uniform(1.2, 1.65)
    if is_upright and width < y - 0.02:
        rest = y - width - GAP
        body.append(((board, rest, z), middle * (1, 1, 0) + free * (half + GAP + rest / 2)))
    moving = [((board, width, height), middle), *knob]
    return Thing(
        body, moving, "revolute", middle - half * free, DOOR_AXES[side], upper, _head(knob, middle + half * free)
    )


def _lid(generator: np.random.Generator, board: float) -> Thing:
    x, y, z = generator.uniform((0.12, 0.16, 0.05), (0.26, 0.36, 0.24))
    body = _hollow((x, y, z), board, is_open_on_top=True)
    side = str(generator.choice(["back", "left", "right"], p=[0.7, 0.15, 0.15]))
    overhang = generator.uniform(0.0, 0.015)
    length, width = x + overhang, y * generator.uniform(0.9, 1.02)
    thick = board * generator.uniform(1, 3)
    free, half = FREE[side], (length if side == "back" else width) / 2
    middle = np.array([-overhang / 2, 0.0, z / 2 + GAP + thick / 2])
    edge = middle + UP * thick / 2 + free * (half - 0.02)
    knob = _handle(generator, edge, UP, LEFT) if generator.random() < 0.5 else []
    # The hinge of a lid at a side is above the middle of the box.
    hinge = middle - half * free if side == "back" else (middle - half * free) * (0, 1, 1)
    upper, moving = generator.uniform(1.2, 2.0), [((length, width, thick), middle), *knob]
    return Thing(body, moving, "revolute", hinge, LID_AXES[side], upper, _head(knob, middle + half * free))


def _head(knob: Sequence[Box], edge: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the point at which the hand moves a door or a lid: its handle, or otherwise its free edge."""
    return np.asarray(knob[0][1], dtype=np.float64) if knob else edge


def sliding(generator: np.random.Generator) -> Thing:
    """Return a cabinet with one to three drawers, one of which moves."""
    board = generator.uniform(0.006, 0.01)
    x, y, z = generator.uniform((0.16, 0.16, 0.10), (0.28, 0.36, 0.36))
    count = int(generator.integers(1, 4)) if z > 0.18 else 1
    body = _hollow((x, y, z), board, is_open_on_top=False)
    space, chosen = (z - board * (count + 1)) / count, int(generator.integers(count))
    moving: list[Box] = []
    head = np.zeros(3)
    for number in range(count):
        level = -z / 2 + board + space / 2 + number * (space + board)
        if number > 0:
            body.append(((x - 2 * board, y - 2 * board, board), (0, 0, level - space / 2 - board / 2)))
        width, height, front = y - 2 * board - 2 * SLACK, space - 2 * SLACK, -x / 2 + board / 2
        depth, wall = x - 2 * board - SLACK, level - 0.15 * height
        drawer: list[Box] = [
            ((board, width, height), (front, 0, level)),
            ((depth, width, board), (front + depth / 2, 0, level - height / 2 + board / 2)),
            ((depth, board, height * 0.7), (front + depth / 2, -width / 2 + board / 2, wall)),
            ((depth, board, height * 0.7), (front + depth / 2, width / 2 - board / 2, wall)),
            ((board, width, height * 0.7), (front + depth - board / 2, 0, wall)),
        ]
        face = np.array([front - board / 2, 0.0, level])
        knob = _handle(generator, face, OUT, LEFT) or [((0.02, 0.03, 0.015), face + 0.01 * OUT)]
        if number == chosen:
            moving, head = [*drawer, *knob], np.add(knob[0][1], OUT * knob[0][0][0] / 2)
        else:
            body += [drawer[0], *knob]
    return Thing(body, moving, "prismatic", np.zeros(3), OUT, generator.uniform(0.5, 0.85) * x, head)


def _hollow(size: Vector, board: float, *, is_open_on_top: bool) -> list[Box]:
    """Return the boards of a box around the origin that is open on top or at the front."""
    x, y, z = size
    last: Box = (
        ((board, y, z), (-x / 2 + board / 2, 0, 0)) if is_open_on_top else ((x, y, board), (0, 0, z / 2 - board / 2))
    )
    return [
        ((x, y, board), (0, 0, -z / 2 + board / 2)),
        ((x, board, z), (0, -y / 2 + board / 2, 0)),
        ((x, board, z), (0, y / 2 - board / 2, 0)),
        ((board, y, z), (x / 2 - board / 2, 0, 0)),
        last,
    ]


def _handle(generator: np.random.Generator, at: Vector, outward: Vector, along: Vector) -> list[Box]:
    """Return no handle, a knob or a bar at a point of a surface."""
    kind, depth = int(generator.integers(3)), generator.uniform(0.015, 0.03)
    if kind == 0:
        return []
    length = generator.uniform(0.02, 0.03) if kind == 1 else generator.uniform(0.05, 0.1)
    size = np.abs(outward) * depth + np.abs(along) * length
    return [(np.where(size == 0, generator.uniform(0.01, 0.02), size), np.add(at, np.asarray(outward) * depth / 2))]


def _shapes(boxes: Sequence[Box]) -> str:
    return "".join(
        f'<{tag}><origin xyz="{_numbers(at)}"/><geometry><box size="{_numbers(size)}"/></geometry></{tag}>'
        for size, at in boxes
        for tag in ("visual", "collision")
    )


def _numbers(values: Vector) -> str:
    return " ".join(f"{value:.4f}" for value in values)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder of the library")
    parser.add_argument("--count", type=int, default=60, help="number of objects of each class")
    given = parser.parse_args()
    for seed, (name, make) in enumerate((("any_hinged", hinged), ("any_sliding", sliding))):
        generator = np.random.default_rng(seed)
        for number in range(given.count):
            thing = make(generator)
            file = given.out / "urdf" / f"{name}_{number}.urdf"
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(thing.urdf())
            head = np.subtract(thing.head, thing.origin).tolist()
            import_object(file, given.out, name, str(number), scale=1.0, keypoints={"head": head, "tail": head})


if __name__ == "__main__":
    main()
