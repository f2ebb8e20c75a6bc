"""Define a class of generated objects: a pot with a lid that lifts off."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.shapes import ball, cone, path, rod, tube

GAP = 0.0015


def build(rng: np.random.Generator) -> Blueprint:
    radius, height = c.between(rng, 0.075, 0.105), c.between(rng, 0.08, 0.12)
    look = c.pick(rng, (c.STEEL, c.CHROME, *c.PAINTS[1:5]))
    lid_look = look if rng.random() < 0.6 else c.pick(rng, (c.STEEL, c.GLASS))
    grip_look = c.pick(rng, (c.BLACK, c.STEEL, *c.WOODS))
    knob = c.between(rng, 0.016, 0.021)
    stem = c.between(rng, 0.016, 0.024)
    dome = c.between(rng, 0.010, 0.022)
    lift = c.between(rng, 0.06, 0.10)

    bottom, top = -height / 2, height / 2
    body = tube((0, bottom, 0), (0, top, 0), radius, radius, 0.005, look, 12, bottom=0.006)
    for s in (-1, 1):
        x = s * radius
        ear = [np.array([x, 0.55 * top, z]) for z in (-0.030, 0.030)]
        out = np.array([s * 0.030, 0.004, 0])
        body += path([ear[0], ear[0] + out, ear[1] + out, ear[1]], 0.005, grip_look, 8)
    y = top + GAP
    lid = [
        cone((0, y, 0), (0, y + 0.004, 0), radius + 0.003, radius + 0.003, lid_look),
        cone((0, y + 0.004, 0), (0, y + 0.004 + dome, 0), radius - 0.004, 0.3 * radius, lid_look),
    ]
    foot = y + 0.004 + dome
    lid.append(rod((0, foot, 0), (0, foot + stem, 0), 0.4 * knob, grip_look, 8))
    middle = np.array([0, foot + stem, 0])
    lid.append(ball(middle, (knob, 0.6 * knob, knob), grip_look))
    return c.sliding(body, lid, (0, 1, 0), (0.0, lift), head=(middle, "the middle of the knob on the pot's lid"))


OBJECT_CLASS = ObjectClass("kitchen_pot", 3, "prismatic", build)
