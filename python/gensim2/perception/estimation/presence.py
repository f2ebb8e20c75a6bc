"""Judge whether a point cloud shows the articulated object that a task needs."""

from __future__ import annotations

import contextlib
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.distance import pdist

from gensim2.objects.words import noun
from gensim2.perception.estimation.bail import raised_bail
from gensim2.perception.estimation.classes import ClassConstants
from gensim2.perception.estimation.deformation import SMALLEST
from gensim2.perception.estimation.estimator import ObjectEstimate, Points
from gensim2.perception.estimation.rigid import clusters

CLASS_ODDS = 100.0
"""Prior odds that an articulated object in the cloud is of the task's kind instead of another kind."""
CONNECTED = 0.045
"""Maximum distance (m) between neighbouring points of an object. The points of a thinned cloud of a large object are up
to 4 cm apart."""


def connected_extent(points: Points) -> float:
    """Return the largest distance (m) between two points of the largest connected part of a cloud (N, 3)."""
    found = clusters(points.astype(np.float64), CONNECTED)
    if not found:
        return 0.0
    part = points[found[0]].astype(np.float64)
    with contextlib.suppress(QhullError):  # raised if all points lie on a plane
        part = part[ConvexHull(part).vertices]
    return float(pdist(part).max())


def why_absent(found: ObjectEstimate | None, cloud: Points, kind: ClassConstants | None) -> dict[str, Any] | None:
    """Return why a cloud does not show an object of a class, as plain data; None if the cloud shows such an object.

    The network knows only classes of articulated objects, and assigns one of them to any points. Therefore two
    conditions must hold. The kind of object, such as a bucket, must be at least 1 / ``CLASS_ODDS`` times as probable as
    the most probable class, or the cloud must show the raised bail of a bucket. The classes of one kind, such as
    bucket_lift and bucket_swing, have the same shapes. The largest connected part of the object's points must not be
    smaller than in the training clouds of the class. Small objects such as a mug, also several of them side by side,
    fail the second condition.

    Args:
        found: estimate for the class; None if the cloud shows no articulated object.
        cloud: (N, 3) point cloud in which the object was estimated, m.
        kind: constants of the class; None: unknown class, so any object is accepted.
    """
    if found is None:
        return {}
    if kind is None:
        return None
    likeliest = max(found.classes, key=lambda name: found.classes[name])
    probability = sum(each for name, each in found.classes.items() if noun(name) == noun(kind.name))
    is_unlikely = CLASS_ODDS * probability < found.classes[likeliest]
    if is_unlikely and not (kind.is_bail and _shows_bail(found, cloud)):
        return {
            "probability": round(probability, 4),
            "likeliest": likeliest,
            "probability_of_likeliest": round(found.classes[likeliest], 4),
        }
    if kind.least_extent is not None:
        extent = connected_extent(cloud[found.points])
        if extent < SMALLEST * kind.least_extent:
            return {"extent": round(extent, 3), "least_extent": round(SMALLEST * kind.least_extent, 3)}
    return None


def _shows_bail(found: ObjectEstimate, cloud: Points) -> bool:
    """Return whether a cloud (N, 3) shows the raised bail of an estimated bucket."""
    return raised_bail(cloud[found.points], found.joint.axis, found.joint.origin) is not None
