"""Define a class of generated objects: a faucet with a lever on top that turns about the vertical axis."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.shapes import Look, Solid, Vec3, ball, box, cone, convex, path, rod

GAP = 0.001
LEGS = 8  # number of straight segments of which a long spout consists


def _with_lever(
    body: list[Solid], lever: list[Solid], base: Vec3, start: Vec3, tip: Vec3, under_spout: Vec3
) -> Blueprint:
    return c.hinged(
        body,
        lever,
        base,
        (0, -1, 0),
        (-1.2, 1.2),
        head=(tip, "the tip of the faucet's lever"),
        tail=(start, "the point where the faucet's lever meets its joint"),
        bottom_base=(under_spout, "the point under the faucet's spout"),
    )


def _blade(rng: np.random.Generator, start: Vec3, tip: Vec3, radius: float, look: Look) -> Solid:
    broad, narrow = c.between(rng, 0.55, 0.95) * radius, c.between(rng, 0.4, 1.0)
    thin = c.between(rng, 0.004, 0.008)
    corners = [
        np.asarray(middle) + np.array([sx * half, sy * thin, 0])
        for middle, half in ((start, broad), (tip, narrow * broad))
        for sx in (-1, 1)
        for sy in (-1, 1)
    ]
    return convex(corners, look)


def build(rng: np.random.Generator) -> Blueprint:
    height = c.between(rng, 0.16, 0.23)
    radius = c.between(rng, 0.018, 0.026)
    spout = c.between(rng, 0.10, 0.15)
    tube = c.between(rng, 0.009, 0.013)
    lever = c.between(rng, 0.11, 0.16)
    bar = c.between(rng, 0.006, 0.010)
    rise = c.between(rng, 0.1, 0.5)
    cap = c.between(rng, 0.020, 0.034)
    look = c.pick(rng, c.METALS)
    lever_look = look if rng.random() < 0.6 else c.pick(rng, c.METALS)
    bent = rng.random() < 0.5
    flat_tip = rng.random() < 0.5

    bottom, z = -height / 2, -0.03
    top = bottom + height
    plate = 0.012
    body = [
        cone((0, bottom, z), (0, bottom + plate, z), 2.0 * radius, 1.8 * radius, look),
        cone((0, bottom + plate, z), (0, top, z), radius, 0.92 * radius, look),
    ]
    at = bottom + c.between(rng, 0.52, 0.68) * height
    if bent:
        points = [
            np.array([0, at, z]),
            np.array([0, at + 0.015, z + 0.5 * spout]),
            np.array([0, at + 0.006, z + spout]),
        ]
    else:
        points = [np.array([0, at, z]), np.array([0, at + 0.01, z + spout])]
    body += path(points, tube, look)
    end = points[-1]
    body.append(cone(end, end - np.array([0, 0.028, 0]), tube, 1.1 * tube, look))
    body.append(ball(end, tube, look).visual_only())

    base = top + GAP
    moving = [cone((0, base, z), (0, base + cap, z), radius, 0.8 * radius, lever_look)]
    start = np.array([0, base + 0.6 * cap, z])
    tip = start + lever * np.array([0, np.sin(rise), np.cos(rise)])
    moving += path([start, tip], bar, lever_look)
    moving.append(ball(tip, (1.6 * bar if flat_tip else 1.15 * bar, 1.15 * bar, 1.15 * bar), lever_look))
    moving.append(rod((0, base + cap, z), (0, base + cap + 0.002, z), 0.4 * radius, c.PAINTS[1]).visual_only())
    return _with_lever(body, moving, (0, base, z), start, tip, (0, bottom + 0.03, z + spout))


def mixer(rng: np.random.Generator) -> Blueprint:
    """Generate a random faucet with a wide column, a short flat or round lever, and a thick spout."""
    height, radius = c.between(rng, 0.10, 0.25), c.between(rng, 0.024, 0.048)
    cap, lever = c.between(rng, 0.016, 0.05), c.between(rng, 0.075, 0.14)
    rise, at = c.between(rng, 0.0, 0.45), c.between(rng, 0.3, 0.85)
    spout, tube, slope = c.between(rng, 0.11, 0.20), c.between(rng, 0.011, 0.020), c.between(rng, -0.15, 0.5)
    look = c.pick(rng, (c.CHROME, c.CHROME, c.STEEL, c.WHITE, c.BRASS, c.DARK_METAL))
    is_flat, droops, square = rng.random() < 0.6, rng.random() < 0.7, rng.random() < 0.3

    bottom, z = -height / 2, -0.03
    top = bottom + height
    if square:
        body = [box((0, 0, z), (1.7 * radius, height, 1.7 * radius), look, 0.004)]
    else:
        body = [cone((0, bottom, z), (0, top, z), radius, c.between(rng, 0.85, 1.0) * radius, look)]
    highest = top - tube - 0.004  # the spout stays below the turning lever
    root = np.array([0.0, min(bottom + at * height, highest), z])
    end = root + spout * np.array([0, np.sin(slope), np.cos(slope)])
    mouth = bottom + 0.06  # the mouth of the spout is this high, so that there is free space below it
    drop = min(c.between(rng, 0.012, 0.035), highest - mouth)
    end[1] = np.clip(end[1], mouth + drop, highest)
    body += path([root, end, end - np.array([0, drop, 0])] if droops else [root, end], tube, look)

    base = top + GAP
    start = np.array([0.0, base + max(0.6 * cap, 0.012), z])
    tip = start + (lever + radius) * np.array([0, np.sin(rise), np.cos(rise)])
    if square:
        moving = [box((0, base + cap / 2, z), (1.7 * radius, cap, 1.7 * radius), look, 0.003)]
    else:
        moving = [cone((0, base, z), (0, base + cap, z), radius, c.between(rng, 0.7, 1.0) * radius, look)]
    if is_flat:
        moving.append(_blade(rng, start, tip, radius, look))
    else:
        moving += path([start, tip], c.between(rng, 0.005, 0.009), look)
    return _with_lever(body, moving, (0, base, z), start, tip, (0, bottom + 0.03, z + spout))


def sweeping(rng: np.random.Generator) -> Blueprint:
    """Generate a faucet with a low column, a short lever that slopes or is bent, and a long, higher spout."""
    height, radius = c.between(rng, 0.075, 0.15), c.between(rng, 0.019, 0.032)
    cap, lever = c.between(rng, 0.012, 0.035), c.between(rng, 0.065, 0.11)
    rise, crook = c.between(rng, 0.1, 0.6), c.between(rng, 0.02, 0.05)
    spout, tube, at = c.between(rng, 0.19, 0.31), c.between(rng, 0.010, 0.017), c.between(rng, 0.15, 0.5)
    climb, sag, drop = c.between(rng, 0.02, 0.14), c.between(rng, 0.0, 0.05), c.between(rng, 0.015, 0.035)
    look = c.pick(rng, (c.CHROME, c.CHROME, c.STEEL, c.WHITE, c.BRASS, c.DARK_METAL))
    shape = int(rng.integers(3))

    bottom, z = -height / 2, -spout / 2
    top = bottom + height
    body = [
        cone((0, bottom, z), (0, bottom + 0.008, z), 1.3 * radius, 1.2 * radius, look),
        cone((0, bottom + 0.008, z), (0, top, z), radius, c.between(rng, 0.85, 1.0) * radius, look),
    ]
    root = max(bottom + at * height, bottom + tube + 0.002)
    # The highest point of the spout is so high that there is free space below the mouth of the spout.
    highest = max(top + climb, bottom + 0.06 + sag + drop)
    base = top + GAP
    start = np.array([0.0, base + max(0.6 * cap, 0.012), z])
    points = []
    for share in np.linspace(0, 1, LEGS + 1):
        out = share * spout
        y = root + (highest - root) * np.sin(share * np.pi / 2) - sag * max(0.0, share - 0.6) / 0.4
        # Close to the column, the spout stays below the lever on top of the column.
        if out - spout / LEGS < 1.4 * radius + tube:
            y = min(y, top - tube - 0.006)
        # Farther from the column, but still within reach of the lever, the spout stays below the path of the lever.
        elif out - spout / LEGS < lever + 0.03:
            y = min(y, start[1] + (crook if shape == 0 else out * np.tan(rise)) - tube - 0.022)
        points.append(np.array([0.0, y, z + out]))
    body += path([*points, points[-1] - np.array([0, drop, 0])], tube, look)

    moving = [cone((0, base, z), (0, base + cap, z), radius, c.between(rng, 0.7, 1.0) * radius, look)]
    if shape == 0:
        tip = start + np.array([0, crook, lever])
        moving += path([start, start + np.array([0, crook, 0]), tip], c.between(rng, 0.006, 0.010), look)
    else:
        tip = start + lever * np.array([0, np.sin(rise), np.cos(rise)])
        if shape == 1:
            moving.append(_blade(rng, start, tip, 0.8 * radius, look))
        else:
            moving += path([start, tip], c.between(rng, 0.005, 0.009), look)
    return _with_lever(body, moving, (0, base, z), start, tip, (0, bottom + 0.03, z + spout))


OBJECT_CLASS = ObjectClass("faucet", 13, "revolute", build, (mixer, sweeping))
