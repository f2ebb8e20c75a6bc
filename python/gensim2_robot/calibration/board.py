"""Calibrate a camera with a ChArUco board.

``A X = Z B`` is solved in closed form, and then the reprojection errors are minimized.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from gensim2.core.arrays import Array
from gensim2.core.errors import InputError
from gensim2.perception import Camera

LEAST_VIEWS = 4
LEAST_CORNERS = 6
DICTIONARY = "DICT_4X4_50"
OUTLIER = 1.0
"""Reprojection error (pixels) above which a corner has less weight in the fit."""


@dataclass(frozen=True)
class Board:
    """A ChArUco board.

    Attributes:
        columns, rows: number of squares in each direction.
        square, marker: side lengths of a square and of a marker, m.
    """

    columns: int
    rows: int
    square: float
    marker: float

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 3 or not 0.0 < self.marker < self.square < 1.0:
            wrong = "must have at least 3 x 3 squares, and markers smaller than the squares"
            raise InputError(wrong, field="board", remedy="for example 7x5:0.04:0.03")

    @staticmethod
    def parse(text: str) -> Board:
        """Return a board from ``COLUMNSxROWS:SQUARE:MARKER`` (m).

        Raises:
            InputError: the text is invalid.
        """
        try:
            size, square, marker = text.split(":")
            columns, rows = size.split("x")
            return Board(int(columns), int(rows), float(square), float(marker))
        except ValueError as error:
            wrong = f"must be a valid board COLUMNSxROWS:SQUARE:MARKER with lengths in m, but is {text!r}"
            raise InputError(wrong, field="--board", remedy="for example 7x5:0.04:0.03") from error

    def charuco(self) -> Any:
        import cv2

        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, DICTIONARY))
        return cv2.aruco.CharucoBoard((self.columns, self.rows), self.square, self.marker, dictionary)


@dataclass(frozen=True, eq=False)
class Corners:
    """Corners of a board in one image.

    Attributes:
        T_base_hand: (4, 4) pose of the hand in the base frame.
        points: (k, 3) corners in the board's frame, m.
        pixels: (k, 2) corners in the image, pixels; pixel centres are at .5.
    """

    T_base_hand: Array
    points: Array
    pixels: Array


@dataclass(frozen=True, eq=False)
class HandEye:
    """Result of a hand-eye calibration.

    Attributes:
        camera: (4, 4) pose of the camera, in the hand's frame if the hand carries the camera, else in the base frame.
        board: (4, 4) pose of the board, in the base frame if the hand carries the camera, else in the hand's frame.
        residual_px, held_out_px: median reprojection error in the images of the fit, and in held-out images.
        residual_mm, held_out_mm: the same errors, converted from pixels to mm at the board's distance.
    """

    camera: Array
    board: Array
    residual_px: float
    held_out_px: float
    residual_mm: float
    held_out_mm: float


def find_corners(colors: npt.NDArray[np.uint8], board: Board, T_base_hand: Array) -> Corners | None:
    """Return the board's corners in an image (H, W, 3); None if too few corners are visible."""
    import cv2

    charuco = board.charuco()
    grey = cv2.cvtColor(np.ascontiguousarray(colors), cv2.COLOR_RGB2GRAY)
    corners, ids, _, _ = cv2.aruco.CharucoDetector(charuco).detectBoard(grey)
    if ids is None or len(ids) < LEAST_CORNERS:
        return None
    points, pixels = charuco.matchImagePoints(corners, ids)
    # In OpenCV the centre of the first pixel is at 0, here it is at 0.5.
    return Corners(T_base_hand, points.reshape(-1, 3).astype(float), pixels.reshape(-1, 2).astype(float) + 0.5)


