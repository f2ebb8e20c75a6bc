"""Velocity limits that depend on where a joint is: the nearer the end of its range, the slower towards it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Braking:
    """Velocity limits ``-offset + sqrt(gain (upper - q))`` upwards, ``-offset + sqrt(gain (q - lower))`` downwards.

    Beside constant limits; 0 where they would be negative.

    Attributes:
        upper, lower: (m,) rad, where the limits would be ``-offset``.
        gain: (m,) rad/s^2, twice the deceleration that they allow for.
        offset: (m,) rad/s.
    """

    upper: Array
    lower: Array
    gain: Array
    offset: Array

    def scaled(self, share: float) -> Braking:
        """Limits that are a share of these everywhere."""
        return replace(self, gain=share**2 * self.gain, offset=share * self.offset)

    def fastest(self, q: Array) -> tuple[Array, Array]:
        """(..., m) rad/s upwards and downwards, each at least 0, at (..., m) positions (rad)."""
        return self._root(self.upper - q), self._root(q - self.lower)

    def ahead(self, seconds: float) -> Braking:
        """Limits that a joint keeps for so long as it goes on at its velocity.

        ``v = -offset + sqrt(gain (room - v seconds))``, solved for v, is such a limit itself.
        """
        offset = self.offset + 0.5 * self.gain * seconds
        room = (offset**2 - self.offset**2) / self.gain
        return Braking(self.upper + room, self.lower - room, self.gain, offset)

    def range(self) -> tuple[Array, Array]:
        """(m,) lower and upper positions (rad) at which a joint may still come nearer, by a tenth of the offset."""
        room = (1.1 * self.offset) ** 2 / self.gain
        return self.lower + room, self.upper - room

    def rows(self) -> list[tuple[float, float, float, float]]:
        """Upper, lower, gain and offset of each joint, as ``gensim2_kpam.retime`` takes them."""
        columns = (self.upper, self.lower, self.gain, self.offset)
        return [(float(u), float(low), float(k), float(o)) for u, low, k, o in zip(*columns, strict=True)]

    def _root(self, room: Array) -> Array:
        found: Array = np.maximum(np.sqrt(np.maximum(self.gain * room, 0.0)) - self.offset, 0.0)
        return found


FR3 = Braking(
    upper=np.array([2.7501, 1.7918, 2.9065, -0.1458, 2.8101, 4.5205, 3.0196]),
    lower=np.array([-2.7501, -1.7918, -2.9065, -3.0481, -2.8101, 0.54092, -3.0196]),
    gain=np.array([12.0, 5.17, 7.0, 8.0, 34.0, 11.0, 34.0]),
    offset=np.array([0.3, 0.2, 0.2, 0.3, 0.35, 0.35, 0.35]),
)
"""As Franka publishes them for the Research 3; the solver has the same (``limits: "fr3"``)."""
