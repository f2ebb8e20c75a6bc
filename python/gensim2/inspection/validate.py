"""Check objects in two stages: first check the geometry of an object, then simulate the object without rendering."""

from __future__ import annotations

import re
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from typing import Any

import numpy as np

import gensim2_kpam as kpam
from gensim2.core.errors import InputError, MissingExtraError
from gensim2.core.processes import WorkerPool, enumerated, in_order
from gensim2.inspection import rigid
from gensim2.inspection.checks import Finding, geometric_findings
from gensim2.objects.library.catalogue import Library
from gensim2.objects.physics import GRAVITY, class_rule, inertial
from gensim2.objects.shapes import transform
from gensim2.objects.types import Array, ArticulatedObject, RigidObject
from gensim2.robots import RobotProfile, robot
from gensim2.scenes.table import HALF_SIZE

SHARES = (0.0, 0.5, 1.0)  # values of openness at which objects are checked
FINGERTIPS = 0.01  # m, maximum distance between fingertips and keypoint
HEAD = "articulated_object_head"
BUDGET: kpam.Options = {
    "candidates": 4,
    "samples": 50,
    "extra_seeds": 0,
}  # A small budget is enough, because the solver finds a path to the keypoint either quickly or not at all.


def reach_findings(instance: ArticulatedObject, profile: RobotProfile) -> list[Finding]:
    """Check whether the robot's fingertips can reach an object's head keypoint, at several values of openness.

    The hand must stay above the table. Each openness at which the keypoint is out of reach is a finding. The finding
    has the remaining distance in mm, or names the table.

    The head keypoint is ``articulated_object_head``, or else the first keypoint.

    Raises:
        MissingExtraError: the robot's files are in a package that is not installed.
    """
    name = HEAD if HEAD in instance.keypoints else next(iter(instance.keypoints))
    found = []
    for share in SHARES:
        plan = kpam.plan(_problem(in_base(instance, name, share, profile), profile))
        if plan.status == "solved":
            continue
        check, missed = f"fingertips from {name} at openness {share:g}, mm", plan.residuals[0]
        if missed["satisfied"]:
            found.append(Finding(check, plan.reason, 1000 * FINGERTIPS))
        else:
            found.append(Finding(check, round(1000 * missed["residual"], 1), 1000 * FINGERTIPS))
    return found


def in_base(instance: ArticulatedObject, name: str, openness: float, profile: RobotProfile) -> Array:
    """Return a keypoint (3,) in the robot's base frame, m, with the object in its default placement."""
    keypoint = instance.keypoints[name]
    point = keypoint.position
    if keypoint.link == instance.joint.child_link:
        point = transform(instance.link_pose(openness), point[None])[0]
    T_base_world = np.linalg.inv(profile.T_world_base)
    at = instance.placement.rotation @ point + instance.placement.position
    return np.asarray(T_base_world[:3, :3] @ at + T_base_world[:3, 3])


@cache
def _config() -> kpam.SolverConfig:
    constraint = {
        "type": "point2point_constraint",
        "keypoint_name": "tool_head",
        "target_keypoint_name": HEAD,
        "tolerance": FINGERTIPS,
    }
    return kpam.SolverConfig(
        {"constraint_list": [constraint], "pre_actuation_motions": [], "post_actuation_motions": []}
    )


def _table(profile: RobotProfile) -> kpam.Body:
    T_world_table = np.eye(4)
    T_world_table[2, 3] = -HALF_SIZE[2]
    T_base_table = np.linalg.inv(profile.T_world_base) @ T_world_table
    return kpam.Body("table", "table", [kpam.Shape.box(HALF_SIZE)], T_base_table)


def _problem(head: Array, profile: RobotProfile) -> kpam.KeypointProblem:
    return kpam.KeypointProblem(
        profile.model,
        _config(),
        np.array(profile.reset_qpos),
        tool_keypoints=profile.tool_keypoints,
        object_keypoints={HEAD: head},
        T_base_object=np.eye(4),
        bodies=[_table(profile)],
        options={**profile.solver, **BUDGET},
    )


