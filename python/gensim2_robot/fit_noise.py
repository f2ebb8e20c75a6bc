"""Fit depth noise to recordings of fixed cameras in front of a static scene.

Differences between images of the same scene are noise. The width of the stereo matching window and a constant depth
error cannot be estimated without the true depth. These parameters keep the values of the noise model ``base``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter, maximum_filter, minimum_filter

from gensim2.core.arrays import Array
from gensim2.core.errors import InputError
from gensim2.core.files import write_atomic
from gensim2.perception import D435, DepthNoise
from gensim2.perception.noise import NoiseFile, brightness, incidence, shadows
from gensim2_robot.calibration.poses import read_standing

MIN_PICTURES, MOST_PICTURES = 8, 60
"""Minimum and maximum number of images of one camera and scene for the fit."""
TOLD = 200
"""Minimum number of pixels for an estimate."""
SMOOTHED = 1.0
"""Standard deviation (pixels) of the smoothing before surface angles are computed."""
DOUBT = 0.1
"""Width (rad) of the range of surface angles that the fit excludes as uncertain."""
WORKSPACE = 2.0
"""Maximum depth (m) of pixels that the fit uses; noise beyond the workspace does not matter."""
MILLIMETRE = 1e-3


@dataclass(frozen=True, eq=False)
class StillRecording:
    """Images of one camera of a static scene.

    Attributes:
        depths: (N, H, W) m; 0 for no measurement.
        colors: (H, W, 3) colours of one of the images.
        focal: focal length of the images, pixels.
    """

    depths: npt.NDArray[np.float32]
    colors: npt.NDArray[np.uint8]
    focal: float


def fit_log(log: Path, out: Path, base: DepthNoise = D435) -> dict[str, Any]:
    """Fit depth noise to the images of a log that show the arm at rest, and write the parameters to a file.

    Args:
        base: noise model with the geometry of the stereo pair and with the parameters that cannot be estimated.

    Returns:
        Plain data: the parameters, and the number of pixels from which each one was estimated.

    Raises:
        InputError: the log is missing, or the arm was never at rest long enough.
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
        wrong = f"the arm is never at rest for {MIN_PICTURES} images"
        raise InputError(wrong, file=log, remedy="keep the arm at rest for some seconds")
    found, told = fit(recordings, base)
    write_atomic(out, NoiseFile(noise=asdict(found), told=told).model_dump_json(indent=2) + "\n")
    return {"schema_version": 1, "noise": asdict(found), "told": told, "recordings": len(recordings), "file": str(out)}


def fit(recordings: Sequence[StillRecording], base: DepthNoise = D435) -> tuple[DepthNoise, dict[str, int]]:
    """Fit noise parameters, and return the parameters and the number of pixels from which each parameter was estimated.

    Parameters that cannot be estimated keep their value in ``base``.

    Raises:
        InputError: there are too few images.
    """
    if not recordings or min(len(each.depths) for each in recordings) < MIN_PICTURES:
        wrong = f"each recorded scene must have at least {MIN_PICTURES} images"
        raise InputError(wrong, field="recordings")
    parts = [_Part(each, base) for each in recordings]
    found: dict[str, Any] = {}
    told: dict[str, int] = {}

    def tell(name: str, pairs: Sequence[tuple[float, int]]) -> None:
        """Store the mean of a parameter over recordings, weighted by the number of pixels of each recording."""
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
    """One recording, with masks of the pixels from which each parameter is estimated."""

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
        # The median is noisy at edges, so only pixels away from edges count as flat surfaces.
        inside = measured & (wide_far - wide_near < 2.0 * base.edge) & (wide_near > 0)
        self.edges = measured & (near > 0) & (far - near > base.edge) & (self._share > 0.2)
        # The noise of the median would change the surface angle by 0.1 rad and more between pixels.
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
        # The mean is computed from the same N values, so the measured variance is too small by the factor (N - 1) / N.
        self._error = (self._error - middle) * np.sqrt(count / np.maximum(count - 1, 1))
        rounding = pair * MILLIMETRE / np.where(self._median > 0, self._median, 1.0) ** 2
        self._rounded = (base.disparity_step**2 + rounding**2) / 12.0

    def sigma(self) -> tuple[float, int]:
        """Return the standard deviation of disparity, pixels, and the number of pixels used."""
        which = self.plain & (self._share > 0.5)
        if not which.any():
            return 0.0, 0
        variance = np.nanmean(self._error[:, which] ** 2, axis=0) - self._rounded[which]
        return float(np.sqrt(max(float(np.mean(variance)), 0.0))), int(which.sum())

    def correlation(self) -> tuple[float, int]:
        """Return the standard deviation (pixels) of the blur that correlates errors, and the number of pixels used."""
        error, which = self._error, self.plain & (self._share > 0.5)
        if not which.any():
            return 0.0, 0
        white = float(np.mean(self._rounded[which]))
        variance = float(np.nanmean(error[:, which] ** 2)) - white
        found = []
        for lag in (1, 2):
            products = [error[:, :, lag:] * error[:, :, :-lag], error[:, lag:, :] * error[:, :-lag, :]]
            covariance = float(np.mean([np.nanmean(each) for each in products]))
            share = covariance / max(variance, 1e-12)
            if 0.02 < share < 0.995:
                found.append(lag / np.sqrt(-4.0 * np.log(share)))
        # A blur below a third of a pixel cannot be told from none. Without a measurable correlation the result is 0.
        return (float(np.mean(found)) if found else 0.0), int(which.sum())

    def lost(self, mask: npt.NDArray[np.bool_]) -> tuple[float, int]:
        """Return the fraction of the pixels in ``mask`` that have no measurement, and the number of pixels used."""
        return (float(1.0 - self._share[mask].mean()) if mask.any() else 0.0), int(mask.sum())

    def mixed(self) -> tuple[float, int]:
        """Return the fraction of edge pixels with a depth between both sides of the edge, and the number of pixels
        used.
        """
        if not self.edges.any():
            return 0.0, 0
        near, far = (each[self.edges] for each in _window(self._median, 1))
        depths = self._depths[:, self.edges]
        room = np.minimum(0.2 * (far - near), 0.02)
        between = (depths > near + room) & (depths < far - room)
        # A mixed depth is recognized if it differs from both sides by more than ``room``. Of uniformly distributed
        # mixed depths, this is the fraction ``shows``. The division corrects for it.
        shows = (far - near - 2.0 * room) / (far - near)
        return float(np.mean(between.mean(axis=0) / shows)), int(self.edges.sum())

    def shadowed(self) -> tuple[float, int]:
        """Return the fraction without depth of pixels that only one stereo camera sees, and their number."""
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
    """Return the smallest and the largest depth in a window around each pixel; a missing measurement counts as 0."""
    side = 2 * reach + 1
    return minimum_filter(depth, side), maximum_filter(depth, side)


def shown(noise: Mapping[str, Any], told: Mapping[str, int]) -> list[tuple[str, str, str]]:
    """Return table rows with parameter, value, and number of pixels used."""
    return [
        (name, f"{value:.4g}" if isinstance(value, float) else str(value), str(told.get(name, "as given")))
        for name, value in noise.items()
    ]
