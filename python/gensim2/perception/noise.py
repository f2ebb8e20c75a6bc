"""Simulate the noise of a stereo depth camera: disparity noise, edges, holes, calibration and clock errors."""

from __future__ import annotations

import reprlib
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict

from gensim2.core.errors import InputError
from gensim2.core.record_files import read_record

# SciPy is imported inside functions, because argument checks do not need it.

Depth = npt.NDArray[np.float32]
Colors = npt.NDArray[np.uint8]

MAX_SETTING = 1e9
FIELD = 3.0
"""Standard deviation (pixels) of the random field that selects fattened edges, if the noise is uncorrelated."""


@dataclass(frozen=True)
class DepthNoise:
    """Parameters of depth noise.

    A stereo depth camera measures the disparity between two images. A pixel without a measurement is called lost. The
    defaults describe only the uncorrelated noise of a RealSense D435 camera at 848 x 480 pixels; :data:`D435` describes
    all effects of this camera.

    Attributes:
        focal: focal length of the stereo pair, pixels.
        baseline: distance between the two cameras of the stereo pair, m.
        disparity_sigma: standard deviation of a measured disparity, pixels.
        disparity_step: step to which disparities are rounded, pixels.
        edge: minimum depth difference between neighbouring pixels that counts as an edge, m.
        edge_lost: fraction of the pixels at edges that are lost.
        edge_mixed: fraction of the pixels at edges that get a depth between the depths of the near and the far side.
        lost: fraction of all other pixels that are lost.
        correlation: standard deviation (pixels) of the Gaussian filter that makes the errors of neighbouring pixels
            similar; 0: the errors are independent.
        shadow: whether pixels are lost beside a near object, where it hides the background from the right camera. The
            shadow is ``f B (1/z_near - 1/z_far)`` pixels wide.
        fattening: maximum growth of near objects at their edges, pixels.
        dark, dark_lost: a fraction ``dark_lost`` of the pixels darker than ``dark`` (brightness from 0 to 1) is lost.
        grazing, grazing_lost: a fraction ``grazing_lost`` of the pixels with an angle of incidence above ``grazing``
            (rad) is lost.
        specular, specular_lost: a fraction ``specular_lost`` of the pixels with an angle of incidence below
            ``specular`` (rad) is lost, because of specular reflections.
        spread: variation of the noise between episodes. In each episode, the amount of noise and the fractions of lost
            pixels are multiplied by random factors. ``spread`` is the standard deviation of the logarithms of these
            factors.
        rotation, translation: standard deviations of the error of a camera's pose (rad and m). The error is drawn once
            for each episode.
        scale, bias: standard deviations of the relative depth error and of the depth offset (m). The errors are drawn
            once for each episode.
        time: standard deviation of the delay between an image and the joint readings, s. The delay is drawn once for
            each episode.
    """

    focal: float = 425.0
    baseline: float = 0.05
    disparity_sigma: float = 0.08
    disparity_step: float = 1.0 / 32.0
    edge: float = 0.02
    edge_lost: float = 0.3
    edge_mixed: float = 0.2
    lost: float = 0.005
    correlation: float = 0.0
    shadow: bool = False
    fattening: float = 0.0
    dark: float = 0.0
    dark_lost: float = 0.0
    grazing: float = 1.3
    grazing_lost: float = 0.0
    specular: float = 0.0
    specular_lost: float = 0.0
    spread: float = 0.0
    rotation: float = 0.0
    translation: float = 0.0
    scale: float = 0.0
    bias: float = 0.0
    time: float = 0.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not isinstance(value, int | float) or not 0 <= value < MAX_SETTING:
                said = f"must be a number from 0 to {MAX_SETTING:g}, got {reprlib.repr(value)}"
                raise InputError(said, field=f"noise.{name}")
        if min(self.focal, self.baseline) <= 0:
            raise InputError("must be positive", field="noise.focal and noise.baseline")
        if self.edge_lost + self.edge_mixed > 1 or self.lost > 1:
            wrong = "edge_lost and edge_mixed must add up to at most 1, and lost must be at most 1"
            raise InputError(wrong, field="noise.edge_lost, noise.edge_mixed, noise.lost")
        for name in ("dark_lost", "grazing_lost", "specular_lost"):
            if getattr(self, name) > 1:
                raise InputError("must be at most 1", field=f"noise.{name}")
        if self.fattening > 20 or self.correlation > 20:
            raise InputError("must be at most 20 pixels", field="noise.fattening and noise.correlation")

    def on(
        self,
        depth: Depth,
        generator: np.random.Generator,
        colors: Colors | None = None,
        focal: float | None = None,
    ) -> Depth:
        """Return the depth (H, W), m, with added noise. A depth of 0 means that a pixel has no measurement; it stays 0.

        Args:
            depth: (H, W) exact depth, m.
            generator: random generator.
            colors: (H, W, 3) colours, which show the dark surfaces on which pixels are lost; None: no surface is dark.
            focal: focal length of the image, pixels; None: focal length of the stereo pair.
        """
        seen = depth > 0
        draws = generator.random(depth.shape, dtype=np.float32)
        weights = generator.random(depth.shape, dtype=np.float32)
        errors = self.disparity_sigma * generator.standard_normal(depth.shape, dtype=np.float32)
        if self.correlation:
            errors = _smooth(errors, self.correlation)
            draws = self._even(depth, generator)
        lost_too = self._lost_by_surface(depth, generator, colors, self.focal if focal is None else focal)
        if self.shadow:
            lost_too |= shadows(depth, self.baseline, self.focal if focal is None else focal)
        depth = self._fattened(depth, generator)
        near, far = _around(depth)
        edges = seen & (far - near > self.edge)
        mixed = edges & (draws >= self.edge_lost) & (draws < self.edge_lost + self.edge_mixed)
        found = np.where(mixed, near + weights * (far - near), depth)
        disparity = self.focal * self.baseline / np.where(seen, found, 1.0) + errors
        if self.disparity_step:
            disparity = np.round(disparity / self.disparity_step) * self.disparity_step
        lost = ~seen | lost_too | (disparity <= 0) | (draws < np.where(edges, self.edge_lost, self.lost))
        measured = self.focal * self.baseline / np.where(lost, 1.0, disparity)
        return np.where(lost, 0.0, measured).astype(np.float32)

    def drawn(self, generator: np.random.Generator) -> DepthNoise:
        """Draw the noise parameters of one episode: the amount of noise and the fractions of lost pixels are multiplied
        by random factors (see ``spread``).
        """
        if not self.spread:
            return self
        factors = np.exp(self.spread * generator.standard_normal(4))
        return replace(
            self,
            disparity_sigma=self.disparity_sigma * factors[0],
            lost=min(self.lost * factors[1], 1.0),
            edge_lost=min(self.edge_lost * factors[1], 1.0 - self.edge_mixed),
            correlation=min(self.correlation * factors[2], 20.0),
            dark_lost=min(self.dark_lost * factors[3], 1.0),
            grazing_lost=min(self.grazing_lost * factors[3], 1.0),
            specular_lost=min(self.specular_lost * factors[3], 1.0),
        )

    def error(self, generator: np.random.Generator) -> CameraError:
        """Draw the calibration error of one camera in one episode."""
        from scipy.spatial.transform import Rotation

        draw = generator.standard_normal(8)
        T = np.eye(4)
        T[:3, :3] = Rotation.from_rotvec(self.rotation / np.sqrt(3.0) * draw[:3]).as_matrix()
        T[:3, 3] = self.translation / np.sqrt(3.0) * draw[3:6]
        return CameraError(T, 1.0 + self.scale * float(draw[6]), self.bias * float(draw[7]))

    def _lost_by_surface(
        self, depth: Depth, generator: np.random.Generator, colors: Colors | None, focal: float
    ) -> npt.NDArray[np.bool_]:
        """Return a mask (H, W) of pixels that have no measurement because the surface is dark, seen at a grazing angle,
        or reflects the light.
        """
        lost = np.zeros(depth.shape, dtype=bool)
        if self.dark_lost and colors is not None:
            lost |= (brightness(colors) < self.dark) & (self._even(depth, generator) < self.dark_lost)
        if self.grazing_lost or self.specular_lost:
            angle = incidence(depth, focal, self.edge)
            draws = self._even(depth, generator)
            lost |= (angle > self.grazing) & (draws < self.grazing_lost)
            lost |= (angle < self.specular) & (draws < self.specular_lost)
        return lost

    def _even(self, depth: Depth, generator: np.random.Generator) -> npt.NDArray[np.floating]:
        """Return uniform random numbers (H, W) from 0 to 1. Neighbouring pixels are correlated in the same way as the
        depth noise.
        """
        from scipy.special import ndtr

        if not self.correlation:
            return generator.random(depth.shape, dtype=np.float32)
        field = _smooth(generator.standard_normal(depth.shape, dtype=np.float32), self.correlation)
        return np.asarray(ndtr(field))

    def _fattened(self, depth: Depth, generator: np.random.Generator) -> Depth:
        """Return depth (H, W), m, in which near objects are enlarged at random parts of their edges."""
        from scipy.ndimage import minimum_filter
        from scipy.special import ndtr

        reach = int(np.ceil(self.fattening))
        if not reach:
            return depth
        field = ndtr(_smooth(generator.standard_normal(depth.shape, dtype=np.float32), self.correlation or FIELD))
        low = np.where(depth > 0, depth, np.float32(np.inf))
        found = depth
        for by in range(1, reach + 1):
            near = minimum_filter(low, 2 * by + 1)
            grown = (depth > 0) & (depth - near > self.edge) & (found == depth) & (by <= field * self.fattening)
            found = np.where(grown, near, found)
        return found


