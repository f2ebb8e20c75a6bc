"""Check that bodies keep their distance along a motion, with samples so dense that no collision is missed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mechanism import Mechanism
from parts import Moved, least_distance

Array = np.ndarray

#: Maximum motion of any point of a link between two samples, m.
STEP = 1e-3
#: Distances above this value are not computed, m.
CUTOFF = 0.03
#: Maximum depth of an overlap that is not reported, m.
PENETRATION_TOLERANCE = 1e-3
#: Tolerance of the margin, m: 0.1 mm tolerance of the planner, plus the motion between two samples.
MARGIN_TOLERANCE = 4e-4


@dataclass
class Pair:
    """Two bodies, and a mask (M,) of the samples at which they are checked."""

    one: Moved
    two: Moved
    judged: Array


@dataclass
class Overlap:
    """Two bodies that overlap by ``depth`` (m) at a sample of the motion."""

    one: str
    two: str
    depth: float
    sample: int

    def describe(self, times: Array) -> str:
        """Describe the overlap as text."""
        return f"{self.one} is {1e3 * self.depth:.1f} mm inside {self.two} at {times[self.sample]:.3f} s"


def corners(arm: Mechanism, q: Array) -> Array:
    """Return extreme points (M, K, 3) of all moving links in the base frame, at joint vectors (M, n)."""
    placed = arm.place(q)
    found = []
    for name in arm.moving_links:
        points = np.concatenate([each.corners for each in arm.parts[name]])
        low, high = points.min(axis=0), points.max(axis=0)
        box = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
        found.append(box @ placed[name][:, :3, :3].transpose(0, 2, 1) + placed[name][:, None, :3, 3])
    # A hand without collision shapes is represented by its origin.
    found.append(placed[arm.hand_link][:, None, :3, 3])
    return np.concatenate(found, axis=1)


def largest_moves(arm: Mechanism, q: Array) -> Array:
    """Return the largest displacement (M - 1,) of a corner between consecutive joint vectors (M, n), m."""
    placed = corners(arm, q)
    moved = np.diff(placed, axis=0)
    return np.sqrt(np.einsum("mki,mki->mk", moved, moved).max(axis=1))


def refine(arm: Mechanism, times: Array, path: Array, step: float = STEP) -> tuple[Array, Array]:
    """Sample a polyline so densely that no corner of a link moves more than ``step`` (m) between samples."""
    # The displacement underestimates the path of a corner, so add 20 % more samples, and check the result again.
    counts = np.maximum(1, np.ceil(1.2 * largest_moves(arm, path) / step).astype(int))
    while True:
        segment = np.repeat(np.arange(len(counts)), counts)
        first = np.repeat(np.cumsum(counts) - counts, counts)
        share = (np.arange(counts.sum()) - first + 1) / counts[segment]
        fine = path[segment] + share[:, None] * (path[segment + 1] - path[segment])
        fine = np.concatenate([path[:1], fine])
        wide = np.unique(segment[largest_moves(arm, fine) > step])
        if len(wide) == 0:
            fine_times = times[segment] + share * (times[segment + 1] - times[segment])
            return np.concatenate([times[:1], fine_times]), fine
        counts[wide] *= 2


def thin(arm: Mechanism, path: Array, step: float = STEP) -> Array:
    """Return the indices of points of a curve that are about half of ``step`` (m) apart, including both ends."""
    travelled = np.concatenate([[0.0], np.cumsum(largest_moves(arm, path))])
    kept = np.flatnonzero(np.diff(np.floor(2.0 * travelled / step), prepend=-1.0))
    return np.union1d(kept, [len(path) - 1])


def judge(pair: Pair, cutoff: float = CUTOFF) -> tuple[Overlap | None, float, int]:
    """Check two bodies along a motion.

    Bodies that overlap at the first sample may stay in contact, but not deeper, until they separate.

    Returns:
        An overlap beyond ``PENETRATION_TOLERANCE``, the minimum signed distance (at most ``cutoff``, m), and its
        sample.
    """
    samples = np.flatnonzero(pair.judged)
    least, at = cutoff, -1
    if len(samples) and samples[0] == 0:
        start = least_distance(pair.one, pair.two, samples[:1], 0.0)
        while start is not None and len(samples):
            now = least_distance(pair.one, pair.two, samples[:1], 0.0)
            if now is None:
                break
            least, at = min((least, at), now)
            if now[0] < start[0] - PENETRATION_TOLERANCE:
                return Overlap(pair.one.name, pair.two.name, -now[0], now[1]), least, at
            samples = samples[1:]
    found = least_distance(pair.one, pair.two, samples, cutoff)
    if found is None:
        return None, least, at
    least, at = min((least, at), found)
    if found[0] < -PENETRATION_TOLERANCE:
        return Overlap(pair.one.name, pair.two.name, -found[0], found[1]), least, at
    return None, least, at


def too_near(pair: Pair, legs: Sequence[Array], margin: float) -> Overlap | None:
    """Return the first segment of a motion in which two bodies come too close.

    In each segment the bodies keep ``margin``, or their distance at the segment's start or end if it is smaller.

    Args:
        pair: the bodies, and the samples at which they are checked.
        legs: increasing sample numbers of each leg, both ends included.
        margin: required distance, m.

    Returns:
        The distance as a negative depth, and its sample.
    """
    for leg in legs:
        samples = leg[pair.judged[leg]]
        if len(samples) == 0:
            continue
        ends = [least_distance(pair.one, pair.two, samples[[end]], margin) for end in (0, -1)]
        asked = min(margin, *(end[0] for end in ends if end is not None), margin)
        found = least_distance(pair.one, pair.two, samples, asked - MARGIN_TOLERANCE)
        if found is not None:
            return Overlap(pair.one.name, pair.two.name, -found[0], found[1])
    return None
