"""A scripted world: its measurements are given in advance and nothing is simulated.

It replaces the simulator in tests of one certain course of events.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.perception import Encoder, Observation, ObservationSpec
from gensim2.planning.scene import Scene, SceneBody, SceneObject
from gensim2.robots import RobotProfile, robot
from gensim2.rollout.controller import PROPRIOCEPTIVE, Action, Event, PrivilegedObservation
from gensim2.rollout.record import StepRecord
from gensim2.tasks.measurement import Measurement
from gensim2.tasks.parse import parse_task
from gensim2.tasks.spec import TaskSpec

Array = npt.NDArray[np.float64]

OPEN_DRAWER = parse_task(
    {
        "schema_version": 2,
        "name": "ScriptedOpen",
        "description": "open the drawer",
        "objects": {"drawer": {"class": "drawer"}},
        "steps": [
            {
                "name": "open",
                "object": "drawer",
                "strategies": ["pull"],
                "done": [{"type": "articulated_open", "object": "drawer"}],
            }
        ],
        "max_episode_steps": 100,
    }
)

PUT_BALL_AWAY = parse_task(
    {
        "schema_version": 2,
        "name": "ScriptedPut",
        "description": "put the ball into the drawer",
        "objects": {"drawer": {"class": "drawer"}, "ball": {"class": "golf_ball"}, "cup": {"class": "cup"}},
        "steps": [
            {"name": "grasp", "object": "ball", "strategies": ["grasp"]},
            {
                "name": "place",
                "object": "drawer",
                "tool": "ball",
                "strategies": ["place"],
                "done": [{"type": "distance_articulated_rigidbody", "articulated": "drawer", "rigid": "ball"}],
            },
        ],
        "max_episode_steps": 100,
    }
)

HANDLE, INSIDE = np.array([0.2, 0.0, 0.1]), np.array([0.1, 0.0, 0.1])
"""Keypoints of the drawer at openness 0, in the world; it opens towards -x, by 0.2 m."""
WAY = np.array([-0.2, 0.0, 0.0])
AWAY = np.array([-0.3, 0.3, 0.5])
"""Hand position after the retreat."""


def instant(
    openness: float = 0.0,
    ball: Sequence[float] = (0.0, -0.4, 0.02),
    hand: Sequence[float] | Array = AWAY,
    opening: float = 0.08,
    *,
    joint_speed: float = 0.0,
    speed: tuple[float, float] = (0.0, 0.0),
    cup: Sequence[float] = (0.3, 0.4, 0.05, 1.0, 0.0, 0.0, 0.0),
) -> Measurement:
    """Return an instant of the drawer, the ball and a cup that must not be touched.

    ``ball`` is its position or pose; ``joint_speed`` and ``speed`` are the physics engine's values for the drawer and
    the ball, which may differ from their motion.
    """
    lies = np.array([*ball, 1.0, 0.0, 0.0, 0.0] if len(ball) == 3 else ball, dtype=np.float64)
    at, place = lies[:3], np.asarray(hand, dtype=np.float64)
    standing = np.asarray(cup, dtype=np.float64)
    moved = openness * WAY
    return Measurement(
        openness={"drawer": openness},
        joint_speed={"drawer": joint_speed},
        keypoints={
            "drawer": {"head": HANDLE + moved, "inside": INSIDE + moved},
            "ball": {"head": at},
            "cup": {"head": standing[:3]},
        },
        poses={"ball": lies, "cup": standing},
        speeds={"ball": np.array(speed), "cup": np.zeros(2)},
        gripper={"tool_head": place, "tool_tail": place + np.array([0.0, 0.0, 0.03])},
        finger_opening=opening,
        contents={"drawer": frozenset({"ball"} if _is_in_tray(at - INSIDE - moved) else ())},
    )


def _is_in_tray(offset: Array) -> bool:
    """Return whether a point, from the drawer's measured keypoint 10 cm above its floor, lies between its walls."""
    return bool((np.abs(offset[:2]) < 0.09).all() and -0.09 < offset[2] < 0.0)


def _box(low: Sequence[float], high: Sequence[float]) -> Array:
    return np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])


TRAY = (
    _box((-0.1, -0.1, 0.0), (0.1, 0.1, 0.01)),
    _box((-0.1, -0.1, 0.0), (-0.09, 0.1, 0.1)),
    _box((0.09, -0.1, 0.0), (0.1, 0.1, 0.1)),
    _box((-0.1, -0.1, 0.0), (0.1, -0.09, 0.1)),
    _box((-0.1, 0.09, 0.0), (0.1, 0.1, 0.1)),
)
"""A floor and four walls in the frame of the drawer's moving link, whose origin is below ``INSIDE``."""
BALL = (_box((-0.02, -0.02, -0.02), (0.02, 0.02, 0.02)),)


