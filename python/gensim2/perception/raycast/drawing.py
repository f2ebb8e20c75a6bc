"""Draw pictures by ray casting, with labelled points and frames, without a graphics driver."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from gensim2.core.arrays import Array
from gensim2.perception import Camera
from gensim2.perception.raycast.caster import Caster, CastSolid
from gensim2.perception.raycast.scene import RaycastView
from gensim2.perception.raycast.shapes import Surface

if TYPE_CHECKING:
    from PIL import Image


SKY = (235, 238, 242)
AMBIENT = np.float32(0.42)
LAMPS = (((0.8, -0.5, -1.3), 0.5), ((-0.4, 0.8, -1.0), 0.25))
"""Directions in the base frame in which light falls, and its brightness; with the ambient light a table keeps its
color."""
EDGE_TURN, EDGE_STEP, EDGE_SHADE = 0.85, 0.02, np.float32(0.6)
"""Two neighbouring pixels lie on two sides of an edge if the cosine of the angle between their normals is smaller than
``EDGE_TURN``, or if the depth changes by more than the fraction ``EDGE_STEP``. Edges are drawn in the colour of the
surface times ``EDGE_SHADE``, so that the parts of a white object are distinguishable."""
FAR = np.float32(1e6)
"""Depth (m) of pixels that see no surface."""

FIELD_OF_VIEW = float(np.deg2rad(36))
OVERSAMPLING = 2
DOT = 4.5
"""Radius of a marked point, in pixels of the finished picture."""
TEXT = 13
AXES = ("#d33636", "#2f9e44", "#1c6fd4")


def shaded(view: RaycastView) -> npt.NDArray[np.uint8]:
    """Return an image (H, W, 3) of a view. A surface is bright where it faces one of the ``LAMPS``, and darker the more
    it is turned away from them.
    """
    rays = view.camera.rays.reshape(-1, 3)
    seen = np.flatnonzero(view.face >= 0)
    normals = view.normals_at(seen)
    # Flip normals that point away from the camera, so that the visible side of each triangle is shaded.
    normals *= -np.sign((normals * rays[seen]).sum(axis=1, keepdims=True))
    light = np.full(len(seen), AMBIENT)
    for direction, brightness in LAMPS:
        lamp = -np.asarray(direction, np.float32) / np.float32(np.linalg.norm(direction))
        light += np.float32(brightness) * (normals @ lamp).clip(min=0.0)
    light[_edges(view, seen, normals)] *= EDGE_SHADE
    picture = np.full((len(rays), 3), SKY, dtype=np.uint8)
    picture[seen] = np.minimum(view.colors_at(seen) * light[:, None], np.float32(255.0))
    return picture.reshape(*view.face.shape, 3)


def _edges(view: RaycastView, seen: npt.NDArray[np.int64], normals: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]:
    """Return which of the seen pixels lie on the near side of an edge: a step in depth, or a fold of the surface."""
    face, index = view.face, np.arange(view.face.size).reshape(view.face.shape)
    turned = np.zeros((face.size, 3), np.float32)
    turned[seen] = normals
    depth, found = np.where(face >= 0, view.depth, FAR).reshape(-1), np.zeros(face.size, np.bool_)
    for one, other in ((index[1:], index[:-1]), (index[:, 1:], index[:, :-1])):
        # Only pixels that see another triangle than their neighbour can lie on an edge.
        changes = face.reshape(-1)[one] != face.reshape(-1)[other]
        pair = one[changes], other[changes]
        folded = (turned[pair[0]] * turned[pair[1]]).sum(axis=1) < EDGE_TURN
        for near, far in (pair, pair[::-1]):
            steps = depth[far] - depth[near] > EDGE_STEP * depth[near]
            found[near[steps | (folded & (depth[near] <= depth[far]))]] = True
    return found[seen]


def fitting_distance(points: Array, away: Array) -> float:
    """Return the smallest distance (m) at which the camera of a drawing sees all points.

    Args:
        points: (N, 3) points relative to the target of the camera, m.
        away: (3,) unit vector from the target to the camera.
    """
    turn = Camera.looking("drawing", away, np.zeros(3), width=1, height=1, fov=FIELD_OF_VIEW).T_base_camera[:3, :3]
    right, down, ahead = (points @ turn).T
    return float((np.maximum(np.abs(right), np.abs(down)) / np.tan(FIELD_OF_VIEW / 2) - ahead).max())


class Drawing:
    """A square picture of solids with marked points and frames.

    Args:
        solids: surfaces, each with a pose (4, 4).
        eye: (3,) position of the camera, m, in the same frame as the poses of the solids.
        target: (3,) point in the middle of the picture, m.
        size: width and height of the picture, pixels.
    """

    def __init__(
        self, solids: Sequence[tuple[Surface, Array]], eye: npt.ArrayLike, target: npt.ArrayLike, size: int
    ) -> None:
        from PIL import Image, ImageDraw

        pixels = OVERSAMPLING * size
        self._camera = Camera.looking("drawing", eye, target, width=pixels, height=pixels, fov=FIELD_OF_VIEW)
        self._size = size
        caster = Caster([CastSolid(n, surface, True) for n, (surface, _) in enumerate(solids, 1)], [self._camera])
        poses = np.stack([pose for _, pose in solids])
        view = RaycastView(caster, caster.cast(poses), 0, self._camera, poses)
        self._depth = view.depth
        self._image = Image.fromarray(shaded(view))
        self._draw = ImageDraw.Draw(self._image)
        self._labels: list[tuple[float, float, str, str]] = []

    def point(self, at: npt.ArrayLike, color: str, label: str = "") -> None:
        """Mark a point by a disc, or by a ring if the point is hidden.

        Args:
            at: (3,) position, m.
            color: colour as ``#rrggbb``.
            label: text next to the point.
        """
        x, y, ahead = self._project(at)
        if ahead <= 0:
            return
        inside = 0 <= x < self._depth.shape[1] and 0 <= y < self._depth.shape[0]
        seen = float(self._depth[int(y), int(x)]) if inside else 0.0
        radius = OVERSAMPLING * DOT
        self._draw.ellipse((x - radius - 2, y - radius - 2, x + radius + 2, y + radius + 2), fill="#ffffff")
        box = (x - radius, y - radius, x + radius, y + radius)
        if 0 < seen < ahead - 0.015:
            self._draw.ellipse(box, outline=color, width=2 * OVERSAMPLING)
        else:
            self._draw.ellipse(box, fill=color)
        self._name(x, y, label, color)

    def frame(self, T: Array, length: float, label: str = "") -> None:
        """Draw a frame with a red x axis, a green y axis and a blue z axis.

        Args:
            T: (4, 4) pose of the frame.
            length: length of the axes, m.
            label: text next to the frame.
        """
        x0, y0, ahead = self._project(T[:3, 3])
        if ahead <= 0:
            return
        for axis, color in enumerate(AXES):
            x, y, there = self._project(T[:3, 3] + length * T[:3, axis])
            if there > 0:
                self._draw.line((x0, y0, x, y), fill=color, width=2 * OVERSAMPLING)
        self._name(x0, y0, label, "#1c2430")

    def picture(self) -> Image.Image:
        """Return the picture with all marked points and frames. Labels are moved down so that they do not overlap."""
        from PIL import Image, ImageDraw, ImageFont

        found = self._image.resize((self._size, self._size), Image.Resampling.BOX)
        draw, font = ImageDraw.Draw(found), ImageFont.load_default(size=TEXT)
        taken: list[tuple[float, float, float]] = []
        for x, y, label, color in sorted(self._labels, key=lambda each: each[1]):
            width = draw.textlength(label, font=font)
            left, top = max(min(x + 9, self._size - width - 3), 2), max(y - 8, 2)
            while any(abs(top - other) < TEXT + 2 and left < b and left + width > a for a, b, other in taken):
                top += 3
            taken.append((left, left + width, top))
            draw.text((left, top), label, fill=color, font=font, stroke_width=2, stroke_fill="#ffffff")
        return found

    def _project(self, at: npt.ArrayLike) -> tuple[float, float, float]:
        """Return the pixel of a point, and the point's depth."""
        x, y, ahead = self._camera.projection @ [*np.asarray(at, dtype=np.float64), 1.0]
        return float(x / ahead), float(y / ahead), float(ahead)

    def _name(self, x: float, y: float, label: str, color: str) -> None:
        x, y = x / OVERSAMPLING, y / OVERSAMPLING
        if label and 0 <= x < self._size and 0 <= y < self._size:
            self._labels.append((x, y, label, color))
