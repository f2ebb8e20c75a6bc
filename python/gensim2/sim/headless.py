"""Simulate a task in a physics engine without ManiSkill's environment. Only the selected engine is imported.

With SAPIEN, the bodies, their order and therefore all states are the same as in :class:`~gensim2.sim.env.GenSim2Env`.
This environment is faster: it has no batched tensors or rewards, and computes observations only on request.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
import numpy.typing as npt

from gensim2.core.arrays import Array
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
from gensim2.sim.parts import RigidPart, Row
from gensim2.sim.scene_state import RobotReader, SceneAccessMixin, StandingRobot, read_scene
from gensim2.tasks.criteria import all_hold
from gensim2.tasks.spec import TaskSpec

if TYPE_CHECKING:
    from gensim2.perception.raycast.observer import Observer, Photograph
    from gensim2.sim.pictures import StatePictures


NO_POSE = np.full(7, np.nan, dtype=np.float32)
"""Placeholder for a tool pose that is not computed."""


@dataclass(frozen=True)
class Snapshot:
    """State from which an episode can continue.

    Attributes:
        physics: (D,) state of the engine.
        scene: hash of the scene.
        elapsed_steps: number of control steps since the reset.
        command: last gripper command.
    """

    physics: Array
    scene: str
    elapsed_steps: int
    command: float


class HeadlessEnv(SceneAccessMixin):
    """Physics-only environment of a task; actions are those of the control mode ``pd_joint_pos``.

    The engine ``sapien`` (default) gives the same states as :class:`~gensim2.sim.env.GenSim2Env`. The engine ``mujoco``
    needs neither SAPIEN nor PyTorch.

    Example:
        ```python
        import numpy as np

        env = gensim2.HeadlessEnv("OpenDrawer", assets="builtin")
        env.reset(seed=7)
        env.step(np.append(env.initial_state.start[:7], 1.0))  # targets of the arm's joints in rad; gripper -1..1
        env.measure().openness
        ```

    Args:
        task: library task, :class:`TaskSpec`, its fields, or a :class:`~gensim2.scenes.config.SceneConfig`.
        scene: see :class:`~gensim2.scenes.config.SceneArguments`. A reset chooses from ``instances``: an id is for the
            first object whose class has several instances, and a mapping is for named objects.

    Raises:
        InputError: an argument is invalid.
    """

    control_mode = "pd_joint_pos"
    waits = True

    def __init__(self, task: str | TaskSpec | Mapping[str, Any] | SceneConfig, **scene: Unpack[SceneArguments]) -> None:
        self._sampler = sampler = SceneSampler(task, **scene)
        self.task, self.profile, self.randomization = sampler.task, sampler.profile, sampler.randomization
        self.engine, self.physics = sampler.engine, physics_switches(sampler.physics)
        self.instance_ids = sampler.instances
        # Seed and initial state of the last reset without options. Another reset with this seed uses the state again.
        self._drawn: tuple[int, InitialState] | None = None
        self.seed = 0
        self.elapsed_steps = 0
        self.reset_options: dict[str, Any] = {}
        self._observers: dict[ObservationSpec, Observer] = {}
        self._pictures: StatePictures | None = None

    @property
    def max_episode_steps(self) -> int:
        """Maximum number of control steps of an episode."""
        return self.profile.steps(self.task.max_seconds)

    def reset(self, seed: int, options: Mapping[str, Any] | None = None, *, robot: bool = True) -> None:
        """Build a new scene.

        Args:
            seed: 0 to 2**32 - 1.
            options: as in :class:`~gensim2.sim.env.GenSim2Env`.
            robot: False leaves the robot out, for the no-op baseline.

        Raises:
            InputError: a seed, an option, or an object's file is invalid.
        """
        read_options(options, tuple(self.task.objects))
        self.seed = check_seed(seed)
        self.reset_options = {name: value for name, value in (options or {}).items() if name in RESET_OPTIONS}
        # The initial state of a seed is sampled once for both the episode and its no-op baseline.
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
            raise GenSim2Error("the scene was built without the robot (call reset with robot=True)")
        return self._robot

    def step(self, action: npt.ArrayLike) -> None:
        """Execute one control step.

        Args:
            action: (m + 1,): targets of the m arm joints in rad, and the gripper from -1 (closed) to 1 (open).

        Raises:
            InputError: the action has the wrong shape or is not finite.
        """
        self._drive(action)
        self._advance()

    def substep(self, action: npt.ArrayLike) -> None:
        """Execute one of the physics steps of a control step, for simulated sensors that are read more often.

        Args:
            action: as for :meth:`step`.

        Raises:
            InputError: the action has the wrong shape or is not finite.
        """
        self._drive(action)
        self._scene.step()

    def pressing_force(self) -> float:
        """Return the total contact force (N) on the robot in the last physics step."""
        assert self._reader
        return self._scene.pressing_force()

    def wait(self) -> None:
        """Execute one control step without a command; the arm keeps its targets."""
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
        """Return the current state. :meth:`restore` continues from it exactly.

        Raises:
            InputError: the engine is ``sapien``, which cannot restore states.
        """
        assert self.initial_state
        return Snapshot(*self._scene.snapshot(), self.elapsed_steps, self._command)

    def restore(self, snapshot: Snapshot) -> None:
        """Continue from a snapshot after :meth:`reset` with the same seed and options.

        Another process may have made it.

        Raises:
            InputError: the engine cannot restore states, or the snapshot belongs to another scene.
        """
        assert self.initial_state
        self._scene.restore(snapshot.physics, snapshot.scene)
        self.elapsed_steps, self._command = snapshot.elapsed_steps, snapshot.command

    def nudge(self, name: str, dx: float = 0.0, dy: float = 0.0, dyaw: float = 0.0) -> None:
        """Move an object suddenly, as a bump would. :attr:`initial_state` keeps the object's pose at the reset.

        Args:
            name: name of the object.
            dx, dy: displacement in the world frame, m.
            dyaw: rotation about the vertical axis through the object's root, rad.

        Raises:
            InputError: the object does not exist.
        """
        if name not in self.parts:
            raise InputError(f"there is no object {name!r}", field="name", remedy=near(name, self.parts))
        self._parts[name].nudge(dx, dy, dyaw)

    @property
    def success(self) -> bool:
        """Whether the success criteria of the task are met now."""
        return all_hold(self.task.success, self.measure())

    @property
    def is_finite(self) -> bool:
        """Whether all values of the simulation are finite."""
        robot = self._scene.robot
        arm = robot is None or bool(np.isfinite(robot.q).all())
        return arm and all(part.is_finite for part in self.parts.values())

    def touched(self) -> frozenset[str]:
        """Return the names of the objects that the robot touches."""
        assert self._reader
        return self._scene.touched()

    @property
    def q(self) -> npt.NDArray[np.float64]:
        """Positions (n,) of the robot's active joints, rad or m."""
        return self._reader.q

    @property
    def qvel(self) -> npt.NDArray[np.float64]:
        """Velocities (n,) of the robot's joints, rad/s or m/s."""
        return self._reader.qvel

    def scene_state(self) -> Scene:
        """Return the scene in the planner's form."""
        return read_scene(self._reader, self._parts)

    def state(self) -> dict[str, dict[str, Row]]:
        """Return the state of all bodies in the form of ManiSkill's ``env_states``.

        The state of a rigid body is its pose (7,) and velocities (6,). The state of an articulation consists of
        the pose and velocities of its root, and of the positions and velocities of its joints.
        """
        assert self._reader
        found: dict[str, dict[str, Row]] = {
            "actors": {},
            "articulations": {self.profile.agent: self._scene.robot_state()},
        }
        for name, part in self._parts.items():
            found["actors" if isinstance(part, RigidPart) else "articulations"][name] = part.state()
        return found

    def observe(self, spec: ObservationSpec) -> Observation:
        """Return the observation of this instant; the same state, spec and seed give the same bytes.

        Args:
            spec: observation spec. Colours (``rgb``) need a second scene with a renderer, which takes 2 GB.

        Raises:
            EmptyCloudError: the point cloud is empty.
            InputError: an object's files cannot be used, or no renderer works for ``rgb``.
            MissingExtraError: Embree is not installed.
        """
        observer = self._observers.get(spec)
        if observer is None:
            observer = self._observers[spec] = self._observer(spec)
        if spec.is_proprioceptive:  # An observation without a camera needs only the robot's state.
            return observer.joints(self.q, self.qvel, self.elapsed_steps, self._command)
        rows = {kind: {name: row[None] for name, row in group.items()} for kind, group in self.state().items()}
        return observer.observe(rows, self.elapsed_steps, self._command)

    def _observer(self, spec: ObservationSpec) -> Observer:
        from gensim2.perception.raycast.observer import Observer  # imported here: most episodes use no camera

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
        """Release all resources that are kept between scenes."""
        if self._pictures is not None:
            self._pictures.close()
            self._pictures = None

    def observation(self, tool: bool = True) -> Row:
        """Return the state observation, a vector (D,).

        The vector has the robot's joint positions, joint velocities and tool pose. For each object in the task's order
        follow openness, joint position, root pose and pose of the moving link if it is articulated, or its pose if it
        is rigid.

        Args:
            tool: whether to compute the pose of the tool. If False, the vector contains NaN instead of the pose.
        """
        q = self.q.astype(np.float32)
        tool_row = tool_pose(self.profile, q) if tool else NO_POSE
        objects = [row for part in self._parts.values() for row in part.observed().values()]
        return np.concatenate([q, self.qvel, tool_row, *objects]).astype(np.float32)
