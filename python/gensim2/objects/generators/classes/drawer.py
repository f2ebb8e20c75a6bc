"""Define a class of generated objects: a cabinet, table or sideboard with a drawer that slides out."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.shapes import Look, Solid, ball, box, rod, tray

GAP = 0.002  # m, gap between the drawer and the parts around it
FRONT = 0.012  # m, thickness of a drawer's front
WALL = 0.012  # m, thickness of a table's aprons, and of a sideboard's boards


def knob(at: np.ndarray, end: np.ndarray, radius: float, look: Look) -> list[Solid]:
    """Return a round knob with a stem.

    The stem begins at ``at``, and the centre of the knob is ``end``; ``radius`` is in metres.
    """
    return [rod(at, end, 0.5 * radius, look, 8), ball(end, (radius, radius, 0.7 * radius), look)]


def sliding(body: list[Solid], drawer: list[Solid], head: np.ndarray, middle: np.ndarray, stroke: float) -> Blueprint:
    """Return the blueprint of a drawer that slides to the front by ``stroke`` (m).

    Objects are put into the middle of the part that is out when the drawer is open. The hand can reach this part.

    Args:
        body: fixed parts.
        drawer: parts that slide.
        head: point at which the hand pulls the drawer.
        middle: middle of the drawer's box in the plane of the cabinet's front.
        stroke: distance by which the drawer slides, m.
    """
    return c.sliding(
        body,
        drawer,
        (0, 0, 1),
        (0.0, stroke),
        head=(head, "the middle of the drawer's handle"),
        inside=(middle - np.array([0, 0, stroke / 2]), "the point inside the drawer to put an object"),
    )


def small_handle(rng: np.random.Generator, at: np.ndarray, width: float) -> tuple[list[Solid], np.ndarray]:
    """Generate a small handle in front of ``at``: a bar, a tab or knobs. Return its parts and its grasp point."""
    look = c.pick(rng, c.METALS)
    kind = int(rng.integers(4))
    reach, radius = c.between(rng, 0.018, 0.032), c.between(rng, 0.009, 0.015)
    middle = at + np.array([0, 0, reach])
    if kind == 0:
        length = min(c.between(rng, 0.06, 0.10), 0.5 * width)
        return c.bar_handle(middle, length, "x", reach, c.between(rng, 0.004, 0.006), look), middle
    if kind == 1:
        size = (c.between(rng, 0.02, 0.05), c.between(rng, 0.008, 0.014), reach)
        return [box(at + np.array([0, 0, reach / 2]), size, look)], middle
    aside = 0.0 if kind == 2 else c.between(rng, 0.2, 0.32) * width
    parts: list[Solid] = []
    for x in sorted({aside, -aside}):
        there = np.array([x, 0, 0])
        parts += knob(at + there, middle + there, radius, look)
    return parts, middle + np.array([aside, 0, 0])


def sideboard(rng: np.random.Generator) -> Blueprint:
    """Generate a sideboard.

    Under its top are two or three bays, some of them empty. Below the bays are doors, drawers or a shelf.
    """
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

    # Heights (y): ``floor`` is the lower face of the carcass, and ``under`` is the lower face of the top board.
    floor, under = -rise / 2 + foot, rise / 2 - top
    # Heights (y): ``y`` is the middle of the drawer bays, and ``shelf`` is the middle of the board below them.
    y, shelf = under - row / 2, under - row - WALL / 2
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
    head = middle = np.zeros(3)
    long = depth - WALL - 2 * GAP
    for number in range(bays):
        x = -inner / 2 + bay / 2 + number * (bay + WALL)
        if number > 0:
            body.append(box((x - (bay + WALL) / 2, y, WALL / 2), (WALL, row, depth - WALL), wood))
        if empty[number] and number != slides:
            continue
        front = box((x, y, face - FRONT / 2), (bay - 2 * GAP, row - 2 * GAP, FRONT), front_look)
        handle, grip = small_handle(np.random.default_rng(handles), np.array([x, y, face]), bay)
        if number != slides:
            body += [front, *handle]
            continue
        center = (x, y - 0.004, face - FRONT - (long - FRONT) / 2)
        drawer = [front, *handle, *tray(center, (bay - 0.014, row - 0.016, long - FRONT), 0.006, c.WOODS[1], "+y")]
        head, middle = grip, np.array([x, y - 0.004, depth / 2])
    return sliding(body, drawer, head, middle, min(stroke, long - 0.03))


def _below(
    rng: np.random.Generator, width: float, low: float, high: float, depth: float, wood: Look, look: Look
) -> list[Solid]:
    """Generate a random lower part from y = ``low`` to ``high``.

    The lower part has doors, a stack of fixed drawers, or a shelf.
    """
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


def _handle(rng: np.random.Generator, at: np.ndarray, width: float, height: float) -> tuple[list[Solid], float]:
    """Generate a random handle in front of ``at``; return its parts and its distance (m) from the surface."""
    look = c.pick(rng, c.METALS)
    kind = int(rng.integers(3))
    reach = c.between(rng, 0.030, 0.042)
    middle = at + np.array([0, 0, reach])
    length = min(c.between(rng, 0.08, 0.14), 0.55 * width)
    if kind == 0:
        return c.bar_handle(middle, length, "x", reach, c.between(rng, 0.0045, 0.0065), look), reach
    if kind == 1:
        return c.flat_handle(middle, length, "x", reach, c.between(rng, 0.010, 0.014), look), reach
    radius = c.between(rng, 0.012, 0.016)
    return knob(at, middle, radius, look), reach


def build(rng: np.random.Generator) -> Blueprint:
    width, depth = c.between(rng, 0.22, 0.34), c.between(rng, 0.18, 0.25)
    rows = int(rng.integers(1, 4))
    row_height = c.between(rng, 0.075, 0.11)
    wall = c.between(rng, 0.008, 0.014)
    plinth = c.between(rng, 0.0, 0.04)
    stroke = c.between(rng, 0.11, 0.15)
    moving_row = int(rng.integers(rows))
    wood = c.pick(rng, c.WOODS + c.PAINTS)
    front_look = wood if rng.random() < 0.5 else c.pick(rng, c.WOODS + c.PAINTS)

    shelf = wall
    height = plinth + rows * row_height + (rows + 1) * shelf
    bottom = -height / 2
    body: list[Solid] = []
    for side in (-1, 1):
        body.append(box((side * (width - wall) / 2, 0, 0), (wall, height, depth), wood))
    body.append(box((0, 0, -(depth - wall) / 2), (width - 2 * wall, height, wall), wood))
    for row in range(rows + 1):
        y = bottom + plinth + row * (row_height + shelf) + shelf / 2
        body.append(box((0, y, wall / 2), (width - 2 * wall, shelf, depth - wall), wood))

    drawer: list[Solid] = []
    head = middle = np.zeros(3)
    inner_w, inner_d = width - 2 * wall - 2 * GAP, depth - wall - 2 * GAP
    handle_seed = rng.bit_generator.random_raw()
    for row in range(rows):
        y = bottom + plinth + row * (row_height + shelf) + shelf + row_height / 2
        # The drawer fronts lie in front of the carcass, with a shadow gap between the fronts.
        front = box(
            (0, y, depth / 2 + 0.001 + FRONT / 2), (width - 0.004, row_height + shelf - 0.004, FRONT), front_look
        )
        at = np.array([0, y, depth / 2 + 0.001 + FRONT])
        handle, reach = _handle(np.random.default_rng(handle_seed), at, width, row_height)
        if row == moving_row:
            box_height = row_height - 2 * GAP - 0.01
            center = (0, y - 0.005, depth / 2 - inner_d / 2)
            drawer = [front, *handle, *tray(center, (inner_w, box_height, inner_d), 0.006, c.WOODS[1], "+y")]
            head = at + np.array([0, 0, reach])
            middle = np.array([0, y - 0.005, depth / 2])
        else:
            body += [front, *handle]
            body.append(box((0, y, wall / 2 + 0.001), (inner_w, row_height - 2 * GAP, inner_d), c.WOODS[1], 0.0))
    return sliding(body, drawer, head, middle, min(stroke, inner_d - 0.03))


def table(rng: np.random.Generator) -> Blueprint:
    """Generate a random table on legs or panels, with an overhanging top and a drawer in the middle or at a side."""
    width, depth = c.between(rng, 0.24, 0.58), c.between(rng, 0.17, 0.27)
    top, over = c.between(rng, 0.010, 0.022), c.between(rng, 0.0, 0.03)
    rise, leg = c.between(rng, 0.28, 0.44), c.between(rng, 0.016, 0.030)
    row, stroke = c.between(rng, 0.06, 0.12), c.between(rng, 0.10, 0.15)
    wood = c.pick(rng, c.WOODS + c.PAINTS)
    front_look = wood if rng.random() < 0.6 else c.pick(rng, c.WOODS + c.PAINTS)
    between_legs = width - 2 * leg
    front = min(c.between(rng, 0.14, 0.30), between_legs)
    free = (between_legs - front) / 2
    aside = 0.0 if rng.random() < 0.4 else c.between(rng, -free, free)
    flush, panels, shelf = rng.random() < 0.5, rng.random() < 0.3, rng.random() < 0.4

    under = rise / 2 - top  # the lower face of the top
    y = under - row / 2 - 0.004
    body: list[Solid] = [box((0, rise / 2 - top / 2, 0), (width + 2 * over, top, depth + 2 * over), wood)]
    for side in (-1, 1):
        x = side * (width - leg) / 2
        if panels:
            body.append(box((x, under - (rise - top) / 2, 0), (leg, rise - top, depth), wood))
            continue
        for end in (-1, 1):
            body.append(box((x, under - (rise - top) / 2, end * (depth - leg) / 2), (leg, rise - top, leg), wood))
        body.append(box((x, y, 0), (0.6 * leg, row, depth - 2 * leg), wood))
    body.append(box((0, y, -(depth - WALL) / 2), (between_legs, row, WALL), wood))
    for left, right in ((-between_legs / 2, aside - front / 2), (aside + front / 2, between_legs / 2)):
        if right - left > 2 * GAP:  # a board beside the drawer
            body.append(box(((left + right) / 2, y, (depth - WALL) / 2), (right - left, row, WALL), wood))
    if shelf:
        low = -rise / 2 + c.between(rng, 0.03, 0.10)
        body.append(box((0, low, 0), (between_legs, 0.010, depth - 2 * leg), wood))

    face = depth / 2 + (0.0 if flush else FRONT)
    inner = depth - WALL - 2 * GAP
    slides = [
        box((aside, y, face - FRONT / 2), (front - 2 * GAP, row - GAP, FRONT), front_look),
        *tray(
            (aside, y - 0.004, face - FRONT - (inner - FRONT) / 2),
            (front - 0.02, row - 0.016, inner - FRONT),
            0.006,
            c.WOODS[1],
            "+y",
        ),
    ]
    at = np.array([aside, y, face])
    handles, head = small_handle(rng, at, front)
    return sliding(body, [*slides, *handles], head, np.array([aside, y - 0.004, depth / 2]), min(stroke, inner - 0.03))


OBJECT_CLASS = ObjectClass("drawer", 20, "prismatic", build, (table, sideboard))
