"""Configure the control loop that runs, trials and web pages use."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal, cast

from gensim2.core.errors import InputError
from gensim2.perception import DepthNoise
from gensim2.policy.remote.client import DEADLINE
from gensim2.robots.force import FORCE_LIMIT
from gensim2.rollout.config import TRUE_SCENE
from gensim2.rollout.controller_spec import ControllerSpec
from gensim2.scenes.config import SceneArguments, split_arguments
from gensim2_robot.arm_limits import JUMP, MARGIN, SPEED
from gensim2_robot.calibration.file import DAYS
from gensim2_robot.watch import WatchRules

SIMULATED = "simulated"
SOFTWARE = "software"
ARMS = ("franka", "panda", "ur", "xarm")
"""Arms with a driver; ``franka`` uses franky-control, ``panda`` uses panda-python for the same arms."""

MAX_RATE = 1000.0
"""Maximum frame rate of a camera, Hz."""
MAX_PIXELS = 8192
"""Maximum width and height of an image, pixels."""

CameraKind = Literal["simulated", "software", "recording", "realsense"]


@dataclass(frozen=True)
class CameraSource:
    """Source of camera images: the kind of the source, and its devices or files.

    Attributes:
        kind: ``simulated``: ray casting; ``software``: ray casting that passes through software devices of
            ``pyrealsense2``; ``recording``: recordings of RealSense devices or logs; ``realsense``: real cameras.
        devices: recording, log folder or serial number of each camera, by camera name; empty for simulated cameras.
    """

    kind: CameraKind
    devices: Mapping[str, str] = field(default_factory=dict)

    @property
    def is_rendered(self) -> bool:
        """Whether images are rendered from the simulated scene."""
        return self.kind in (SIMULATED, SOFTWARE)

    @classmethod
    def parse(cls, word: str) -> CameraSource:
        """Parse ``simulated``, ``software``, ``recording:NAME=DIR|FILE,...`` or ``realsense:NAME=SERIAL,...``.

        Raises:
            InputError: the text is invalid.
        """
        if word in (SIMULATED, SOFTWARE):
            return cls(cast(CameraKind, word))
        kind, _, rest = word.partition(":")
        pairs = [each.partition("=") for each in rest.split(",")]
        if kind not in ("recording", "realsense") or not all(name and device for name, _, device in pairs):
            remedy = f"{SIMULATED}, {SOFTWARE}, recording:NAME=DIR|FILE,... or realsense:NAME=SERIAL,..."
            raise InputError(f"unknown cameras {word!r}", field="--cameras", remedy=remedy)
        found = {name: device for name, _, device in pairs}
        if len(found) < len(pairs):
            raise InputError(f"{word!r} gives the same camera name twice", field="--cameras")
        return cls(cast(CameraKind, kind), found)


@dataclass(frozen=True)
class Delays:
    """Delays of simulated devices with a simulated clock. Each is a range (s) from which every episode draws a value.

    Attributes:
        camera: delay from the exposure of an image to its arrival.
        controller: delay from a request for actions to the answer.
    """

    camera: tuple[float, float] = (0.03, 0.03)
    controller: tuple[float, float] = (0.05, 0.05)

    def __post_init__(self) -> None:
        for name, (low, high) in vars(self).items():
            if not 0.0 <= low <= high < 10.0:
                wrong = f"must be a range of seconds from 0 to 10, but is {(low, high)}"
                raise InputError(wrong, field=f"delays.{name}")


class LineArguments(SceneArguments, total=False):
    """Keyword arguments of a run: the arguments of scenes, and the attributes of :class:`LineConfig`."""

    arm: str
    cameras: str
    policy: Path | str | ControllerSpec | None
    scene_source: str
    deadline: float
    speed: float
    margin: float
    force: float
    jump: float
    pixels: tuple[int, int]
    rate: float
    noise: DepthNoise | str | Path
    delays: Delays
    calibration: Path | None
    calibration_days: float
    seed: int
    dry: bool
    simulated_clock: bool
    rules: WatchRules | None


@dataclass(frozen=True)
class LineConfig:
    """Settings of a control loop, without its task and scenes.

    Attributes:
        arm: ``simulated``, ``franka:HOST``, ``panda:HOST``, ``ur:HOST`` or ``xarm:HOST``.
        cameras: as in :meth:`CameraSource.parse`. Recordings require a dry run with a simulated arm.
        policy: checkpoint, URL of a policy server (``ws://host:port``), or name of a controller; None: the planner.
        scene_source: scene of the planner. ``"true"``: state of the simulator; ``"perceived"``: the package's estimate
            from the point clouds of the cameras; otherwise the folder of an estimator.
        deadline: time limit for an action from a policy server, s.
        speed: fraction of the arm's maximum speed; control steps take longer in proportion.
        margin: minimum distance (rad) of joints from the ends of their range.
        force: maximum contact force, N.
        jump: maximum distance (rad) of an episode's first action from the arm's position.
        pixels: width and height of the images.
        rate: frame rate of the cameras, Hz.
        noise: depth noise of simulated cameras: parameters, the name of a preset, or a file of fitted parameters.
        delays: delays of simulated devices with a simulated clock.
        calibration: calibration file with camera poses; None: the camera poses of the simulation.
        calibration_days: maximum age of the calibration, days.
        seed: seed of the scenes and of all noise.
        dry: True for a dry run, in which no command is sent to the arm.
        simulated_clock: whether to run all devices in this process, with a simulated clock that waits for the devices.
        rules: tolerances of the watchdog; None: the default tolerances.

    Raises:
        InputError: a value is invalid.
    """

    arm: str = SIMULATED
    cameras: str = SIMULATED
    policy: Path | str | ControllerSpec | None = None
    scene_source: str = TRUE_SCENE
    deadline: float = DEADLINE
    speed: float = SPEED
    margin: float = MARGIN
    force: float = FORCE_LIMIT
    jump: float = JUMP
    pixels: tuple[int, int] = (320, 240)
    rate: float = 10.0
    noise: DepthNoise | str | Path = "d435"
    delays: Delays = Delays()
    calibration: Path | None = None
    calibration_days: float = DAYS
    seed: int = 0
    dry: bool = False
    simulated_clock: bool = False
    rules: WatchRules | None = None

    def __post_init__(self) -> None:
        kind, _, host = self.arm.partition(":")
        if self.arm != SIMULATED and (kind not in ARMS or not host):
            known = ", ".join(f"{each}:HOST" for each in ARMS)
            raise InputError(f"unknown arm {self.arm!r}", field="--arm", remedy=f"{SIMULATED}, {known}")
        kind = self.source.kind
        if (self.arm == SIMULATED) != (kind != "realsense"):
            said = f"--arm {self.arm} with --cameras {self.cameras}: both are real, or both are simulated"
            raise InputError(said, field="--cameras", remedy="as --arm franka:HOST --cameras realsense:left=SERIAL")
        if kind == "recording" and not self.dry:
            wrong = "recorded images can be used only in a dry run"
            raise InputError(wrong, field="--cameras", remedy="use gensim2 robot dry-run")
        if kind != SIMULATED and self.simulated_clock:
            wrong = "must be off, because only simulated devices can run on a simulated clock"
            raise InputError(wrong, field="simulated_clock")
        if not 0.0 < self.rate <= MAX_RATE:
            problem = f"must lie between 0 and {MAX_RATE:g} pictures per second, but is {self.rate}"
            raise InputError(problem, field="rate")
        if len(self.pixels) != 2 or not all(1 <= count <= MAX_PIXELS for count in self.pixels):
            raise InputError(f"must be width and height from 1 to {MAX_PIXELS}, but is {self.pixels}", field="pixels")
        if self.delays != Delays() and not self.simulated_clock:
            raise InputError("can only be set for a simulated clock", field="delays", remedy="use simulated_clock=True")
        if self.policy is not None and self.scene_source != TRUE_SCENE:
            problem = "is an option of the planner, and cannot be combined with a policy"
            raise InputError(problem, field="--scene", remedy="leave it out, or give --plan instead of --policy")
        if not self.is_simulated and self.policy is None and self.scene_source == TRUE_SCENE:
            raise InputError(
                "with a true scene works only in simulation, because no camera shows the true state of the scene",
                field="--plan",
                remedy="give --scene perceived, which estimates the scene from the cameras",
            )

    @property
    def is_simulated(self) -> bool:
        return self.arm == SIMULATED

    @property
    def source(self) -> CameraSource:
        """Parsed form of ``cameras``."""
        return CameraSource.parse(self.cameras)

    @classmethod
    def split(cls, given: Mapping[str, Any]) -> tuple[LineConfig, SceneArguments]:
        """Split keyword arguments into the configuration and the arguments of the scenes.

        Raises:
            InputError: an argument is invalid.
            TypeError: a keyword is unknown.
        """
        scene, others = split_arguments(given)
        unknown = set(others) - {each.name for each in fields(cls)}
        if unknown:
            raise TypeError(f"unexpected keywords: {', '.join(sorted(unknown))}")
        return cls(**cast(Any, others)), scene
