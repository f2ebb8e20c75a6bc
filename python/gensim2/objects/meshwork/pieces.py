"""Collision parts as the original GenSim2 has them: each connected piece of a mesh file as its convex hull.

Cavities of a piece are filled by it; nothing is taken apart or merged.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from gensim2.objects.meshwork.decompose import Faces, connected_pieces, make_hull

Array = npt.NDArray[np.float64]

FLAT = 1e-5
"""m: pieces thinner than this have no volume, and PhysX cooks no hull of them."""


def piece_hulls(meshes: Sequence[tuple[Array, Faces]]) -> tuple[list[Array], int]:
    """Convex hulls of the connected pieces of one link's files.

    Pieces that are thin but not flat are thickened as the default rule thickens them: what this engine does with them
    otherwise differs from what the original's did, too.

    Args:
        meshes: of each file vertices (N, 3) in metres and faces (M, 3).

    Returns:
        the hulls, each (N, 3), and how many pieces were left out: flat ones, and those under a millimetre.
    """
    found: list[Array] = []
    dropped = 0
    for vertices, _ in connected_pieces(meshes):
        hull = None if _thickness(vertices) < FLAT else make_hull(vertices)
        if hull is None:
            dropped += 1
        else:
            found.append(hull.points)
    return found, dropped


def _thickness(points: Array) -> float:
    """Least extent (m) of (N, 3) points along their principal axes."""
    centered = points - points.mean(axis=0)
    axes = np.linalg.eigh(centered.T @ centered)[1]
    return float(np.ptp(centered @ axes, axis=0).min())
