"""Define the type of arrays in computations."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
"""Array of double precision; docstrings give its shape, unit and frame."""
