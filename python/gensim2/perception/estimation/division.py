"""Divide a point cloud among the articulated objects of a task and other bodies, before the network estimates each
object. The first cloud is divided by the estimated classes of its parts, each later cloud by the previous one.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from gensim2.perception.estimation.estimator import LEAST_POINTS, Points
from gensim2.perception.estimation.presence import CONNECTED, connected_extent
from gensim2.perception.estimation.rigid import TABLE, Indices, clusters

Labels = npt.NDArray[np.int64]

NOTHING = -1
"""Label of points that show no articulated object of the task."""
GRAIN = 0.01
"""Side (m) of the cells of which one point is used to find clusters, because dense clouds have too many pairs."""
BESIDE, ABOVE = 0.08, 0.15
"""Maximum gap (m) between an object and a cluster that is a part of this object: of a cluster that reaches down to the
table, and of a cluster that does not.
"""
LEAST_RATIO = 0.4
"""A cluster beside an object is a part of this object only if the probability of the object's class, with the cluster,
is positive and at least this fraction of the probability without the cluster.
"""
FAR_SHARE, LIKELY, RISE = 0.3, 0.4, 0.1
"""Maximum gap between an object and a cluster that looks like the object itself, such as the open door of a large
refrigerator beside its other door, as a fraction of the object's extent; and minimum probability of the object's class,
given the cluster alone. The gap may also be as large if the cluster increases the probability of the class by at least
``RISE``.
"""
LEAST_CHANCE = 1e-9
"""Probability of a class that replaces smaller ones, so that their logarithms are finite."""


def parts(cloud: Points, table: float) -> list[Indices]:
    """Divide a cloud into bodies that stand on the table, and return the row indices of each, the largest first.

    A cluster that does not reach down to the table belongs to the nearest body that does, if the gap is at most
    ``ABOVE``. Points of no cluster are left out.

    Args:
        cloud: (N, 3) points in a frame with a vertical z axis, m.
        table: height of the table in this frame, m.
    """
    found = _clusters(cloud)
    stands = [bool(cloud[rows, 2].min() - table <= TABLE) for rows in found]
    trees = {at: cKDTree(cloud[rows]) for at, rows in enumerate(found) if stands[at]}
    added: dict[int, list[Indices]] = {at: [rows] for at, rows in enumerate(found) if stands[at]}
    for at, rows in enumerate(found):
        if not stands[at]:
            gaps = {other: float(tree.query(cloud[rows])[0].min()) for other, tree in trees.items()}
            nearest = min(gaps, key=gaps.__getitem__, default=at)
            added.setdefault(nearest if gaps and gaps[nearest] <= ABOVE else at, []).append(rows)
    whole = [np.sort(np.concatenate(each)) for each in added.values()]
    return sorted(whole, key=lambda rows: (-len(rows), rows[0]))


def first_division(
    cloud: Points, table: float, classes: Sequence[str], chances: Callable[[Points, str], float]
) -> Labels:
    """Divide the first cloud of an episode, and return the label (N,) of each point: the index of its object, or
    ``NOTHING``.

    The bodies on the table are assigned to the objects so that the product of the class probabilities is greatest. A
    body beside an object may be a part of this object that seems to be separate, because the arm hides the connection.
    Such a body is added to the object if the probability of the class hardly falls.

    Args:
        cloud: (N, 3) points in a frame with a vertical z axis, m.
        table: height of the table in this frame, m.
        classes: classes of the task's articulated objects.
        chances: function that returns the probability of a class, given points (N, 3); 0 if the points are too few or
            too small for the class.
    """
    found = [rows for rows in parts(cloud, table) if len(rows) >= LEAST_POINTS]
    if len(classes) == 1 and len(found) < 2:
        return np.zeros(len(cloud), dtype=np.int64)
    labels = np.full(len(cloud), NOTHING, dtype=np.int64)
    costs = np.array([[-np.log(max(chances(cloud[rows], name), LEAST_CHANCE)) for rows in found] for name in classes])
    if not found:
        return labels
    owners = {int(part): int(number) for number, part in zip(*linear_sum_assignment(costs), strict=True)}
    for part, number in owners.items():
        labels[found[part]] = number
    for part, rows in enumerate(found):
        if part not in owners:
            label = _joined(cloud, labels, rows, classes, chances)
            labels[rows] = label
    # Points of no body belong to the nearest one.
    loose = np.ones(len(cloud), dtype=bool)
    loose[np.concatenate(found)] = False
    kept = np.flatnonzero(~loose)
    labels[loose] = labels[kept[cKDTree(cloud[kept]).query(cloud[loose])[1]]]
    return labels


def _joined(
    cloud: Points, labels: Labels, rows: Indices, classes: Sequence[str], chances: Callable[[Points, str], float]
) -> int:
    """Return the label of an object of which a body, given by its row indices, is a part; ``NOTHING`` if it is none."""
    gaps = {
        number: float(cKDTree(cloud[labels == number]).query(cloud[rows])[0].min())
        for number in range(len(classes))
        if (labels == number).any()
    }
    for number in sorted(gaps, key=gaps.__getitem__):
        own = cloud[labels == number]
        is_beside = gaps[number] <= BESIDE
        if not is_beside and gaps[number] > FAR_SHARE * connected_extent(own):
            continue
        joined = chances(np.concatenate([own, cloud[rows]]), classes[number])
        alone = chances(own, classes[number])
        is_part = is_beside or joined >= alone + RISE or chances(cloud[rows], classes[number]) >= LIKELY
        # The probability without the body may be 0, because the body is needed for the minimum size of the class.
        if is_part and joined > 0.0 and joined >= LEAST_RATIO * alone:
            return number
    return NOTHING


def next_division(cloud: Points, bodies: Sequence[Points], others: Points, moved: Collection[int]) -> Labels:
    """Divide a later cloud, and return the label (N,) of each point: the index of its object, or ``NOTHING``.

    A cluster belongs to the object that was there in the previous cloud. If several bodies were there, each point
    belongs to the nearest of these bodies, and points at places that were empty belong to the object that the latest
    motion has moved. If no body was there, the cluster belongs to an object that was moved and has left its place, or
    to the nearest object.

    Args:
        cloud: (N, 3) points, m.
        bodies: points (N, 3) of each object in the previous cloud, m.
        others: (N, 3) points of other bodies in the previous cloud, m.
        moved: indices of the objects that the latest motion should have moved.
    """
    if not len(cloud):
        return np.zeros(0, dtype=np.int64)
    known = {at: each for at, each in enumerate([*bodies, others]) if len(each)}
    if not known:
        return np.zeros(len(cloud), dtype=np.int64)
    names = list(known)
    distances = np.stack([cKDTree(each).query(cloud)[0] for each in known.values()])
    of_objects = [place for place, name in enumerate(names) if name < len(bodies)]
    places = np.full(len(cloud), -1, dtype=np.int64)
    unknown = []
    for rows in _clusters(cloud):
        there = np.flatnonzero(distances[:, rows].min(axis=1) <= CONNECTED)
        if not len(there):
            unknown.append(rows)
            continue
        places[rows] = there[distances[there][:, rows].argmin(axis=0)]
        if len(there) > 1:
            movers = [place for place in there if names[place] in moved]
            if movers:
                empty = distances[there][:, rows].min(axis=0) > CONNECTED
                places[rows[empty]] = movers[0]
    for rows in unknown:
        gone = [place for place in of_objects if names[place] in moved and not (places == place).any()]
        nearest = min(of_objects, key=lambda place: distances[place, rows].min(), default=0)
        places[rows] = gone[0] if gone else nearest
    loose = places < 0
    places[loose] = distances[:, loose].argmin(axis=0)
    labels = np.array([name if name < len(bodies) else NOTHING for name in names])
    return labels[places]


def _clusters(cloud: Points) -> list[Indices]:
    """Return the row indices of the clusters of a cloud (N, 3), in which neighbouring points are at most about
    ``CONNECTED`` apart, the largest first.
    """
    if not len(cloud):
        return []
    _, first, cell = np.unique(np.floor(cloud / GRAIN).astype(np.int64), axis=0, return_index=True, return_inverse=True)
    labels = np.full(len(first), -1, dtype=np.int64)
    for number, rows in enumerate(clusters(cloud[first].astype(np.float64), CONNECTED)):
        labels[rows] = number
    of_point = labels[cell.reshape(-1)]
    found = [np.flatnonzero(of_point == number) for number in range(labels.max() + 1)]
    return sorted(found, key=lambda rows: (-len(rows), rows[0]))
