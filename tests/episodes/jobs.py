"""Jobs for the tests of this folder: plain functions that a worker can import."""

from __future__ import annotations

from functools import cache

import numpy as np
import numpy.typing as npt
import pinocchio as pin
from gensim2.demos.rollout import EpisodeResult

from gensim2.planning.scene import Scene
from gensim2.robots import CLOSED, robot

HALFWAY = {
    "name": "PushDrawerHalfway",
    "description": "push the drawer in a good deal further",
    "asset_class": "drawer",
    "success": [{"type": "articulated_closed", "threshold": 0.3}],
    "randomization": {"x": 0.03, "y": 0.03, "yaw": 0.2},
    "max_episode_steps": 120,
}
"""A task that the library does not have, and that a plain push does."""


def push(scene: Scene) -> npt.NDArray[np.float64]:
    """(N, 8) actions that come down in front of the drawer's handle and push it in; the hand points down."""
    head, axis = scene.object_keypoints["articulated_object_head"], scene.joint.axis
    above, before = head + 0.1 * axis + [0.0, 0.0, 0.15], head + 0.1 * axis
    inside = head - (scene.joint.value - scene.joint.lower) * axis
    waypoints = [above, before, *np.linspace(before, inside, 6)[1:]]
    path, q = [], scene.q.copy()
    for point, steps in zip(waypoints, [20, 10, 6, 6, 6, 6, 6], strict=True):
        goal = _reach(q, point)
        path.append(np.linspace(q[:7], goal[:7], steps, endpoint=False))
        q = goal
    joints = np.concatenate([*path, q[None, :7]])
    return np.column_stack([joints, np.full(len(joints), CLOSED)])


def hold() -> npt.NDArray[np.float64]:
    """(30, 8) actions of an arm that stays where it is."""
    return np.tile([*robot().reset_qpos[:7], CLOSED], (30, 1))


def _reach(q: npt.NDArray[np.float64], point: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Joints near ``q`` that bring the fingertips to ``point`` (base frame) with the hand pointing down."""
    model, data, frame = _panda()
    down = pin.SE3(np.diag([1.0, -1.0, -1.0]), point + np.array([0.0, 0.0, 0.105]))
    for _ in range(200):
        pin.framesForwardKinematics(model, data, q)
        error = pin.log6(data.oMf[frame].actInv(down)).vector
        jacobian = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL)[:, :7]
        step = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + 1e-4 * np.eye(6), error)
        q = np.concatenate([q[:7] + step, q[7:]])
    assert np.linalg.norm(error) < 1e-2, "out of reach"
    return q


@cache
def _panda() -> tuple[pin.Model, pin.Data, int]:
    from mani_skill import PACKAGE_ASSET_DIR

    model = pin.buildModelFromUrdf(str(PACKAGE_ASSET_DIR / "robots/panda/panda_v2.urdf"))
    return model, model.createData(), model.getFrameId("panda_hand")


def record(seed: int) -> EpisodeResult:
    """One recorded episode of ``HALFWAY``: the arm pushes on even seeds and stays still on odd ones."""
    from gensim2.demos.rollout import run_episode

    from gensim2.sim.lane import Lane

    lane = Lane(HALFWAY, assets="builtin")
    lane.reset(seed)
    return run_episode(lane, hold() if seed % 2 else push(lane.scene_state()), record=True)
