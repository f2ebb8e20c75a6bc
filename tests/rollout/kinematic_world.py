"""A table without physics, for tests of chains: the arm follows its targets, closed fingers hold the object between
them, and a drawer moves with a hand that is closed on its handle.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from gensim2.perception import Encoder
from gensim2.planning import predict
from gensim2.planning.scene import Scene
from gensim2.planning.world import carried_by
from gensim2.robots import robot
from gensim2.rollout.controller import PROPRIOCEPTIVE, Action, Controller, PrivilegedObservation
from gensim2.tasks.measurement import Measurement

Array = npt.NDArray[np.float64]

PANDA = robot("panda")
#: Share of the distance to its target that a joint moves in a control step, like drives with a delay of 0.1 s.
FOLLOWS = 1 - np.exp(-1 / (float(PANDA.lags[0]) * PANDA.control_hz))
FINGER_STEP = 0.006
#: Largest distance (m) of a ball's centre or a handle from the point between the fingertips for a grasp.
NEAR = 0.02


class KinematicWorld:
    """A drawer and a ball.

    Args:
        scene: the initial scene.
        ball: name of the rigid object.
        width: finger distance when closed on it, m.
    """

    def __init__(self, scene: Scene, ball: str, width: float, drawer: str = "drawer") -> None:
        self.scene, self.ball, self.width, self.drawer = scene, ball, width, drawer
        self.steps = 0
        self.holds = False
        self.gone = 0.0
        #: Called before each step to change the scene.
        self.mischief: Callable[[KinematicWorld], None] = lambda _: None

    def run(self, controller: Controller, max_steps: int = 1200) -> None:
        """Run one episode."""
        controller.reset(self.observation(), 0)
        for _ in range(max_steps):
            action = controller.act(self.observation())
            if action is None:
                return
            self.step(action)
        raise AssertionError("the controller never ends")

    def observation(self) -> PrivilegedObservation:
        seen = Encoder(PROPRIOCEPTIVE, PANDA).encode(self.steps, self.scene.q, self.scene.qvel, 1.0)
        return PrivilegedObservation.of(seen, self.measure(), lambda: self.scene)

    def step(self, action: Action) -> None:
        self.mischief(self)
        scene = self.scene
        before, tip_before = self.hand(), self.tip()
        q = scene.q.copy()
        q[:7] += FOLLOWS * (action[:7] - q[:7])
        target = 0.5 * (PANDA.gripper.open + PANDA.gripper.closed) + 0.5 * (
            PANDA.gripper.open - PANDA.gripper.closed
        ) * float(action[7])
        between = np.linalg.norm(self.tip() - self.center()) < NEAR
        least = self.width / 2 if between else 0.0
        if target > q[7] + 1e-6:
            self.holds = False
        finger = float(np.clip(q[7] + np.clip(target - q[7], -FINGER_STEP, FINGER_STEP), least, 0.04))
        self.holds = self.holds or (between and finger <= least + 1e-9)
        q[7:] = finger
        self.scene = replace(scene, q=q, qvel=(q - scene.q) * PANDA.control_hz)
        moved = self.hand() @ np.linalg.inv(before)
        if self.holds:
            self.put(moved @ scene.objects[self.ball].T_base_object)
        else:
            self._drop()
        self._pull(tip_before)
        self.steps += 1

    def _drop(self) -> None:
        """Let free objects fall on the table, or keep their place in the drawer."""
        pose = self.scene.objects[self.ball].T_base_object.copy()
        if carried_by(self.scene, self.ball) is None and pose[2, 3] > self.width / 2 + 1e-6:
            pose[2, 3] = self.width / 2
            self.put(pose)

    def _pull(self, tip_before: Array) -> None:
        thing = self.scene.objects[self.drawer]
        joint, handle = thing.joint, thing.keypoints["articulated_object_head"]
        assert joint is not None
        near = np.linalg.norm(tip_before - handle) < 3 * NEAR
        if not near or self.holds or self.scene.q[7] >= 0.02:
            self.gone = 0.0
            return
        by = float((self.tip() - tip_before) @ joint.axis)
        if by * self.gone < 0.0 and abs(self.gone) > NEAR:
            return  # pushing fingers do not pull the drawer back
        self.gone += by
        self.scene = predict.with_joint(self.scene, self.drawer, joint.value + by)

    def hand(self) -> Array:
        return PANDA.model.forward_kinematics(self.scene.q)

    def tip(self) -> Array:
        hand = self.hand()
        return np.asarray(hand[:3, :3] @ PANDA.tool_keypoints["tool_head"] + hand[:3, 3])

    def center(self) -> Array:
        return self.scene.objects[self.ball].T_base_object[:3, 3]

    def put(self, pose: Array) -> None:
        """Put the ball at a pose (4, 4) in the base frame."""
        self.scene = predict.with_pose(self.scene, self.ball, pose)

    def shift(self, x: float, y: float) -> None:
        """Push the ball over the table, m."""
        pose = self.scene.objects[self.ball].T_base_object.copy()
        pose[:2, 3] += x, y
        self.put(pose)

    def measure(self) -> Measurement:
        scene, base = self.scene, self.scene.T_world_base
        hand = base @ self.hand()
        ball = base @ scene.objects[self.ball].T_base_object
        joint = scene.objects[self.drawer].joint
        assert joint is not None
        quaternion = Rotation.from_matrix(ball[:3, :3]).as_quat(scalar_first=True)
        return Measurement(
            openness={self.drawer: joint.openness},
            joint_speed={self.drawer: 0.0},
            keypoints={
                name: {key: base[:3, :3] @ at + base[:3, 3] for key, at in thing.keypoints.items()}
                for name, thing in scene.objects.items()
            },
            poses={self.ball: np.concatenate([ball[:3, 3], quaternion])},
            speeds={self.ball: np.zeros(2)},
            gripper={key: hand[:3, :3] @ at + hand[:3, 3] for key, at in PANDA.tool_keypoints.items()},
            finger_opening=float(scene.q[7] + scene.q[8]),
        )
