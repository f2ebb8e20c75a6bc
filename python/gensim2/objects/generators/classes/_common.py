"""Functions and materials that several generated classes share.

Some classes describe the moving part when it is closed. Functions in this module rotate it to joint value zero.
"""

from __future__ import annotations

import numpy as np

from gensim2.core.arrays import Array
from gensim2.objects.generators.blueprint import Blueprint
from gensim2.objects.shapes import Look, Solid, Vec3, ball, box, loft, pose, ring, rod, rotation

Rng = np.random.Generator
Keypoint = tuple[Vec3, str]

# Renderers without an environment map show a metallic value of 1 as dark grey. Therefore metals have 1/3.
CHROME = Look((0.88, 0.89, 0.91, 1), 0.35, 0.18)
STEEL = Look((0.66, 0.67, 0.69, 1), 0.30, 0.35)
BRASS = Look((0.84, 0.66, 0.32, 1), 0.35, 0.28)
DARK_METAL = Look((0.19, 0.19, 0.21, 1), 0.30, 0.40)
BLACK = Look((0.03, 0.03, 0.035, 1), 0.0, 0.5)
RUBBER = Look((0.06, 0.06, 0.06, 1), 0.0, 0.95)
GLASS = Look((0.10, 0.12, 0.15, 0.75), 0.0, 0.05)
SCREEN = Look((0.05, 0.10, 0.22, 1), 0.1, 0.08)
WHITE = Look((0.90, 0.90, 0.88, 1), 0.0, 0.4)
DISPLAY = Look((0.10, 0.75, 0.45, 1), 0.0, 0.3)

METALS = (CHROME, STEEL, BRASS, DARK_METAL)
WOODS = tuple(
    Look((r, g, b, 1), 0.0, 0.65)
    for r, g, b in ((0.52, 0.33, 0.18), (0.70, 0.52, 0.32), (0.34, 0.20, 0.12), (0.80, 0.66, 0.46))
)
PAINTS = tuple(
    Look((r, g, b, 1), 0.0, 0.45)
    for r, g, b in (
        (0.86, 0.85, 0.82),
        (0.72, 0.20, 0.16),
        (0.16, 0.33, 0.55),
        (0.20, 0.42, 0.30),
        (0.88, 0.68, 0.22),
        (0.30, 0.31, 0.34),
        (0.55, 0.38, 0.60),
        (0.85, 0.50, 0.35),
    )
)


def pick(rng: Rng, choices: tuple[Look, ...]) -> Look:
    """Select a random material from ``choices``, and return it in a slightly lighter or darker shade."""
    look = choices[int(rng.integers(len(choices)))]
    shade = float(rng.uniform(0.88, 1.1))
    r, g, b, a = look.rgba
    return Look((min(r * shade, 1), min(g * shade, 1), min(b * shade, 1), a), look.metallic, look.roughness)


def between(rng: Rng, low: float, high: float) -> float:
    """Return a uniform random number between ``low`` and ``high``, rounded to 0.1 mm."""
    return round(float(rng.uniform(low, high)), 4)


def turned(solids: list[Solid], origin: Vec3, axis: Vec3, angle: float) -> list[Solid]:
    """Rotate parts by ``angle`` rad about the line through ``origin`` along ``axis``."""
    T = turn_about(origin, axis, angle)
    return [solid.moved(T) for solid in solids]


def turn_about(origin: Vec3, axis: Vec3, angle: float) -> Array:
    """Return the transform (4, 4) of a rotation by ``angle`` (rad) about the line through ``origin`` along ``axis``."""
    T = pose(axis=axis, angle=angle)
    o = np.asarray(origin, float)
    T[:3, 3] = o - rotation(axis, angle) @ o
    return T


def turned_point(point: Vec3, origin: Vec3, axis: Vec3, angle: float) -> Array:
    """Rotate a point (3,) about the line through ``origin`` along ``axis``."""
    o = np.asarray(origin, float)
    return np.asarray(o + rotation(axis, angle) @ (np.asarray(point, float) - o))


def bar_handle(center: Vec3, length: float, along: str, reach: float, radius: float, look: Look) -> list[Solid]:
    """Return a round bar on two posts in front of a surface.

    Args:
        center: (3,) middle of the bar, m; the surface lies ``reach`` metres behind it (towards -z).
        length: length of the bar, m.
        along: ``"x"`` or ``"y"``, direction of the bar.
        reach: distance between bar and surface, m.
        radius: radius of the bar, m.
        look: material.
    """
    c = np.asarray(center, float)
    d = np.eye(3)["xyz".index(along)]
    ends = [c - d * length / 2, c + d * length / 2]
    parts = [rod(ends[0], ends[1], radius, look, 10)]
    parts += [ball(e, radius, look).visual_only() for e in ends]
    for side in (-1, 1):
        foot = c + d * side * (length / 2 - 1.5 * radius)
        parts.append(rod(foot - np.array([0, 0, reach]), foot, 0.8 * radius, look, 8))
    return parts