@dataclass(frozen=True, eq=False)
class CameraError:
    """Calibration error of a camera.

    Attributes:
        T: (4, 4) assumed camera pose in the frame of the true camera.
        scale, bias: measured depth = ``scale`` * true depth + ``bias`` (m).
    """

    T: npt.NDArray[np.float64]
    scale: float
    bias: float

    def on(self, depth: Depth) -> Depth:
        """Return the depth (H, W) with the calibration error, m; 0 stays 0."""
        found = np.float32(self.scale) * depth + np.float32(self.bias)
        return np.where((depth > 0) & (found > 0), found, np.float32(0.0))


D435 = DepthNoise(
    correlation=1.0,
    shadow=True,
    fattening=1.5,
    dark=0.08,
    dark_lost=0.3,
    grazing=1.3,
    grazing_lost=0.5,
    specular=0.03,
    specular_lost=0.2,
    spread=0.2,
)
"""Noise of a RealSense D435 at 848 x 480 from published figures; ``gensim2 robot fit-noise`` fits it to your camera."""

DEPLOYED = replace(D435, rotation=0.0035, translation=0.003, scale=0.005, bias=0.002, time=0.01)
"""``D435`` with typical errors in each episode: camera pose 0.2 degrees and 3 mm, depth 0.5 % and 2 mm, clock 10 ms.
"""

