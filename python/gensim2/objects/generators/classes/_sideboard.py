"""A sideboard with a row of drawers side by side, of which one slides, above doors, more drawers or shelves."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.generators.classes._drawer import FRONT, GAP, WALL, sliding, small_handle
from gensim2.objects.shapes import Look, Solid, box, tray


def sideboard(rng: np.random.Generator) -> Blueprint:
    """Draw one: two or three bays under a top, some of them empty, and what is below."""
    width, depth = c.between(rng, 0.34, 0.56), c.between(rng, 0.15, 0.24)
    top, over = c.between(rng, 0.010, 0.022), c.between(rng, 0.0, 0.035)
    rise, foot = c.between(rng, 0.26, 0.42), c.between(rng, 0.0, 0.07)
    row, stroke = c.between(rng, 0.06, 0.10), c.between(rng, 0.10, 0.15)
    bays, flush = int(rng.integers(2, 4)), rng.random() < 0.4
    slides = int(rng.integers(bays))
    empty = [rng.random() < 0.3 for _ in range(bays)]
    wood = c.pick(rng, c.WOODS + c.PAINTS)
    front_look = wood if rng.random() < 0.6 else c.pick(rng, c.WOODS + c.PAINTS)
    handles = int(rng.bit_generator.random_raw())

    floor, under = -rise / 2 + foot, rise / 2 - top  # lower face of the carcass and of the top
    y, shelf = under - row / 2, under - row - WALL / 2  # middles of the row and of the board below it
    body: list[Solid] = [box((0, rise / 2 - top / 2, 0), (width + 2 * over, top, depth + 2 * over), wood)]
    for side in (-1, 1):
        body.append(box((side * (width - WALL) / 2, (floor + under) / 2, 0), (WALL, under - floor, depth), wood))
        for end in (-1, 1):
            if foot > 0.01:
                at = (side * (width - 0.03) / 2, floor - foot / 2, end * (depth - 0.03) / 2)
                body.append(box(at, (0.024, foot, 0.024), wood))
    inner = width - 2 * WALL
    body.append(box((0, (floor + under) / 2, -(depth - WALL) / 2), (inner, under - floor, WALL), wood))
    for board in (shelf, floor + WALL / 2):
        body.append(box((0, board, WALL / 2), (inner, WALL, depth - WALL), wood))
    body += _below(rng, inner, floor + WALL, shelf - WALL / 2, depth, wood, front_look)

    bay = (inner - (bays - 1) * WALL) / bays
    face = depth / 2 + (0.0 if flush else FRONT)
    drawer: list[Solid] = []
    head = inside = np.zeros(3)
    long = depth - WALL - 2 * GAP
    for number in range(bays):
        x = -inner / 2 + bay / 2 + number * (bay + WALL)
        if number > 0:
            body.append(box((x - (bay + WALL) / 2, y, WALL / 2), (WALL, row, depth - WALL), wood))
        if empty[number] and number != slides:
            continue
        front = box((x, y, face - FRONT / 2), (bay - 2 * GAP, row - 2 * GAP, FRONT), front_look)
        handle, middle = small_handle(np.random.default_rng(handles), np.array([x, y, face]), bay)
        if number != slides:
            body += [front, *handle]
            continue
        center = (x, y - 0.004, face - FRONT - (long - FRONT) / 2)
        drawer = [
            front,
            *handle,
            *tray(center, (bay - 0.014, row - 0.016, long - FRONT), 0.006, c.WOODS[1], "+y"),
        ]
        head, inside = middle, np.array([x, y - 0.004, face - long / 2])
    return sliding(body, drawer, head, inside, min(stroke, long - 0.03))


def _below(
    rng: np.random.Generator, width: float, low: float, high: float, depth: float, wood: Look, look: Look
) -> list[Solid]:
    """Draw a pair of doors, wide drawers that stay shut, or a shelf below the row; y from ``low`` to ``high``."""
    kind, tall, y = int(rng.integers(3)), high - low, (low + high) / 2
    handles = int(rng.bit_generator.random_raw())
    if kind == 0:
        parts: list[Solid] = []
        reach, aside = c.between(rng, 0.015, 0.03), c.between(rng, 0.015, 0.04)
        metal, length = c.pick(rng, c.METALS), min(c.between(rng, 0.05, 0.10), 0.6 * tall)
        for side in (-1, 1):
            parts.append(box((side * width / 4, y, depth / 2), (width / 2 - GAP, tall - GAP, FRONT), look))
            bar = (side * aside, y, depth / 2 + FRONT / 2 + reach)
            parts += c.bar_handle(bar, length, "y", reach, 0.0045, metal)
        return parts
    if kind == 1:
        parts, rows = [], max(1, round(tall / 0.09))
        for row in range(rows):
            at = np.array([0, low + (row + 0.5) * tall / rows, depth / 2])
            parts.append(box(at, (width - GAP, tall / rows - 2 * GAP, FRONT), look))
            generator = np.random.default_rng(handles)
            parts += small_handle(generator, at + np.array([0, 0, FRONT / 2]), width)[0]
        return parts
    return [box((0, y, 0), (width, 0.010, depth - 2 * WALL), wood)]
