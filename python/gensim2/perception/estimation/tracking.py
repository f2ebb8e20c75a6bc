"""Measure the displacement of a joint between two point clouds, and combine it with the estimates of the openness."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from gensim2.core.arrays import Array
from gensim2.objects.types import joint_motion
from gensim2.perception.cloud import uniform_stride
from gensim2.perception.estimation.estimator import MEASURED_OPENNESS, JointEstimate, ObjectEstimate, Points

Rows = npt.NDArray[np.int64]

LEAST_MOVING = 12
"""Minimum number of points on the moving part in each cloud; with fewer points no displacement is measured."""
MOST_COMPARED = 400
"""Maximum number of points on the moving part that are compared with the other cloud."""
CHANGED = 0.015
"""Minimum distance (m) of a point from the other cloud if the point has no counterpart there."""
FAR = 0.02
"""Maximum distance (m) that counts for a point without a counterpart in the other cloud."""
OUT_OF_VIEW = 0.016
"""Minimum mean distance (m) of the moving part's points from the cloud if the part is not there."""
CERTAIN = 0.1
"""Standard deviation of the openness below which a new estimate needs no confirmation by the cloud."""
NOTHING_THERE, MUCH_NEARER = 0.014, 0.8
"""An openness in a new estimate is discarded if the moving part's points would have at least this mean distance (m)
from the other cloud, and if the measured displacement reduces the distance to this fraction."""
GRID, FINE = 41, 9
"""Number of displacements that are compared over the joint range, and around the best of these displacements."""
WITHIN = 2.0
"""Number of standard deviations of the openness by which a displacement may lead beyond the joint range."""
LEAST_GAIN, LEAST_GAIN_OF_CHANGES = 0.1, 0.2
"""Minimum reduction of the mean distance, as a fraction, by a displacement other than zero: of the estimated moving
part, and of the points without a counterpart.
"""
LEAST_GAIN_AWAY = 0.3
"""Minimum of this reduction by a displacement away from the goal of the motion. A thin part that no camera sees any
more often seems to have moved to the opposite side."""
UNEXPECTED_GAIN = 0.5
"""Minimum of this reduction after a motion that should not move the joint. The hand often hides a part of the object,
and a displacement can then match the rest of the part with other surfaces.
"""
LEAST_SHIFT = {"revolute": 0.3, "prismatic": 0.025}
"""Minimum displacement (rad or m) of an estimated keypoint along the joint for the displacement to count."""
LEAST_RANGE = {"revolute": 0.15, "prismatic": 0.025}
"""Minimum joint range (rad or m) for a displacement to be measured. The points of smaller displacements, for example of
a button, are too far apart to show it."""
SHORT = 0.08
"""Displacement (m) of a sliding part that is possible although the estimated range is smaller, if the estimate is
uncertain."""
NEAREST = 3
"""Number of cloud points whose mean replaces a keypoint that the hand has missed."""
MOST_MISSED = 0.06
"""Maximum distance (m) of the points that replace a keypoint."""
RELATIVE, ABSOLUTE = 0.1, 0.04
"""Standard deviation of a measured displacement: a fraction of the displacement plus a fraction of the joint range."""
AGREEING, AGREEING_SHARE = 0.25, 0.5
"""Maximum difference between two changes of the openness that agree, one from two estimates and the other from a
measured displacement: a constant, or a fraction of the displacement if this is larger.
"""