def hand_eye(camera: Camera, views: Sequence[Corners], held_out: Sequence[Corners], *, carried: bool) -> HandEye:
    """Find the pose of a camera by hand-eye calibration.

    Args:
        camera: camera with its intrinsics; images must be undistorted.
        views: corners in 4 or more images. The hand must be rotated about two axes or more.
        held_out: corners in 1 or more images for validation. The fit does not use these images.
        carried: True if the hand carries the camera and the board is fixed; False if the hand holds the board.

    Raises:
        InputError: there are too few images, or the hand was not rotated.
    """
    if len(views) < LEAST_VIEWS or not held_out:
        needed = f"at least {LEAST_VIEWS} images to compute the camera's pose, and one more to validate the result"
        raise InputError(f"the calibration needs {needed}", field="views")
    A = np.stack([view.T_base_hand for view in views])
    if not carried:
        A = np.asarray(np.linalg.inv(A), dtype=np.float64)
    B = np.stack([_board_pose(camera, view) for view in views])
    X, Z = _closed_form(A, B)
    start = np.concatenate([_vector(X), _vector(Z)])
    found = least_squares(
        lambda x: _off(camera, views, x, carried).reshape(-1), start, loss="soft_l1", f_scale=OUTLIER, x_scale="jac"
    )
    every, others = (_distance(camera, part, found.x, carried) for part in (views, held_out))
    scale = 1e3 * float(np.median(B[:, 2, 3])) / camera.intrinsic[0, 0]
    X, Z = _matrix(found.x[:6]), _matrix(found.x[6:])
    return HandEye(X, Z, every, others, every * scale, others * scale)


def _closed_form(A: Array, B: Array) -> tuple[Array, Array]:
    """Return X and Z of ``A_i X B_i = Z`` (Shah, 2013).

    One SVD gives the rotations, and least squares give the translations.
    """
    K = sum((np.kron(b[:3, :3].T, a[:3, :3]) for a, b in zip(A, B, strict=True)), np.zeros((9, 9)))
    # The equation is (B^T kron A) vec(X) = vec(Z), so K vec(X) = n vec(Z). Take the singular vectors of the largest
    # value.
    U, values, Vt = np.linalg.svd(K)
    if len(A) - values[1] < 1e-3 * len(A):
        raise InputError("the hand was not rotated about two axes between the images", field="views")
    rotations = []
    for vector in (Vt[0], U[:, 0]):
        M = vector.reshape(3, 3, order="F")
        u, _, vt = np.linalg.svd(np.sign(np.linalg.det(M)) * M)
        rotations.append(u @ vt)
    RX, RZ = rotations
    # With known rotations, R_A (R_X t_B + t_X) + t_A = t_Z is a linear system for t_X and t_Z.
    left = np.concatenate([np.hstack([a[:3, :3], -np.eye(3)]) for a in A])
    right = np.concatenate([-a[:3, 3] - a[:3, :3] @ RX @ b[:3, 3] for a, b in zip(A, B, strict=True)])
    t = np.linalg.lstsq(left, right, rcond=None)[0]
    X, Z = np.eye(4), np.eye(4)
    X[:3, :3], X[:3, 3], Z[:3, :3], Z[:3, 3] = RX, t[:3], RZ, t[3:]
    return X, Z


def _board_pose(camera: Camera, view: Corners) -> Array:
    """Return the board's pose (4, 4) in the camera's frame."""
    import cv2

    there, turn, shift = cv2.solvePnP(view.points, view.pixels, camera.intrinsic, None, flags=cv2.SOLVEPNP_ITERATIVE)
    if not there:
        raise InputError("the board's pose cannot be determined from its corners", field="views")
    return _matrix(np.concatenate([turn.reshape(3), shift.reshape(3)]))


def _off(camera: Camera, views: Sequence[Corners], x: Array, carried: bool) -> Array:
    """Return the reprojection errors (k, 2) of the corners, pixels."""
    X, Z = _matrix(x[:6]), _matrix(x[6:])
    found = []
    for view in views:
        T_camera_board = np.linalg.inv((view.T_base_hand if carried else np.linalg.inv(view.T_base_hand)) @ X) @ Z
        seen = (view.points @ T_camera_board[:3, :3].T + T_camera_board[:3, 3]) @ camera.intrinsic.T
        found.append(seen[:, :2] / seen[:, 2:].clip(min=1e-6) - view.pixels)
    return np.concatenate(found)


def _distance(camera: Camera, views: Sequence[Corners], x: Array, carried: bool) -> float:
    return float(np.median(np.linalg.norm(_off(camera, views, x, carried), axis=1)))


def _vector(T: Array) -> Array:
    return np.concatenate([Rotation.from_matrix(T[:3, :3]).as_rotvec(), T[:3, 3]])


def _matrix(x: Array) -> Array:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec(x[:3]).as_matrix(), x[3:]
    return T
