"""Which distances are judged at which time, and a path so fine that nothing slips between two checks."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from peers import HAND_LINKS, Arm, Obstacle, link_distance, shape_distance, transform

Array = np.ndarray

#: No point of a link moves further between two checks, metres.
STEP = 5e-3
#: Distances beyond this are not computed, metres.
CUTOFF = 0.03
#: An overlap up to this is let pass, metres.
PENETRATION_TOLERANCE = 1e-3


def refine(arm: Arm, times: Array, path: Array) -> tuple[Array, Array]:
    """Points of the polyline such that no corner of a link moves more than ``STEP`` from one to the next."""
    fine_times, fine = [float(times[0])], [path[0]]
    before = corners(arm, path[0])
    for index in range(1, len(path)):
        here = corners(arm, path[index])
        # A chord underestimates an arc, so take twice the number and look again at what is left.
        count = max(1, int(np.ceil(1.2 * np.linalg.norm(here - before, axis=1).max() / STEP)))
        while True:
            shares = np.arange(1, count + 1) / count
            points = path[index - 1] + shares[:, None] * (path[index] - path[index - 1])
            placed = [before, *(corners(arm, q) for q in points)]
            if max(np.linalg.norm(b - a, axis=1).max() for a, b in pairwise(placed)) <= STEP:
                break
            count *= 2
        fine += list(points)
        fine_times += list(times[index - 1] + shares * (times[index] - times[index - 1]))
        before = here
    return np.array(fine_times), np.array(fine)


def corners(arm: Arm, q: Array) -> Array:
    """Extreme points of every moving link, (M, 3) in the base frame."""
    places = arm.place(q)
    return np.concatenate(
        [
            box_corners(arm, name) @ places[name][:3, :3].T + places[name][:3, 3]
            for name in arm.parts
            if name != "panda_link0"
        ]
    )


def box_corners(arm: Arm, name: str) -> Array:
    """The 8 corners of a link's bounding box, which bound how far any of its points moves."""
    points = arm.corners[name]
    low, high = points.min(axis=0), points.max(axis=0)
    return np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])


class Judge:
    """Which pairs are judged at which time, and how deep they were at the start."""

    def __init__(self, problem: dict[str, Any], arm: Arm, obstacles: list[Obstacle]) -> None:
        self.arm = arm
        self.fixed = [obstacle for obstacle in obstacles if obstacle.role != "attached"]
        self.held = next((obstacle for obstacle in obstacles if obstacle.role == "attached"), None)
        pre = problem["pre_actuation_times"]
        self.hand_free_from = pre[-1] if pre else problem["start_time"]
        self.arm_free_from = problem["actuation_time"]
        self.allowed: dict[tuple[str, str], float] = {}
        self.least: dict[str, tuple[float, float, str]] = {}
        self.started = False

    def judged(self, link: str, role: str, time: float) -> bool:
        """The contact rules."""
        of_hand = link in HAND_LINKS or link == "held"
        if role == "moving_link":
            return time < (self.hand_free_from if of_hand else self.arm_free_from)
        return not (role == "target" and of_hand)

    def distances(self, q: Array, time: float) -> dict[tuple[str, str], float]:
        """Signed distances below ``CUTOFF`` of every judged pair."""
        places = self.arm.place(q)
        found: dict[tuple[str, str], float] = {}
        for obstacle in self.fixed:
            low, high = obstacle.low.min(axis=0), obstacle.high.max(axis=0)
            for link, parts in self.links(places):
                if link == "panda_link0" or not self.judged(link, obstacle.role, time):
                    continue
                if nearest(parts, places[link], low, high) < CUTOFF:
                    found[link, obstacle.name] = link_distance(parts, places[link], obstacle, CUTOFF)
        for one, two in self.arm.self_pairs:
            found[one, two] = pair_distance(self.arm, places, one, two)
        if self.held is not None:
            for name in ("panda_link0", "panda_link1", "panda_link2", "panda_link3", "panda_link4", "panda_link5"):
                found["held", name] = parts_distance(
                    self.held.parts, places["held"], self.arm.parts[name], places[name]
                )
        return found

    def links(self, places: dict[str, Array]) -> list[tuple[str, list[Any]]]:
        """The robot's links and what the hand holds."""
        links = list(self.arm.parts.items())
        if self.held is not None:
            places["held"] = places["panda_hand"] @ self.held.pose
            links.append(("held", self.held.parts))
        return links

    def look(self, q: Array, time: float) -> list[str]:
        """Check one configuration; the first one sets what may persist."""
        errors = []
        found = self.distances(q, time)
        if not self.started:
            self.started = True
            self.allowed = {pair: distance for pair, distance in found.items() if distance < 0.0}
        for pair, distance in found.items():
            group = self.group(pair)
            if distance < self.least.get(group, (CUTOFF, 0.0, ""))[0]:
                self.least[group] = (distance, time, " and ".join(pair))
            floor = self.allowed.get(pair, 0.0)
            if distance < floor - PENETRATION_TOLERANCE:
                errors.append(f"{pair[0]} is {-1e3 * distance:.1f} mm inside {pair[1]} at {time:.3f} s")
            if pair in self.allowed and distance >= 0.0:
                del self.allowed[pair]
        for pair in [pair for pair in self.allowed if pair not in found]:
            del self.allowed[pair]
        return errors

    def group(self, pair: tuple[str, str]) -> str:
        """self, table or object."""
        if pair[1].startswith("panda"):
            return "self"
        return "table" if pair[1] == "table" else "object"


def nearest(parts: list[Any], pose: Array, low: Array, high: Array) -> float:
    """Lower bound of the distance between a link and a box along the base axes."""
    best = np.inf
    for each in parts:
        center = pose[:3, :3] @ each.center + pose[:3, 3]
        best = min(best, float(np.linalg.norm(np.maximum(np.maximum(low - center, center - high), 0.0))) - each.radius)
    return best


def pair_distance(arm: Arm, places: dict[str, Array], one: str, two: str) -> float:
    """Signed distance of two links, ``CUTOFF`` at most."""
    return parts_distance(arm.parts[one], places[one], arm.parts[two], places[two])


def parts_distance(ones: list[Any], at_one: Array, twos: list[Any], at_two: Array) -> float:
    """Signed distance of two sets of parts, ``CUTOFF`` at most."""
    best = CUTOFF
    for a in ones:
        center = at_one[:3, :3] @ a.center + at_one[:3, 3]
        for b in twos:
            other = at_two[:3, :3] @ b.center + at_two[:3, 3]
            if np.linalg.norm(center - other) - a.radius - b.radius < best:
                best = min(
                    best, shape_distance(a.shape, transform(at_one @ a.pose), b.shape, transform(at_two @ b.pose))
                )
    return best