@dataclass
class ScriptedWorld:
    """The measurements after each control step are those of ``course``, and after its end the last one.

    Attributes:
        task: the task.
        course: measurements from the reset on.
        alone: measurements without the arm; by default nothing moves.
        touches: names of objects that the hand touches.
    """

    task: TaskSpec
    course: Sequence[Measurement]
    alone: Sequence[Measurement] = ()
    touches: frozenset[str] = frozenset()
    seed: int = 0
    elapsed_steps: int = 0
    control_mode: str = "pd_joint_pos"
    is_finite: bool = True
    waits: bool = True
    profile: RobotProfile = field(default_factory=lambda: robot("panda"))
    reset_options: Mapping[str, Any] = field(default_factory=dict)

    def reset(self, seed: int, options: Mapping[str, Any] | None = None, *, robot: bool = True) -> None:
        self.seed, self.elapsed_steps = seed, 0
        self._now: Sequence[Measurement] = self.course if robot else (self.alone or self.course[:1])

    def step(self, action: npt.ArrayLike) -> None:
        self.elapsed_steps += 1

    def wait(self) -> None:
        self.elapsed_steps += 1

    def measure(self) -> Measurement:
        return self._now[min(self.elapsed_steps, len(self._now) - 1)]

    def touched(self) -> frozenset[str]:
        return self.touches

    def observe(self, spec: ObservationSpec) -> Observation:
        return Encoder(spec, self.profile).encode(self.elapsed_steps, self.q, np.zeros(9), 1.0)

    def close(self) -> None:
        pass

    @property
    def q(self) -> Array:
        return np.array(self.profile.reset_qpos)

    def state(self) -> dict[str, Any]:
        return {}

    def observation(self, tool: bool = True) -> npt.NDArray[np.float32]:
        return np.zeros(25, np.float32)

    @property
    def initial_state(self) -> Any:
        point = SimpleNamespace(link="tray", position=np.array([0.0, 0.0, 0.1]))
        joint = SimpleNamespace(type="prismatic", lower=0.0, upper=0.2)
        common = {"id": "0", "source": "generated", "content_hash": "ab"}
        models = {
            "drawer": SimpleNamespace(
                asset_class="drawer", joint=joint, keypoints={"head": point, "inside": point}, **common
            ),
            "ball": SimpleNamespace(asset_class="golf_ball", joint=None, keypoints={}, **common),
            "cup": SimpleNamespace(asset_class="cup", joint=None, keypoints={}, **common),
        }
        placed = {
            name: SimpleNamespace(
                model=models[name],
                position=np.zeros(3),
                quaternion=np.array([1.0, 0.0, 0.0, 0.0]),
                yaw=0.0,
                default_pose="default",
                factors=SimpleNamespace(mass=1.0, contact_friction=1.0, joint_friction=1.0),
            )
            for name in self.task.objects
        }
        start = self.profile.reset_qpos
        return SimpleNamespace(objects=placed, draws=1, start=start, randomization="paper")

    def scene_state(self) -> Scene:
        measured = self.measure()
        T_world_base = self.profile.T_world_base
        T_base_world = np.linalg.inv(T_world_base)

        def thing(name: str, body: str, hulls: tuple[Array, ...], at: Array) -> SceneObject:
            pose = np.eye(4)
            pose[:3, 3] = at
            return SceneObject(name, (SceneBody(body, hulls, T_base_world @ pose),), T_base_world @ pose, {})

        objects = {"drawer": thing("drawer", "drawer/tray", TRAY, measured.point("drawer") - [0.0, 0.0, 0.1])}
        objects |= {name: thing(name, name, BALL, pose[:3]) for name, pose in measured.poses.items()}
        return Scene(self.q, np.zeros(9), T_world_base, objects)


class ScriptedController:
    """Acts for the scripted number of steps and reports scripted turns and deviations.

    Args:
        turns: name of each step and the control step at which its turn starts.
        steps: number of control steps.
        history, events: its records at the end.
    """

    def __init__(
        self,
        steps: int,
        turns: Sequence[tuple[str, int]] = (),
        history: Sequence[StepRecord] = (),
        events: Sequence[Event] = (),
        see: Callable[[PrivilegedObservation], None] = lambda observation: None,
    ) -> None:
        self._steps, self._turns, self._see = steps, turns, see
        self.history, self.events = history, events
        self.turn: str | None = None

    privileged = True
    observation_spec = PROPRIOCEPTIVE

    def reset(self, observation: PrivilegedObservation, seed: int) -> None:
        self.turn = None

    def act(self, observation: PrivilegedObservation) -> Action | None:
        self._see(observation)
        for name, first in self._turns:
            if observation.step >= first:
                self.turn = name
        return np.zeros(8, np.float32) if observation.step < self._steps else None


def glide(*waypoints: tuple[int, Mapping[str, Any]]) -> list[Measurement]:
    """Interpolate measurements between waypoints: (control step, arguments of :func:`instant`)."""
    course = []
    for (first, before), (last, after) in pairwise(waypoints):
        for step in range(first, last):
            share = (step - first) / (last - first)
            course.append(instant(**{key: _between(before[key], after[key], share) for key in after}))
    return [*course, instant(**waypoints[-1][1])]


def _between(before: Any, after: Any, share: float) -> Any:
    mixed = (1 - share) * np.asarray(before, dtype=np.float64) + share * np.asarray(after, dtype=np.float64)
    return float(mixed) if mixed.ndim == 0 else mixed
