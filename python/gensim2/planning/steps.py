"""One step of a task planned on a scene: by a config of the keypoint solver, or by a grasp."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

import gensim2_kpam as kpam
from gensim2.planning import predict
from gensim2.planning.actions import Acts, Schedule, grip_force, grip_on, schedule
from gensim2.planning.grasping import COMPARED, HELD, grasp_config, grasps_of, lever_of, margin_of
from gensim2.planning.landmarks import FLOOR, floor
from gensim2.planning.reaching import REACH_CLEARANCES, Reach, reach
from gensim2.planning.scene import Scene, SceneObject
from gensim2.planning.shortening import shortened
from gensim2.planning.strategies import GraspStrategy, KeypointStrategy, Strategy
from gensim2.planning.world import PlanningWorld
from gensim2.robots import CLOSED, OPEN, RobotProfile
from gensim2.tasks.spec import HAND, Step

Array = npt.NDArray[np.float64]

#: Options of every plan that is executed: the longest part of a motion that can be done is taken; physics judges it.
PLAN_OPTIONS: kpam.Options = {"allow_partial": True}

#: A gripper command nearer than this to the one that a step begins with needs no time of its own.
SAME_COMMAND = 0.1

#: Joint speed (rad/s) below which the arm is at rest.
AT_REST = 0.01

#: Share of the joints' velocity limits with which a motion starts at most: somewhat less than the solver plans with.
STARTS_AT_MOST = 0.45

NO_GRASP = "no_grasp"
"""Status of a step whose object has no grasp that serves."""

INVALID = "invalid"
"""Status of a step whose strategy does not fit the objects of the scene."""


@dataclass(frozen=True)
class StepPlan:
    """A step planned.

    Attributes:
        status, reason: the planner's; ``"no_grasp"`` where no grasp serves.
        plan: the motion; None where there was none to be looked for.
        schedule: its actions, None without a motion.
        after: the scene as it will be; None without a motion.
        picks: the object that is taken up, or None.
        width: distance of the finger pads that hold it, m.
        force: with which each finger presses on it, N.
        T_object_hand: (4, 4) hand in its frame as it is grasped.
        touches: what stands in the way of a motion that touches nothing before the actuation pose, where this one does.
        whole: where ``plan`` is the longest part of a motion and then lets go: the plan that says what the rest lacks.
        foreseen: of a grasp the step that it is for, with the plan of it that was found on the scene as it will be.
    """

    status: str
    reason: str
    plan: kpam.Plan | None
    schedule: Schedule | None
    after: Scene | None
    picks: str | None = None
    width: float | None = None
    force: float | None = None
    T_object_hand: Array | None = None
    touches: str | None = None
    whole: kpam.Plan | None = None
    foreseen: Foreseen | None = None

    @property
    def is_solved(self) -> bool:
        """Whether the whole motion was found."""
        return self.status == "solved"

    @property
    def rank(self) -> int:
        """The lower, the better: whole and gentle, whole, a part, no motion at all."""
        if self.schedule is None:
            return 3
        return 2 if not self.is_solved else 0 if self.touches is None else 1

    def detail(self) -> dict[str, Any]:
        """What stands in the way of the whole: residuals missed, the keyframe not reached, bodies that collide; and of
        one that touches nothing before the actuation pose.
        """
        touches = {} if self.touches is None else {"touches": self.touches}
        plan = self.whole or self.plan
        if plan is None or self.is_solved:
            return touches
        found: dict[str, Any] = {
            "residuals": [
                {"name": each["name"], "residual": each["residual"], "tolerance": each["tolerance"]}
                for each in plan.residuals
                if not each["satisfied"]
            ],
            "unreached": next((frame["label"] for frame in plan.keyframes if not frame["reached"]), None),
            "collisions": [
                {"bodies": list(each["bodies"]), "distance": each["distance"], "toward": each["toward"]}
                for each in plan.collisions
            ],
        }
        return {name: value for name, value in found.items() if value} | touches


@dataclass(frozen=True)
class Foreseen:
    """A step planned ahead, on a scene as it will be.

    Attributes:
        step: its name.
        strategy: which of its strategies, by number.
        plan: the motion.
    """

    step: str
    strategy: int
    plan: kpam.Plan


#: A step and its strategies, in order of preference.
Ways = tuple[Step, Sequence[Strategy]]


class StepPlanner:
    """Plans steps on the scenes of one episode.

    Args:
        profile: the robot.
        options: the solver's, for every plan.
    """

    def __init__(self, profile: RobotProfile, options: kpam.Options = PLAN_OPTIONS) -> None:
        self.profile = profile
        self._options = options
        self._world = PlanningWorld(profile)
        self._floors: dict[str, tuple[SceneObject, Array]] = {}
        self._gripper = kpam.ParallelGripper.of_robot(profile.model, **_tool(profile))
        names = profile.model.joint_names
        self._fingers = [names.index(name) for name in profile.gripper.joints]

    def plan(
        self,
        scene: Scene,
        step: Step,
        strategy: Strategy,
        *,
        following: Sequence[Ways] = (),
        former: kpam.Plan | None = None,
        lost: Sequence[Array] = (),
        explain: bool = False,
    ) -> StepPlan:
        """Plan a step.

        Args:
            scene: as it stands; the robot's velocity counts where it moves.
            step: what is acted on, and with what.
            strategy: how.
            following: the steps after it; a grasp looks ahead to the first that uses the object as its tool.
            former: an earlier plan of the same step, or one that was foreseen; its pose and its way are tried first.
            lost: (4, 4) hand poses in the frame of the step's object from which it slipped; they are tried last.
            explain: whether the plan says what became of every pose that was tried.

        Returns:
            One without a motion and with the status ``"invalid"`` where the strategy does not fit these objects.
        """
        if isinstance(strategy, GraspStrategy):
            return self._grasp(scene, step, strategy, following, lost)
        try:
            found = reach(
                lambda options: self.problem(scene, step, strategy, options),
                self._clearances(scene, step, strategy),
                former,
                explain,
            )
            part = self._letting_go(scene, step, strategy, found)
        except kpam.ProblemError as error:
            return StepPlan(INVALID, str(error), None, None, None)
        if part is not None:
            planned = self._planned(scene, step, strategy, part.problem, part.plan)
            whole = found.plan
            return replace(planned, status=whole.status, reason=whole.reason, touches=found.touches, whole=whole)
        return replace(self._planned(scene, step, strategy, found.problem, found.plan), touches=found.touches)

    def _letting_go(self, scene: Scene, step: Step, strategy: KeypointStrategy, found: Reach) -> Reach | None:
        """The longest part of a motion, after which the hand lets go as after the whole; None where there is none."""
        joint = scene.objects[step.object].joint
        config = shortened(strategy.config, found.plan, None if joint is None else joint.openness)
        if config is None:
            return None
        shorter = KeypointStrategy(config)
        part = reach(lambda options: self.problem(scene, step, shorter, options), (found.clearance,), found.plan)
        return part if part.plan.status == "solved" else None

    def _clearances(self, scene: Scene, step: Step, strategy: KeypointStrategy) -> tuple[float | None, ...]:
        """Those to be kept from what the hand reaches for, in order of preference."""
        if "reach_clearance" in self._options:
            return (self._options["reach_clearance"],)
        reaches = strategy.fingers != "release" and (
            not scene.objects[step.object].is_rigid or (strategy.fingers == "grasp" and scene.held is None)
        )
        return REACH_CLEARANCES if reaches else (None,)

    def problem(
        self, scene: Scene, step: Step, strategy: KeypointStrategy, options: kpam.Options | None = None
    ) -> kpam.KeypointProblem:
        """The problem that a config poses on a scene; ``options`` take the place of the planner's."""
        thing = scene.objects[step.object]
        fingers = strategy.fingers
        acts: dict[str, Any] = {}
        if fingers == "grasp" and thing.is_rigid and scene.held is None:
            acts["pick"] = [thing.name]
        # A hand that releases something leaves the joint alone, and may touch nothing but what it held.
        joint = None if thing.is_rigid or fingers == "release" else thing.name
        if fingers == "release" and scene.held is not None:
            acts["release"] = [scene.held]
        if strategy.contact_speed is not None:
            acts["contact_speed"] = float(strategy.contact_speed)
        if fingers == "grasp" and strategy.opening is not None:
            acts["finger_width"] = min(strategy.opening / 2, self.profile.gripper.open)
        return self._problem(scene, step, strategy.solver_config, fingers, joint, {**(options or {}), **acts})

    def _problem(
        self,
        scene: Scene,
        step: Step,
        config: kpam.SolverConfig,
        fingers: str,
        joint: str | None,
        options: Mapping[str, Any],
        more_keypoints: Mapping[str, Array] | None = None,
    ) -> kpam.KeypointProblem:
        world = self._world.of(scene)
        thing = scene.objects[step.object]
        points: dict[str, Array] = {}
        for name, other in scene.objects.items():
            if name != scene.held:
                points |= {f"{name}/{key}": at for key, at in other.points.items()}
        if thing.name != scene.held:
            points |= {**thing.points, FLOOR: self._floor(scene, thing)}
        tool = _tool(self.profile)
        if scene.held is not None:
            tool |= _held_keypoints(world, scene.held, step.tool)
        q = self._start(scene, fingers)
        # The arm may swing faster than its limits, from which no motion that keeps them could begin.
        fastest = STARTS_AT_MOST * self.profile.model.velocity
        velocity = np.clip(scene.qvel, -fastest, fastest)
        velocity[self._fingers] = 0.0
        if np.abs(velocity).max() > AT_REST:
            options = {**options, "start_velocity": velocity}
        merged: kpam.Options = {**self._options, **options}  # type: ignore[typeddict-item]
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
        """(3,) that of an object; grasps are compared by dozens of plans on scenes in which it is the very same."""
        known = self._floors.get(thing.name)
        if known is None or known[0] is not thing:
            known = self._floors[thing.name] = (thing, floor(scene, thing.name))
        return known[1]

    def _start(self, scene: Scene, fingers: str) -> Array:
        """Joints at the start, the fingers as they stand during the approach."""
        q = self._world.joints(scene) if scene.held is not None or fingers == "hold" else scene.q.copy()
        if fingers == "closed" and scene.held is None:
            q[self._fingers] = 0.0
        elif fingers in ("open", "grasp") and scene.held is None:
            q[self._fingers] = self.profile.gripper.open
        return q

    def _acts(
        self, scene: Scene, strategy: Strategy, opening: float = OPEN, grip: float = CLOSED, gently: bool = False
    ) -> Acts:
        present = self._command(float(scene.q[self._fingers[0]]))
        fingers = strategy.fingers
        if scene.held is not None or fingers in ("hold", "release"):
            # What is held is pressed; bare fingers stay where they are.
            command = present if scene.held is None else self._grip(scene)
            return Acts(fingers, command, lets_go=strategy.let_go is not None)
        command = CLOSED if fingers == "closed" else opening
        # Fingers that only come nearer to what they will grasp do so on the way.
        before = abs(command - present) > SAME_COMMAND and (fingers != "grasp" or command > present)
        return Acts(fingers, command, opening, grip, gently, before, strategy.let_go is not None)

    def _grip(self, scene: Scene) -> float:
        """The command that goes on holding what the hand has."""
        if scene.held_width is None:
            return CLOSED
        assert scene.held is not None
        force = grip_force(scene.objects[scene.held].mass or 0.0) if scene.held_force is None else scene.held_force
        return grip_on(scene.held_width, force, self.profile)

    def _command(self, finger: float) -> float:
        """The gripper command that takes a finger joint there."""
        return float(np.clip(self.profile.gripper.command(finger), CLOSED, OPEN))

    def _planned(
        self, scene: Scene, step: Step, strategy: KeypointStrategy, problem: kpam.KeypointProblem, plan: kpam.Plan
    ) -> StepPlan:
        if plan.trajectory is None:
            return StepPlan(plan.status, plan.reason, plan, None, None)
        thing = scene.objects[step.object]
        picks = thing.name if strategy.fingers == "grasp" and thing.is_rigid and scene.held is None else None
        opening = OPEN if strategy.opening is None else self._command(strategy.opening / 2)
        acts = self._acts(scene, strategy, opening, gently=picks is not None)
        rows = schedule(plan, acts, self.profile)
        after = self._after(scene, step, problem, plan, rows, picks)
        return StepPlan(plan.status, plan.reason, plan, rows, after, picks)

    def _after(
        self,
        scene: Scene,
        step: Step,
        problem: kpam.KeypointProblem,
        plan: kpam.Plan,
        rows: Schedule,
        picks: str | None,
    ) -> Scene:
        trajectory = plan.trajectory
        assert trajectory is not None
        hand = self.profile.model.forward_kinematics
        end = np.array(trajectory.positions[-1])
        end[self._fingers] = self._finger(float(rows.actions[-1, -1]))
        acting = next((f["time"] for f in plan.keyframes if f["label"] == "actuation" and f["time"] is not None), None)
        after = scene
        joint = scene.objects[step.object].joint
        if joint is not None and problem.scene.joints:
            gone = float(kpam.joint_travel(problem, plan, [trajectory.duration])[0])
            after = predict.with_joint(after, step.object, joint.value + gone)
        held = scene.held or picks
        if held is not None and acting is not None:
            # What is held goes with the hand: from the start, or from where it is picked; and stays where it is let go.
            q_from = scene.q if scene.held is not None else trajectory.sample(acting)[0]
            q_to = end if rows.released is None else trajectory.sample(rows.times[rows.released - 1])[0]
            ride = hand(q_to) @ np.linalg.inv(hand(q_from))
            after = predict.with_pose(after, held, ride @ scene.objects[held].T_base_object)
            held = held if rows.released is None else None
        return replace(after, q=end, qvel=np.zeros_like(end), held=held)

    def _finger(self, command: float) -> float:
        gripper = self.profile.gripper
        value = 0.5 * (gripper.open + gripper.closed) + 0.5 * (gripper.open - gripper.closed) * command
        return float(max(value, 0.0))

    def _grasp(
        self,
        scene: Scene,
        step: Step,
        strategy: GraspStrategy,
        following: Sequence[Ways],
        lost: Sequence[Array],
    ) -> StepPlan:
        thing = scene.objects[step.object]
        if not thing.is_rigid or scene.held is not None:
            what = "has a joint" if not thing.is_rigid else f"cannot be taken: the hand holds {scene.held}"
            return StepPlan(NO_GRASP, f"{thing.name} {what}", None, None, None)
        found = grasps_of(self._world.of(scene), scene, thing.name, self._gripper, strategy, lost)
        use = next((ways for ways in following if ways[0].tool == thing.name), None)
        best: StepPlan | None = None
        serving: StepPlan | None = None
        ways: Sequence[Strategy] = () if use is None else use[1]  # in which it is yet to serve
        compared = 0
        for grasp, swapped in product(found, (False, True)):
            taken = self._take(scene, step, strategy, grasp, swapped)
            if not taken.is_solved:
                best = best if best is not None else taken
                continue
            assert taken.after is not None
            if use is None:
                return taken
            way = self._way(taken.after, use[0], ways)
            if way is not None:
                serving, ways = replace(taken, foreseen=way), ways[: way.strategy]
            elif best is None or not best.is_solved:
                best = taken
            compared += serving is not None
            if serving is not None and (not ways or compared == COMPARED):
                break
        if serving is not None:
            return serving
        if best is None:
            return StepPlan(NO_GRASP, f"{thing.name} cannot be held between the fingers as it lies", None, None, None)
        if best.is_solved:
            assert use is not None
            reason = f"with none of {len(found)} grasps of {thing.name} can {use[0].name} be planned"
            return replace(best, status="partial", reason=reason)
        return replace(best, status=NO_GRASP, reason=f"none of {len(found)} grasps is reached: {best.reason}")

    def _take(self, scene: Scene, step: Step, strategy: GraspStrategy, grasp: kpam.Grasp, swapped: bool) -> StepPlan:
        points, config = grasp_config(scene, grasp, self.profile, strategy, swapped)
        options = {
            "pick": [step.object],
            "finger_width": float(min(grasp.opening / 2, self.profile.gripper.open)),
            "allow_partial": False,
        }
        problem = self._problem(scene, step, config, "grasp", None, options, points)
        plan = kpam.plan(problem)
        if plan.trajectory is None:
            return StepPlan(plan.status, plan.reason, plan, None, None)
        thing = scene.objects[step.object]
        margin = max(margin_of(grasp, scene, step.object, strategy), HELD)
        force = grip_force(thing.mass or 0.0, margin, lever_of(grasp, thing, self.profile))
        opening, grip = self._command(grasp.opening / 2), grip_on(grasp.width, force, self.profile)
        acts = self._acts(scene, strategy, opening, grip, gently=True)
        rows = schedule(plan, acts, self.profile)
        after = self._after(scene, step, problem, plan, rows, step.object)
        after = replace(after, held_width=grasp.width, held_force=force)
        at = np.array(grasp.T_object_hand)
        return StepPlan(plan.status, plan.reason, plan, rows, after, step.object, grasp.width, force, at)

    def _way(self, scene: Scene, step: Step, strategies: Sequence[Strategy]) -> Foreseen | None:
        """By which of the strategies, the first, a step can be planned on a scene that is foreseen, and how."""
        for number, strategy in enumerate(strategies):
            if not isinstance(strategy, KeypointStrategy):
                continue
            try:
                problem = self.problem(scene, step, strategy, {"allow_partial": False})
            except kpam.ProblemError:  # it is for other objects than these
                continue
            if (plan := kpam.plan(problem)).status == "solved":
                return Foreseen(step.name, number, plan)
        return None


def _tool(profile: RobotProfile) -> dict[str, Array]:
    return dict(profile.tool_keypoints)


def _held_keypoints(world: kpam.Scene, held: str, tool: str) -> dict[str, Array]:
    """Keypoints of what is held; without prefix where it is the step's tool."""
    if tool == HAND:
        return {}  # the scene hands them over, with prefix
    prefix = f"{held}/"
    return {key.removeprefix(prefix): at for key, at in world.tool_keypoints.items() if key.startswith(prefix)}