UNKNOWN = 0.3
"""Standard deviation of the openness above which a cloud does not show the openness, for example of an object that is
pushed along the table."""
REFUTED = 0.15
"""Minimum difference of the openness in a new estimate from the openness after the measured displacement for the new
estimate to be discarded."""
SAME, SAME_SHARE = 0.003, 0.9
"""Maximum distance (m) of a point from the last cloud if the last cloud shows this point, too; and the fraction of an
object's points that the last cloud shows if a new cloud shows nothing more of the object."""
MOVED = {"revolute": 0.15, "prismatic": 0.012}
"""Minimum displacement towards the goal (rad or m) before a standstill counts as the end of the joint range. A joint
that moves back by this displacement does not stand still.
"""
STALLED = {"revolute": 0.05, "prismatic": 0.005}
"""Maximum displacement in a motion during which the joint stands still, rad or m."""
MOST_DEVIATIONS, FAR_FROM_END, NEAR_END, REPEATED, DOUBTFUL, UNCERTAIN = 3.0, 0.35, 0.2, 0.25, 0.42, 0.15
"""Maximum number of standard deviations between the estimated openness and the end of the joint range if the joint is
at this end, and maximum difference of an openness that the cloud shows. ``NEAR_END`` is the maximum after a motion that
moved the joint until it resisted, and after a motion without a displacement and without resistance. ``REPEATED`` is
allowed, even if the estimate is more certain, after a motion without a displacement but with resistance, and after two
motions without both. ``DOUBTFUL`` is allowed after these motions if the standard deviation is at least ``UNCERTAIN``,
and for an object that moved as a whole until it resisted.
"""


@dataclass(frozen=True)
class Displacement:
    """Measured displacement of a joint between two clouds.

    Attributes:
        value: displacement, rad or m.
        moved: (N, 3) points of the moving part in the old cloud after the displacement, m.
        distance: function that returns the mean distance (m) of the moving part's points from the other cloud for a
            displacement; None if the displacement was not found by this distance.
    """

    value: float
    moved: Array
    distance: Callable[[float], float] | None = None

    def contradicts(self, value: float) -> bool:
        """Return whether the moving part cannot have the displacement ``value`` (rad or m), because the clouds show no
        points there.
        """
        if self.distance is None:
            return False
        there = self.distance(value)
        return there >= NOTHING_THERE and self.distance(self.value) <= MUCH_NEARER * there


def displacement(
    before: ObjectEstimate,
    old: Points,
    after: ObjectEstimate,
    new: Points,
    *,
    goal: int = 0,
    is_expected: bool = True,
) -> Displacement | None:
    """Return the displacement of an object's joint between two clouds. The type and the axis of the joint are taken
    from the estimate ``before``.

    The function searches for the displacement at which the two clouds match best. It compares the clouds in both
    directions. First, the moving part's points in the old cloud are moved forwards along the joint and compared with
    the object in the new cloud. Second, the moving part's points in the new cloud are moved backwards and compared with
    the object in the old cloud.
    If no displacement of the estimated moving part makes the clouds match better, the function searches for the
    displacement of the points that have no counterpart in the other cloud, because the estimated part may be wrong.
    If this search does not find a displacement either, for example because the moving part is small, the displacement
    of the first moving keypoint counts, if it is large enough.

    Args:
        before, after: estimates of the object.
        old, new: (N, 3) point clouds of the estimates in the base frame, m.
        goal: 1 if the motion should open the joint, -1 if it should close the joint, otherwise 0. The opposite
            direction counts only if the clouds then match much better.
        is_expected: whether the motion should have moved the joint. If it should not, only a displacement that explains
            most of the change counts, and a displacement of the keypoint alone does not count.

    Returns:
        The displacement; None if a cloud shows too little of the moving part, or if the joint range is too small.
    """
    if before.joint.upper - before.joint.lower < LEAST_RANGE[before.joint.type]:
        return None
    points = [old[before.points].astype(np.float64), new[after.points].astype(np.float64)]
    trees = [cKDTree(points[1]), cKDTree(points[0])]
    estimated = [points[0][before.moving], points[1][after.moving]]
    changed = [each[tree.query(each)[0] > CHANGED] for each, tree in zip(points, trees, strict=True)]
    found = None
    for moving, gain in ((estimated, LEAST_GAIN), (changed, LEAST_GAIN_OF_CHANGES)):
        moving = [each[uniform_stride(len(each), MOST_COMPARED)] for each in moving]
        if min(map(len, moving)) >= LEAST_MOVING:
            found = _fitted(before.joint, moving, trees, gain if is_expected else UNEXPECTED_GAIN, goal)
            if found.value:
                return found
    if not is_expected:
        return found
    shift = _keypoint_shift(before, after)
    counts = abs(shift) >= LEAST_SHIFT[before.joint.type] and shift * goal >= 0
    return Displacement(shift, estimated[0][:0]) if counts else found


