"""Define generated dishes, cutlery, tools and toys."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from gensim2.objects.generators.rigid.parts import (
    BLACK,
    STEEL,
    WHITE,
    WOOD,
    RigidBlueprint,
    RigidClass,
    along_x,
    blade,
    centred,
    matte,
    plastic,
    seam,
    shifted,
    sphere,
    turned,
    vessel,
)
from gensim2.objects.shapes import Look, Solid, box, convex, path, pose, ring, rod, rounded_box

MIDDLE = "the center of the object"
BALL = "the center of the sphere object"
TOP = "the center of the top face of the object"
BOTTOM = "the center of the bottom face of the object"
HANDLE = "the middle of the handle of the object"
TIP = "the far end of the object from its handle"
RED, BLUE, YELLOW = plastic(0.75, 0.08, 0.07), plastic(0.10, 0.25, 0.65), plastic(0.93, 0.78, 0.12)
GOLD = Look((1.0, 0.74, 0.18, 1.0), 0.5, 0.3)


def _ball(diameter: float, look: Look, seam_look: Look | None = None) -> RigidBlueprint:
    parts = [sphere(diameter / 2, look)]
    if seam_look is not None:
        parts.append(seam(diameter / 2, seam_look, 0.012 * diameter))
    return RigidBlueprint(parts, ((0, 0, 0), BALL))


def _golf_ball() -> RigidBlueprint:
    radius, count = 0.02135, 90
    k = np.arange(count) + 0.5
    lat, lon = np.arccos(1 - 2 * k / count), np.pi * (1 + 5**0.5) * k
    spots = radius * np.column_stack([np.cos(lon) * np.sin(lat), np.sin(lon) * np.sin(lat), np.cos(lat)])
    parts = [sphere(radius, WHITE)]
    parts += [sphere(0.0014, plastic(0.62, 0.62, 0.64), at * 0.945).visual_only() for at in spots]
    return RigidBlueprint(parts, ((0, 0, 0), BALL))


def _soccer_ball() -> RigidBlueprint:
    radius, golden = 0.070, (1 + 5**0.5) / 2
    corners = [(s, t * golden, 0) for s in (-1, 1) for t in (-1, 1)]
    parts = [sphere(radius, WHITE)]
    for corner in [c for x in corners for c in (x, np.roll(x, 1), np.roll(x, 2))]:
        n = np.asarray(corner, float) / np.linalg.norm(corner)
        # A black patch is a flat pentagon that is projected onto the ball and raised slightly.
        flat = ring((0, 0, 0), n, 0.34, 5)
        edges = np.concatenate([a + np.linspace(0, 1, 4)[:, None] * (b - a) for a, b in pairwise([*flat, flat[0]])])
        patch = np.concatenate([n + share * edges for share in (1.0, 0.75, 0.5, 0.25, 0.001)])
        patch *= 1.006 * radius / np.linalg.norm(patch, axis=1)[:, None]
        parts.append(convex(patch, BLACK).visual_only())
    return RigidBlueprint(parts, ((0, 0, 0), BALL))


def _mug() -> RigidBlueprint:
    parts = vessel([(0.0400, -0.0405), (0.0410, 0.0405)], 0.004, plastic(0.62, 0.10, 0.10))
    angles = np.linspace(-1.7, 1.7, 8)
    handle = [(0, -0.038 - 0.028 * np.cos(a), 0.026 * np.sin(a)) for a in angles]
    parts += path(handle, 0.0045, plastic(0.62, 0.10, 0.10))
    return RigidBlueprint(parts, ((0, 0, 0), MIDDLE), ((0, 0, -0.0405), BOTTOM))


def _cup() -> RigidBlueprint:
    parts = vessel([(0.024, -0.031), (0.0325, 0.031)], 0.002, BLUE)
    return RigidBlueprint(parts, ((0, 0, 0.01), MIDDLE), ((0, 0, -0.031), BOTTOM))


def _bowl() -> RigidBlueprint:
    outline = [(0.040, -0.0265), (0.062, -0.012), (0.075, 0.008), (0.0795, 0.0265)]
    return RigidBlueprint(vessel(outline, 0.003, RED), ((0, 0, 0), MIDDLE), ((0, 0, -0.0265), BOTTOM))


def _plate() -> RigidBlueprint:
    outline = [(0.078, -0.012), (0.098, -0.006), (0.129, 0.012)]
    return RigidBlueprint(vessel(outline, 0.004, WHITE, 16), ((0, 0, 0), MIDDLE), ((0, 0, -0.012), BOTTOM))


def _pitcher() -> RigidBlueprint:
    look = plastic(0.15, 0.35, 0.72)
    parts = vessel([(0.045, -0.1175), (0.051, 0.02), (0.054, 0.1175)], 0.003, look)
    parts += path([(-0.050, 0, 0.09), (-0.095, 0, 0.085), (-0.095, 0, -0.05), (-0.046, 0, -0.065)], 0.008, look)
    spout = [(0.050, s * 0.018, 0.085) for s in (-1, 1)] + [(0.072, s * 0.006, 0.116) for s in (-1, 1)]
    parts.append(convex([*spout, (0.050, -0.024, 0.1165), (0.050, 0.024, 0.1165)], look))
    return RigidBlueprint(
        parts, ((0, 0, 0.1), "the center of the top surface of the object"), ((0, 0, -0.1175), BOTTOM)
    )


def _handle(length: float, width: float, thickness: float, look: Look) -> list[Solid]:
    outline = [(-length, -0.6 * width / 2), (-length, 0.6 * width / 2), (0, width / 3), (0, -width / 3)]
    outline += [(-0.8 * length, width / 2), (-0.8 * length, -width / 2)]
    return [blade(outline, thickness, look)]


def _cutlery(head: list[Solid], length: float) -> RigidBlueprint:
    """Return cutlery whose ``head`` begins at x = 0 and whose handle extends to -x."""
    parts = centred([*_handle(length, 0.016, 0.0045, RED), *head])
    low = min(float(p.hull[:, 0].min()) for p in parts if p.hull is not None)
    high = max(float(p.hull[:, 0].max()) for p in parts if p.hull is not None)
    return RigidBlueprint(parts, ((low + 0.5 * length, 0, 0), HANDLE), ((high, 0, 0), TIP))


def _spoon() -> RigidBlueprint:
    neck = blade([(0, -0.003), (0, 0.003), (0.03, 0.003), (0.03, -0.003)], 0.003, STEEL)
    bowl = sphere((0.027, 0.018, 0.006), STEEL, (0.052, 0, 0.001))
    hollow = sphere((0.024, 0.015, 0.005), Look((0.45, 0.46, 0.48, 1), 0.9, 0.35), (0.052, 0, 0.004)).visual_only()
    return _cutlery([neck, bowl, hollow], 0.115)


def _fork() -> RigidBlueprint:
    neck = blade([(0, -0.003), (0, 0.003), (0.03, 0.003), (0.03, -0.003)], 0.003, STEEL)
    palm = blade(
        [(0.028, -0.003), (0.028, 0.003), (0.042, 0.011), (0.050, 0.011), (0.050, -0.011), (0.042, -0.011)],
        0.003,
        STEEL,
    )
    tines = [
        blade([(0.049, y - 0.0016), (0.049, y + 0.0016), (0.084, y + 0.0008), (0.084, y - 0.0008)], 0.003, STEEL)
        for y in (-0.0094, -0.0031, 0.0031, 0.0094)
    ]
    return _cutlery([neck, palm, *tines], 0.115)


def _knife() -> RigidBlueprint:
    edge = [(0, -0.007), (0, 0.007), (0.085, 0.008), (0.100, 0.002), (0.090, -0.007)]
    return _cutlery([blade(edge, 0.003, STEEL)], 0.115)


def _spatula() -> RigidBlueprint:
    neck = blade([(0, -0.005), (0, 0.005), (0.090, 0.005), (0.090, -0.005)], 0.004, BLACK)
    corners = [(0.088, -0.026), (0.088, 0.026), (0.100, 0.034), (0.190, 0.041), (0.190, -0.041), (0.100, -0.034)]
    turner = blade(corners, 0.003, BLACK)
    slots = [
        box((0.145, y, 0.0), (0.055, 0.006, 0.0034), matte(0.35, 0.35, 0.36), 0).visual_only()
        for y in (-0.018, 0, 0.018)
    ]
    handle = along_x(shifted(turned([(0.009, 0), (0.012, 0.05), (0.011, 0.15)], BLACK, 10, 3), (0, 0, -0.155)))
    parts = centred([*handle, neck, turner, *slots])
    return RigidBlueprint(parts, ((-0.095, 0, 0), HANDLE), ((0.172, 0, 0), TIP))


def _hammer() -> RigidBlueprint:
    shaft = along_x(turned([(0.011, -0.135), (0.013, -0.06), (0.010, 0.10), (0.010, 0.125)], WOOD, 10, 3))
    head = [
        rod((0.112, -0.045, 0), (0.112, -0.018, 0), 0.0145, STEEL, 12),
        box((0.112, 0, 0), (0.026, 0.040, 0.024), STEEL),
        convex(
            [(0.112 + s * 0.011, 0.018, t * 0.011) for s in (-1, 1) for t in (-1, 1)]
            + [(0.105 + s * 0.011, 0.060, -0.004) for s in (-1, 1)]
            + [(0.105 + s * 0.011, 0.060, -0.001) for s in (-1, 1)],
            STEEL,
        ),
    ]
    return RigidBlueprint(
        [*shaft, *head], ((-0.02, 0, 0), HANDLE), ((0.112, -0.045, 0), "the face of the head of the hammer")
    )


def _screwdriver() -> RigidBlueprint:
    handle = along_x(
        turned([(0.010, -0.108), (0.0155, -0.095), (0.0155, -0.035), (0.010, -0.012), (0.012, -0.002)], RED, 8, 3)
    )
    shaft = along_x(turned([(0.0035, -0.004), (0.0035, 0.098), (0.001, 0.108)], STEEL, 8, 1))
    return RigidBlueprint([*handle, *shaft], ((-0.06, 0, 0), HANDLE), ((0.108, 0, 0), TIP))


def _marker() -> RigidBlueprint:
    body = turned([(0.009, -0.060), (0.009, 0.012)], WHITE, 12, 1)
    cap = turned([(0.0095, 0.012), (0.0095, 0.048), (0.007, 0.060)], BLACK, 12, 1)
    clip = box((0.0, 0.0098, 0.033), (0.004, 0.0016, 0.034), BLACK).visual_only()
    return RigidBlueprint(along_x([*body, *cap, clip]), ((0, 0, 0), MIDDLE), ((0.060, 0, 0), "the tip of the cap"))


def _scissors() -> RigidBlueprint:
    parts = []
    for side, look in ((-1, RED), (1, RED)):
        edge = [
            (0.0, side * 0.004),
            (0.004, -side * 0.007),
            (0.095, side * 0.002),
            (0.094, side * 0.003),
            (0.02, side * 0.008),
        ]
        parts.append(blade(edge, 0.003, STEEL, side * 0.0015))
        angles = np.linspace(0, 2 * np.pi, 9)
        loop = [(-0.062 + 0.030 * np.cos(a), side * 0.027 + 0.017 * np.sin(a), 0) for a in angles]
        parts += path(loop, 0.0048, look)
        arm = [(-0.034, side * 0.020, 0), (0.004, -side * 0.001, 0)]
        parts += path(arm, 0.0048, look)
    parts.append(rod((0.006, 0, -0.005), (0.006, 0, 0.005), 0.005, STEEL, 10))
    return RigidBlueprint(centred(parts), ((0, 0, 0), MIDDLE), ((0.094, 0, 0), "the tip of the blades"))


def _clamp() -> RigidBlueprint:
    parts: list[Solid] = []
    for side in (-1, 1):
        jaw = [
            (-0.005, side * 0.004),
            (-0.005, side * 0.014),
            (0.050, side * 0.016),
            (0.062, side * 0.012),
            (0.062, side * 0.004),
        ]
        parts.append(blade(jaw, 0.020, BLACK))
        grip = [(0.0, side * 0.005), (-0.010, side * 0.016), (-0.065, side * 0.034), (-0.068, side * 0.026)]
        parts.append(blade(grip, 0.018, YELLOW))
        parts.append(box((0.056, side * 0.004, 0), (0.014, 0.006, 0.022), RED))
    parts.append(rod((0.0, 0, -0.013), (0.0, 0, 0.013), 0.006, STEEL, 12))
    return RigidBlueprint(centred(parts), ((0, 0, 0), MIDDLE), ((0.06, 0, 0), "the jaws of the clamp"))


def _power_drill() -> RigidBlueprint:
    red = plastic(0.80, 0.24, 0.05)
    barrel = along_x(turned([(0.020, -0.085), (0.026, -0.070), (0.028, 0.0), (0.024, 0.045)], red, 12, 3))
    chuck = along_x(turned([(0.020, 0.045), (0.020, 0.070), (0.012, 0.090)], BLACK, 12, 1))
    bit = along_x(turned([(0.003, 0.088), (0.003, 0.115)], STEEL, 8, 1))
    grip = rounded_box((-0.045, 0, -0.070), (0.036, 0.032, 0.110), BLACK, 0.012, axis=2)
    battery = rounded_box((-0.035, 0, -0.138), (0.085, 0.056, 0.036), red, 0.012, axis=2)
    trigger = box((-0.022, 0, -0.045), (0.014, 0.014, 0.024), plastic(0.2, 0.2, 0.2)).visual_only()
    parts = [p.moved(pose(axis=(1, 0, 0), angle=np.pi / 2)) for p in [*barrel, *chuck, *bit, grip, battery, trigger]]
    return RigidBlueprint(centred(parts), ((-0.05, 0.0, 0), HANDLE), ((0.108, 0.06, 0), "the tip of the bit"))


def _rubiks_cube() -> RigidBlueprint:
    half, look = 0.0285, BLACK
    colours = [
        (0.75, 0.05, 0.06),
        (0.95, 0.42, 0.04),
        (0.93, 0.93, 0.92),
        (0.95, 0.83, 0.1),
        (0.05, 0.25, 0.7),
        (0.05, 0.5, 0.2),
    ]
    parts = [box((0, 0, 0), (2 * half,) * 3, look, 0.002)]
    for axis in range(3):
        for side in (0, 1):
            for i in (-1, 0, 1):
                for j in (-1, 0, 1):
                    at, size = np.zeros(3), np.full(3, 0.0155)
                    at[axis], size[axis] = (1 if side else -1) * half, 0.001
                    at[(axis + 1) % 3], at[(axis + 2) % 3] = 0.019 * i, 0.019 * j
                    parts.append(box(at, size, plastic(*colours[2 * axis + side]), 0).visual_only())
    return RigidBlueprint(parts, ((0, 0, half), TOP), ((0, 0, -half), BOTTOM))


def _block(size: tuple[float, float, float], look: Look, bevel: float) -> RigidBlueprint:
    z = size[2] / 2
    return RigidBlueprint([box((0, 0, 0), size, look, bevel)], ((0, 0, z), TOP), ((0, 0, -z), BOTTOM))


def _gold_bar() -> RigidBlueprint:
    # The sides are inclined by 10 degrees. Cast gold bars have 5 to 15 degrees, so that they come out of the mould.
    top, bottom = (0.050, 0.019), (0.055, 0.024)
    corners = [(s * top[0], t * top[1], 0.014) for s in (-1, 1) for t in (-1, 1)]
    corners += [(s * bottom[0], t * bottom[1], -0.014) for s in (-1, 1) for t in (-1, 1)]
    mark = box((0, 0, 0.014), (0.05, 0.014, 0.0008), Look((0.85, 0.55, 0.1, 1), 0.5, 0.4), 0).visual_only()
    return RigidBlueprint([convex(corners, GOLD), mark], ((0, 0, 0.014), TOP), ((0, 0, -0.014), BOTTOM))


def _airplane() -> RigidBlueprint:
    body = along_x(
        turned([(0.015, -0.12), (0.026, -0.06), (0.032, 0.03), (0.030, 0.09), (0.016, 0.115)], YELLOW, 12, 3)
    )
    wing = blade([(0.0, -0.13), (0.045, -0.125), (0.055, 0), (0.045, 0.125), (0.0, 0.13)], 0.010, BLUE, -0.010)
    tail = blade([(-0.125, -0.050), (-0.095, -0.045), (-0.095, 0.045), (-0.125, 0.050)], 0.007, BLUE, 0.012)
    fin = convex(
        [
            (x, s * 0.0035, z)
            for x, z in ((-0.125, 0.01), (-0.085, 0.01), (-0.115, 0.062), (-0.128, 0.062))
            for s in (-1, 1)
        ],
        RED,
    )
    propeller = convex(
        [(0.116 + s * 0.003, t * 0.006, u * 0.036) for s in (-1, 1) for t in (-1, 1) for u in (-1, 1)], BLACK
    )
    wheels = [rod((0.05, s * 0.022, -0.046), (0.05, s * 0.034, -0.046), 0.017, BLACK, 12) for s in (-1, 1)]
    struts = [rod((0.05, s * 0.020, -0.046), (0.045, s * 0.012, -0.020), 0.004, STEEL, 8) for s in (-1, 1)]
    skid = convex(
        [(-0.10 + s * 0.004, t * 0.004, u) for s in (-1, 1) for t in (-1, 1) for u in (-0.034, -0.010)], BLACK
    )
    cockpit = sphere((0.026, 0.017, 0.018), Look((0.6, 0.8, 0.95, 1), 0.1, 0.1), (0.02, 0, 0.026)).visual_only()
    parts = [*body, wing, tail, fin, propeller, *wheels, *struts, skid, cockpit]
    return RigidBlueprint(centred(parts), ((0, 0, 0), MIDDLE), ((-0.12, 0, 0.01), "the tail of the airplane"))


HOUSEHOLD: dict[str, RigidClass] = {
    "baseball": RigidClass(0.148, 0.7, lambda: _ball(0.075, WHITE, RED), "a white baseball with red seams"),
    "bowl": RigidClass(0.147, 1.0, _bowl, "a red bowl"),
    "clamp": RigidClass(0.059, 0.7, _clamp, "a spring clamp"),
    "cup": RigidClass(0.021, 1.2, _cup, "a blue plastic cup without a handle"),
    "foam_brick": RigidClass(
        0.028, 0.7, lambda: _block((0.050, 0.075, 0.050), matte(0.72, 0.20, 0.16), 0.004), "a foam brick", 0.9
    ),
    "fork": RigidClass(0.034, 1.0, _fork, "a fork with a red handle"),
    "gold_bar": RigidClass(0.500, 0.8, _gold_bar, "a bar of gold"),
    "golf_ball": RigidClass(0.046, 0.8, _golf_ball, "a golf ball"),
    "hammer": RigidClass(0.665, 0.5, _hammer, "a hammer with a wooden shaft"),
    "knife": RigidClass(0.031, 1.0, _knife, "a table knife with a red handle"),
    "marker": RigidClass(0.0158, 1.0, _marker, "a marker pen with a black cap"),
    "mug": RigidClass(0.118, 0.7, _mug, "a red mug with a handle"),
    "pitcher": RigidClass(0.178, 0.5, _pitcher, "a blue pitcher with a handle and a spout"),
    "plate": RigidClass(0.279, 0.8, _plate, "a white plate"),
    "power_drill": RigidClass(0.895, 0.7, _power_drill, "a cordless drill, lying on its side"),
    "racquetball": RigidClass(0.041, 0.7, lambda: _ball(0.0553, plastic(0.06, 0.16, 0.6)), "a blue racquetball"),
    "rubiks_cube": RigidClass(0.094, 0.7, _rubiks_cube, "a cube of coloured squares"),
    "scissors": RigidClass(0.082, 0.6, _scissors, "a pair of scissors"),
    "screwdriver": RigidClass(0.097, 1.0, _screwdriver, "a screwdriver with a red handle"),
    "soccer_ball": RigidClass(0.123, 0.4, _soccer_ball, "a small soccer ball"),
    "softball": RigidClass(0.191, 0.5, lambda: _ball(0.096, plastic(0.88, 0.93, 0.18), RED), "a yellow softball"),
    "spatula": RigidClass(0.0515, 1.0, _spatula, "a black spatula"),
    "spoon": RigidClass(0.030, 1.0, _spoon, "a spoon with a red handle"),
    "tennis_ball": RigidClass(0.058, 0.8, lambda: _ball(0.0647, matte(0.80, 0.92, 0.20), WHITE), "a tennis ball"),
    "toy_airplane": RigidClass(0.570, 0.3, _airplane, "a toy airplane"),
    "wood_block": RigidClass(0.729, 0.5, lambda: _block((0.085, 0.085, 0.200), WOOD, 0.003), "a block of wood"),
}