REST_SECONDS = 5.0
REST_DRIFT = 0.02  # maximum change of openness at rest
LOAD_FACTOR = 1.5  # The joint must move if the force on it is this many times the resistance by gravity and friction.
SWEEP_SECONDS = 6.0
PUSH_ON_SECONDS = 0.5  # s, duration of the final push against the joint limit
BODY_DRIFT = 1e-4  # m, maximum displacement of the fixed body while the joint is pushed
TIME_STEP = 0.01
CONTROL_STEPS = 5


@dataclass(frozen=True)
class ObjectReport:
    """Report on one object: its failed checks. The object is sound if no check failed.

    ``seconds`` is the time needed to load and check the object.
    """

    asset_class: str
    id: str
    findings: tuple[Finding, ...]
    seconds: float

    @property
    def sound(self) -> bool:
        return not self.findings

    def to_dict(self) -> dict[str, Any]:
        """Return ``class``, ``id``, ``sound`` and ``findings`` (``check``, ``value``, ``limit``)."""
        return {
            "class": self.asset_class,
            "id": self.id,
            "sound": self.sound,
            "findings": [asdict(f) for f in self.findings],
        }


def check_object(library: Library, asset_class: str, instance_id: str, physics: bool = True) -> ObjectReport:
    """Check one object; if the object cannot be loaded, report this as a finding and raise no error.

    Example:
        ```python
        report = check_object(gensim2.open_library("builtin"), "drawer", "4711")
        print(report.findings)
        ```
    """
    started = time.perf_counter()
    try:
        findings = _findings(library.load(asset_class, instance_id), physics)
    except InputError as error:
        findings = [Finding("loads", str(error), "no error")]
    return ObjectReport(asset_class, instance_id, tuple(findings), time.perf_counter() - started)


def _findings(model: ArticulatedObject | RigidObject, physics: bool) -> list[Finding]:
    if isinstance(model, RigidObject):
        return rigid.geometric_findings(model) + (rigid.physical_findings(model) if physics else [])
    return geometric_findings(model) + (physical_findings(model) + reach_findings(model, robot()) if physics else [])


def validate(
    library: Library, items: Sequence[tuple[str, str]], physics: bool = True, workers: int = 0
) -> Iterator[ObjectReport]:
    """Check objects, and yield their reports in the order of ``items``.

    Args:
        items: (class, id) of each object to check.
        physics: whether to simulate; otherwise only the geometry is checked.
        workers: number of processes. 0 uses this process. A crashed worker becomes a finding.

    Raises:
        MissingExtraError: ``physics`` is set and SAPIEN is not installed.
    """
    modules = ("gensim2.inspection.validate", "gensim2.sim.objects") if physics else ("gensim2.inspection.validate",)
    with WorkerPool(workers, preload=modules) as pool:
        jobs = enumerated((library, *item, physics) for item in items)
        for outcome in in_order(pool.map_unordered(check_object, jobs)):
            if outcome.failures:
                finding = Finding("loads", outcome.failures[-1].reason, "no error")
                yield ObjectReport(*items[outcome.index], (finding,), 0.0)
            else:
                yield outcome.unwrap()


def summary(library: Library, reports: Sequence[ObjectReport]) -> dict[str, Any]:
    """Return a summary as JSON data.

    The summary has the numbers of ``objects``, of ``sound`` objects, and of findings by check.
    """
    checks = Counter(check for report in reports for check in {family(f.check) for f in report.findings})
    return {
        "schema_version": 1,
        "library": library.name,
        "objects": [report.to_dict() for report in reports],
        "sound": sum(report.sound for report in reports),
        "checks": dict(checks.most_common()),
    }


