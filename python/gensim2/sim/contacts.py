"""Contacts of the robot."""

from __future__ import annotations

import numpy as np
from sapien import physx

from gensim2.sim.parts import ArticulatedPart, Parts


def touched(system: physx.PhysxCpuSystem, robot: physx.PhysxArticulation, parts: Parts) -> frozenset[str]:
    """Names of the objects that press against any link of the robot; bodies that are merely near do not."""
    links = {link.entity for link in robot.links}
    owners = {
        entity: name
        for name, part in parts.items()
        for entity in (
            [link.entity for link in part.articulation.links] if isinstance(part, ArticulatedPart) else [part.entity]
        )
    }
    found = set()
    for contact in system.get_contacts():
        first, second = (body.entity for body in contact.bodies)
        other = second if first in links else first if second in links else None
        if other in owners and any(np.any(point.impulse) for point in contact.points):
            found.add(owners[other])
    return frozenset(found)
