"""Upright pianos of different sizes, whose lid over the keys is hinged: a class that the package does not have."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

CLASS = "piano_lid"


def write_pianos(folder: Path, count: int, seed: int = 0) -> list[Path]:
    """Write ``count`` URDF files ``piano_0.urdf``, ... of random sizes, and return their paths.

    The z axis points up, the front faces -x, lengths are in metres, and the lid opens upwards.
    """
    folder.mkdir(parents=True, exist_ok=True)
    generator = np.random.default_rng(seed)
    return [_write(folder / f"piano_{number}.urdf", generator) for number in range(count)]


def _write(path: Path, generator: np.random.Generator) -> Path:
    width, depth, height = generator.uniform((0.20, 0.06, 0.20), (0.32, 0.10, 0.30))
    shelf, overhang = generator.uniform((0.08, 0.012), (0.13, 0.025))
    level = height * generator.uniform(0.45, 0.62)
    board, gap = generator.uniform(0.014, 0.03), 0.002
    front = -0.5 * depth
    body = [
        ((depth, width, height), (0, 0, 0.5 * height)),
        ((shelf, width, board), (front - 0.5 * shelf, 0, level - 0.5 * board)),
        ((0.015, width, level), (front - 0.8 * shelf, 0, 0.5 * level)),
    ]
    length, thick = shelf + overhang, generator.uniform(0.006, 0.010)
    lid = [((length, width * generator.uniform(0.86, 0.98), thick), (-0.5 * length, 0, 0))]
    hinge = (front - gap - thick, 0, level + gap + 0.5 * thick)
    path.write_text(
        f'<robot name="piano"><link name="case">{_shapes(body)}</link><link name="lid">{_shapes(lid)}</link>'
        '<joint name="hinge" type="revolute"><parent link="case"/><child link="lid"/>'
        f'<origin xyz="{_numbers(hinge)}"/><axis xyz="0 1 0"/>'
        f'<limit lower="0" upper="{generator.uniform(1.35, 1.5):.3f}" effort="10" velocity="3"/></joint></robot>\n'
    )
    return path


def _shapes(boxes: Sequence[tuple[tuple[float, ...], tuple[float, ...]]]) -> str:
    """Return the visual and the collision shape of boxes, given by size and centre."""
    return "".join(
        f'<{tag}><origin xyz="{_numbers(at)}"/><geometry><box size="{_numbers(size)}"/></geometry></{tag}>'
        for size, at in boxes
        for tag in ("visual", "collision")
    )


def _numbers(values: tuple[float, ...]) -> str:
    return " ".join(f"{value:.4f}" for value in values)
