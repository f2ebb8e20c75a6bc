"""``gensim2 robot run``: episodes on an arm until the time is over or something ends them, and what came of it."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import FrameType
from typing import Any, Unpack

import numpy as np

from gensim2.deploy.arm import Arm
from gensim2.deploy.arm_limits import FORCE, JUMP, MARGIN, SPEED, ArmLimits, Array
from gensim2.deploy.calibration.file import DAYS, calibrated, read_calibration
from gensim2.deploy.calibration.file import serials as calibrated_serials
from gensim2.deploy.clocks import MachineClock, SimulatedClock
from gensim2.deploy.devices import ArmDriver, ArmState
from gensim2.deploy.faults import Fault, FullDisk
from gensim2.deploy.fit_noise import read_noise
from gensim2.deploy.keys import Keys
from gensim2.deploy.line import Journal, Line, NoJournal
from gensim2.deploy.mind import MindSpec, looked_at
from gensim2.deploy.remote.client import DEADLINE, RemoteController
from gensim2.deploy.remote.protocol import is_url
from gensim2.deploy.replay import camera_to_dict
from gensim2.deploy.session import Devices, Session
from gensim2.deploy.watch import Watch, WatchRules
from gensim2.errors import InputError
from gensim2.observations import Camera, DepthNoise
from gensim2.progress import NULL_PROGRESS, Progress
from gensim2.robots import robot
from gensim2.rollout.controller import is_privileged, spec_of
from gensim2.rollout.controller_spec import ControllerSpec
from gensim2.rollout.inputs import TaskInput, read_task_input
from gensim2.scenes.config import SceneArguments


class DryArm:
    """An arm that is told nothing: all is computed and judged, and nothing is sent."""

    def __init__(self, driver: ArmDriver) -> None:
        self._driver, self.profile = driver, driver.profile

    def poll(self) -> Sequence[ArmState]:
        """States that came."""
        return self._driver.poll()

    def send(self, q: Array, gripper: float, t: float) -> None:
        """Nothing."""

    def stand(self) -> None:
        """Stop all the same."""
        self._driver.stand()


def run(
    task: str,
    *,
    policy: Path | str | None = None,
    deadline: float = DEADLINE,
    speed: float = SPEED,
    margin: float = MARGIN,
    force: float = FORCE,
    jump: float = JUMP,
    minutes: float = 1.0,
    episodes: int | None = None,
    faults: Sequence[Fault] = (),
    pixels: tuple[int, int] = (320, 240),
    rate: float = 10.0,
    noise: DepthNoise | str | Path = "d435",
    calibration: Path | None = None,
    calibration_days: float = DAYS,
    seed: int = 0,
    log: Path | None = None,
    dry: bool = False,
    simulated_clock: bool = False,
    rules: WatchRules | None = None,
    keys: Keys | None = None,
    progress: Progress = NULL_PROGRESS,
    **scene: Unpack[SceneArguments],
) -> dict[str, Any]:
    """Let a policy, or the planner's chain, drive a simulated arm through the deployed line.

    Args:
        task: name of a library task, or a folder that holds one.
        policy: a checkpoint, or the URL of a server (``ws://host:port``); None: the plan's chain, which is shown the
            true scene.
        deadline: seconds within which an action must come from a server.
        speed: share of the arm's speed; control steps are stretched by as much.
        margin: rad that joints keep from the ends of their range.
        force: that may press on the arm, N.
        jump: rad by which the first action of an episode may lie off where the arm stands.
        minutes: after which no episode goes on.
        episodes: at most; None: as many as there is time for.
        faults: of the simulated devices.
        pixels: width and height of the cameras' pictures.
        rate: of the cameras, pictures a second.
        noise: of the simulated cameras: itself, ``d435``, ``white``, or a file that was fitted.
        calibration: file that says where the cameras are; None: they are where the simulation has them.
        calibration_days: of its age from which on it is refused.
        seed: of the scenes and of all noise.
        log: folder of the log; None: nothing is written down.
        dry: nothing is sent to the arm.
        simulated_clock: everything in this process, by a clock that waits for it.
        rules: of the watch.
        keys: of a person, who resumes or stops.
        progress: is told of episodes.
        scene: see :class:`~gensim2.scenes.config.SceneArguments`.

    Returns:
        Plain data: docs/robot.md.

    Raises:
        InputError: an argument cannot be used.
        MissingExtraError: what is needed is not installed.
    """
    if not 0.0 < minutes < 1e5:
        raise InputError(f"must be positive, is {minutes}", field="minutes")
    for fault in faults:
        if fault.name == "disk-full" and log is None:
            raise InputError("disk-full needs a log that can fail", field="fault", remedy="leave out --no-log")
    given = read_task_input(task, seed=seed, **scene)
    depth_noise = noise if isinstance(noise, DepthNoise) else read_noise(noise)
    controller = _controller(given, policy, deadline)
    profile = robot(given.scene.robot)
    limits = ArmLimits.of(profile, speed=speed, margin=margin, force=force, jump=jump)
    limits.prepare()
    made = controller.make(given.spec, profile)
    from gensim2.deploy.simulated_cameras import simulated_cameras, simulated_serials

    seen = spec_of(made)
    cameras = simulated_cameras(profile, *pixels)
    if seen.modalities:
        cameras = tuple(each for each in cameras if each.name in seen.cameras)
    if len(cameras) < 2 and any(fault.name in ("camera-swapped", "camera-mislabelled") for fault in faults):
        raise InputError("there is one camera, and nothing to exchange it with", field="fault")
    believed, serials = cameras, simulated_serials(cameras)
    if calibration is not None:
        read = read_calibration(calibration, given.scene.robot, cameras, days=calibration_days)
        believed, serials = calibrated(cameras, read), {**serials, **calibrated_serials(read)}
    privileged = is_privileged(made)
    if isinstance(made, RemoteController):
        made.close()  # the controller's process connects anew
    del made
    about = {
        "task": given.spec.name,
        "language": given.spec.description,
        "robot": given.scene.robot,
        "controller": controller.to_dict() if policy is not None else {"target": controller.target},
        "speed": speed,
        "margin": margin,
        "seed": seed,
        "observation": looked_at(seen, cameras).to_dict(),
        "cameras": [camera_to_dict(camera) for camera in believed],
    }
    disk = None if log is None else FullDisk(log / ".reserve")
    with contextlib.ExitStack() as stack:
        interrupted = stack.enter_context(_interruptions())
        journal: Journal = NoJournal()
        if log is not None and disk is not None:
            from gensim2.deploy.log import Log

            written = Log(log, about, opener=disk.open)
            stack.callback(written.close)
            journal = written
        spec = MindSpec(controller, given.spec, given.scene.robot, believed)
        open_devices = _local if simulated_clock else _in_processes
        devices = open_devices(given, spec, cameras, seed, rate, depth_noise)
        stack.callback(devices.close)
        if rules is None:
            rules = WatchRules(behind=np.inf) if dry else WatchRules()
        line = Line(
            Arm(DryArm(devices.arm) if dry else devices.arm, limits),
            devices.cameras,
            devices.mind,
            Watch(rules, serials),
            devices.clock,
            journal,
            pace=profile.control_hz * speed,
        )
        line.commands = []
        session = Session(line, devices, given, faults, disk, interrupted, keys, progress)
        session.run(60.0 * minutes, episodes, seed, goal_ends=not privileged)
    return session.report(about, None if log is None else log)


def _controller(given: TaskInput, policy: Path | str | None, deadline: float) -> ControllerSpec:
    from gensim2.rollout.worker import chain

    if policy is None:
        return chain(given.strategies, given.rollout)
    if is_url(str(policy)):
        arguments = {"url": str(policy), "robot": given.scene.robot, "deadline": deadline}
        return ControllerSpec("gensim2.deploy.remote.client:RemoteController", arguments)
    from gensim2.policy.evaluating import policy_controller

    return policy_controller(Path(policy))


def _local(
    given: TaskInput, spec: MindSpec, cameras: tuple[Camera, ...], seed: int, rate: float, noise: DepthNoise
) -> Devices:
    from gensim2.deploy.local import LocalArm, LocalCameras, LocalMind
    from gensim2.deploy.simulated_cameras import SimulatedCameras
    from gensim2.deploy.simulated_world import SimulatedWorld

    world, clock = SimulatedWorld(given.scene), SimulatedClock()
    arm = LocalArm(world, clock)
    seeing = LocalCameras(world, SimulatedCameras(world.profile, cameras, seed, noise), clock, rate)
    return Devices(arm, seeing, LocalMind(spec, world, clock), clock)


def _in_processes(
    given: TaskInput, spec: MindSpec, cameras: tuple[Camera, ...], seed: int, rate: float, noise: DepthNoise
) -> Devices:
    from gensim2.deploy.processes import ProcessArm, ProcessCameras, ProcessMind, preload

    preload()
    arm = ProcessArm(given.scene)
    seeing = ProcessCameras(given.scene.robot, cameras, arm.eyes, seed, rate, noise)
    return Devices(arm, seeing, ProcessMind(spec, arm.truth), MachineClock())


@contextlib.contextmanager
def _interruptions() -> Iterator[list[int]]:
    """Signals that ask to stop, as they come: the arm is stopped first, then they are heard."""
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
