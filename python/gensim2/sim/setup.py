"""What a reset stands on the table: drawn from the seed, or given by reset options; the same for every simulator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.errors import InputError
from gensim2.objects.types import Instance
from gensim2.sim.arguments import ObjectSource
from gensim2.sim.randomize import draw_scene, openness_at_reset, placed
from gensim2.tasks.spec import TaskSpec

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class SceneSetup:
    """One object, where it stands and how far it is open.

    Attributes:
        instance: the object.
        position: (3,) of its root in the world, m.
        quaternion: (4,) of its root in the world, (w, x, y, z).
        yaw: what the randomization turned it by about the vertical, rad.
        openness: of its joint, 0..1.
    """

    instance: Instance
    position: Array
    quaternion: Array
    yaw: float
    openness: float

    @property
    def joint_value(self) -> float:
        """Value of the joint (rad or m) at that openness."""
        joint = self.instance.joint
        return joint.lower + self.openness * (joint.upper - joint.lower)


def set_up(
    task: TaskSpec, library: ObjectSource, instances: Sequence[str], seed: int, options: Mapping[str, Any]
) -> SceneSetup:
    """Draw the scene of ``seed``; what ``options`` name takes the place of what was drawn.

    Args:
        task: whose ranges are drawn from.
        library: of the objects.
        instances: ids to draw from.
        seed: of the reset.
        options: reset options, checked.

    Raises:
        InputError: there is no such instance, or its files cannot be used.
    """
    draw = draw_scene(task, seed, instances)
    chosen = options.get("instance")
    if chosen is not None and chosen not in library.instances(task.asset_class):
        raise InputError(f"{task.asset_class} has no instance {chosen!r}", field="instance")
    instance = library.load(task.asset_class, chosen or draw.instance)
    if options.get("pose") is not None:
        pose = np.asarray(options["pose"], dtype=np.float64)
        position, quaternion, yaw = pose[:3], pose[3:], 0.0
    else:
        offset = options.get("offset")
        x, y, yaw = (draw.x, draw.y, draw.yaw) if offset is None else map(float, offset)
        position, quaternion = placed(instance.placement.position, instance.placement.quaternion, x, y, yaw)
    given = options.get("openness")
    openness = openness_at_reset(task, draw, instance.default_openness) if given is None else float(given)
    return SceneSetup(instance, position, quaternion, yaw, openness)
