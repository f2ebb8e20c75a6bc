"""Jobs and controllers for the tests of this folder, which workers import by name."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from gensim2.planning.scene import Scene
from gensim2.robots import CLOSED, robot
from gensim2.rollout.controller import Action, PrivilegedObservation
from gensim2.rollout.recording import EpisodeResult

Array = npt.NDArray[np.float64]

HALFWAY = {
    "name": "PushDrawerHalfway",
    "description": "push the drawer in a good deal further",
    "asset_class": "drawer",
    "success": [{"type": "articulated_closed", "threshold": 0.3}],
    "randomization": {"x": 0.03, "y": 0.03, "yaw": 0.2},
    "max_episode_steps": 120,
}
"""A task that is not in the library, and that a plain push does."""

ROLE = "object"
"""Name of its object, as in every file of schema version 1."""

BESIDE_A_BALL = {
    "schema_version": 2,
    "name": "PushDrawerBesideBall",
    "description": "push the drawer in a good deal further, beside a ball",
    "objects": {
        ROLE: {"class": "drawer", "randomization": {"x": [-0.03, 0.03], "y": [-0.03, 0.03], "yaw": 0.2}},
        "ball": {"class": "golf_ball", "place": {"at": [-0.2, -0.45]}},
    },
    "steps": [
        {
            "name": "push",
            "object": ROLE,
            "strategies": ["push"],
            "done": [{"type": "articulated_closed", "object": ROLE, "threshold": 0.3}],
        }
    ],
    "max_episode_steps": 120,
}
"""The same task with a second object."""


class Actions:
    """A controller that executes actions that were computed from the initial scene.

    Args:
        decide: scene to (N, 8) actions.
    """

    privileged = True

    def __init__(self, decide: Callable[[Scene], Array]) -> None:
        self._decide = decide
        self.count = 0

    def reset(self, observation: PrivilegedObservation, seed: int) -> None:
        self._actions = self._decide(observation.scene())
        self.count = len(self._actions)

    def act(self, observation: PrivilegedObservation) -> Action | None:
        return self._actions[observation.step] if observation.step < self.count else None


def push(scene: Scene) -> Array:
    """Return actions (N, 8) that come down in front of the drawer's handle and push it in; the hand points down."""
    thing = scene.objects[ROLE]
    joint = thing.joint
    assert joint is not None
    head, axis = thing.keypoints["articulated_object_head"], joint.axis
    above, before = head + 0.1 * axis + [0.0, 0.0, 0.15], head + 0.1 * axis
    inside = head - (joint.value - joint.lower) * axis
    return through(scene, [above, before, *np.linspace(before, inside, 6)[1:]], [20, 10, 6, 6, 6, 6, 6])


def through(
    scene: Scene, points: Sequence[Array], steps: Sequence[int], grip: float | Sequence[float] = CLOSED
) -> Array:
    """Return actions (N, 8) that move the fingertips through points (base frame) with the hand pointing down.

    Args:
        scene: start of the arm.
        points: (3,) each.
        steps: control steps to each.
        grip: gripper command on the way to each.
    """
    grips = [grip] * len(points) if isinstance(grip, float) else grip
    path, q = [], scene.q.copy()
    for point, count, command in zip(points, steps, grips, strict=True):
        goal = _reach(q, point)
        arm = np.linspace(q[:7], goal[:7], count + 1)[1:]
        path.append(np.column_stack([arm, np.full(count, command)]))
        q = goal
    return np.concatenate(path)


def hold(scene: Scene | None = None) -> Array:
    """Return actions (30, 8) of an arm that keeps its position."""
    return np.tile([*robot("panda").reset_qpos[:7], CLOSED], (30, 1))


def _reach(q: Array, point: Array) -> Array:
    """Return joints near ``q`` with the fingertips at ``point`` (base frame) and the hand pointing down."""
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
    model = pin.buildModelFromUrdf(str(robot("panda").urdf))
    return model, model.createData(), model.getFrameId("panda_hand")


def record(seed: int, several: bool = False) -> EpisodeResult:
    """Return a recorded episode of a task above: the arm pushes on even seeds and stays still on odd ones."""
    from gensim2.rollout.run import run
    from gensim2.sim.headless import HeadlessEnv

    lane = HeadlessEnv(BESIDE_A_BALL if several else HALFWAY, assets="builtin")
    return run(lane, Actions(hold if seed % 2 else push), seed=seed, record=True)
