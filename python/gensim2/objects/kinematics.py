"""Forward kinematics of one joint: the only place that says how far a joint's value moves what hangs on it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def joint_motion(kind: str, axis: Array, value: npt.ArrayLike, origin: Array | None = None) -> Array:
    """Return the rigid motion from joint value zero, in the frame of ``axis`` and ``origin``.

    Args:
        kind: ``"prismatic"``, or ``"revolute"`` or ``"continuous"``.
        axis: (3,) unit axis.
        value: rad or m, of any shape.
        origin: (3,) m, a point on the axis; None: the frame's own origin.

    Returns:
        (..., 4, 4), one for each value.
    """
    values = np.asarray(value, dtype=np.float64)[..., None]
    found = np.zeros((*values.shape[:-1], 4, 4))
    found[...] = np.eye(4)
    if kind == "prismatic":
        found[..., :3, 3] = values * axis
        return found
    from scipy.spatial.transform import Rotation  # here: whoever only names objects needs no SciPy

    found[..., :3, :3] = Rotation.from_rotvec(values * axis).as_matrix()
    if origin is not None:
        found[..., :3, 3] = origin - found[..., :3, :3] @ origin
    return found
