"""Whether an object is sound: geometry first, then physics without pictures."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from gensim2.assets.checks import Finding, geometric_findings, link_pose, world_rotation
from gensim2.assets.library import Library
from gensim2.assets.physics import GRAVITY, class_rule, inertial
from gensim2.assets.types import Instance
from gensim2.errors import InputError

REST_SECONDS = 5.0
REST_DRIFT = 0.02  # openness
LOAD_FACTOR = 1.5  # times gravity and friction moves the joint through its range
SWEEP_SECONDS = 6.0
TIME_STEP = 0.01
CONTROL_STEPS = 5


@dataclass(frozen=True)
class ObjectReport:
    """Findings about one object; sound where there are none.

    ``seconds`` is what loading and checking took.
    """

    asset_class: str
    id: str
    findings: tuple[Finding, ...]
    seconds: float

    @property
    def sound(self) -> bool:
        return not self.findings

    def to_dict(self) -> dict[str, Any]:
        """``class``, ``id``, ``sound``, ``findings`` (``check``, ``value``, ``limit``)."""
        return {
            "class": self.asset_class,
            "id": self.id,
            "sound": self.sound,
            "findings": [asdict(f) for f in self.findings],
        }


def validate(library: Library, items: Sequence[tuple[str, str]], physics: bool = True) -> Iterator[ObjectReport]:
    """Check (class, id) pairs one after the other; an object that cannot be used is a finding, not an error."""
    for asset_class, instance_id in items:
        started = time.perf_counter()
        try:
            instance = library.load(asset_class, instance_id)
        except InputError as error:
            findings = [Finding("loads", str(error), "no error")]
        else:
            findings = geometric_findings(instance)
            if physics:
                findings += physical_findings(instance)
        yield ObjectReport(asset_class, instance_id, tuple(findings), time.perf_counter() - started)


def physical_findings(instance: Instance) -> list[Finding]:
    """Loads whole; stays where it is left; moves through its whole range under 1.5 times its load.

    Raises:
        MissingExtraError: SAPIEN is not installed.
    """
    stage = _Stage(instance)
    found = stage.whole()
    shares = [0.0, 0.5, 1.0]
    for share in shares:
        moved = stage.rest(share)
        if not abs(moved) <= REST_DRIFT:
            found.append(Finding(f"drift in {REST_SECONDS:g} s from {share:g}", round(moved, 4), REST_DRIFT))
    for start, goal in ((0.0, 1.0), (1.0, 0.0)):
        reached = stage.sweep(start, goal)
        if abs(reached - goal) > REST_DRIFT:
            found.append(Finding(f"openness reached from {start:g} under load", round(reached, 4), goal))
    return found


class _Stage:
    """One object in an empty SAPIEN scene, physics only."""

    def __init__(self, instance: Instance) -> None:
        try:
            import sapien
            from sapien.physx import PhysxCpuSystem

            from gensim2.sim.objects import CREEP_SPEED
        except ImportError as error:
            from gensim2.errors import MissingExtraError

            raise MissingExtraError("sapien", "sim") from error
        self.instance, self._creep_speed = instance, CREEP_SPEED
        sapien.physx.set_scene_config(enable_tgs=True)
        system = PhysxCpuSystem()
        system.timestep = TIME_STEP
        self._scene = sapien.Scene([system])
        loader = self._scene.create_urdf_loader()
        builder = loader.parse(str(instance.urdf))[0][0]
        for link in builder.link_builders:
            link.visual_records.clear()
        self._object = builder.build(fix_root_link=True)
        place = instance.placement
        self._object.set_root_pose(sapien.Pose(place.position, place.quaternion))
        self._joint = self._object.active_joints[0]
        self._joint.set_friction(0.0)  # PhysX's own is a share of the load that the joint carries, 0.05 by default

    def whole(self) -> list[Finding]:
        """Nothing vanished on the way into the physics engine."""
        found = []
        for link in self._object.links:
            promised = len(self.instance.hulls.get(link.name, ()))
            if len(link.collision_shapes) != promised:
                found.append(Finding(f"hulls of {link.name} in physics", len(link.collision_shapes), promised))
        if len(self._object.active_joints) != 1:
            found.append(Finding("moving joints", len(self._object.active_joints), 1))
        return found

    def _set(self, openness: float) -> None:
        joint = self.instance.joint
        self._object.set_qpos(np.array([joint.lower + openness * (joint.upper - joint.lower)], np.float32))
        self._object.set_qvel(np.zeros(1, np.float32))
        self._object.set_qf(np.zeros(1, np.float32))

    def _openness(self) -> float:
        joint = self.instance.joint
        return (float(self._object.qpos[0]) - joint.lower) / (joint.upper - joint.lower)

    def _friction(self) -> None:
        speed = float(self._object.qvel[0])
        joint = self.instance.joint
        limit = joint.friction + joint.damping * abs(speed)
        self._joint.set_drive_properties(0.0, limit / self._creep_speed, limit, "force")

    def _run(self, seconds: float) -> None:
        for step in range(round(seconds / TIME_STEP)):
            if step % CONTROL_STEPS == 0:
                self._friction()
            self._scene.step()

    def rest(self, openness: float) -> float:
        """Change of openness of an object that is left alone."""
        self._set(openness)
        self._run(REST_SECONDS)
        return self._openness() - openness

    def sweep(self, start: float, goal: float) -> float:
        """Openness reached from ``start`` under 1.5 times the load of gravity and friction towards ``goal``."""
        instance, joint = self.instance, self.instance.joint
        moving = inertial(list(instance.hulls[joint.child_link]), class_rule(instance.asset_class).density)
        R_world_root = world_rotation(instance)
        gravity = R_world_root.T @ GRAVITY
        self._set(start)
        sign = np.sign(goal - start)
        force = 0.0
        for step in range(round(SWEEP_SECONDS / TIME_STEP)):
            openness = self._openness()
            if abs(openness - goal) < 0.5 * REST_DRIFT:
                break
            if step % CONTROL_STEPS == 0:
                self._friction()
                T = link_pose(instance, float(np.clip(openness, 0, 1)))
                center = T[:3, :3] @ moving.center + T[:3, 3]
                weight = moving.mass * gravity
                load = (
                    float(weight @ joint.axis)
                    if joint.type == "prismatic"
                    else float(np.cross(center - joint.origin, weight) @ joint.axis)
                )
                against = max(-sign * load, 0.0)
                force = (
                    sign * LOAD_FACTOR * (against + joint.friction + joint.damping * abs(float(self._object.qvel[0])))
                )
            self._object.set_qf(np.array([force], np.float32))  # PhysX forgets it after every step
            self._scene.step()
        return self._openness()