def flat_handle(center: Vec3, length: float, along: str, reach: float, width: float, look: Look) -> list[Solid]:
    """Return a flat bracket in front of a surface; the arguments are those of ``bar_handle``."""
    c = np.asarray(center, float)
    i = "xyz".index(along)
    size = np.array([width, width, 0.4 * width])
    size[i] = length
    parts = [box(c, size, look)]
    for side in (-1, 1):
        post = np.array([width, width, reach - 0.2 * width])
        post[i] = 0.6 * width
        at = c - np.array([0, 0, (reach + 0.2 * width) / 2])
        at[i] += side * (length - 0.6 * width) / 2
        parts.append(box(at, post, look))
    return parts


def feet(width: float, depth: float, bottom: float, height: float, radius: float, look: Look = RUBBER) -> list[Solid]:
    """Return four round feet of the given ``height`` under a box whose lower face lies at y = ``bottom``."""
    return [
        rod(
            (sx * (width / 2 - 1.6 * radius), bottom - height, sz * (depth / 2 - 1.6 * radius)),
            (sx * (width / 2 - 1.6 * radius), bottom, sz * (depth / 2 - 1.6 * radius)),
            radius,
            look,
            8,
        )
        for sx in (-1, 1)
        for sz in (-1, 1)
    ]


def hoop(center: Vec3, direction: Vec3, radius: float, thick: float, look: Look) -> Solid:
    """Return a visual ring without collision shape; ``thick`` is the radius of its cross-section (m)."""
    c, d = np.asarray(center, float), np.asarray(direction, float)
    sides, around = 48, np.array([ring(c, d, radius + thick * np.cos(t), 48) for t in _SECTION])
    heights = thick * np.sin(_SECTION)[:, None, None] * (d / np.linalg.norm(d))
    assert around.shape == (len(_SECTION), sides, 3)
    return Solid(None, loft(list(around + heights), look, closed=False))


_SECTION = 2 * np.pi * np.arange(8) / 8


def extra(rng: Rng) -> Rng:
    """Return a generator for visual details. Because it is separate, details do not change the shape of the object."""
    return np.random.default_rng(rng.bit_generator.random_raw())


def at(blueprint: Blueprint, q: float) -> list[Solid]:
    """Return all parts of a blueprint with the moving parts at the revolute joint value ``q`` (rad)."""
    moved = turned(blueprint.moving, blueprint.joint_origin, blueprint.joint_axis, q)
    return [*blueprint.body, *moved]


def bounds(parts: list[Solid]) -> tuple[Array, Array]:
    """Return the lowest and the highest corner (3,) of the bounding box of the collision parts."""
    points = np.concatenate([part.hull for part in parts if part.hull is not None])
    return points.min(axis=0), points.max(axis=0)


def hinged(
    body: list[Solid], moving: list[Solid], hinge: Vec3, axis: Vec3, limits: tuple[float, float], **keypoints: Keypoint
) -> Blueprint:
    """Return the blueprint of an object whose moving parts turn about the line through ``hinge`` along ``axis``.

    Names in ``keypoints`` omit the prefix ``articulated_object_``.
    """
    return Blueprint(body, moving, "revolute", hinge, axis, limits, _named(keypoints))


def sliding(
    body: list[Solid], moving: list[Solid], axis: Vec3, limits: tuple[float, float], **keypoints: Keypoint
) -> Blueprint:
    """Return the blueprint of an object whose moving parts slide along ``axis``; ``keypoints`` are as in ``hinged``."""
    return Blueprint(body, moving, "prismatic", (0, 0, 0), axis, limits, _named(keypoints))


def upright_lid(
    body: list[Solid],
    lid: list[Solid],
    hinge: Vec3,
    widest: float,
    head: Keypoint,
    tail: Keypoint,
    **keypoints: Keypoint,
) -> Blueprint:
    """Return the blueprint of a box or laptop whose lid is upright at joint value zero and closed at -90 degrees.

    ``lid``, ``head`` and ``tail`` describe the closed lid. The function rotates them to joint value zero.
    """
    axis, shut = (-1.0, 0.0, 0.0), -np.pi / 2
    moved = {
        name: (turned_point(at, hinge, axis, -shut), words) for name, (at, words) in (("head", head), ("tail", tail))
    }
    return hinged(body, turned(lid, hinge, axis, -shut), hinge, axis, (shut, widest), **moved, **keypoints)


def pushed(parts: list[Solid], stroke: float, description: str, head: Vec3 | None = None) -> Blueprint:
    """Return the blueprint of an object that can be pushed: all parts move on one prismatic joint, away from the robot.

    ``head`` is the point to push; default: the middle of the upper half of the front.
    """
    low, high = bounds(parts)
    where = ((low[0] + high[0]) / 2, low[1] + 0.7 * (high[1] - low[1]), high[2]) if head is None else head
    return sliding([], parts, (0, 0, -1), (0.0, stroke), head=(where, description))


def lifted(parts: list[Solid], head: Vec3, description: str, **keypoints: Keypoint) -> Blueprint:
    """Return the blueprint of an object that is lifted at ``head``. All its parts move along one vertical joint."""
    return sliding([], parts, (0, 1, 0), (0.0, 0.2), head=(head, description), **keypoints)


def _named(keypoints: dict[str, Keypoint]) -> dict[str, Keypoint]:
    return {f"articulated_object_{name}": keypoint for name, keypoint in keypoints.items()}
