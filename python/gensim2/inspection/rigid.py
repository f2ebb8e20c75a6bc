"""Check a rigid object: its hulls, its resting pose, its mass, and whether it fits the gripper."""

from __future__ import annotations

import numpy as np

from gensim2.core.errors import MissingExtraError
from gensim2.inspection.checks import Finding
from gensim2.objects.types import BODY, RigidObject
from gensim2.robots import robot

MAX_HULLS = 64
MASSES = (0.002, 2.0)  # kg, minimum and maximum mass
REST_SECONDS = 5.0
REST_DRIFT, REST_TURN = 0.005, np.radians(5)  # limits on the translation (m) and rotation (rad) of a resting object
BASE_HEIGHT = 0.001  # m, maximum distance of the lowest point from the table
KEYPOINT_DISTANCE = 0.02  # a keypoint may lie at most this far (m) outside the object's bounding box
TIME_STEP = 0.01
SPARE = 0.004  # m, the open fingers must be at least this much farther apart than the object is wide


def geometric_findings(rigid: RigidObject) -> list[Finding]:
    findings: list[Finding] = []

    def at_most(check: str, value: float, limit: float) -> None:
        if value > limit:
            findings.append(Finding(check, float(value), limit))

    at_most("hull_count", len(rigid.hulls[BODY]), MAX_HULLS)
    at_most("mass", rigid.mass, MASSES[1])
    at_most("mass_least", MASSES[0], rigid.mass)
    at_most("grip_width", rigid.grip.width, robot().gripper.widest - SPARE)
    points = np.concatenate(rigid.hulls[BODY])
    R = rigid.placement.rotation
    at_most("base_height", abs(float((points @ R[2]).min() + rigid.placement.position[2])), BASE_HEIGHT)
    low, high = points.min(axis=0), points.max(axis=0)
    for name, keypoint in rigid.keypoints.items():
        beyond = np.maximum(np.maximum(low - keypoint.position, keypoint.position - high), 0)
        at_most(f"keypoint_distance: {name}", float(np.linalg.norm(beyond)), KEYPOINT_DISTANCE)
    return findings


def physical_findings(rigid: RigidObject) -> list[Finding]:
    """Simulate the object on a table for five seconds, and return the failed checks.

    Raises:
        InputError: the physics engine drops or changes a hull of the object.
    """
    try:
        import sapien

        from gensim2.sim.rigid import check_shapes, fill, resting_pose
    except ImportError as error:
        raise MissingExtraError("sapien", "sim") from error
    system = sapien.physx.PhysxCpuSystem()
    scene = sapien.Scene([system])
    scene.set_timestep(TIME_STEP)
    table = scene.create_actor_builder()
    table.add_box_collision(sapien.Pose([0, 0, -0.05]), [1, 1, 0.05])
    table.build_static("table")
    builder = scene.create_actor_builder()
    fill(builder, rigid, visual=False)
    builder.initial_pose = start = resting_pose(rigid)
    body = builder.build(rigid.asset_class).find_component_by_type(sapien.physx.PhysxRigidDynamicComponent)
    check_shapes(body.get_collision_shapes(), rigid)
    for _ in range(round(REST_SECONDS / TIME_STEP)):
        scene.step()
    moved = start.inv() * body.entity.pose
    drift = float(np.linalg.norm(body.entity.pose.p - start.p))
    turn = 2 * float(np.arccos(min(abs(float(moved.q[0])), 1.0)))
    findings = []
    if not drift <= REST_DRIFT:
        findings.append(Finding("rest_drift", drift, REST_DRIFT))
    if not turn <= REST_TURN:
        findings.append(Finding("rest_turn", turn, float(REST_TURN)))
    return findings
