"""Convert a step of a task, together with the scene at its start, to a problem for the keypoint solver."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

import gensim2_kpam as kpam
from gensim2.core.arrays import Array
from gensim2.planning.landmarks import FLOOR, floor
from gensim2.planning.reaching import REACH_CLEARANCES
from gensim2.planning.scene import Scene, SceneObject
from gensim2.planning.strategies import KeypointStrategy, Strategy
from gensim2.planning.world import PlanningWorld
from gensim2.robots import RobotProfile
from gensim2.tasks.spec import HAND, Step

#: Joint speed (rad/s) below which the arm counts as at rest.
AT_REST = 0.01

#: Solver options of executed motions. The margin may shrink to zero. Contacts may be deep, because a pressing hand is
#: commanded into the body, and the plan reports such contacts. A motion may start in contact.
EXECUTED: kpam.Options = {"least_margin": 0.0, "contact_depth": None, "start_depth": 1.0}

#: Maximum start velocity as a fraction of the velocity limits, slightly below the fraction that the solver accepts.
MAX_START_VALUES = 0.45


class StepProblems:
    """Creates the solver problems of one episode.

    Args:
        profile: profile of the robot.
        options: solver options for every problem.
        world: converts scenes to the solver's form.
    """

    def __init__(self, profile: RobotProfile, options: kpam.Options, world: PlanningWorld) -> None:
        self._profile, self._options, self._world = profile, options, world
        self._floors: dict[str, tuple[SceneObject, Array]] = {}
        self._fingers = list(profile.gripper_columns)

    def clearances(self, scene: Scene, step: Step, strategy: Strategy) -> tuple[float | None, ...]:
        """Return the clearances (m) between hand and target, in the order in which the planner tries them."""
        if "reach_clearance" in self._options:
            return (self._options["reach_clearance"],)
        reaches = strategy.fingers != "release" and (
            not scene.objects[step.object].is_rigid or (strategy.fingers == "grasp" and scene.held is None)
        )
        return REACH_CLEARANCES if reaches else (None,)

    def of_step(
        self,
        scene: Scene,
        step: Step,
        strategy: KeypointStrategy,
        options: kpam.Options | None = None,
        more_keypoints: Mapping[str, Array] | None = None,
    ) -> kpam.KeypointProblem:
        """Return the solver problem of a strategy's config in a scene.

        Args:
            scene: scene at the start of the step.
            step: object and tool of the step.
            options: options that override the planner's.
            more_keypoints: additional keypoints (3,) in the base frame.
        """
        thing, gripper = scene.objects[step.object], self._profile.gripper
        fingers = strategy.fingers
        acts: dict[str, Any] = {}
        if fingers == "grasp" and thing.is_rigid and scene.held is None:
            acts["pick"] = [thing.name]
        # A hand that releases an object does not move the joint, and may touch only the released object.
        joint = None if thing.is_rigid or fingers == "release" else thing.name
        if fingers == "release" and scene.held is not None:
            acts["release"] = [scene.held]
        if strategy.contact_speed is not None:
            acts["contact_speed"] = float(strategy.contact_speed)
        if fingers == "grasp" and strategy.opening is not None:
            acts["finger_width"] = gripper.planned(min(strategy.opening, gripper.widest))
        return self.posed(
            scene, step, strategy.solver_config, fingers, joint, {**(options or {}), **acts}, more_keypoints
        )

    def posed(
        self,
        scene: Scene,
        step: Step,
        config: kpam.SolverConfig,
        fingers: str,
        joint: str | None,
        options: Mapping[str, Any],
        more_keypoints: Mapping[str, Array] | None = None,
    ) -> kpam.KeypointProblem:
        """Return the solver problem of a config that has only the solver's fields.

        Unlike in :meth:`of_step`, the caller gives the finger mode and the joint.

        Args:
            scene: scene at the start of the step.
            step: object and tool of the step.
            config: config with the solver's fields.
            fingers: finger mode.
            joint: name of the object whose joint is moved, or None.
            options: options that override the planner's options.
            more_keypoints: additional keypoints (3,) in the base frame.
        """
        world = self._world.of(scene)
        thing = scene.objects[step.object]
        points: dict[str, Array] = {}
        for name, other in scene.objects.items():
            if name != scene.held:
                points |= {f"{name}/{key}": at for key, at in other.points.items()}
        if thing.name != scene.held:
            points |= {**thing.points, FLOOR: self._floor(scene, thing)}
        tool = dict(self._profile.tool_keypoints)
        if scene.held is not None:
            tool |= _held_keypoints(world, scene.held, step.tool)
        q = self._start(scene, fingers)
        # A disturbed arm can be faster than its velocity limits; no motion within the limits could start there.
        fastest = MAX_START_VALUES * self._profile.model.velocity
        velocity = np.clip(scene.qvel, -fastest, fastest)
        velocity[self._fingers] = 0.0
        if np.abs(velocity).max() > AT_REST:
            options = {**options, "start_velocity": velocity}
        known: kpam.Options = {**self._profile.solver, **EXECUTED}
        merged: kpam.Options = {**known, **self._options, **options}  # type: ignore[typeddict-item]
        return world.problem(
            config,
            q,
            tool_keypoints=tool,
            object_keypoints={**points, **(more_keypoints or {})},
            T_base_object=thing.T_base_object,
            joint=joint,
            object_axis=thing.object_axis,
            object_yaw=thing.yaw,
            T_base_world=np.linalg.inv(scene.T_world_base).astype(np.float64),
            options=merged,
        )

    def _floor(self, scene: Scene, thing: SceneObject) -> Array:
        """Return an object's floor point (3,), cached because dozens of plans compare grasps on the same object."""
        known = self._floors.get(thing.name)
        if known is None or known[0] is not thing:
            known = self._floors[thing.name] = (thing, floor(scene, thing.name))
        return known[1]

    def _start(self, scene: Scene, fingers: str) -> Array:
        """Return the robot's joints at the start, with the finger joints that the approach requires."""
        q = self._world.joints(scene) if scene.held is not None or fingers == "hold" else scene.q.copy()
        if fingers == "closed" and scene.held is None:
            q[self._fingers] = self._profile.gripper.at_opening(0.0)
        elif fingers in ("open", "grasp") and scene.held is None:
            q[self._fingers] = self._profile.gripper.at_opening(self._profile.gripper.widest)
        return q


def _held_keypoints(world: kpam.Scene, held: str, tool: str) -> dict[str, Array]:
    """Return the keypoints of the grasped object, which is the tool, by bare name.

    Return an empty dict for the bare hand.
    """
    if tool == HAND:
        # the problem already contains the keypoints of the grasped object, named with the prefix ``<object>/``
        return {}
    prefix = f"{held}/"
    return {key.removeprefix(prefix): at for key, at in world.tool_keypoints.items() if key.startswith(prefix)}
