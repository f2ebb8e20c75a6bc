"""Convert the scenes of an episode to solver scenes. Bodies are converted once; later only states change."""

from __future__ import annotations

import numpy as np

import gensim2_kpam as kpam
from gensim2.core.arrays import Array
from gensim2.planning.landmarks import UPRIGHT, UPRIGHT_HEIGHT
from gensim2.planning.scene import Scene, SceneBody, SceneObject
from gensim2.robots import RobotProfile

#: Name of the table in a scene.
TABLE = "table"


class PlanningWorld:
    """Converts the scenes of one episode to solver scenes; the bodies are converted once.

    Args:
        profile: profile of the robot.
    """

    def __init__(self, profile: RobotProfile) -> None:
        self._profile = profile
        self._built: kpam.Scene | None = None
        self._first: Scene | None = None

    def of(self, scene: Scene) -> kpam.Scene:
        """Return the solver's scene with the joints, rigid objects and grasped object of ``scene``.

        A rigid object inside a part that a joint moves, such as a drawer, moves with that joint.
        """
        if self._built is None or self._first is None or not _same_bodies(self._first, scene):
            self._built, self._first = self._build(scene), scene
        world, first = self._built, self._first
        for name, thing in scene.objects.items():
            before = first.objects[name]
            if thing.joint is not None and before.joint is not None and thing.joint.value != before.joint.value:
                world = world.with_joint(name, float(np.clip(thing.joint.value, thing.joint.lower, thing.joint.upper)))
        for name, thing in scene.objects.items():
            if thing.is_rigid:
                pose = thing.bodies[0].T_base_body
                if not np.array_equal(pose, first.objects[name].bodies[0].T_base_body):
                    world = world.with_pose(name, pose)
                carrier = None if name == scene.held else carried_by(scene, name)
                if carrier is not None:
                    world = world.attached(name, self.joints(scene)).detached(name, self.joints(scene), on=carrier)
        if scene.held is not None:
            world = world.attached(scene.held, self.joints(scene))
        return world

    def joints(self, scene: Scene) -> Array:
        """Return the robot's joints (n,), clipped to their limits."""
        model = self._profile.model
        return np.asarray(np.clip(scene.q, model.lower, model.upper), dtype=np.float64)

    def _build(self, scene: Scene) -> kpam.Scene:
        T_base_world = np.linalg.inv(scene.T_world_base)
        bodies = [_body(body, "table" if body.name == TABLE else "rigid") for body in scene.fixtures]
        joints = []
        for name, thing in scene.objects.items():
            if thing.joint is None:
                T_body_base = np.linalg.inv(thing.bodies[0].T_base_body)
                upright = next(iter(thing.keypoints.values())) + UPRIGHT_HEIGHT * T_base_world[:3, 2]
                named = {**thing.points, UPRIGHT: upright}
                points = {key: T_body_base[:3, :3] @ at + T_body_base[:3, 3] for key, at in named.items()}
                bodies.append(_body(thing.bodies[0], "rigid", points))
                continue
            bodies += [_body(body, "object_body") for body in thing.bodies]
            state = thing.joint
            value = float(np.clip(state.value, state.lower, state.upper))
            joint = kpam.Joint(state.type, state.origin, state.axis, value, state.lower, state.upper)
            joints.append(kpam.SceneJoint(name, joint, list(state.moves)))
        return kpam.Scene(self._profile.model, bodies, joints)


def _body(body: SceneBody, role: str, keypoints: dict[str, Array] | None = None) -> kpam.Body:
    shapes = [kpam.Shape.convex_hull(np.ascontiguousarray(hull)) for hull in body.hulls]
    return kpam.Body(body.name, role, shapes, body.T_base_body, keypoints=keypoints)  # type: ignore[arg-type]


def _same_bodies(one: Scene, other: Scene) -> bool:
    """Return whether two scenes have the same bodies with the same hulls, which is true for scenes of one episode."""
    first, second = one.bodies, other.bodies
    return len(first) == len(second) and all(
        a.name == b.name and a.hulls is b.hulls for a, b in zip(first, second, strict=True)
    )


def carried_by(scene: Scene, name: str) -> str | None:
    """Return the name of the articulated object whose moving part encloses a rigid object's centre, or None."""
    thing = scene.objects[name]
    center = np.zeros(3) if thing.center_of_mass is None else thing.center_of_mass
    point = thing.T_base_object[:3, :3] @ center + thing.T_base_object[:3, 3]
    return next((other.name for other in scene.objects.values() if _encloses(other, point)), None)


def _encloses(thing: SceneObject, point: Array) -> bool:
    if thing.joint is None:
        return False
    from scipy.spatial import ConvexHull, QhullError  # imported here because checking a strategy does not need SciPy

    parts = [
        hull @ body.T_base_body[:3, :3].T + body.T_base_body[:3, 3]
        for body in thing.bodies
        if body.name in thing.joint.moves
        for hull in body.hulls
    ]
    if not parts:
        return False
    points = np.concatenate(parts)
    if (point < points.min(axis=0)).any() or (point > points.max(axis=0)).any():
        return False
    try:
        hull = ConvexHull(points)
    except QhullError:  # a flat body has no volume that could enclose an object
        return False
    return bool((hull.equations[:, :3] @ point + hull.equations[:, 3] <= 0).all())