def _keypoint_shift(before: ObjectEstimate, after: ObjectEstimate) -> float:
    """Return the displacement (rad or m) of the first moving keypoint along the joint of the estimate ``before``; 0 if
    the joint moves no keypoint.
    """
    if not before.moving_keypoints:
        return 0.0
    joint, name = before.joint, before.moving_keypoints[0]
    old, new = (each.keypoints[name] - joint.origin for each in (before, after))
    if joint.type == "prismatic":
        return float((new - old) @ joint.axis)
    return float(np.arctan2(np.cross(old, new) @ joint.axis, old @ new - (old @ joint.axis) * (new @ joint.axis)))


def _fitted(
    joint: JointEstimate, moving: Sequence[Array], trees: Sequence[cKDTree], gain: float, goal: int
) -> Displacement:
    """Return the displacement with the smallest mean distance between moving points (2 clouds, each (N, 3)) and the
    other cloud; 0 if this displacement reduces the distance by less than the fraction ``gain``.
    """

    def distance(value: float) -> float:
        found = []
        for points, tree, sign in zip(moving, trees, (1.0, -1.0), strict=True):
            found.append(_apart(_moved(points, joint, sign * value), tree))
        return float(np.mean(found))

    span = joint.upper - joint.lower
    # The joint stays in its range.
    doubt = WITHIN * joint.openness_deviation
    low, high = -min(joint.openness + doubt, 1.0), min(1.0 - joint.openness + doubt, 1.0)
    lower, upper = span * low, span * high
    if joint.type == "prismatic" and joint.openness_deviation >= UNCERTAIN:
        lower, upper = (lower, max(upper, SHORT)) if goal > 0 else (min(lower, -SHORT), upper)
    coarse = np.linspace(lower, upper, GRID)
    least = distance(0.0)

    def best_of(values: Array, gain: float) -> float:
        best = min(values, key=distance)
        best = float(min(np.linspace(best - step, best + step, FINE), key=distance))
        return best if distance(best) < (1.0 - gain) * least else 0.0

    step = coarse[1] - coarse[0]
    towards, away = coarse[coarse * goal >= 0], coarse[coarse * goal < 0]
    found = best_of(towards, gain)
    if len(away):
        opposite = best_of(away, max(gain, LEAST_GAIN_AWAY))
        found = min(found, opposite, key=distance) if opposite else found
    return Displacement(found, _moved(moving[0], joint, found), distance)


def _moved(points: Array, joint: JointEstimate, value: float) -> Array:
    """Return points (N, 3) after a displacement (rad or m) of the joint that carries them."""
    T = joint_motion(joint.type, joint.axis, value, joint.origin)
    return np.asarray(points @ T[:3, :3].T + T[:3, 3])


def _apart(points: Array, tree: cKDTree) -> float:
    """Return the mean distance (m) of points (N, 3) from a cloud, in which each point counts ``FAR`` at most."""
    return float(np.minimum(tree.query(points)[0], FAR).mean())