def family(check: str) -> str:
    """Return the name of a check with X in place of numbers, so that similar checks are counted together."""
    return re.sub(r"\b(openness|from|hull) [\d.]+", r"\1 X", check)


def physical_findings(instance: ArticulatedObject) -> list[Finding]:
    """Check an object in simulation: its hulls, its drift at rest, and the motion of its joint over the whole range.

    The joint is driven by 1.5 times the force or torque that is needed to overcome gravity and the joint's friction.

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
        if not abs(reached - goal) <= REST_DRIFT:
            found.append(Finding(f"openness reached from {start:g} under load", round(reached, 4), goal))
        body = stage.body_moved()
        if not body <= BODY_DRIFT:
            found.append(Finding(f"body moved from {start:g} under load, mm", round(1000 * body, 3), 1000 * BODY_DRIFT))
    return found


class _Stage:
    """One object in an empty SAPIEN scene, without rendering."""

    def __init__(self, instance: ArticulatedObject) -> None:
        try:
            import sapien
            from sapien.physx import PhysxCpuSystem

            from gensim2.sim import objects
            from gensim2.sim.physics import DEFAULT
        except ImportError as error:
            raise MissingExtraError("sapien", "sim") from error
        self.instance, self._sim = instance, objects
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
        self._resistance = DEFAULT.resist(self._object, instance)

    def whole(self) -> list[Finding]:
        """Return a finding for each collision hull that the physics engine ignored or whose shape it changed."""
        found = []
        for link in self._object.links:
            hulls, shapes = self.instance.hulls.get(link.name, ()), link.collision_shapes
            if len(shapes) != len(hulls):
                found.append(Finding(f"hulls of {link.name} in physics", len(shapes), len(hulls)))
                continue
            for number, (hull, shape) in enumerate(zip(hulls, shapes, strict=True)):
                lost, grown = self._sim.cooking_misfit(hull, shape)
                if not self._sim.cooking_is_fair(hull, lost, grown):
                    off = round(1000 * max(lost, grown), 1)
                    found.append(
                        Finding(
                            f"hull {number} of {link.name} in physics, mm off", off, 1000 * self._sim.HULL_TOLERANCE
                        )
                    )
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

    def _run(self, seconds: float) -> None:
        for step in range(round(seconds / TIME_STEP)):
            if step % CONTROL_STEPS == 0:
                self._resistance.update()
            self._scene.step()

    def rest(self, openness: float) -> float:
        """Return by how much the openness changes when nothing touches the object."""
        self._set(openness)
        self._run(REST_SECONDS)
        return self._openness() - openness

    def sweep(self, start: float, goal: float) -> float:
        """Push the joint to ``goal`` with 1.5 times its resistance, and then briefly further.

        Return the reached openness.
        """
        instance, joint = self.instance, self.instance.joint
        moving = inertial(list(instance.hulls[joint.child_link]), class_rule(instance.asset_class).density)
        gravity = instance.placement.rotation.T @ GRAVITY
        self._set(start)
        sign = np.sign(goal - start)
        force, farthest, left = 0.0, sign * start, round(PUSH_ON_SECONDS / TIME_STEP)
        for step in range(round(SWEEP_SECONDS / TIME_STEP)):
            openness = self._openness()
            farthest = max(farthest, sign * openness)
            if abs(openness - goal) < 0.5 * REST_DRIFT or sign * (openness - goal) > 0:
                left -= 1
                if left < 0:
                    break
            if step % CONTROL_STEPS == 0:
                self._resistance.update()
                T = instance.link_pose(float(np.clip(openness, 0, 1)))
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
            self._object.set_qf(np.array([force], np.float32))  # PhysX resets the force after every step
            self._scene.step()
        return float(sign * max(farthest, sign * self._openness()))

    def body_moved(self) -> float:
        """Return how far (m) the object's root link has moved from its initial position."""
        return float(np.linalg.norm(self._object.root_pose.p - self.instance.placement.position))
