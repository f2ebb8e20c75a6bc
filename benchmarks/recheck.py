"""Check a trajectory against its problem with independent code: limits, mimic joints, ends, collisions.

The problem is given as plain values (:class:`Question`), so the check does not depend on the planner's parser. Rates
are finite differences of positions. Collisions are checked at steps in which no corner of a link moves more than 1 mm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Protocol

import numpy as np
from contacts import INSTANT, Clock, Hinge, Obstacle, checked_pairs, touching_pairs
from judge import MARGIN_TOLERANCE, Overlap, Pair, judge, refine, thin, too_near
from mechanism import Mechanism
from parts import least_distance

Array = np.ndarray

#: Rounding of positions, rad or m.
ROUNDING = 1e-9
#: Rates may exceed their limits by this share.
RATE_SLACK = 1e-6
#: Keyframes may be missed by this, metres and entries of a rotation: where the motion rests, and where it passes on.
REST_SLACK, PASSING_SLACK = 1e-4, 1e-3
#: Seconds between the samples that rates are taken from, and the least and largest number of those.
SAMPLE_STEP, FEWEST, MOST = 2e-3, 400, 6000


class Motion(Protocol):
    """Motion that the planner returned."""

    @property
    def times(self) -> Array: ...
    @property
    def duration(self) -> float: ...
    def sample_every(self, dt: float) -> Array: ...
    def sample(self, t: float) -> tuple[Array, Array, Array]: ...


@dataclass
class Question:
    """A planning problem as plain values; joint vectors (n,) in the order of the URDF's joints.

    ``velocity``, ``acceleration`` and ``jerk`` are what every joint is held to, scales included. The motion keeps
    ``margin`` from what it may not touch; what may touch overlaps by ``contact_depth`` at most, where that is not None.
    ``hinge`` is the joint of the moving link, ``contact`` the point of the hand that takes it along, ``after`` the
    config's post-actuation motions, ``gripper`` its word for the fingers; at the end the hand lets go and moves back
    ``let_go`` metres, where that is not zero.
    """

    arm: Mechanism
    q_start: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    start_velocity: Array
    start_acceleration: Array
    obstacles: Sequence[Obstacle] = ()
    gripper: str = "open"
    let_go: float = 0.0
    hinge: Hinge | None = None
    contact: Array = field(default_factory=lambda: np.zeros(3))
    after: Sequence[Any] = ()
    margin: float = 0.0
    contact_depth: float | None = None


@dataclass
class Answer:
    """Content of a plan: its keyframes in time as (label, seconds or None, hand pose, reached), and its motion.

    ``nearer`` are the pairs of names that it says come nearer than the margin.
    """

    keyframes: list[tuple[str, float | None, Array, bool]]
    motion: Motion
    whole: bool
    nearer: set[frozenset[str]]


@dataclass
class Verdict:
    """Result of a check; the motion is correct if ``errors`` is empty."""

    errors: list[str] = field(default_factory=list)
    looks: int = 0
    least_mm: float = np.inf


def answer_of(plan: Any) -> Answer:
    """Convert a plan to plain values."""
    frames = [
        (each["label"], each["time"], np.asarray(each["T_base_hand"]), each["reached"]) for each in plan.keyframes
    ]
    nearer = {frozenset(pair["bodies"]) for pair in plan.tight}
    return Answer(frames, plan.trajectory, plan.status == "solved", nearer)


def fine_samples(motion: Motion) -> tuple[Array, Array]:
    """Return times (M,) and positions (M, n) at even time steps."""
    count = int(np.clip(motion.duration / SAMPLE_STEP, FEWEST, MOST))
    step = motion.duration / count
    positions = motion.sample_every(step * (1.0 + 1e-12))[: count + 1]
    return motion.times[0] + step * np.arange(len(positions)), positions


def recheck(question: Question, answer: Answer) -> Verdict:
    """Return all errors of a motion."""
    verdict = Verdict()
    times, q = fine_samples(answer.motion)
    if q.shape[1:] != question.q_start.shape or not np.isfinite(q).all():
        verdict.errors.append("positions are not finite numbers, one a joint")
        return verdict
    verdict.errors += start_errors(question, q[0])
    verdict.errors += limit_errors(question, q)
    if answer.motion.duration > 0.0:
        verdict.errors += rate_errors(question, answer, times, q)
    verdict.errors += keyframe_errors(question, answer)
    verdict.errors += overlaps(question, answer, times, q, verdict)
    return verdict


def start_errors(question: Question, first: Array) -> list[str]:
    """Return an error if the motion does not begin at the start of the problem."""
    off = np.abs(first - question.q_start)
    return [f"starts {off[j]:.2e} from q_start at {name}" for j, name in named(question, off > ROUNDING)]


def limit_errors(question: Question, q: Array) -> list[str]:
    """Joints that leave their limits, mimic joints by their own, and mimic joints that leave their sources.

    What lies outside its limits at the start may come back in.
    """
    arm = question.arm
    over = np.maximum(np.minimum(arm.lower, question.q_start) - q, q - np.maximum(arm.upper, question.q_start)).max(
        axis=0
    )
    errors = [f"{name} leaves its limits by {over[j]:.5f}" for j, name in named(question, over > ROUNDING)]
    stray = np.abs(arm.coupled(q) - q).max(axis=0)
    return errors + [f"{name} strays {stray[j]:.5f} from its source" for j, name in named(question, stray > ROUNDING)]


def rate_errors(question: Question, answer: Answer, times: Array, q: Array) -> list[str]:
    """Velocity, acceleration and jerk by differences, and those at both ends.

    Divided differences are means of the derivative over their interval, so a motion that keeps a limit keeps it there.
    """
    step = (times[-1] - times[0]) / (len(times) - 1)
    errors = []
    rates = q
    names = ("velocity", "acceleration", "jerk")
    limits = (question.velocity, question.acceleration, question.jerk)
    scale = 1.0 + np.abs(q).max(axis=0)
    differences = []
    for order, (name, limit) in enumerate(zip(names, limits, strict=True), start=1):
        rates = np.diff(rates, axis=0) / step
        differences.append(rates)
        noise = 4e-16 * 2.0**order * scale / step**order
        reached = np.abs(rates).max(axis=0)
        errors += [
            f"{joint}: {name} {reached[j]:.5g} over {limit[j]:.5g}"
            for j, joint in named(question, reached > limit * (1.0 + RATE_SLACK) + noise + ROUNDING)
        ]
    # The first difference is the velocity half a step on, the second the acceleration one step on.
    velocity, acceleration = differences[0], differences[1]
    near = 0.5 * question.acceleration * step + 1e-6
    off = np.abs(velocity[0] - question.start_velocity)
    errors += [
        f"{joint} starts at {velocity[0][j]:.5g}, not {question.start_velocity[j]:.5g} per s"
        for j, joint in named(question, off > near)
    ]
    noise = 4e-15 * scale / step**2
    off = np.abs(acceleration[0] - question.start_acceleration)
    errors += [
        f"{joint} starts at acceleration {acceleration[0][j]:.5g}, not {question.start_acceleration[j]:.5g}"
        for j, joint in named(question, off > question.jerk * step + 1e-6 + noise)
    ]
    errors += [f"{joint} ends at {velocity[-1][j]:.5g} per s" for j, joint in named(question, abs(velocity[-1]) > near)]
    off = np.abs(acceleration[-1])
    errors += [
        f"{joint} ends at acceleration {acceleration[-1][j]:.5g}"
        for j, joint in named(question, off > question.jerk * step + 1e-6 + noise)
    ]
    for label, time, _, reached in answer.keyframes:
        if label in acts(question, answer) and reached and time is not None:
            speed = np.abs(answer.motion.sample(time)[1])
            errors += [
                f"{joint} moves at {speed[j]:.5g} per s where the gripper acts, at {label}"
                for j, joint in named(question, speed > 1e-6)
            ]
    return errors


def acts(question: Question, answer: Answer) -> list[str]:
    """Labels of the keyframes at which the gripper acts."""
    found = ["actuation"] if question.gripper in ("grasp", "release") else []
    if question.let_go > 0.0:
        found.append(answer.keyframes[-2][0])
    return found


def keyframe_errors(question: Question, answer: Answer) -> list[str]:
    """Return errors of keyframes that are missing, out of order, or wrongly reported as reached."""
    errors, last = let_go_errors(question, answer), -np.inf
    for label, time, pose, reached in answer.keyframes:
        if not reached:
            if answer.whole:
                errors.append(f"solved, but {label} is not reached")
            continue
        if time is None or time < last:
            errors.append(f"{label} at {time} s comes before {last} s")
            continue
        last = time
        position, velocity, _ = answer.motion.sample(time)
        miss = np.abs(question.arm.hand_poses(position)[0] - pose).max()
        if miss > (REST_SLACK if np.abs(velocity).max() < 1e-9 else PASSING_SLACK):
            errors.append(f"{label} is missed by {miss:.5f}")
    return errors


def let_go_errors(question: Question, answer: Answer) -> list[str]:
    """Return errors of the retreat after the release."""
    if question.let_go == 0.0:
        return [f"{label}, which was not asked for" for label, *_ in answer.keyframes if label == "let_go"]
    (_, _, before, _), (label, _, after, _) = answer.keyframes[-2:]
    wanted = before.copy()
    wanted[:3, 3] -= question.let_go * before[:3, 2]
    off = np.abs(wanted - after).max()
    return [] if label == "let_go" and off < ROUNDING else [f"lets go at {label}, {off:.5f} from where it should end"]


def overlaps(question: Question, answer: Answer, times: Array, q: Array, verdict: Verdict) -> list[str]:
    """Return errors for forbidden overlaps."""
    arm = question.arm
    kept = thin(arm, q)
    # Legs end at keyframes, to the microsecond.
    met = sorted({time for _, time, _, _ in answer.keyframes if time is not None})
    order = np.argsort(np.r_[times[kept], met], kind="stable")
    times = np.r_[times[kept], met][order]
    q = np.vstack([q[kept], *([answer.motion.sample(time)[0]] for time in met)])[order]
    different = np.r_[True, np.diff(times) > 0.0]
    times, q = times[different], q[different]
    times, q = refine(arm, times, q) if len(times) > 1 else (times, q)
    verdict.looks = len(q)
    errors = []
    clock = clock_of(question, answer, times, q)
    bounds = [0, *(int(np.argmin(np.abs(times - time))) for time in met), len(times) - 1]
    legs = [np.arange(begin, end + 1) for begin, end in pairwise(bounds) if end > begin]
    for _, pair in checked_pairs(arm, question.obstacles, clock, times, q):
        overlap, least, _ = judge(pair, cutoff=0.0)
        verdict.least_mm = min(verdict.least_mm, 1e3 * least)
        if overlap is not None:
            errors.append(overlap.describe(times))
        elif question.margin > 0.0:
            errors += margin_errors(pair, legs, question.margin, answer.nearer, times)
    if question.contact_depth is not None:
        for pair in touching_pairs(arm, question.obstacles, clock, times, q):
            errors += deep_errors(pair, question.contact_depth, times)
    return errors


def margin_errors(
    pair: Pair, legs: Sequence[Array], margin: float, nearer: set[frozenset[str]], times: Array
) -> list[str]:
    """Return errors for bodies that come closer than permitted, or closer than the plan reports."""
    least = least_distance(pair.one, pair.two, np.flatnonzero(pair.judged), margin)
    if least is None:
        return []
    near = too_near(pair, legs, margin)
    if near is not None:
        return [f"within the margin: {near.describe(times)}"]
    if least[0] > margin - MARGIN_TOLERANCE or frozenset((pair.one.name, pair.two.name)) in nearer:
        return []
    apart = f"{1e3 * least[0]:.1f} mm from {pair.two.name} at {times[least[1]]:.3f} s"
    return [f"not told of: {pair.one.name} is {apart}"]


def deep_errors(pair: Pair, depth: float, times: Array) -> list[str]:
    """Return errors for contacts that are deeper than permitted and deeper than at the start."""
    allowed = -depth - MARGIN_TOLERANCE
    begun = least_distance(pair.one, pair.two, np.array([0]), allowed)
    allowed = allowed if begun is None else begun[0] - MARGIN_TOLERANCE
    found = least_distance(pair.one, pair.two, np.flatnonzero(pair.judged), allowed)
    if found is None:
        return []
    return [f"too deep: {Overlap(pair.one.name, pair.two.name, -found[0], found[1]).describe(times)}"]


def clock_of(question: Question, answer: Answer, times: Array, q: Array) -> Clock:
    """From pre_0 on (from the start, where there is none) the hand may touch the moving link."""
    at = {label: np.inf if time is None else time for label, time, _, _ in answer.keyframes}
    letting_go = at[answer.keyframes[-2][0]] if question.let_go > 0.0 else np.inf
    clock = Clock(at.get("pre_0", -np.inf), at["actuation"], question.hinge, letting_go=letting_go)
    if question.hinge is not None:
        clock.travel = joint_travel(question, question.hinge, at, times, question.arm.hand_poses(q))
    return clock


def joint_travel(question: Question, hinge: Hinge, at: dict[str, float], times: Array, hands: Array) -> Array:
    """Return the travel of the object's joint at each time (M,), by the hand's motion; NaN from where on it is unknown.

    A motion that follows the joint turns the hand as far, one that traces it takes the contact point along.
    """
    travel = np.zeros(len(times))
    begin = at["actuation"]
    for index, motion in enumerate(question.after):
        end = at.get(f"post_{index}", np.inf)
        now = np.flatnonzero((times >= begin - INSTANT) & (times <= end + INSTANT))
        later = times > end + INSTANT
        if len(now) == 0:
            break
        kind = motion if isinstance(motion, str) else motion[0]
        if not kind.startswith(("follow_joint", "trace_joint")):
            # The travel at its first sample is known from the motions before it.
            travel[now[1:]] = np.nan
            travel[later] = np.nan
            break
        hand = hands[now]
        contact = hand[:, :3, :3] @ question.contact + hand[:, :3, 3]
        if not hinge.turns:
            moved = (contact - contact[0]) @ hinge.axis
        elif kind.startswith("follow_joint"):
            side = np.linalg.svd(hinge.axis[None])[2][1]
            moved = angles(hand[:, :3, :3] @ (hand[0, :3, :3].T @ side), hinge.axis)
        else:
            moved = angles(contact - hinge.origin, hinge.axis)
        travel[now] += moved
        travel[later] += moved[-1]
        begin = end
    return travel


def angles(arms: Array, axis: Array) -> Array:
    """Angles (M,) from the first of some vectors (M, 3) to each of them, about a unit axis."""
    across = arms - np.outer(arms @ axis, axis)
    return np.unwrap(np.arctan2(np.cross(across[0], across) @ axis, across @ across[0]))


def named(question: Question, which: Array) -> list[tuple[int, str]]:
    """Return joints by index and name."""
    return [(int(j), question.arm.joint_names[j]) for j in np.flatnonzero(which)]
