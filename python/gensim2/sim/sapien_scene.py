"""Simulate a scene of the headless environment in SAPIEN. The bodies are added in the same order as in the ManiSkill
environment, because their order affects PhysX's contact solver.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import numpy.typing as npt
import sapien
from sapien.wrapper.articulation_builder import ArticulationBuilder

from gensim2.core.arrays import Array
from gensim2.core.errors import GenSim2Error, InputError
from gensim2.objects import RigidObject
from gensim2.robots import RobotProfile
from gensim2.scenes.initial_state import InitialState, PlacedObject
from gensim2.sim.arm import Arm, built, parsed
from gensim2.sim.objects import check_object
from gensim2.sim.parts import Row
from gensim2.sim.physics import Physics, named_physics, vary
from gensim2.sim.rigid import build_rigid, build_table
from gensim2.sim.sapien_parts import (
    SapienArticulatedPart,
    SapienPart,
    SapienRigidPart,
    SapienRobot,
    articulation_state,
    touched,
)


class SapienScene:
    """A scene in SAPIEN without ManiSkill; see :class:`~gensim2.sim.engines.EngineScene`.

    Files are read once in each process; later changes of a file are ignored.
    """

    def __init__(self, profile: RobotProfile, physics: str, setup: InitialState, robot: bool) -> None:
        self._profile, how = profile, named_physics(physics)
        self.system = how.new_system(profile)
        self.scene = sapien.Scene([self.system])  # without this reference Python would free the scene and its contents
        # The order of bodies is ManiSkill's. The order affects PhysX's contact solver.
        self.arm = Arm(self.scene, profile, how) if robot else None
        build_table(self.scene, visible=False)
        self.parts = {name: _build(self.scene, name, thing, how) for name, thing in setup.objects.items()}
        if setup.has_rigid_objects:
            articulation = None if self.arm is None else self.arm.articulation
            how.prepare_for_rigid_objects(self.system, articulation, profile, setup.rigid_classes)
        if self.arm is not None:
            self.arm.put(setup.start)
        for part in self.parts.values():
            part.put()

    @staticmethod
    def prepare(profile: RobotProfile, physics: str) -> None:
        how = named_physics(physics)
        Arm(sapien.Scene([how.new_system(profile)]), profile, how)

    @property
    def robot(self) -> SapienRobot | None:
        return None if self.arm is None else self.arm.reader

    @property
    def _arm(self) -> Arm:
        if self.arm is None:
            raise GenSim2Error("the scene was built without the robot")
        return self.arm

    def drive(self, action: npt.ArrayLike) -> None:
        self._arm.drive(action)

    def step(self) -> None:
        if self.arm is not None:
            self.arm.transmission.before_substep()
        for part in self.parts.values():
            part.before_substep()
        self.system.step()

    def touched(self) -> frozenset[str]:
        return touched(self.system, self._arm.articulation, list(self.parts.values()))

    def pressing_force(self) -> float:
        links = {link.entity for link in self._arm.articulation.links}
        total = np.zeros(3)
        for contact in self.system.get_contacts():
            first, second = (body.entity in links for body in contact.bodies)
            if first != second:
                total += (1.0 if first else -1.0) * np.sum([point.impulse for point in contact.points], axis=0)
        return float(np.linalg.norm(total) * self._profile.simulation.physics_hz)

    def robot_state(self) -> Row:
        return articulation_state(self._arm.articulation)

    def snapshot(self) -> tuple[Array, str]:
        """Raise an error. SAPIEN cannot read PhysX's stored contacts and impulses, so snapshots would be incomplete.

        Raises:
            InputError: always.
        """
        raise InputError("sapien cannot resume exactly from a stored state", field="engine", remedy="use mujoco")

    def restore(self, state: Array, scene: str) -> None:
        """Raise an error, as :meth:`snapshot` does."""
        self.snapshot()


def _build(scene: sapien.Scene, name: str, thing: PlacedObject, physics: Physics) -> SapienPart:
    pose = sapien.Pose(thing.position, thing.quaternion)
    if isinstance(thing.model, RigidObject):
        part = SapienRigidPart(name, thing, build_rigid(scene, thing.model, pose, name, physics))
        vary([part.body], thing.factors)
        return part
    model = thing.model
    known = _known(model.urdf, model.content_hash, model.asset_class, physics.name)
    articulation = built(known.builder, scene, pose)
    if known.warnings is None:
        known.warnings = check_object(articulation, model)
    vary(articulation.links, thing.factors)
    resistance = physics.resist(articulation, model, thing.factors)
    return SapienArticulatedPart(name, thing, articulation, resistance, known.warnings)


@dataclass
class _Known:
    """Cached data of an articulated object: the parsed URDF, and the warnings about its collision hulls."""

    builder: ArticulationBuilder
    warnings: tuple[str, ...] | None = None


@lru_cache(maxsize=256)
def _known(urdf: Path, content_hash: str, asset_class: str, physics: str) -> _Known:
    how = named_physics(physics)
    return _Known(parsed(str(urdf), prepare=lambda loader: how.prepare_loader(loader, asset_class)))
