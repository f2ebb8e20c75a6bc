"""Scene and solver config in, plan out."""

from __future__ import annotations

import numpy as np

import gensim2_kpam as kpam
from gensim2.planning.scene import Scene, SceneBody
from gensim2.robots import RobotProfile


def _body(body: SceneBody) -> kpam.Body:
    return kpam.Body(
        body.name,
        body.role,
        [kpam.Shape.convex_hull(np.ascontiguousarray(hull)) for hull in body.hulls],
        body.T_base_body,
    )


class SceneProblems:
    """Builds problems on one scene; the obstacles are converted once and shared by every config.

    Args:
        scene: what the simulator says stands where.
        robot: who is to do it.
        object_axis: axis of the object frame that "rotate" motions turn about.
    """

    def __init__(self, scene: Scene, robot: RobotProfile, object_axis: str = "y") -> None:
        self.scene = scene
        self._robot = robot
        self._object_axis = object_axis
        self._bodies = [_body(body) for body in scene.bodies]
        joint = scene.joint
        self._joint = kpam.Joint(joint.type, joint.origin, joint.axis, joint.value, joint.lower, joint.upper)

    def problem(self, config: kpam.SolverConfig, options: kpam.Options | None = None) -> kpam.KeypointProblem:
        """Return the problem that ``config`` poses on this scene.

        The fingers stand as the config wants them during the approach: closed to push, open to hook or to grasp.
        """
        q_start = self.scene.q.copy()
        if config.gripper == "closed":
            q_start[self._robot.arm_size :] = 0.0
        return kpam.KeypointProblem(
            self._robot.model,
            config,
            q_start,
            tool_keypoints=self._robot.tool_keypoints,
            object_keypoints=self.scene.object_keypoints,
            T_base_object=self.scene.T_base_object,
            joint=self._joint,
            object_axis=self._object_axis,  # type: ignore[arg-type]
            object_yaw=self.scene.object_yaw,
            T_base_world=np.linalg.inv(self.scene.T_world_base).astype(np.float64),
            bodies=self._bodies,
            options=options,
        )
