"""Parameters of the depth noise from recordings of cameras that stand still before a scene that stands still.

What changes from picture to picture of the same thing is noise. How wide the window of the stereo matcher is
(fattening), and what is always wrong in the same way, cannot be told without the truth, and stays as it is given.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter, maximum_filter, minimum_filter

from gensim2.core.errors import InputError
from gensim2.core.files import write_atomic
from gensim2.perception import D435, DepthNoise
from gensim2.perception.noise import NoiseFile, brightness, incidence, shadows
from gensim2_robot.calibration.poses import read_standing

Array = npt.NDArray[np.float64]

MIN_PICTURES, MOST_PICTURES = 8, 60
"""Pictures of one camera and one scene that are enough to tell, and that are looked at."""
TOLD = 200
"""Pixels from which on a share is told."""
SMOOTHED = 1.0
"""Pixels by which surfaces are smoothed before their angle is told."""
DOUBT = 0.1
"""Rad within which an angle is not told."""
WORKSPACE = 2.0
"""Metres within which pixels count: noise matters there."""
MILLIMETRE = 1e-3


@dataclass(frozen=True, eq=False)
class StillRecording:
    """Pictures of one camera; nothing in them moves.

    Attributes:
        depths: (N, H, W) m; 0 where nothing was measured.
        colors: (H, W, 3) of one of them.
        focal: pixels of the pictures.
    """

    depths: npt.NDArray[np.float32]
    colors: npt.NDArray[np.uint8]
    focal: float


def fit_log(log: Path, out: Path, base: DepthNoise = D435) -> dict[str, Any]:
    """Fit to the stretches of a run's log in which its arm stood, and write a file.

    Args:
        log: folder.
        out: file to write.
        base: what cannot be told, and the stereo pair's focal length and baseline.

    Returns:
        Plain data: the parameters, and of how many pixels each was told.

    Raises:
        InputError: there is no log, or the arm stood nowhere long enough.
    """
    from gensim2_robot.log_reader import about_of

    cameras = {each.name: each.camera() for each in about_of(log).cameras}
    recordings = []
    for standing in read_standing(log, MOST_PICTURES):
        for name, frames in standing.frames.items():
            if cameras[name].link is None and len(frames) >= MIN_PICTURES:
                depths = np.stack([cameras[name].metres(frame.depth) for frame in frames])
                recordings.append(StillRecording(depths, frames[0].colors, float(cameras[name].intrinsic[1, 1])))
    if not recordings:
        raise InputError(
            f"the arm stands nowhere for {MIN_PICTURES} pictures", file=log, remedy="let it stand for some seconds"
        )
    found, told = fit(recordings, base)
    write_atomic(out, NoiseFile(noise=asdict(found), told=told).model_dump_json(indent=2) + "\n")
    return {"schema_version": 1, "noise": asdict(found), "told": told, "recordings": len(recordings), "file": str(out)}


def fit(recordings: Sequence[StillRecording], base: DepthNoise = D435) -> tuple[DepthNoise, dict[str, int]]:
    """Parameters of noise, and the number of pixels by which each was told; what was not is as in ``base``.

    Raises:
        InputError: there are too few pictures.
    """
    if not recordings or min(len(each.depths) for each in recordings) < MIN_PICTURES:
        raise InputError(f"needs {MIN_PICTURES} pictures of each scene", field="recordings")
    parts = [_Part(each, base) for each in recordings]
    found: dict[str, Any] = {}
    told: dict[str, int] = {}

    def tell(name: str, pairs: Sequence[tuple[float, int]]) -> None:
        """The mean of a parameter over recordings, by their pixels."""
        count = sum(each for _, each in pairs)
        if count >= TOLD:
            found[name], told[name] = float(sum(value * each for value, each in pairs) / count), count

    tell("disparity_sigma", [part.sigma() for part in parts])
    tell("correlation", [part.correlation() for part in parts])
    tell("lost", [part.lost(part.plain) for part in parts])
    tell("edge_lost", [part.lost(part.edges) for part in parts])
    tell("edge_mixed", [part.mixed() for part in parts])
    lost = found.get("lost", base.lost)
    for name, masks in (
        ("dark_lost", [part.dark for part in parts]),
        ("grazing_lost", [part.grazing for part in parts]),
        ("specular_lost", [part.specular for part in parts]),
    ):
        shares = [part.lost(mask) for part, mask in zip(parts, masks, strict=True)]
        tell(name, [(max(0.0, (share - lost) / (1.0 - lost)), count) for share, count in shares])
    shade = [part.shadowed() for part in parts]
    if sum(count for _, count in shade) >= TOLD:
        told["shadow"] = sum(count for _, count in shade)
        found["shadow"] = sum(share * count for share, count in shade) > 0.5 * told["shadow"]
    return replace(base, **found), told


class _Part:
    """One recording, and which of its pixels tell what."""

    def __init__(self, recording: StillRecording, base: DepthNoise) -> None:
        depths = recording.depths.astype(np.float64)
        self._depths, self._base, self._focal = depths, base, recording.focal
        seen = depths > 0
        self._share = seen.mean(axis=0)
        total = np.where(seen, depths, np.nan).reshape(len(depths), -1)
        median = np.zeros(total.shape[1])
        some = seen.any(axis=0).reshape(-1)
        median[some] = np.nanmedian(total[:, some], axis=0)
        self._median = median.reshape(depths.shape[1:])
        measured = (self._share > 0) & (self._median < WORKSPACE)
        near, far = _window(self._median, 1)
        wide_near, wide_far = _window(self._median, 2 + int(np.ceil(base.fattening)))
        # In a median at an edge noise stands still: what is wide of an edge is plain.
        inside = measured & (wide_far - wide_near < 2.0 * base.edge) & (wide_near > 0)
        self.edges = measured & (near > 0) & (far - near > base.edge) & (self._share > 0.2)
        # Noise left in the median turns a surface by a tenth of a radian and more from pixel to pixel.
        angle = incidence(gaussian_filter(self._median, SMOOTHED).astype(np.float32), recording.focal, base.edge)
        bright = brightness(recording.colors)
        self.dark = inside & (bright < base.dark)
        self.grazing = inside & (angle > base.grazing) & ~self.dark
        self.specular = inside & (angle < base.specular) & ~self.dark
        between = (angle > base.specular + DOUBT) | (base.specular == 0)
        self.plain = inside & ~self.dark & between & ((angle < base.grazing - DOUBT) | (base.grazing_lost == 0))
        pair = base.focal * base.baseline
        self._error = np.where(seen & (self._median > 0), pair / np.where(seen, depths, 1.0), np.nan)
        middle = np.full(self._median.shape, np.nan)
        middle[self.plain] = np.nanmean(self._error[:, self.plain], axis=0)
        count = seen.sum(axis=0)
        # The mean of N has a share of each: what is left of it is smaller by (N - 1) / N.
        self._error = (self._error - middle) * np.sqrt(count / np.maximum(count - 1, 1))
        rounding = pair * MILLIMETRE / np.where(self._median > 0, self._median, 1.0) ** 2
        self._rounded = (base.disparity_step**2 + rounding**2) / 12.0

    def sigma(self) -> tuple[float, int]:
        """Standard deviation of disparity, pixels."""
        which = self.plain & (self._share > 0.5)
        if not which.any():
            return 0.0, 0
        variance = np.nanmean(self._error[:, which] ** 2, axis=0) - self._rounded[which]
        return float(np.sqrt(max(float(np.mean(variance)), 0.0))), int(which.sum())

    def correlation(self) -> tuple[float, int]:
        """Pixels of the Gaussian that neighbouring errors share."""
        error, which = self._error, self.plain & (self._share > 0.5)
        if not which.any():
            return 0.0, 0
        white = float(np.mean(self._rounded[which]))
        variance = float(np.nanmean(error[:, which] ** 2)) - white
        found = []
        for lag in (1, 2):
            products = [
                error[:, :, lag:] * error[:, :, :-lag],
                error[:, lag:, :] * error[:, :-lag, :],
            ]
            covariance = float(np.mean([np.nanmean(each) for each in products]))
            share = covariance / max(variance, 1e-12)
            if 0.02 < share < 0.995:
                found.append(lag / np.sqrt(-4.0 * np.log(share)))
        # A Gaussian of less than a third of a pixel shares nothing that could be told from white noise.
        return (float(np.mean(found)) if found else 0.0), int(which.sum())

    def lost(self, mask: npt.NDArray[np.bool_]) -> tuple[float, int]:
        """Share of the pictures in which pixels measure nothing."""
        return (float(1.0 - self._share[mask].mean()) if mask.any() else 0.0), int(mask.sum())

    def mixed(self) -> tuple[float, int]:
        """Share of the pixels at an edge that lie between its sides."""
        if not self.edges.any():
            return 0.0, 0
        near, far = (each[self.edges] for each in _window(self._median, 1))
        depths = self._depths[:, self.edges]
        room = np.minimum(0.2 * (far - near), 0.02)
        between = (depths > near + room) & (depths < far - room)
        # Of what is mixed evenly this much shows.
        shows = (far - near - 2.0 * room) / (far - near)
        return float(np.mean(between.mean(axis=0) / shows)), int(self.edges.sum())

    def shadowed(self) -> tuple[float, int]:
        """Share of what lies in the shadow of a stereo pair that is never measured."""
        filled = self._median.copy()
        for row in filled:
            there = np.flatnonzero(row)
            if len(there):
                gaps = np.flatnonzero(row == 0)
                left = row[there[np.searchsorted(there, gaps).clip(1, len(there)) - 1]]
                right = row[there[np.searchsorted(there, gaps).clip(0, len(there) - 1)]]
                row[gaps] = np.maximum(left, right)
        hidden = shadows(filled.astype(np.float32), self._base.baseline, self._focal) & (filled < WORKSPACE)
        return (float((self._share[hidden] < 0.05).mean()) if hidden.any() else 0.0), int(hidden.sum())


def _window(depth: Array, reach: int) -> tuple[Array, Array]:
    """Least and largest depth of each pixel and those around it; 0 counts as the least."""
    side = 2 * reach + 1
    return minimum_filter(depth, side), maximum_filter(depth, side)


def shown(noise: Mapping[str, Any], told: Mapping[str, int]) -> list[tuple[str, str, str]]:
    """Rows of a table: parameter, value, by how many pixels it was told."""
    return [
        (name, f"{value:.4g}" if isinstance(value, float) else str(value), str(told.get(name, "as given")))
        for name, value in noise.items()
    ]
