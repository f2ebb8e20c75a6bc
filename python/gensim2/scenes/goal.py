"""Check that a task's goal can distinguish success from failure."""

from __future__ import annotations

from collections.abc import Collection, Iterable

import numpy as np
from scipy.spatial.transform import Rotation

from gensim2.core.arrays import Array
from gensim2.core.errors import InputError
from gensim2.objects import RigidObject
from gensim2.objects.types import ArticulatedObject
from gensim2.robots import RobotProfile
from gensim2.scenes.footprint import keypoint_in_root
from gensim2.scenes.geometry import bounds_of, contents_of, measured_link
from gensim2.scenes.initial_state import InitialState, PlacedObject
from gensim2.tasks.criteria import (
    JOINT,
    ArticulatedBetween,
    ArticulatedClosed,
    ArticulatedOpen,
    Criterion,
    RigidLifted,
    RigidMoved,
    RigidOnRigid,
    all_hold,
)
from gensim2.tasks.measurement import Measurement
from gensim2.tasks.spec import TaskSpec

_OF_POSES = (RigidLifted, RigidMoved, RigidOnRigid)
DIRECTIONS = {"away": (1.0, 0.0), "closer": (-1.0, 0.0), "left": (0.0, 1.0), "right": (0.0, -1.0)}


class GoalError(InputError):
    """A task's goal is already reached in every initial scene, or the robot cannot reach it."""


def measure_initial_state(state: InitialState, robot: RobotProfile) -> Measurement:
    """Return the measurement of a sampled initial state at rest, without simulation."""
    articulated = {name: thing for name, thing in state.objects.items() if isinstance(thing.model, ArticulatedObject)}
    rigid = {name: thing for name, thing in state.objects.items() if isinstance(thing.model, RigidObject)}
    models = {name: thing.model for name, thing in state.objects.items()}
    poses = {name: measured_pose(thing) for name, thing in state.objects.items()}
    return Measurement(
        openness={name: float(thing.openness or 0.0) for name, thing in articulated.items()},
        joint_speed=dict.fromkeys(articulated, 0.0),
        keypoints={name: _keypoints(thing) for name, thing in state.objects.items()},
        poses={name: np.concatenate([thing.position, thing.quaternion]) for name, thing in rigid.items()},
        speeds={name: np.zeros(2) for name in rigid},
        gripper=robot.gripper_with(state.start),
        finger_opening=robot.gripper.widest,
        start_positions={name: thing.position for name, thing in rigid.items()},
        bounds=bounds_of(models, poses),
        contents=contents_of(models, poses),
    )


def check_reachable(task: TaskSpec, state: InitialState, robot: RobotProfile, placed: Collection[str] = ()) -> None:
    """Check that the robot can bring about a state that meets the goal.

    Args:
        task: task whose goal and ``done`` criteria are checked, also for the kinds of the objects; without a goal, the
            last ``done`` is the goal.
        robot: robot profile, whose reach limits how far objects can be moved.
        placed: names of objects that reset options have placed; their distance to the goal is not checked.

    Raises:
        GoalError: a criterion is about the wrong kind of object, criteria contradict each other, or a place is beyond
            the robot's reach.
    """
    for step in task.steps:
        _check_kinds(step.done, state, f"steps.{step.name}.done")
    field = _field(task)
    _check_kinds(task.success, state, field)
    for name in task.objects:
        low, high = _openness_range(task.success, name)
        if low >= high:
            raise GoalError(
                f"the goal is unreachable, because its criteria require the openness of {name} to be above {low:g} and "
                f"below {high:g} at the same time",
                field=field,
                remedy="remove one of these criteria, or change its threshold",
            )
    for criterion in task.success:
        if isinstance(criterion, RigidLifted | RigidMoved) and criterion.rigid not in placed:
            away = _beyond_reach(criterion, state.objects[criterion.rigid], robot)
            if away > 0.0:
                raise GoalError(
                    f"the goal is unreachable: {criterion.type} requires {criterion.rigid} to be at a position "
                    f"{away:.2f} m beyond the robot's reach of {robot.reach:g} m",
                    field=field,
                    remedy="lower the criterion's values, or place the object elsewhere",
                )