PRESETS = {"white": DepthNoise(), "d435": D435, "deployed": DEPLOYED}
"""Presets of depth noise by name."""


def shadows(depth: Depth, baseline: float, focal: float) -> npt.NDArray[np.bool_]:
    """Return a mask (H, W) of pixels that the left camera of a stereo pair sees and the right camera does not.

    Args:
        depth: (H, W) depth of the left camera, m; 0 for no measurement.
        baseline: distance of the cameras, m.
        focal: focal length of the image, pixels.
    """
    seen = depth > 0
    disparity = focal * baseline / np.where(seen, depth, np.inf)
    # column of each pixel in the right image of the stereo pair
    column = np.arange(depth.shape[1])[None, :] - disparity
    beyond = np.full(depth.shape, np.inf)
    beyond[:, :-1] = np.minimum.accumulate(np.where(seen, column, np.inf)[:, :0:-1], axis=1)[:, ::-1]
    return np.asarray(seen & (beyond <= column - 0.5))


def brightness(colors: Colors) -> npt.NDArray[np.float32]:
    weights = np.array([0.299, 0.587, 0.114], dtype=np.float32) / np.float32(255.0)
    return np.asarray(colors.astype(np.float32) @ weights)


def incidence(depth: Depth, focal: float, edge: float) -> npt.NDArray[np.float32]:
    """Return the angle of incidence (H, W), rad: the angle between the camera's axis and the surface normal. If the
    normal of a pixel is unknown, the angle is set to 0.5 rad.

    Args:
        depth: (H, W) depth, m.
        focal: focal length of the image, pixels.
        edge: maximum depth difference between neighbouring pixels on the same object, m.
    """
    slopes = []
    for axis in (0, 1):
        ahead, behind = np.roll(depth, -1, axis), np.roll(depth, 1, axis)
        told = (ahead > 0) & (behind > 0) & (np.abs(ahead - depth) < edge) & (np.abs(behind - depth) < edge)
        slopes.append(np.where(told, 0.5 * (ahead - behind), np.nan))
    with np.errstate(invalid="ignore", divide="ignore"):
        angle = np.arctan(np.hypot(*slopes) * focal / depth)
    angle[[0, -1]], angle[:, [0, -1]] = np.nan, np.nan
    return np.where(np.isfinite(angle) & (depth > 0), angle, 0.5).astype(np.float32)


