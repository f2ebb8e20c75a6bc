"""Plan one step of a task on a scene with one of the step's strategies."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain, product
from typing import Any

import numpy as np

import gensim2_kpam as kpam
from gensim2.core.arrays import Array
from gensim2.planning import predict
from gensim2.planning.actions import Acts, Schedule, grip_force, grip_on, schedule
from gensim2.planning.grasping import ASIDE, COMPARED, DRAWN_OUT, HELD, grasp_config, grasps_of, lever_of, margin_of
from gensim2.planning.landing import misses
from gensim2.planning.pulling import pull_config, pulls_of
from gensim2.planning.reaching import Reach, reach
from gensim2.planning.scene import Scene
from gensim2.planning.step_plan import CLEAR, INVALID, NO_GRASP, Foreseen, StepPlan, Ways
from gensim2.planning.step_problems import StepProblems
from gensim2.planning.strategies import GraspStrategy, KeypointStrategy, PullStrategy, Strategy
from gensim2.planning.world import PlanningWorld
from gensim2.robots import CLOSED, OPEN, RobotProfile
from gensim2.tasks.spec import Step

#: Options of every executed plan: a partial plan keeps the longest feasible part of the motion, which is executed.
PLAN_OPTIONS: kpam.Options = {"allow_partial": True}


class StepPlanner:
    """Plans the steps of one episode, each in the scene at the start of the step.

    Args:
        profile: profile of the robot.
        options: solver options for every plan.
        patience: maximum number of reachable grasps to try for an object that the next step needs. The same grasp with
            swapped fingers counts as another one. None: all grasps, which takes half a minute if all fail.

    Attributes:
        profile: profile of the robot.
        world: scene of the episode in the solver's form.
    """

    def __init__(
        self, profile: RobotProfile, options: kpam.Options = PLAN_OPTIONS, patience: int | None = None
    ) -> None:
        self.profile = profile
        self._patience = patience
        self.world = PlanningWorld(profile)
        self._problems = StepProblems(profile, options, self.world)
        self._fingers = Fingers(profile)
        self._gripper = profile.gripper.grasping(profile.model, profile.tool_keypoints)

    def plan(
        self,
        scene: Scene,
        step: Step,
        strategy: Strategy,
        *,
        following: Sequence[Ways] = (),
        warm_start: kpam.Plan | None = None,
        lost: Sequence[Array] = (),
        explain: bool = False,
    ) -> StepPlan:
        """Plan a step.

        Args:
            scene: scene at the start of the step, with the robot's velocity.
            step: object and tool of the step.
            strategy: strategy of the step.
            following: later steps. If one of them uses the object of ``step`` as its tool, a grasp must allow a plan of
                that step.
            warm_start: earlier or predicted plan of the same step, whose pose and path are tried first.
            lost: (4, 4) hand poses, in the object's frame, of grasps that slipped; similar grasps are tried last.
            explain: whether the plan reports the result of every pose that was tried.

        Returns:
            The plan, or the reason for its failure. The status is ``"invalid"`` if the strategy does not fit the
            objects of the scene, or if the strategy has the field ``makes_room``: such a strategy moves an obstacle and
            does not do the step itself.
        """
        if strategy.makes_room is not None:
            return StepPlan(
                INVALID, f"makes room by moving {strategy.makes_room}, and is no way to do it", None, None, None
            )
        try:
            if isinstance(strategy, GraspStrategy):
                return self._grasp(scene, step, strategy, following, lost)
            if isinstance(strategy, PullStrategy):
                return self._pull(scene, step, strategy)
            found = reach(
                lambda options: self.problem(scene, step, strategy, options),
                self._problems.clearances(scene, step, strategy),
                warm_start,
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

    def make_room(
        self,
        scene: Scene,
        step: Step,
        strategy: KeypointStrategy,
        ways: Sequence[Strategy],
        following: Sequence[Ways] = (),
    ) -> StepPlan | None:
        """Plan a motion that moves another object out of the way of a step.

        Args:
            scene: scene in which every strategy in ``ways`` failed.
            step: step that should become possible.
            strategy: strategy that moves the other object.
            ways: strategies that handle the step's object.
            following: later steps, as for :meth:`plan`.

        Returns:
            The motion; None if planning it fails, or if every strategy in ``ways`` fails on the predicted scene.
        """
        if strategy.makes_room is None:
            raise ValueError("the strategy's field 'makes_room' must name the object to move out of the way")
        aside = step.model_copy(update={"object": strategy.makes_room})
        moved = self.plan(scene, aside, strategy.as_step())
        if not moved.is_solved or moved.after is None:
            return None
        able = any(self.plan(moved.after, step, way, following=following).is_solved for way in ways)
        return moved if able else None

    def _letting_go(self, scene: Scene, step: Step, strategy: KeypointStrategy, found: Reach) -> Reach | None:
        """Return a shortened motion that ends with the release.

        Return None if the motion is complete, or if a shorter motion cannot be planned.
        """
        joint = scene.objects[step.object].joint
        config = shortened(strategy.config, found.plan, None if joint is None else joint.openness)
        if config is None:
            return None
        shorter = KeypointStrategy(config)
        part = reach(lambda options: self.problem(scene, step, shorter, options), (found.clearance,), found.plan)
        return part if part.plan.status == "solved" else None

    def problem(
        self, scene: Scene, step: Step, strategy: KeypointStrategy, options: kpam.Options | None = None
    ) -> kpam.KeypointProblem:
        """Return the solver problem of a strategy's config in a scene; ``options`` override the planner's options."""
        return self._problems.of_step(scene, step, strategy, options)

    def _planned(
        self, scene: Scene, step: Step, strategy: KeypointStrategy, problem: kpam.KeypointProblem, plan: kpam.Plan
    ) -> StepPlan:
        if plan.trajectory is None:
            return StepPlan(plan.status, plan.reason, plan, None, None)
        thing = scene.objects[step.object]
        picks = thing.name if strategy.fingers == "grasp" and thing.is_rigid and scene.held is None else None
        opening = OPEN if strategy.opening is None else self._fingers.command(strategy.opening)
        acts = self._fingers.acts(scene, strategy, opening, gently=picks is not None)
        rows = schedule(plan, acts, self.profile)
        after = self._after(scene, step, problem, plan, rows, picks)
        planned = StepPlan(plan.status, plan.reason, plan, rows, after, picks)
        if scene.held is None or rows.released is None:
            return planned
        reason = misses(after, scene.held, after.objects[step.object])
        return replace(planned, misses=reason, is_tight=plan.margin < CLEAR)

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
        end[self._fingers.joints] = self._fingers.positions(float(rows.commands[-1]))
        acting = next((f["time"] for f in plan.keyframes if f["label"] == "actuation" and f["time"] is not None), None)
        after = scene
        joint = scene.objects[step.object].joint
        if joint is not None and problem.scene.joints:
            gone = float(kpam.joint_travel(problem, plan, [trajectory.duration])[0])
            after = predict.with_joint(after, step.object, joint.value + gone)
        held = scene.held or picks
        if held is not None and acting is not None:
            # From the grasp, or from the start of the plan, a grasped object moves with the hand until its release.
            q_from = scene.q if scene.held is not None else trajectory.sample(acting)[0]
            q_to = end if rows.released is None else trajectory.sample(rows.times[rows.released - 1])[0]
            ride = hand(q_to) @ np.linalg.inv(hand(q_from))
            after = predict.with_pose(after, held, ride @ scene.objects[held].T_base_object)
            held = held if rows.released is None else None
        return replace(after, q=end, qvel=np.zeros_like(end), held=held)

    def _grasp(
        self, scene: Scene, step: Step, strategy: GraspStrategy, following: Sequence[Ways], lost: Sequence[Array]
    ) -> StepPlan:
        thing = scene.objects[step.object]
        if not thing.is_rigid or scene.held is not None:
            what = "has a joint" if not thing.is_rigid else f"cannot be taken: the hand holds {scene.held}"
            return StepPlan(NO_GRASP, f"{thing.name} {what}", None, None, None)
        found = grasps_of(self.world.of(scene), scene, thing.name, self._gripper, self.profile, strategy, lost)
        use = next((ways for ways in following if ways[0].tool == thing.name), None)
        best: StepPlan | None = None
        serving: StepPlan | None = None
        served: Foreseen | None = None
        compared = useless = 0
        barred: list[tuple[kpam.Grasp, bool]] = []
        for grasp, swapped, aside in chain(((*each, None) for each in product(found, (False, True))), _aside(barred)):
            if aside is not None and best is not None and best.is_solved:
                break
            taken = self._take(scene, step, strategy, grasp, swapped, aside)
            if not taken.is_solved:
                best = best if best is not None else taken
                if aside is None and _is_barred(taken, thing.name):
                    barred.append((grasp, swapped))
                continue
            assert taken.after is not None
            if use is None:
                return taken
            way = self._way(taken.after, use, served)
            if way is not None:
                serving, served = replace(taken, foreseen=way), way
            elif serving is None:
                best = best if best is not None and best.is_solved else taken
                useless += 1
            compared += serving is not None
            is_best = served is not None and (served.rank, served.strategy) == (0, 0)
            if (is_best or compared == COMPARED) if serving is not None else useless == self._patience:
                break
        if serving is not None:
            return serving
        if best is None:
            return StepPlan(NO_GRASP, f"{thing.name} cannot be held between the fingers as it lies", None, None, None)
        if best.is_solved:
            assert use is not None
            reason = f"with none of {useless} grasps of {thing.name}, either way round, can {use[0].name} be planned"
            return replace(best, status="partial", reason=reason)
        return replace(best, status=NO_GRASP, reason=f"none of {len(found)} grasps is reached: {best.reason}")

    def _pull(self, scene: Scene, step: Step, strategy: PullStrategy) -> StepPlan:
        """Plan to grasp a link and move it.

        The first grasp is used that is reached without early contact and allows the whole motion.
        """
        thing = scene.objects[step.object]
        if thing.joint is None or scene.held is not None:
            what = "has no joint" if thing.joint is None else f"cannot be taken: the hand holds {scene.held}"
            return StepPlan(NO_GRASP, f"{thing.name} {what}", None, None, None)
        found = pulls_of(self.world.of(scene), scene, thing, self._gripper, strategy)
        # The clearance None is left out, because a pull strategy must not touch the object before the grasp.
        clearances = [each for each in self._problems.clearances(scene, step, strategy) if each is not None]
        first: kpam.Plan | None = None
        for grasp, swapped in product(found if clearances else (), (False, True)):
            points, way = pull_config(scene, grasp, self.profile, strategy, swapped)
            problem_with = partial(self._problems.of_step, scene, step, way, more_keypoints=points)
            tried = reach(problem_with, clearances)
            if tried.plan.status == "solved":
                return self._planned(scene, step, way, tried.problem, tried.plan)
            first = first or tried.plan
        if first is None:
            return StepPlan(NO_GRASP, f"what {thing.name} moves cannot be held where it stands", None, None, None)
        return StepPlan(NO_GRASP, f"none of {len(found)} grasps pulls it: {first.reason}", first, None, None)

    def _take(
        self,
        scene: Scene,
        step: Step,
        strategy: GraspStrategy,
        grasp: kpam.Grasp,
        swapped: bool,
        aside: str | None = None,
    ) -> StepPlan:
        points, config = grasp_config(scene, grasp, self.profile, strategy, swapped, aside)
        options = {
            "pick": [step.object],
            "finger_width": self.profile.gripper.planned(float(min(grasp.opening, self.profile.gripper.widest))),
            "allow_partial": False,
        }
        problem = self._problems.posed(scene, step, config, "grasp", None, options, points)
        plan = kpam.plan(problem)
        if plan.trajectory is None:
            return StepPlan(plan.status, plan.reason, plan, None, None)
        thing = scene.objects[step.object]
        margin = max(margin_of(grasp, scene, step.object, strategy), HELD)
        force = grip_force(thing.mass or 0.0, margin, lever_of(grasp, thing, self.profile))
        opening = self._fingers.command(grasp.opening)
        grip = grip_on(grasp.width, force, self.profile, scene.finger_stiffness)
        acts = self._fingers.acts(scene, strategy, opening, grip, gently=True)
        rows = schedule(plan, acts, self.profile)
        after = self._after(scene, step, problem, plan, rows, step.object)
        q = self._fingers.around(after.q, grasp.width, scene)
        after = replace(after, q=q, held_width=grasp.width, held_force=force)
        at = np.array(grasp.T_object_hand)
        return StepPlan(plan.status, plan.reason, plan, rows, after, step.object, grasp.width, force, at)

    def _way(self, scene: Scene, use: Ways, than: Foreseen | None) -> Foreseen | None:
        """Return the plan of a later step in a predicted scene with the first of its strategies that yields a plan of
        rank 0 or 1; without such a plan, the first plan of another rank.

        Args:
            scene: predicted scene.
            use: later step and its strategies.
            than: plan with another grasp; only better plans are of interest. None: any plan.

        Returns:
            The plan; None if no strategy yields a better plan than ``than``. Plans are compared by their ranks, and
            plans of equal rank by the order of the strategies.
        """
        step, strategies = use
        best = than
        for number, strategy in enumerate(strategies):
            # A plan of rank 1 is good enough for its grasp: with another grasp, the same strategy may be of rank 0.
            if best is not None and best.rank <= 1 and number >= best.strategy + best.rank:
                break
            if not isinstance(strategy, KeypointStrategy) or strategy.makes_room is not None:
                continue
            try:
                problem = self.problem(scene, step, strategy, {"allow_partial": False})
            except kpam.ProblemError:  # the strategy does not fit these objects
                continue
            if (plan := kpam.plan(problem)).status != "solved":
                continue
            rank = self._planned(scene, step, strategy, problem, plan).rank
            if best is None or (rank, number) < (best.rank, best.strategy):
                best = Foreseen(step.name, number, plan, rank)
        return None if best is than else best


def _is_barred(taken: StepPlan, name: str) -> bool:
    """Return whether the hand reaches a grasp but the grasped object hits an obstacle during the lift."""
    met = () if taken.plan is None else taken.plan.collisions
    return any(each["toward"].startswith("post_") and name in each["bodies"] for each in met)


def _aside(barred: Sequence[tuple[kpam.Grasp, bool]]) -> Iterator[tuple[kpam.Grasp, bool, str]]:
    """Yield the first ``DRAWN_OUT`` grasps whose lift is blocked, each with every pull-out motion of ``ASIDE``."""
    for (grasp, swapped), aside in product(barred[:DRAWN_OUT], ASIDE):
        yield grasp, swapped, aside


#: A shortened motion ends before the end of the partial motion, by this fraction of the full length.
LEFT_OUT = 0.05

TO_OPENNESS = ("follow_joint_to", "trace_joint_to")
"""Types of motions that are given by the final openness. Other types are given by a distance or an angle."""


def shortened(config: Mapping[str, Any], plan: kpam.Plan, openness: float | None) -> dict[str, Any] | None:
    """Return a solver config whose motions end where a partial plan ends.

    Args:
        config: complete config as plain data.
        plan: partial plan of the config.
        openness: openness of the object's joint at the start of the motion; None for a rigid object.

    Returns:
        The shortened config, or None if the config does not release the object, or if the plan ends before actuation.
    """
    motions = list(config.get("post_actuation_motions", []))
    if plan.status != "partial" or not config.get("let_go") or not motions:
        return None
    gone = plan.reached_fraction * (len(motions) + 1)  # + 1, because the planner counts the release as one motion
    kept = motions[: int(gone)]
    share = gone - int(gone) - LEFT_OUT
    if len(kept) < len(motions) and share > 0.0:
        begin = openness
        for motion in kept:
            begin = _openness_after(motion, begin)
        part = _part(motions[len(kept)], share, begin)
        kept += [] if part is None else [part]
    return {**config, "post_actuation_motions": kept} if kept else None


def _openness_after(motion: Any, openness: float | None) -> float | None:
    """Return the joint's openness after a motion; None if the motion is a change in rad or m."""
    if isinstance(motion, list | tuple) and motion[0] in TO_OPENNESS:
        return float(motion[1])
    return openness if isinstance(motion, list | tuple) and motion[0] not in ("follow_joint", "trace_joint") else None