@dataclass(frozen=True)
class Track:
    """Estimate of an object that is followed over the motions of an episode.

    Attributes:
        found: estimate, with an openness and keypoints that take all clouds so far into account.
        cloud: (N, 3) last point cloud that shows the object, base frame, m.
        others: row indices of cloud points on other bodies.
        moved: displacement of the joint since the first cloud, rad or m.
        change: displacement of the joint in the latest motion, rad or m; None if it was not measured.
        misses: number of motions that did not move the joint since a motion last moved it.
        latest: estimate from the last cloud alone; None: the same as ``found``.
        was_pressed: whether the object blocked the arm in the latest motion.
    """

    found: ObjectEstimate
    cloud: Points
    others: Rows
    moved: float = 0.0
    change: float | None = None
    misses: int = 0
    latest: ObjectEstimate | None = None
    was_pressed: bool = False

    @property
    def to_plan(self) -> ObjectEstimate:
        """Estimate on which the next motion is planned.

        If the latest motion has not moved the joint, the hand has probably missed the part that it should have pulled
        or pushed. After every second motion of this kind, the points of the cloud that are nearest to the first moving
        keypoint replace this keypoint. The other motions use the estimated keypoint.
        """
        return at_points(self.found, self.cloud) if self.misses % 2 else self.found

    def displacement(
        self, found: ObjectEstimate, cloud: Points, goal: int, *, is_expected: bool = True
    ) -> Displacement | None:
        """Return the displacement of the joint between the last cloud and a new cloud, as the function
        :func:`displacement` does. If a bail is measured in both clouds, the displacement follows from its openness.
        """
        before = self.latest or self.found
        if before.is_bail and max(before.joint.openness_deviation, found.joint.openness_deviation) <= MEASURED_OPENNESS:
            change = (found.joint.openness - before.joint.openness) * (before.joint.upper - before.joint.lower)
            return Displacement(change, np.zeros((0, 3)))
        return displacement(before, self.cloud, found, cloud, goal=goal, is_expected=is_expected)

    def after(
        self,
        found: ObjectEstimate,
        cloud: Points,
        others: Rows,
        goal: int,
        *,
        is_expected: bool = True,
        is_pressed: bool | None = None,
    ) -> Track:
        """Return the track after a motion.

        The new openness is a weighted mean of two values: the openness in the new estimate, and the openness in the old
        estimate plus the measured displacement. The weights are the inverse variances. If the motion has given a sign
        that the joint is at the end of its range, such as resistance, the joint counts as being there, unless the new
        openness contradicts this (:meth:`_most_from_end`).

        If a motion that should not move the joint has not moved it, and the new cloud shows no more of the object than
        the last one, for example because the arm hides a part of it, the keypoints are not changed.

        If a motion has moved a prismatic joint, and the new openness agrees with the measured displacement, each
        keypoint is the more certain of two: the new keypoint, and the old keypoint after the displacement.

        Args:
            found: new estimate of the object.
            cloud, others: cloud of this estimate, and points on other bodies.
            goal: 1 if the motion should open the joint, -1 if it should close the joint, otherwise 0.
            is_expected: whether the motion should have moved the joint, as for :func:`displacement`.
            is_pressed: whether the object has blocked the arm in the motion; None: unknown.
        """
        way = self._way_to_goal(found, cloud, goal) if goal else None
        if way is not None:
            return self._moved_by(way, found, cloud, others, goal)
        measured = self.displacement(found, cloud, goal, is_expected=is_expected)
        if measured is None:
            if found.joint.openness_deviation > UNKNOWN:
                found = self._displaced(Displacement(0.0, np.zeros((0, 3))), found, cloud)
            return Track(found, cloud, others, self.moved, misses=self.misses)
        change, span = measured.value, self.found.joint.upper - self.found.joint.lower
        displaced = self._displaced(measured, found, cloud)
        implied = (found.joint.openness - self.found.joint.openness) * span
        is_wrong = (
            displaced.joint.openness_deviation <= found.joint.openness_deviation
            and abs(displaced.joint.openness - found.joint.openness) > REFUTED
            and measured.contradicts(implied)
        )
        network = found
        found = displaced if is_wrong else found
        kind = self.found.joint.type
        is_still = abs(change) < STALLED[kind]
        if not is_expected and is_still and self._shows_no_more(found, cloud):
            kept = replace(found, keypoints=self.found.keypoints, keypoint_deviations=self.found.keypoint_deviations)
            latest, found = found, kept
        else:
            latest, found = found, self._with_keypoints(found, cloud, change)
        moved = self.moved + change
        misses = self.misses + 1 if goal and is_still else 0
        old, new = self.found.joint, found.joint
        predicted = float(np.clip(old.openness + change / span, 0.0, 1.0))
        variances = (
            old.openness_deviation**2 + (ABSOLUTE + RELATIVE * abs(change) / span) ** 2,
            new.openness_deviation**2,
        )
        shares = np.array([1.0 / each for each in variances])
        openness = float(shares @ [predicted, new.openness] / shares.sum())
        # Two clouds of an object that has not moved lead to the same error, so their mean is not more accurate.
        least = min(old.openness_deviation, new.openness_deviation)
        deviation = least if is_still else float(shares.sum() ** -0.5)
        if is_wrong:
            openness, deviation = new.openness, new.openness_deviation
        end, is_whole = 0.5 + 0.5 * goal, bool(network.moving.all())
        if is_whole and not is_still and new.openness_deviation > UNKNOWN:
            openness = predicted
        if goal:
            # Only the displacement shows an unknown openness after a motion that has moved the joint, and the openness
            # of an object that moves as a whole.
            is_shown = new.openness_deviation <= UNKNOWN or (is_still and not is_whole)
            shown = replace(new, openness=new.openness if is_shown else openness)
            if is_wrong:
                doubt = abs(new.openness - network.joint.openness)
                shown = replace(shown, openness_deviation=max(new.openness_deviation, doubt))
            is_led = abs(predicted - end) <= ABSOLUTE
            if abs(shown.openness - end) <= self._most_from_end(shown, change, goal, is_pressed, is_whole, is_led):
                return Track(found.at(end, ABSOLUTE), cloud, others, moved, change, latest=latest)
        if goal and new.openness_deviation > UNKNOWN and abs(openness - end) <= deviation <= NEAR_END:
            # A part that may have reached its end is there, because it seldom stops shortly before its end.
            openness, deviation = end, ABSOLUTE
        return Track(found.at(openness, deviation), cloud, others, moved, change, misses, latest, bool(is_pressed))

    def _most_from_end(
        self,
        shown: JointEstimate,
        change: float,
        goal: int,
        is_pressed: bool | None,
        is_whole: bool,
        is_led: bool,
    ) -> float:
        """Return the maximum difference of the openness from the end of the joint range at which the joint counts as
        being at the end after a motion. The difference depends on the signs of the end that the motion has given; it is
        negative without any sign.

        Args:
            shown: joint with the openness after the motion.
            change: displacement in the motion, rad or m.
            goal: 1 if the motion should open the joint, -1 if it should close the joint.
            is_pressed: whether the object has blocked the arm in the motion; None: unknown.
            is_whole: whether the object moves as a whole, as a lifted bucket does.
            is_led: whether the openness before the motion plus the displacement is at the end.
        """
        kind, deviation = shown.type, shown.openness_deviation
        has_moved, stands_still = goal * self.moved >= MOVED[kind], abs(change) < STALLED[kind]
        has_ended = has_moved and -MOVED[kind] < goal * change < STALLED[kind]
        plausible = MOST_DEVIATIONS * deviation
        if deviation <= UNKNOWN:
            plausible = min(plausible, FAR_FROM_END)
        if is_pressed and goal * change >= MOVED[kind]:
            # The joint has moved until it resisted. An object also resists on its way if the hand pushes in a wrong
            # direction.
            return DOUBTFUL if is_whole else max(plausible, NEAR_END) if is_led else NEAR_END
        if has_ended:
            if is_whole and deviation > UNKNOWN and not self.misses:
                # The hand may have slipped off an object that is pushed along the table.
                return DOUBTFUL
            # Two of three signs are enough: resistance, a second standstill, and an object that moves as a whole,
            # because its cloud does not show the joint range. A second resistance is also enough for a sliding part;
            # the openness of a hinge is well visible.
            signs = (bool(is_pressed), self.misses > 0, is_whole)
            if sum(signs) >= 2 or (is_pressed and self.was_pressed and kind == "prismatic"):
                return 1.0
            if is_pressed or self.misses:
                return max(plausible, REPEATED if deviation < UNCERTAIN else DOUBTFUL)
            # Without resistance, the hand may also have missed the moving part.
            return plausible if is_pressed is None else min(plausible, NEAR_END)
        # The hand has pressed on the part for the second time without moving it.
        return plausible if is_pressed and stands_still and self.misses else -1.0

    def _shows_no_more(self, found: ObjectEstimate, cloud: Points) -> bool:
        """Return whether nearly all points of an object in a new cloud lie at its points in the last cloud."""
        old, new = self.cloud[(self.latest or self.found).points], cloud[found.points]
        distances = cKDTree(old).query(new[uniform_stride(len(new), MOST_COMPARED)])[0]
        return bool(np.quantile(distances, SAME_SHARE) < SAME)

    def _way_to_goal(self, found: ObjectEstimate, cloud: Points, goal: int) -> Displacement | None:
        """Return the displacement towards the goal at which a cloud has points of the moving part, or the displacement
        to the end of the range if no camera sees the part any more. Return None if the part is still where it was, if
        it is where the new estimate places it, or if the new estimate is certain.
        """
        before, joint = self.latest or self.found, self.found.joint
        moving = self.cloud[before.points][before.moving].astype(np.float64)
        if len(moving) < LEAST_MOVING or found.joint.openness_deviation < CERTAIN:
            return None
        moving, tree = moving[uniform_stride(len(moving), MOST_COMPARED)], cKDTree(cloud)
        span, end = joint.upper - joint.lower, 0.5 + 0.5 * goal - joint.openness

        def distance(value: float) -> float:
            return _apart(_moved(moving, joint, value), tree)

        was_measured = before.is_bail and before.joint.openness_deviation <= MEASURED_OPENNESS
        if was_measured and found.joint.openness_deviation > UNKNOWN:
            # A bail that cannot be measured any more lies on the rim, if its middle has moved.
            middle = before.keypoints[before.moving_keypoints[0]]
            return Displacement(end * span, moving[:0]) if tree.query(middle)[0] > FAR else None
        if min(distance(0.0), distance((found.joint.openness - joint.openness) * span)) < OUT_OF_VIEW:
            return None
        best = float(min(np.linspace(0.0, end * span, GRID)[1:], key=distance))
        if distance(best) < OUT_OF_VIEW:
            return Displacement(best, _moved(moving, joint, best))
        return Displacement(end * span, moving[:0])

    def _moved_by(self, way: Displacement, found: ObjectEstimate, cloud: Points, others: Rows, goal: int) -> Track:
        """Return the track after a displacement towards the goal. A part that may have reached the end of its range is
        there, because it seldom stops shortly before its end.
        """
        moved, end = self._displaced(way, found, cloud), 0.5 + 0.5 * goal
        if abs(moved.joint.openness - end) <= min(moved.joint.openness_deviation, NEAR_END):
            moved = moved.at(end, ABSOLUTE)
        return Track(moved, cloud, others, self.moved + way.value, way.value)

    def _displaced(self, measured: Displacement, found: ObjectEstimate, cloud: Points) -> ObjectEstimate:
        """Return the old estimate after a measured displacement of the joint. The new estimate ``found`` only
        determines which points of the new cloud belong to the object.
        """
        before, joint, change = self.found, self.found.joint, measured.value
        span = joint.upper - joint.lower
        T = joint_motion(joint.type, joint.axis, change, joint.origin)
        keypoints = {
            name: T[:3, :3] @ at + T[:3, 3] if name in before.moving_keypoints else at
            for name, at in before.keypoints.items()
        }
        reached = joint.openness + change / span
        openness = float(np.clip(reached, 0.0, 1.0))
        deviation = float(np.hypot(joint.openness_deviation, ABSOLUTE + RELATIVE * abs(change) / span))
        if joint.type == "revolute":
            # A displacement beyond the end of the range makes it more certain that the joint is at the end. The
            # estimated range of a sliding part is too uncertain for this.
            deviation = max(deviation - abs(reached - openness), ABSOLUTE)
        moving = cKDTree(measured.moved).query(cloud[found.points])[0] < CHANGED
        return replace(before, points=found.points, moving=moving, keypoints=keypoints).at(openness, deviation)

    def _with_fixed_keypoints(self, found: ObjectEstimate, cloud: Points) -> ObjectEstimate:
        """Return a new estimate in which the old keypoints on the fixed part replace keypoints that are less certain,
        unless the fixed part has moved. An open lid or door hides a part of the object.
        """
        fixed = cloud[found.points[~found.moving]]
        if len(fixed) < LEAST_MOVING:
            return found
        apart = cKDTree(self.cloud).query(fixed[uniform_stride(len(fixed), MOST_COMPARED)])[0]
        if np.median(apart) >= SAME:
            return found
        before = self.found
        old = {
            name: at
            for name, at in before.keypoints.items()
            if name not in found.moving_keypoints and before.keypoint_deviations[name] < found.keypoint_deviations[name]
        }
        doubts = {name: before.keypoint_deviations[name] for name in old}
        return replace(
            found, keypoints={**found.keypoints, **old}, keypoint_deviations={**found.keypoint_deviations, **doubts}
        )

    def _with_keypoints(self, found: ObjectEstimate, cloud: Points, change: float) -> ObjectEstimate:
        """Return a new estimate in which the old keypoints, after a displacement (m) of the joint, replace keypoints
        that are less certain. For example, the keypoints of a closed drawer are uncertain if several drawers look
        alike.

        If no motion has moved the joint yet, or if the openness in the new estimate does not agree with the
        displacement, the estimate is returned unchanged. Of an object with a revolute joint, only the old keypoints on
        the fixed part are used, because the error of the axis position displaces the others.
        """
        if self.found.joint.type == "revolute":
            return self._with_fixed_keypoints(found, cloud)
        before, joint, latest = self.found, self.found.joint, self.latest or self.found
        has_moved = abs(change) >= MOVED[joint.type] or before.keypoints is not latest.keypoints
        by = change / (joint.upper - joint.lower)
        difference = abs(found.joint.openness - latest.joint.openness - by)
        if not has_moved or difference > max(AGREEING, AGREEING_SHARE * abs(by)):
            return found
        T = joint_motion(joint.type, joint.axis, change, joint.origin)
        keypoints, deviations = dict(found.keypoints), dict(found.keypoint_deviations)
        for name, old in before.keypoints.items():
            moved = T[:3, :3] @ old + T[:3, 3] if name in before.moving_keypoints else old
            doubt = float(np.hypot(before.keypoint_deviations[name], RELATIVE * np.linalg.norm(moved - old)))
            if doubt < deviations[name]:
                keypoints[name], deviations[name] = moved, doubt
        return replace(found, keypoints=keypoints, keypoint_deviations=deviations)


def at_points(found: ObjectEstimate, cloud: Points) -> ObjectEstimate:
    """Return an estimate whose first moving keypoint is the mean of the object's nearest points in the cloud. If no
    point is near the keypoint, return the estimate unchanged.

    Args:
        found: estimate of an object.
        cloud: (N, 3) point cloud of the estimate in the base frame, m.
    """
    if not found.moving_keypoints:
        return found
    name = found.moving_keypoints[0]
    points = cloud[found.points].astype(np.float64)
    distance, rows = cKDTree(points).query(found.keypoints[name], k=NEAREST)
    if distance.max() > MOST_MISSED:
        return found
    return replace(found, keypoints={**found.keypoints, name: points[rows].mean(axis=0)})