def _smooth(field: npt.NDArray[np.float32], sigma: float) -> npt.NDArray[np.float32]:
    """Smooth white noise with a Gaussian filter, and scale the result to the standard deviation of the unsmoothed
    noise.
    """
    from scipy.ndimage import gaussian_filter

    return np.asarray(gaussian_filter(field, sigma, mode="wrap") / _weakened(float(sigma)), dtype=np.float32)


@lru_cache(maxsize=64)
def _weakened(sigma: float) -> float:
    from scipy.ndimage import gaussian_filter1d

    one = np.zeros(2 * int(4.0 * sigma + 1.5) + 1)
    one[len(one) // 2] = 1.0
    return float((gaussian_filter1d(one, sigma, mode="constant") ** 2).sum())


def _around(depth: Depth) -> tuple[Depth, Depth]:
    """For each pixel, return the minimum and the maximum depth of the pixel and its four neighbours. Missing
    measurements are ignored.
    """
    low = np.where(depth > 0, depth, np.float32(np.inf))
    near, far = low.copy(), depth.copy()
    for here, there in (
        (np.s_[1:, :], np.s_[:-1, :]),
        (np.s_[:-1, :], np.s_[1:, :]),
        (np.s_[:, 1:], np.s_[:, :-1]),
        (np.s_[:, :-1], np.s_[:, 1:]),
    ):
        near[here] = np.minimum(near[here], low[there])
        far[here] = np.maximum(far[here], depth[there])
    return np.where(np.isfinite(near), near, np.float32(0.0)), far


REMEDY = "make it anew with gensim2 robot fit-noise"


class NoiseFile(BaseModel):
    """Content of a file with fitted noise parameters."""

    model_config = ConfigDict(extra="forbid")

    schema_version: Literal[1] = 1
    noise: dict[str, float | bool]
    told: dict[str, int]


def read_noise(name: str | Path) -> DepthNoise:
    """Return a preset (``white``, ``d435``, ``deployed``), or read a file written by ``gensim2 robot fit-noise``.

    Raises:
        InputError: the name or file does not exist, or a parameter is invalid.
    """
    if str(name) in PRESETS:
        return PRESETS[str(name)]
    found = read_record(Path(name), NoiseFile, REMEDY)
    try:
        return DepthNoise(**found.noise)  # type: ignore[arg-type]
    except TypeError as error:
        raise InputError(str(error), file=name, field="noise", remedy=REMEDY) from error
    except InputError as error:
        raise InputError(error.message, file=name, field=error.field, remedy=REMEDY) from error