def _part(motion: Any, share: float, openness: float | None) -> list[Any] | None:
    """Return the first part (fraction ``share``) of a motion; None if the motion has no number that can be scaled."""
    if isinstance(motion, str):
        return None
    name, value = motion[0], float(motion[1])
    if name not in TO_OPENNESS:
        return [name, share * value]
    return None if openness is None else [name, openness + share * (value - openness)]


#: If a gripper command differs by less than this from the initial command, the arm does not wait for the fingers.
SAME_COMMAND = 0.1


class Fingers:
    """Chooses gripper commands for one robot.

    Args:
        profile: profile of the robot.
    """

    def __init__(self, profile: RobotProfile) -> None:
        self._profile = profile
        #: Indices of the finger joints in the robot's active joints.
        self.joints = list(profile.gripper_columns)

    def acts(
        self, scene: Scene, strategy: Strategy, opening: float = OPEN, grip: float = CLOSED, gently: bool = False
    ) -> Acts:
        """Return the gripper commands of a step that begins in ``scene``.

        Args:
            scene: scene at the start of the step.
            opening: gripper command of the empty hand while it moves to a grasp.
            grip: command to which the hand closes.
            gently: whether the hand closes slowly.
        """
        present = _clipped(self._profile.gripper.command_at(scene.q[self.joints]))
        fingers = strategy.fingers
        if scene.held is not None or fingers in ("hold", "release"):
            # Fingers that hold an object continue to press on the object. Empty fingers keep their position.
            command = present if scene.held is None else self._grip(scene)
            return Acts(fingers, command, lets_go=strategy.let_go is not None)
        command = CLOSED if fingers == "closed" else opening
        # Move the fingers first, unless they are almost there or only close for the approach.
        before = abs(command - present) > SAME_COMMAND and (fingers != "grasp" or command > present)
        return Acts(fingers, command, opening, grip, gently, before, strategy.let_go is not None)

    def _grip(self, scene: Scene) -> float:
        """Return the gripper command with which the fingers continue to press on the grasped object."""
        if scene.held_width is None:
            return CLOSED
        assert scene.held is not None
        force = grip_force(scene.objects[scene.held].mass or 0.0) if scene.held_force is None else scene.held_force
        return grip_on(scene.held_width, force, self._profile, scene.finger_stiffness)

    def command(self, opening: float) -> float:
        """Return the gripper command at which the pads are ``opening`` metres apart."""
        return _clipped(self._profile.gripper.command(opening))

    def positions(self, command: float) -> Array:
        """Return the positions (g,) of the gripper's joints at a gripper command."""
        return self._profile.gripper.at_command(command)

    def around(self, q: Array, width: float, scene: Scene) -> Array:
        """Return the robot's joints (n,) after the hand has closed on an object ``width`` (m) wide.

        Stiff drives almost reach their command, so ``q`` is not changed. Soft drives let the fingers stop at the
        surface of the object.
        """
        if scene.finger_stiffness is None or scene.finger_stiffness >= self._profile.finger_drive.stiffness:
            return q
        stopped = q.copy()
        stopped[self.joints] = self._profile.gripper.at_opening(width)
        return stopped


def _clipped(command: float) -> float:
    return float(np.clip(command, CLOSED, OPEN))
