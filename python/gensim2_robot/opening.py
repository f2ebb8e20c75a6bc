"""Open a control loop with all its devices, and close them at the end."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import FrameType

import numpy as np
from pydantic import ValidationError

from gensim2.core.arrays import Array
from gensim2.core.errors import InputError
from gensim2.core.validation import input_error
from gensim2.perception import Camera, DepthNoise, ObservationSpec
from gensim2.perception.camera_record import CameraRecord
from gensim2.perception.noise import read_noise
from gensim2.planning.strategies import PLANNER_FIELDS, GraspStrategy, parse_strategy
from gensim2.policy.remote.client import RemoteController
from gensim2.policy.remote.protocol import is_url
from gensim2.robots import RobotProfile, robot
from gensim2.rollout.config import TRUE_SCENE
from gensim2.rollout.controller import is_privileged, spec_of
from gensim2.rollout.controller_spec import ControllerSpec, planner_spec
from gensim2.rollout.inputs import TaskInput
from gensim2.tasks.strategies import Strategies
from gensim2_robot.arm import LimitedArm
from gensim2_robot.arm_limits import ArmLimits
from gensim2_robot.calibration.file import Calibration, calibrated, read_calibration, require_calibrated
from gensim2_robot.calibration.file import serials as calibrated_serials
from gensim2_robot.clocks import MachineClock, SimulatedClock
from gensim2_robot.config import SIMULATED, SOFTWARE, LineConfig
from gensim2_robot.devices import ArmDriver, ArmState
from gensim2_robot.eyes import PIXELS
from gensim2_robot.faults import Fault, FullDisk
from gensim2_robot.line import Line, Mind
from gensim2_robot.log import Journal, Journals
from gensim2_robot.log_messages import About
from gensim2_robot.mind import MindSpec, looked_at
from gensim2_robot.real import ByHand, ProcessCameras, open_arm, open_cameras
from gensim2_robot.session import Devices
from gensim2_robot.watch import Watch, WatchRules

REMOTE = "gensim2.policy.remote.client:RemoteController"
CONTACT_SPEED = 0.05
"""Maximum speed (m/s) of the contact point in a planned motion. The drives of an arm follow their targets with a delay,
so an arm that meets the end of a joint range or an obstacle presses with a force that grows with its speed."""
CAMERA_NOISE = "d435"
"""Name of the noise model of the cameras that the control loop supports."""


class DryArm:
    """Arm of a dry run: commands are computed and checked, but not sent."""

    def __init__(self, driver: ArmDriver) -> None:
        self._driver, self.profile = driver, driver.profile

    def poll(self) -> Sequence[ArmState]:
        return self._driver.poll()

    def send(self, q: Array, gripper: float, t: float) -> None:
        """Do nothing."""

    def stand(self) -> None:
        """Stop the arm through its driver. A stop is the only thing that a dry run sends to the arm."""
        self._driver.stand()

    def close(self) -> None:
        """Do nothing, because the caller closes the driver."""


@dataclass(frozen=True)
class Prepared:
    """Checked inputs of a control loop whose devices are not open yet.

    Attributes:
        given: task with scenes and strategies.
        config: configuration of the loop.
        controller: specification of the controller.
        seen: observation spec of the controller.
        privileged: whether the controller gets the true state of the simulated scene.
        noise: depth noise of simulated cameras.
        cameras: cameras to use. For real cameras, the poses are initial guesses.
        calibration: calibration of the cameras; None: the camera poses of the simulation.
    """

    given: TaskInput
    config: LineConfig
    controller: ControllerSpec
    seen: ObservationSpec
    privileged: bool
    limits: ArmLimits
    noise: DepthNoise
    cameras: tuple[Camera, ...]
    calibration: Calibration | None

    @property
    def profile(self) -> RobotProfile:
        return self.limits.profile

    @property
    def goal_ends(self) -> bool:
        """Whether a simulated episode ends as soon as its goal is reached. The planner ends each episode itself."""
        return self.config.is_simulated and self.config.policy is not None and not self.privileged


def prepare(given: TaskInput, config: LineConfig, faults: Sequence[Fault] = ()) -> Prepared:
    """Read and check all inputs of a control loop.

    Args:
        config: configuration of the loop.
        faults: faults to inject.

    Raises:
        InputError: an argument is invalid.
        MissingExtraError: a package is not installed.
    """
    from gensim2_robot.simulated import simulated_cameras

    noise = config.noise if isinstance(config.noise, DepthNoise) else read_noise(config.noise)
    controller = _controller(given, config)
    profile = robot(given.scene.robot)
    limits = ArmLimits.of(profile, speed=config.speed, margin=config.margin, force=config.force, jump=config.jump)
    limits.prepare()
    made = controller.make(given.spec, profile)
    seen, privileged = spec_of(made), is_privileged(made)
    if isinstance(made, RemoteController):
        # This connection to the policy server served only to check the policy; the controller's process opens its own.
        made.close()
    if privileged and not config.is_simulated:
        raise InputError("needs the true state of the scene, which only a simulation has", field=controller.target)
    if seen.is_privileged:
        raise InputError("needs keypoints of the objects, which no camera provides", field=controller.target)
    cameras = simulated_cameras(profile, *config.pixels)
    source = config.source
    if not source.is_rendered:
        if seen.modalities and not set(seen.cameras) <= set(source.devices):
            said = f"the policy looks through {', '.join(seen.cameras)}"
            raise InputError(said, field="--cameras", remedy="name the device of each")
    elif seen.modalities:
        cameras = tuple(each for each in cameras if each.name in seen.cameras)
    for fault in faults:
        if fault.name == "policy-token" and controller.target != REMOTE:
            wrong = f"{fault.name} needs a policy server, because only a server can reject a wrong token"
            raise InputError(wrong, field="--fault", remedy="give --policy ws://HOST:PORT")
        if (fault.kind == "arm" and not config.is_simulated) or (fault.kind == "camera" and not source.is_rendered):
            raise InputError(f"{fault.name} can only be injected into simulated devices", field="--fault")
        if fault.name in ("camera-swapped", "camera-mislabelled"):
            if len(cameras) < 2:
                raise InputError(f"{fault.name} needs at least two cameras", field="fault")
            if source.kind == SOFTWARE:
                problem = "this fault cannot be injected into software devices"
                raise InputError(problem, field="fault", remedy=f"give --cameras {SIMULATED}")
    calibration = None
    if config.calibration is not None:
        # The image size of a real camera is known and compared only when the camera is opened.
        asked = cameras if source.is_rendered else ()
        calibration = read_calibration(config.calibration, given.scene.robot, asked, days=config.calibration_days)
    elif not source.is_rendered and not config.dry:
        raise InputError(
            "real cameras need a calibration",
            field="--calibration",
            remedy="record a log with a dry run, and make a calibration with gensim2 robot calibrate --from LOG",
        )
    return Prepared(given, config, controller, seen, privileged, limits, noise, cameras, calibration)


@dataclass(frozen=True)
class Opened:
    """A control loop with open devices.

    Attributes:
        line: control loop.
        devices: devices of the loop.
        about: description of the control loop, which the log stores.
        disk: simulated disk of the log; None without a log.
    """

    line: Line
    devices: Devices
    about: About
    disk: FullDisk | None


@contextlib.contextmanager
def opened(
    prepared: Prepared,
    *,
    log: Path | None = None,
    watching: Sequence[Journal] = (),
    seed: int | None = None,
    mind: Mind | None = None,
    pace: float | None = None,
    interrupted: Sequence[int] = (),
) -> Iterator[Opened]:
    """Open devices and log, and close them when the block ends.

    Args:
        prepared: checked inputs.
        log: folder of the log; None for no log.
        watching: additional logs, such as a web page.
        seed: seed of all noise; None: the seed in the configuration.
        mind: connection to a controller; None: start the configured controller in its own process.
        pace: control steps per second; None: the robot's control rate, scaled by the speed.
        interrupted: received stop signals, as from :func:`interruptions`.

    Raises:
        InputError: the log's folder is not empty.
        DriverError: a device cannot be opened.
        DeviceGoneError: the process of a device has ended or does not answer, or a stop signal arrived.
    """
    config, given = prepared.config, prepared.given
    noise_seed = config.seed if seed is None else seed
    with contextlib.ExitStack() as stack:
        real: ProcessCameras | None = None
        cameras = prepared.cameras
        if not config.source.is_rendered:
            real = open_cameras(config.source, cameras, config.rate, interrupted)
            giving_up = stack.enter_context(contextlib.ExitStack())
            giving_up.callback(real.close)
            cameras = real.cameras
        believed, serials = cameras, _serials(cameras, real)
        if prepared.calibration is not None:
            assert config.calibration is not None, "it was read from there"
            require_calibrated(prepared.calibration, cameras, config.calibration)
            believed = calibrated(cameras, prepared.calibration)
            serials = {**serials, **calibrated_serials(prepared.calibration)}
        about = about_line(prepared, believed)
        journals: list[Journal] = []
        disk = None if log is None else FullDisk()
        if log is not None and disk is not None:
            from gensim2_robot.log import Log

            written = Log(log, about, opener=disk.open)
            stack.callback(written.close)
            journals.append(written)
        spec = MindSpec(prepared.controller, given.spec, given.scene.robot, believed)
        if config.simulated_clock:
            devices = _local(prepared, spec, noise_seed, mind, interrupted)
        elif config.is_simulated:
            devices = _in_processes(prepared, spec, noise_seed, mind, real, interrupted)
        else:
            assert real is not None, "a real arm has real cameras"
            devices = _real(prepared, spec, real, mind)
        if real is not None:
            giving_up.pop_all()
        stack.callback(devices.close)
        rules = config.rules
        if rules is None:
            rules = WatchRules(behind=np.inf) if config.dry else WatchRules()
        line = Line(
            LimitedArm(DryArm(devices.arm) if config.dry else devices.arm, prepared.limits),
            devices.cameras,
            devices.mind,
            Watch(rules, serials),
            devices.clock,
            Journals([*journals, *watching]),
            pace=pace or prepared.profile.control_hz * config.speed,
        )
        line.commands = []
        yield Opened(line, devices, about, disk)


def _serials(cameras: tuple[Camera, ...], real: ProcessCameras | None) -> Mapping[str, str]:
    from gensim2_robot.simulated import simulated_serials

    return simulated_serials(cameras) if real is None else real.serials


def about_line(prepared: Prepared, believed: tuple[Camera, ...]) -> About:
    """Return the description of a run for its log and its result.

    Args:
        prepared: checked inputs.
        believed: cameras with the poses that are used. In simulation, they may differ from the true poses.
    """
    config, given, controller = prepared.config, prepared.given, prepared.controller
    try:
        return About(
            task=given.spec.name,
            language=given.spec.description,
            robot=given.scene.robot,
            controller=controller.to_dict() if config.policy is not None else {"target": controller.target},
            arm=config.arm,
            speed=config.speed,
            margin=config.margin,
            seed=config.seed,
            pixels=PIXELS,
            observation=looked_at(prepared.seen, believed).to_dict(),
            cameras=[CameraRecord.of(camera) for camera in believed],
        )
    except ValidationError as error:
        raise input_error(error) from error


def _controller(given: TaskInput, config: LineConfig) -> ControllerSpec:
    policy = config.policy
    if policy is None:
        rollout = given.rollout
        if config.scene_source != TRUE_SCENE:
            # The name of a noise model makes the planner filter stray points. Noise is added only to rendered images.
            rollout = replace(rollout, scene_source=config.scene_source, depth_noise=CAMERA_NOISE)
        # The arm executes a plan at the fraction ``speed`` of the planned speed.
        strategies = slow_in_contact(given.strategies, CONTACT_SPEED / config.speed)
        return planner_spec(given.spec, strategies, rollout, given.scene.robot)
    if isinstance(policy, ControllerSpec):
        return policy
    if is_url(str(policy)):
        arguments = {"url": str(policy), "robot": given.scene.robot, "deadline": config.deadline}
        return ControllerSpec(REMOTE, arguments)
    from gensim2.policy.evaluating import controller_for

    return controller_for(policy, given)


def slow_in_contact(strategies: Strategies, speed: float) -> Strategies:
    """Return strategies, as plain data, in which the contact point is not faster than ``speed`` (m/s)."""
    speed = float(np.clip(speed, *PLANNER_FIELDS["contact_speed"]))
    parsed = {name: parse_strategy(data) for name, data in strategies.items()}
    slowest = {
        name: min(speed, speed if each.contact_speed is None else each.contact_speed)
        for name, each in parsed.items()
        if not isinstance(each, GraspStrategy)
    }
    return {
        name: {**data, "contact_speed": slowest[name]} if name in slowest else data for name, data in strategies.items()
    }


def _local(prepared: Prepared, spec: MindSpec, seed: int, mind: Mind | None, interrupted: Sequence[int]) -> Devices:
    from gensim2_robot.local import LocalArm, LocalCameras, LocalMind
    from gensim2_robot.simulated import SimulatedCameras, SimulatedWorld

    config = prepared.config
    with contextlib.ExitStack() as giving_up:
        world, clock = SimulatedWorld(prepared.given.scene), SimulatedClock()
        arm = LocalArm(world, clock)
        giving_up.callback(arm.close)
        simulated = SimulatedCameras(world.profile, prepared.cameras, seed, prepared.noise)
        seeing = LocalCameras(world, simulated, clock, config.rate, config.delays.camera, seed)
        mind = mind or LocalMind(spec, world, clock, config.delays.controller, interrupted)
        giving_up.pop_all()
    return Devices(arm, seeing, mind, clock, arm, {"arm": arm.fail, "camera": seeing.fail, "policy": mind.fail})


def _in_processes(
    prepared: Prepared,
    spec: MindSpec,
    seed: int,
    mind: Mind | None,
    played: ProcessCameras | None,
    interrupted: Sequence[int],
) -> Devices:
    from gensim2_robot.processes import ProcessArm, ProcessMind
    from gensim2_robot.simulated import RenderedCameras

    config, scene = prepared.config, prepared.given.scene
    with contextlib.ExitStack() as giving_up:
        arm = ProcessArm(scene)
        giving_up.callback(arm.close)
        mind = mind or ProcessMind(spec, arm.truth)
        giving_up.callback(mind.close)
        failing = {"arm": arm.fail, "policy": mind.fail}
        seeing = played
        if seeing is None:
            through = config.source.kind == SOFTWARE
            how = (scene.robot, prepared.cameras, arm.eyes, seed, config.rate, prepared.noise, through)
            seeing = ProcessCameras(RenderedCameras, *how, interrupted=interrupted)
            failing["camera"] = seeing.fail
        giving_up.pop_all()
    return Devices(arm, seeing, mind, MachineClock(), arm, failing)


def _real(prepared: Prepared, spec: MindSpec, cameras: ProcessCameras, mind: Mind | None) -> Devices:
    from gensim2_robot.processes import ProcessMind

    with contextlib.ExitStack() as giving_up:
        arm = open_arm(prepared.config.arm, prepared.profile)
        giving_up.callback(arm.close)
        mind = mind or ProcessMind(spec, None)
        giving_up.pop_all()
    return Devices(arm, cameras, mind, MachineClock(), ByHand(), {"policy": mind.fail})


@contextlib.contextmanager
def interruptions() -> Iterator[list[int]]:
    """Collect stop signals (Ctrl-C, SIGTERM) in the yielded list, so that the program can stop the arm first."""
    came: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield came
        return

    def note(number: int, _: FrameType | None) -> None:
        came.append(number)

    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {number: signal.signal(number, note) for number in numbers}
    try:
        yield came
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
