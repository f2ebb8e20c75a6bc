"""Define generated fruit and groceries."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.rigid.parts import (
    BLACK,
    LEAF,
    STEEL,
    STEM,
    WHITE,
    RigidBlueprint,
    RigidClass,
    blade,
    can,
    carton,
    centred,
    curved,
    matte,
    plastic,
    scaled,
    shifted,
    sphere,
    turned,
)
from gensim2.objects.shapes import Solid, Vec3, box, pose, rod, rounded_box

CENTER = "the center of the body of the object"
TOP = "the center of the top face of the object"
BOTTOM = "the center of the bottom face of the object"


def _stem(height: float, length: float, leaf: bool = True) -> list[Solid]:
    parts = [rod((0, 0, height - 0.004), (0.003, 0, height + length), 0.0015, STEM, 6).visual_only()]
    if leaf:
        outline = [(0.002, 0), (0.010, 0.006), (0.022, 0.001), (0.012, -0.005)]
        parts += shifted([blade(outline, 0.0008, LEAF).visual_only()], (0, 0, height + 0.4 * length))
    return parts


def _fruit(parts: list[Solid]) -> RigidBlueprint:
    return RigidBlueprint(parts, ((0, 0, 0), CENTER))


def _apple() -> RigidBlueprint:
    outline = [(0.012, -0.036), (0.024, -0.033), (0.035, -0.014), (0.037, 0.006), (0.032, 0.024), (0.017, 0.033)]
    return _fruit([*turned(outline, plastic(0.72, 0.09, 0.08)), *_stem(0.031, 0.014)])


def _orange() -> RigidBlueprint:
    return _fruit([sphere(0.0365, matte(0.95, 0.45, 0.04)), *_stem(0.0365, 0.0008, leaf=False)])


def _peach() -> RigidBlueprint:
    outline = [(0.010, -0.029), (0.021, -0.023), (0.0295, 0.0), (0.025, 0.018), (0.010, 0.0275)]
    return _fruit([*turned(outline, matte(0.94, 0.52, 0.32)), *_stem(0.026, 0.006)])


def _plum() -> RigidBlueprint:
    return _fruit([sphere((0.026, 0.025, 0.026), plastic(0.26, 0.05, 0.16)), *_stem(0.0255, 0.007, leaf=False)])


def _lemon() -> RigidBlueprint:
    outline = [
        (0.003, -0.034),
        (0.006, -0.030),
        (0.022, -0.016),
        (0.027, 0),
        (0.022, 0.016),
        (0.006, 0.030),
        (0.004, 0.034),
    ]
    lying = [p.moved(pose(axis=(0, 1, 0), angle=np.pi / 2)) for p in turned(outline, plastic(0.96, 0.82, 0.13))]
    return _fruit(lying)


def _pear() -> RigidBlueprint:
    outline = [(0.010, -0.048), (0.026, -0.042), (0.033, -0.018), (0.025, 0.012), (0.015, 0.034), (0.008, 0.044)]
    return _fruit([*turned(outline, matte(0.72, 0.74, 0.22)), *_stem(0.042, 0.014, leaf=False)])


def _strawberry() -> RigidBlueprint:
    outline = [(0.003, -0.027), (0.012, -0.018), (0.0215, 0.008), (0.019, 0.018), (0.008, 0.023)]
    parts = turned(outline, plastic(0.80, 0.07, 0.09))
    for k in range(6):
        c, s = np.cos(k * np.pi / 3), np.sin(k * np.pi / 3)
        leaf = [(0, 0), (0.010 * c - 0.004 * s, 0.010 * s + 0.004 * c), (0.018 * c, 0.018 * s)]
        leaf.append((0.010 * c + 0.004 * s, 0.010 * s - 0.004 * c))
        parts.append(blade(leaf, 0.0008, LEAF, 0.0232).visual_only())
    for row, z in enumerate((-0.014, -0.005, 0.004)):
        radius = float(np.interp(z, [h for _, h in outline], [r for r, _ in outline]))
        for k in range(7):
            angle = 2 * np.pi * (k + 0.5 * (row % 2)) / 7
            at = (radius * np.cos(angle), radius * np.sin(angle), z)
            parts.append(sphere(0.0011, plastic(0.95, 0.82, 0.35), at).visual_only())
    return _fruit(parts)


def _banana() -> RigidBlueprint:
    angles = np.linspace(-0.9, 0.9, 9)
    points = [(0.105 * np.sin(a), 0, 0.105 * (1 - np.cos(a))) for a in angles]
    radii = [0.005, 0.011, 0.016, 0.018, 0.018, 0.018, 0.017, 0.012, 0.006]
    parts = curved(points, radii, plastic(0.95, 0.78, 0.13))
    end = points[-1]
    parts.append(rod(end, (end[0] + 0.010, 0, end[2] + 0.014), 0.0045, matte(0.55, 0.45, 0.12), 8))
    parts.append(sphere(0.0052, STEM, points[0]).visual_only())
    # The curve of the banana lies in a horizontal plane.
    return _fruit(centred([p.moved(pose(axis=(1, 0, 0), angle=np.pi / 2)) for p in parts]))


def _box(size: Vec3, *looks: tuple[float, float, float]) -> RigidBlueprint:
    z = float(np.asarray(size, float)[2])
    look, stripe, patch = (matte(*rgb) for rgb in looks)
    return RigidBlueprint(carton(size, look, stripe, patch), ((0, 0, z / 2), TOP), ((0, 0, -z / 2), BOTTOM))


def _can(radius: float, height: float, rgb: tuple[float, float, float], lid: str = "steel") -> RigidBlueprint:
    parts = can(radius, height, matte(*rgb), STEEL if lid == "steel" else plastic(0.10, 0.16, 0.42))
    return RigidBlueprint(parts, ((0, 0, height / 2), TOP), ((0, 0, -height / 2), BOTTOM))


def _potted_meat() -> RigidBlueprint:
    size = (0.050, 0.097, 0.082)
    parts = [rounded_box((0, 0, 0), size, matte(0.08, 0.22, 0.55), 0.016, axis=2)]
    for end in (-1, 1):
        rim = rounded_box((0, 0, end * 0.040), (0.0512, 0.0982, 0.003), STEEL, 0.016, axis=2)
        parts.append(rim.visual_only())
    parts.append(box((0.0252, 0, 0.005), (0.0008, 0.055, 0.035), matte(0.95, 0.85, 0.2), 0).visual_only())
    return RigidBlueprint(parts, ((0, 0, 0.041), TOP), ((0, 0, -0.041), BOTTOM))


def _bottle(
    outline: list[tuple[float, float]],
    depth: float,
    look: tuple[float, float, float],
    cap: list[tuple[float, float]],
    cap_look: tuple[float, float, float],
    label: tuple[float, float, float],
) -> RigidBlueprint:
    parts = [scaled(p, (depth, 1, 1)) for p in turned(outline, plastic(*look), 12, 4)]
    parts += turned(cap, plastic(*cap_look), 12, 1)
    belly = [(r + 0.0006, z) for r, z in outline[1:3]]
    parts += [scaled(p, (depth, 1, 1)).visual_only() for p in turned(belly, matte(*label), 16, 1)]
    top = cap[-1][1]
    return RigidBlueprint(parts, ((0, 0, top), TOP), ((0, 0, outline[0][1]), BOTTOM))


def _mustard() -> RigidBlueprint:
    body = [(0.044, -0.095), (0.0475, -0.080), (0.0475, 0.010), (0.036, 0.045), (0.018, 0.060)]
    cap = [(0.017, 0.060), (0.016, 0.074), (0.006, 0.080), (0.004, 0.095)]
    return _bottle(body, 0.62, (0.95, 0.76, 0.08), cap, (0.92, 0.72, 0.06), (0.75, 0.12, 0.08))


def _bleach() -> RigidBlueprint:
    body = [(0.045, -0.125), (0.049, -0.112), (0.049, 0.020), (0.036, 0.065), (0.019, 0.088)]
    cap = [(0.021, 0.088), (0.021, 0.125)]
    return _bottle(body, 0.68, (0.93, 0.94, 0.96), cap, (0.10, 0.25, 0.62), (0.16, 0.38, 0.72))


def _chips() -> RigidBlueprint:
    parts = can(0.0375, 0.250, matte(0.72, 0.10, 0.12))
    parts += [
        p.visual_only() for p in shifted(turned([(0.0382, -0.006), (0.0382, 0.006)], WHITE, 16, 1), (0, 0, 0.121))
    ]
    parts.append(sphere((0.002, 0.017, 0.026), matte(0.96, 0.86, 0.62), (0.0375, 0, 0.02)).visual_only())
    parts += [sphere((0.001, 0.002, 0.003), BLACK, (0.0396, s * 0.006, 0.027)).visual_only() for s in (-1, 1)]
    return RigidBlueprint(parts, ((0, 0, 0.125), TOP), ((0, 0, -0.125), BOTTOM))


FOOD: dict[str, RigidClass] = {
    "apple": RigidClass(0.068, 0.6, _apple, "a red apple"),
    "banana": RigidClass(0.066, 1.0, _banana, "a banana, lying"),
    "bleach_cleanser": RigidClass(1.131, 0.7, _bleach, "a white bottle of bleach with a blue cap"),
    "chips_can": RigidClass(0.205, 0.7, _chips, "a tall can of chips"),
    "cracker_box": RigidClass(
        0.411,
        0.4,
        lambda: _box((0.060, 0.158, 0.210), (0.72, 0.08, 0.09), (0.96, 0.80, 0.25), (0.95, 0.93, 0.88)),
        "a red box of crackers",
    ),
    "gelatin_box": RigidClass(
        0.097,
        1.0,
        lambda: _box((0.085, 0.073, 0.028), (0.80, 0.10, 0.16), (0.95, 0.92, 0.90), (0.95, 0.72, 0.15)),
        "a small flat box of gelatin",
    ),
    "lemon": RigidClass(0.029, 1.0, _lemon, "a lemon"),
    "master_chef_can": RigidClass(
        0.414, 0.7, lambda: _can(0.051, 0.139, (0.06, 0.14, 0.40), "plastic"), "a large can of coffee"
    ),
    "mustard_bottle": RigidClass(0.603, 0.7, _mustard, "a yellow mustard bottle"),
    "orange": RigidClass(0.047, 0.8, _orange, "an orange"),
    "peach": RigidClass(0.033, 0.8, _peach, "a peach"),
    "pear": RigidClass(0.049, 0.6, _pear, "a pear"),
    "plum": RigidClass(0.025, 1.0, _plum, "a plum"),
    "potted_meat_can": RigidClass(0.370, 0.7, _potted_meat, "a rectangular can of meat"),
    "pudding_box": RigidClass(
        0.187,
        0.7,
        lambda: _box((0.110, 0.089, 0.035), (0.42, 0.24, 0.12), (0.95, 0.90, 0.80), (0.80, 0.14, 0.12)),
        "a flat box of pudding",
    ),
    "strawberry": RigidClass(0.018, 0.7, _strawberry, "a strawberry"),
    "sugar_box": RigidClass(
        0.514,
        0.7,
        lambda: _box((0.038, 0.089, 0.175), (0.95, 0.86, 0.20), (0.16, 0.30, 0.66), (0.95, 0.95, 0.93)),
        "a yellow box of sugar",
    ),
    "tomato_soup_can": RigidClass(0.349, 0.7, lambda: _can(0.033, 0.101, (0.75, 0.09, 0.08)), "a can of tomato soup"),
    "tuna_fish_can": RigidClass(0.171, 0.7, lambda: _can(0.0425, 0.033, (0.10, 0.30, 0.60)), "a flat can of tuna"),
}
