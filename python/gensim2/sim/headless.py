"""Physics-only environment in one of the engines; nothing here imports an engine that is not asked for.

In SAPIEN it is the scene of :class:`~gensim2.sim.env.GenSim2Env`, without ManiSkill around each step: the same bodies
in the same order, the same drives and numbers. For the same actions its states are those of the registered
environment, bit for bit. It leaves out what a search or a collection never reads: tensors of one row, rewards, and
observations that were not asked for.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
import numpy.typing as npt

from gensim2.core.errors import GenSim2Error, InputError, near
from gensim2.core.seeding import check_seed
from gensim2.perception import Observation, ObservationSpec
from gensim2.perception.observation import tool_pose
from gensim2.planning.scene import Scene
from gensim2.robots import OPEN
from gensim2.scenes.config import SceneArguments, SceneConfig, SceneOptions
from gensim2.scenes.initial_state import InitialState
from gensim2.scenes.physics import physics_switches
from gensim2.scenes.reset_options import RESET_OPTIONS, read_options
from gensim2.scenes.sampler import SceneSampler
from gensim2.sim.engines import scene_class
from gensim2.sim.parts import Array, RigidPart, Row
from gensim2.sim.scene_state import RobotReader, SceneAccessMixin, StandingRobot, read_scene
from gensim2.tasks.criteria import all_hold
from gensim2.tasks.spec import TaskSpec

if TYPE_CHECKING:
    from gensim2.perception.raycast.observer import Observer, Photograph
    from gensim2.sim.pictures import StatePictures


NO_POSE = np.full(7, np.nan, dtype=np.float32)
"""Pose of a tool that is not worked out."""


@dataclass(frozen=True)
class Snapshot:
    """State of an episode from which it goes on.

    Attributes:
        physics: (D,) of the engine.
        scene: digest of the scene to which the state belongs.
        elapsed_steps: control steps since the reset.
        command: last command of the gripper.
    """

    physics: Array
    scene: str
    elapsed_steps: int
    command: float


class HeadlessEnv(SceneAccessMixin):
    """Physics-only environment of a task; actions are those of the control mode ``pd_joint_pos``.

    The engine ``sapien`` (default) gives the states of :class:`~gensim2.sim.env.GenSim2Env`, bit for bit. The engine
    ``mujoco`` simulates the same scene without SAPIEN, ManiSkill and PyTorch.

    Example:
        ```python
        env = gensim2.HeadlessEnv("OpenDrawer", assets="builtin")
        env.reset(seed=7)
        env.step(np.append(env.initial_state.start[:7], 1.0))  # targets of the arm's joints in rad; gripper -1..1
        env.measure().openness
        ```

    Args:
        task: name of a library task, a :class:`TaskSpec`, or its fields; or a
            :class:`~gensim2.scenes.config.SceneConfig`, which says everything.
        scene: see :class:`~gensim2.scenes.config.SceneArguments`. A reset draws one of ``instances``; an id is said of
            the first object of whose class there are several, or of any, as a mapping from an object's name.

    Raises:
        InputError: an argument is wrong.
    """

    control_mode = "pd_joint_pos"
    waits = True

    def __init__(self, task: str | TaskSpec | Mapping[str, Any] | SceneConfig, **scene: Unpack[SceneArguments]) -> None:
        self._sampler = sampler = SceneSampler(task, **scene)
        self.task, self.profile, self.randomization = sampler.task, sampler.profile, sampler.randomization
        self.engine, self.physics = sampler.engine, physics_switches(sampler.physics)
        self.instance_ids = sampler.instances
        self._drawn: tuple[int, InitialState] | None = None  # what the last seed drew by itself
        self.seed = 0
        self.elapsed_steps = 0
        self.reset_options: dict[str, Any] = {}
        self._observers: dict[ObservationSpec, Observer] = {}
        self._pictures: StatePictures | None = None

    @property
    def max_episode_steps(self) -> int:
        """Control steps after which an episode is truncated."""
        return self.profile.steps(self.task.max_seconds)

    # ------------------------------------------------------------------ scene

    def reset(self, seed: int, options: Mapping[str, Any] | None = None, *, robot: bool = True) -> None:
        """Build a fresh scene.

        Args:
            seed: 0 to 2**32 - 1.
            options: as in :class:`~gensim2.sim.env.GenSim2Env`.
            robot: leave the arm out where False, to see what the objects do by themselves.

        Raises:
            InputError: a seed or an option cannot be used, or an object's files.
        """
        read_options(options, tuple(self.task.objects))
        self.seed = check_seed(seed)
        self.reset_options = {name: value for name, value in (options or {}).items() if name in RESET_OPTIONS}
        # What a seed drew is drawn once, for the episode and for its no-op baseline.
        if options or self._drawn is None or self._drawn[0] != self.seed:
            setup = self._sampler.sample(self.seed, options)
            self._drawn = None if options else (self.seed, setup)
        else:
            setup = self._drawn[1]
        self._scene = scene_class(self.engine)(self.profile, self._sampler.physics, setup, robot)
        self._parts = self._scene.parts
        self._initial_state, self.elapsed_steps, self._command = setup, 0, OPEN
        self._observers = {}
        self._robot = self._scene.robot or StandingRobot(self.profile, setup.start)

    @property
    def _reader(self) -> RobotReader:
        assert self.initial_state
        if isinstance(self._robot, StandingRobot):
            raise GenSim2Error("the scene was built without the robot")
        return self._robot

    # ------------------------------------------------------------------- time

    def step(self, action: npt.ArrayLike) -> None:
        """One control step.

        Args:
            action: (m + 1,): targets of the m arm joints in rad, and the gripper from -1 (closed) to 1 (open).

        Raises:
            InputError: the action has the wrong shape or is not finite.
        """
        self._drive(action)
        self._advance()

    def substep(self, action: npt.ArrayLike) -> None:
        """One step of the physics, a part of a control step: for devices that are driven at its rate.

        Args:
            action: as of :meth:`step`.

        Raises:
            InputError: the action has the wrong shape or is not finite.
        """
        self._drive(action)
        self._scene.step()

    def pressing_force(self) -> float:
        """Force (N) with which everything else pressed on the robot in the last step of the physics, all in all."""
        assert self._reader
        return self._scene.pressing_force()

    def wait(self) -> None:
        """One control step in which nothing is commanded."""
        assert self.initial_state
        self._advance()

    def _drive(self, action: npt.ArrayLike) -> None:
        assert self._reader
        self._scene.drive(action)
        self._command = float(np.asarray(action, dtype=np.float32)[-1])

    def _advance(self) -> None:
        for _ in range(self.profile.substeps):
            self._scene.step()
        self.elapsed_steps += 1

    def snapshot(self) -> Snapshot:
        """Return the state of this instant, from which :meth:`restore` goes on bit for bit.

        Raises:
            InputError: the engine is ``sapien``, which cannot.
        """
        assert self.initial_state
        return Snapshot(*self._scene.snapshot(), self.elapsed_steps, self._command)

    def restore(self, snapshot: Snapshot) -> None:
        """Go on from a state of the scene that the last reset built, in this process or another.

        Raises:
            InputError: the engine cannot, or the state is that of another scene.
        """
        assert self.initial_state
        self._scene.restore(snapshot.physics, snapshot.scene)
        self.elapsed_steps, self._command = snapshot.elapsed_steps, snapshot.command

    def nudge(self, name: str, dx: float = 0.0, dy: float = 0.0, dyaw: float = 0.0) -> None:
        """Disturb an object, as a bump would: what the seed drew (``setup``) stays as it was.

        Args:
            name: of the object.
            dx, dy: metres in the world.
            dyaw: rad about the vertical through its root.

        Raises:
            InputError: there is no such object.
        """
        if name not in self.parts:
            raise InputError(f"there is no object {name!r}", field="name", remedy=near(name, self.parts))
        self._parts[name].nudge(dx, dy, dyaw)

    # ------------------------------------------------------------ measurement

    @property
    def success(self) -> bool:
        """Whether all of the task's goal holds now."""
        return all_hold(self.task.success, self.measure())

    @property
    def is_finite(self) -> bool:
        """Whether physics still gives numbers for the robot and the objects."""
        robot = self._scene.robot
        arm = robot is None or bool(np.isfinite(robot.q).all())
        return arm and all(part.is_finite for part in self.parts.values())

    def touched(self) -> frozenset[str]:
        """Names of the objects that any part of the robot presses against."""
        assert self._reader
        return self._scene.touched()

    @property
    def q(self) -> npt.NDArray[np.float64]:
        """(n,) robot joints, rad and m."""
        return self._reader.q

    @property
    def qvel(self) -> npt.NDArray[np.float64]:
        """(n,) velocities of the robot's joints, rad/s and m/s."""
        return self._reader.qvel

    def scene_state(self) -> Scene:
        """The scene as the planner sees it, in the robot base frame; geometry only."""
        return read_scene(self._reader, self._parts)

    def state(self) -> dict[str, dict[str, Row]]:
        """ManiSkill's ``env_states`` of this instant: root pose (7,) and velocities (6,) of each; of what has joints
        also qpos and qvel (n,)."""
        assert self._reader
        found: dict[str, dict[str, Row]] = {
            "actors": {},
            "articulations": {self.profile.agent: self._scene.robot_state()},
        }
        for name, part in self._parts.items():
            found["actors" if isinstance(part, RigidPart) else "articulations"][name] = part.state()
        return found

    def observe(self, spec: ObservationSpec) -> Observation:
        """Observe this instant; of one state, spec and seed always the same bytes.

        Args:
            spec: what is looked at. Colour pictures (``rgb``) cost a second scene with a renderer, 2 GB.

        Raises:
            EmptyCloudError: the cameras see nothing that a point cloud keeps.
            InputError: an object's files cannot be used, or no renderer works for ``rgb``.
            MissingExtraError: Embree is not installed.
        """
        observer = self._observers.get(spec)
        if observer is None:
            observer = self._observers[spec] = self._observer(spec)
        if spec.is_proprioceptive:  # no more of the state is looked at
            return observer.joints(self.q, self.qvel, self.elapsed_steps, self._command)
        rows = {kind: {name: row[None] for name, row in group.items()} for kind, group in self.state().items()}
        return observer.observe(rows, self.elapsed_steps, self._command)

    def _observer(self, spec: ObservationSpec) -> Observer:
        from gensim2.perception.raycast.observer import Observer  # here: most episodes look through no camera

        photograph = None
        models = {name: thing.model for name, thing in self.initial_state.objects.items()}
        if "rgb" in spec.modalities:
            photograph = self._photograph({name: model.id for name, model in models.items()})
        return Observer(self.profile, models, spec, self.seed, self.task.description, photograph)

    def _photograph(self, instances: dict[str, str]) -> Photograph:
        from gensim2.sim.pictures import StatePictures

        if self._pictures is None:
            words = {"physics": self._sampler.physics, "robot": self._sampler.robot}
            options = SceneOptions.of(assets=self._sampler.library, **words)
            self._pictures = StatePictures(options.with_task(self.task))
        self._pictures.show(instances, self.seed, {**self.reset_options, "instance": instances})
        return self._pictures.colors

    def close(self) -> None:
        """Release the resources that do not belong to the scene."""
        if self._pictures is not None:
            self._pictures.close()
            self._pictures = None

    def observation(self, tool: bool = True) -> Row:
        """(D,) the environment's state observation of this instant: qpos, qvel and tool pose of the robot, then of each
        object in the task's order openness, qpos, pose of its root and of its moving link, or the pose alone of a
        rigid one.

        Args:
            tool: False leaves NaN for the tool's pose.
        """
        q = self.q.astype(np.float32)
        tool_row = tool_pose(self.profile, q) if tool else NO_POSE
        objects = [row for part in self._parts.values() for row in part.observed().values()]
        return np.concatenate([q, self.qvel, tool_row, *objects]).astype(np.float32)