def check_false_at_start(task: TaskSpec, states: Iterable[InitialState], robot: RobotProfile) -> None:
    """Check that the goal is false in some initial state. Otherwise episodes would succeed without the robot.

    Args:
        states: initial states; evaluation stops at the first state in which the goal is not reached.

    Raises:
        GoalError: the goal is reached in all states.
    """
    if all(all_hold(task.success, measure_initial_state(state, robot)) for state in states):
        raise GoalError(
            "the goal is already reached at the start of every episode, before the robot moves",
            field=_field(task),
            remedy="change the goal, the initial openness of the objects (openness_mean in randomization), or their "
            "initial positions",
        )


def _field(task: TaskSpec) -> str:
    return f"{task.name}: goal" if task.goal is not None else f"{task.name}: steps.{task.steps[-1].name}.done"


def _keypoints(thing: PlacedObject) -> dict[str, Array]:
    model = thing.model
    if isinstance(model, ArticulatedObject):
        local = {name: keypoint_in_root(model, name, thing.joint_value) for name in model.keypoints}
    else:
        local = {name: np.asarray(point.position) for name, point in model.keypoints.items()}
    return {name: thing.in_world(point) for name, point in local.items()}


def measured_pose(thing: PlacedObject) -> Array:
    """Return the pose (4, 4) of an object's measured link in the world frame."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_quat(thing.quaternion, scalar_first=True).as_matrix()
    pose[:3, 3] = thing.position
    model = thing.model
    if isinstance(model, ArticulatedObject) and measured_link(model) == model.joint.child_link:
        return np.asarray(pose @ model.joint.T_root_child_at(thing.joint_value), dtype=np.float64)
    return pose


def _check_kinds(criteria: Iterable[Criterion], state: InitialState, field: str) -> None:
    """Check that criteria about joints name articulated objects, and criteria about poses rigid objects."""
    for criterion in criteria:
        for types, kind, other in (
            (JOINT, ArticulatedObject, "a rigid object, which has no joint"),
            (_OF_POSES, RigidObject, "an articulated object"),
        ):
            for name in criterion.objects if isinstance(criterion, types) else ():
                if not isinstance(state.objects[name].model, kind):
                    raise GoalError(
                        f"the goal is unreachable, because {criterion.type} does not apply to {name!r}, which is "
                        f"{other}",
                        field=field,
                        remedy="choose another object or criterion (see docs/reference/tasks.md)",
                    )


def _openness_range(criteria: Iterable[Criterion], name: str) -> tuple[float, float]:
    """Return the exclusive bounds (lower, upper) that the criteria of a goal set for the openness of an object."""
    low, high = -np.inf, np.inf
    for criterion in criteria:
        if isinstance(criterion, ArticulatedOpen) and criterion.object == name:
            low = max(low, criterion.threshold)
        elif isinstance(criterion, ArticulatedClosed) and criterion.object == name:
            high = min(high, criterion.threshold)
        elif isinstance(criterion, ArticulatedBetween) and criterion.object == name:
            low, high = max(low, criterion.low), min(high, criterion.high)
    return low, high


def _beyond_reach(criterion: RigidLifted | RigidMoved, thing: PlacedObject, robot: RobotProfile) -> float:
    """Return the distance (m) from the reach of a hand that points down to the nearest place that meets a criterion."""
    base = np.array(robot.base_position)
    if isinstance(criterion, RigidLifted):
        return max(0.0, float(thing.position[2] + criterion.height - base[2]) - 2.0 * robot.reach)
    along = np.array(DIRECTIONS[criterion.direction])
    across = np.array([-along[1], along[0]])
    offset = thing.position[:2] - base[:2]
    # The accepted positions form a wedge: they have at least the distance in the direction, and half as much sideways
    # at most. Find the point of the wedge that is closest to the base.
    best = np.inf
    for way in np.linspace(criterion.distance, criterion.distance + 1.0, 101):
        strayed = float(np.clip(-offset @ across, -way / 2, way / 2))
        best = min(best, float(np.linalg.norm(offset + way * along + strayed * across)))
    return max(0.0, best - robot.reach)
