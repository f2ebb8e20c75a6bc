"""Bridge to ManiSkill: objects in its scenes, ready to be read, and spared time."""

from __future__ import annotations

import gc
from functools import cache

import sapien
from mani_skill.envs.scene import ManiSkillScene

from gensim2.objects import RigidObject
from gensim2.scenes.initial_state import PlacedObject
from gensim2.sim.objects import load_object
from gensim2.sim.physics import Physics, vary
from gensim2.sim.rigid import load_rigid
from gensim2.sim.sapien_parts import SapienArticulatedPart, SapienPart, SapienRigidPart


def build_part(scene: ManiSkillScene, name: str, thing: PlacedObject, physics: Physics) -> SapienPart:
    """Build an object where it was put.

    Raises:
        InputError: the physics engine made something else of it.
    """
    pose = sapien.Pose(thing.position, thing.quaternion)
    if isinstance(thing.model, RigidObject):
        part = SapienRigidPart(name, thing, load_rigid(scene, thing.model, pose, name, physics)._objs[0])
        vary([part.body], thing.factors)
        return part
    built, warnings = load_object(scene, thing.model, pose, name, physics)
    articulation = built._objs[0]
    vary(articulation.links, thing.factors)
    resistance = physics.resist(articulation, thing.model, thing.factors)
    return SapienArticulatedPart(name, thing, articulation, resistance, warnings)


@cache
def spare_imports_from_collection() -> None:
    """Exempt what is alive now, ManiSkill's and torch's modules above all, from garbage collection, once a
    process.

    ManiSkill runs a full collection at every reset; this makes it cost 2 ms instead of 180.
    """
    gc.collect()
    gc.freeze()
