"""Coarse registration: what moved between pictures onto the surfaces that the ray caster says are visible."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_opening
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from gensim2.perception import Camera
from gensim2_robot.calibration.fitted import Array, Pose, expected_error, placed_at, tukey
from gensim2_robot.calibration.surfaces import ArmView, RobotSurface, shrunk

COARSE_PIXELS = 96
"""Width of the pictures that the coarse registration casts."""
COARSE_POINTS = 400
"""Measured points of each picture in the coarse registration."""
FARTHEST = 3.0
"""Metres within which the robot stands."""
APART = 0.04
"""Metres before what is behind it from which on a pixel shows what has moved."""
LEAST_MOVED = 50
"""Pixels that must have moved in a picture that the coarse registration uses."""
TURN, MAX_STARTS = 0.2, 4
"""Rad by which starts are turned, and how many of them are followed."""
REACHES = (0.4, 0.3, 0.2, 0.15, 0.1, 0.07, 0.05, 0.035, 0.025, 0.02)
"""Metres within which points are matched, round after round."""


def moved_pixels(depths: Sequence[npt.NDArray[np.float32]]) -> list[npt.NDArray[np.bool_]]:
    """(H, W) of each picture: what stands before what other pictures show there, by more than noise; no lone pixels."""
    ordered = np.sort(depths, axis=0)
    behind = ordered[-2] if len(depths) > 3 else ordered[-1]  # one picture may be wrong there
    before = APART + 5.0 * expected_error(behind)
    return [
        binary_opening((depth > 0) & (depth < behind - before) & (depth < FARTHEST), np.ones((3, 3)))
        for depth in depths
    ]


class Coarse:
    """Registration by nearest points."""

    def __init__(
        self,
        surface: RobotSurface,
        camera: Camera,
        views: Sequence[ArmView],
        moved: Sequence[npt.NDArray[np.bool_]],
        draw: np.random.Generator,
    ) -> None:
        used = [number for number, mask in enumerate(moved) if mask.sum() >= LEAST_MOVED]
        self._surface, self._views = surface, [views[number] for number in used]
        self._small = shrunk(camera, max(1, round(camera.width / COARSE_PIXELS)))
        self._guess = Pose(camera.T_base_camera)
        rays = replace(camera, T_base_camera=np.eye(4)).rays.reshape(-1, 3).astype(np.float64)
        self._points = []
        for view, mask in ((views[number], moved[number]) for number in used):
            pixels = np.flatnonzero(mask)
            pixels = draw.choice(pixels, min(COARSE_POINTS, len(pixels)), replace=False)
            self._points.append(view.depth.reshape(-1)[pixels, None] * rays[pixels])
        depth = float(np.median(np.concatenate(self._points)[:, 2]))
        self._expected = 0.6 * depth / self._small.intrinsic[0, 0] + float(expected_error(np.array(depth)))

    def best(self) -> Pose:
        """The registration that lies nearest to the surfaces, of several starts."""
        found: list[tuple[float, Pose]] = []
        for start in self.start_poses():
            pose = self.register(start)
            found.append((self.cost(pose), pose))
            if found[-1][0] < self._expected:
                break
        return min(found, key=lambda each: each[0])[1]

    def start_poses(self) -> list[Pose]:
        """The guess, then the nearest to the surfaces of the guess turned about each axis and brought to the middles of
        what moved."""
        turned = []
        for rotvec in np.concatenate([np.zeros((1, 3)), TURN * np.eye(3), -TURN * np.eye(3)]):
            T = self._guess.T.copy()
            T[:3, :3] = T[:3, :3] @ Rotation.from_rotvec(rotvec).as_matrix()
            turned.append(self._to_middles(self._to_middles(Pose(T))))
        return [self._guess, *sorted(turned, key=self.cost)[:MAX_STARTS]]

    def _to_middles(self, pose: Pose) -> Pose:
        """Shifted so that what moved has its middles where the meshes' have them."""
        shifts = [
            surface.mean(axis=0) - (points @ pose.T[:3, :3].T + pose.T[:3, 3]).mean(axis=0)
            for points, (surface, _) in zip(self._points, self._model(pose), strict=True)
            if len(surface) > 20
        ]
        if not shifts:
            return pose
        T = pose.T.copy()
        T[:3, 3] += np.median(shifts, axis=0)
        return Pose(T)

    def register(self, start: Pose) -> Pose:
        """From a start to where the points lie on the surfaces."""
        pose = start
        for reach in REACHES:
            model = self._model(pose)
            for _ in range(3):
                step = self._step(pose, model, reach)
                if step is None:
                    break
                pose = pose.moved(*step)
        return pose

    def cost(self, pose: Pose) -> float:
        """Mean distance of points from the surfaces, 5 cm at most; m."""
        found = []
        for points, (model, _) in zip(self._points, self._model(pose), strict=True):
            placed = points @ pose.T[:3, :3].T + pose.T[:3, 3]
            found.append(cKDTree(model).query(placed)[0].clip(max=0.05).mean() if len(model) else 0.05)
        return float(np.mean(found))

    def _model(self, pose: Pose) -> list[tuple[Array, Array]]:
        """(k, 3) points and normals of each view that the meshes show to have moved."""
        camera = placed_at(self._small, pose)
        seen = [self._surface.see(camera, view.q) for view in self._views]
        behind = np.max([each.depth for each in seen], axis=0)
        found = []
        for each in seen:
            mask = np.isfinite(each.depth) & (each.depth < behind - APART)
            points = camera.position + each.depth[mask][:, None] * camera.rays[mask]
            found.append((points.astype(np.float64), each.normals[mask].astype(np.float64)))
        return found

    def _step(self, pose: Pose, model: list[tuple[Array, Array]], reach: float) -> tuple[Array, Array] | None:
        placed, normals, off = [], [], []
        for points, (surface, across) in zip(self._points, model, strict=True):
            if not len(surface):
                continue
            here = points @ pose.T[:3, :3].T + pose.T[:3, 3]
            distance, nearest = cKDTree(surface).query(here, distance_upper_bound=reach)
            close = np.isfinite(distance)
            placed.append(here[close])
            normals.append(across[nearest[close]])
            off.append(((here[close] - surface[nearest[close]]) * normals[-1]).sum(axis=1))
        if sum(map(len, off)) < 30:
            return None
        p, n, r = np.concatenate(placed), np.concatenate(normals), np.concatenate(off)
        center = p.mean(axis=0)
        rows = np.column_stack([np.cross(p - center, n), n])
        weights = tukey(r, max(0.3 * reach, 0.004))
        square = rows.T @ (weights[:, None] * rows)
        damping = 1e-3 * np.trace(square) / 6.0
        step = np.linalg.solve(square + damping * np.eye(6), -rows.T @ (weights * r))
        return np.append(step, [0.0, 0.0]), center
