"""Model of a rigid object."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from gensim2.objects.types import Array, Keypoint, Placement, Source

BODY = "body"
"""Name of the only link."""
ONLY_ID = "0"
"""Id of the only instance of a class of rigid objects."""


@dataclass(frozen=True)
class Grip:
    """Grasp of two parallel fingers on the object at rest, as long as nothing else is in the way.

    Attributes:
        point: (3,) middle between the fingertips, metres in the object frame.
        axis: (3,) unit direction in which the fingers close, object frame; level when the object rests.
        width: metres between the fingertips.
    """

    point: Array
    axis: Array
    width: float


@dataclass(frozen=True)
class RigidObject:
    """A rigid object ready to be simulated and planned for; the object frame is that of its only link.

    Attributes:
        asset_class: its name, for example ``"mug"``; it is the only one of its class.
        source: ``"generated"`` or ``"real"``.
        folder: prepared files: ``visual.glb`` and ``hull_<i>.obj``, object frame, metres.
        hulls: ``"body"`` to convex collision parts, each (N, 3) metres in the object frame.
        mass: kg.
        center_of_mass: (3,) metres in the object frame.
        inertia: (3, 3) kg m² about the centre of mass, along the axes of the object frame.
        friction: of its surface, static and dynamic.
        keypoints: by name, on ``"body"``; ``rigidbody_object_head`` always, ``rigidbody_object_tail`` where it has two
            ends.
        placement: pose, object to world, in which it stays on a table at z = 0, its origin above the world's.
        grip: the narrowest hold in that pose.
        license: terms that the data carries.
        content_hash: hex digest of everything that the object was made from.
        warnings: what was odd and by which rule it was repaired.
    """

    asset_class: str
    source: Source
    folder: Path
    hulls: dict[str, tuple[Array, ...]]
    mass: float
    center_of_mass: Array
    inertia: Array
    friction: float
    keypoints: dict[str, Keypoint]
    placement: Placement
    grip: Grip
    license: str
    content_hash: str
    warnings: tuple[str, ...] = field(default=())

    @property
    def id(self) -> str:
        """``"0"``."""
        return ONLY_ID

    @property
    def joint(self) -> None:
        """It has none."""
        return None

    @property
    def size(self) -> Array:
        """(3,) extents in metres along the axes of the object frame."""
        return np.asarray(np.ptp(np.concatenate(self.hulls[BODY]), axis=0))

    @property
    def visual(self) -> Path | None:
        """File to look at, or None where the object has none."""
        file = self.folder / "visual.glb"
        return file if file.is_file() else None

    def hull_file(self, index: int) -> Path:
        """Wavefront OBJ of collision part ``index``."""
        return self.folder / f"hull_{index}.obj"
