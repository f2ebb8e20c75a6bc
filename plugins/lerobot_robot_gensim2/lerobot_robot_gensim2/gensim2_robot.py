"""One arm with its cameras, as LeRobot's loops take it: joints in rad, the gripper from -1 to 1, colour pictures."""

from __future__ import annotations

from typing import Any

from lerobot.robots import Robot

from gensim2_robot.cli.robot_options import moves
from gensim2_robot.live import looking
from gensim2_robot.puppet import Puppet
from lerobot_robot_gensim2.config_gensim2 import GenSim2RobotConfig

GRIPPER = "gripper.pos"


class GenSim2Robot(Robot):
    """An arm behind gensim2's limits and watch; a software stop, not safety-rated.

    Loops run at 10 Hz: a target is for the next tenth of a second, and the watch holds where none comes. What limits
    keep it from is not what was asked for: ``send_action`` returns what the arm was sent.
    """

    config_class = GenSim2RobotConfig
    name = "gensim2"

    def __init__(self, config: GenSim2RobotConfig) -> None:
        super().__init__(config)
        given = {"arm": config.arm, "cameras": config.devices, "policy": looking(config.robot)}
        self._puppet = Puppet(
            config.task,
            move=moves(given, config.move),
            robot=config.robot,
            arm=config.arm,
            cameras=config.devices,
            calibration=config.calibration,
            speed=config.speed,
            margin=config.margin,
            force=config.force,
            pixels=(config.width, config.height),
            rate=config.rate,
            seed=config.seed,
        )
        self._joints = [f"{name}.pos" for name in self._puppet.profile.arm_joints]

    @property
    def observation_features(self) -> dict[str, Any]:
        """Joints, the gripper's last command, pictures (H, W, 3)."""
        return {**self.action_features, **{name: (*size, 3) for name, size in self._puppet.cameras.items()}}

    @property
    def action_features(self) -> dict[str, Any]:
        """Targets of the joints, rad, and of the gripper, -1 to 1."""
        return {**dict.fromkeys(self._joints, float), GRIPPER: float}

    @property
    def is_connected(self) -> bool:
        """Whether the arm takes targets."""
        return self._puppet.is_connected

    def connect(self, calibrate: bool = True) -> None:
        """Open the devices and take the arm over where it stands."""
        self._gripper = 1.0
        self._puppet.connect()

    @property
    def is_calibrated(self) -> bool:
        """Joints need none; cameras: ``gensim2 robot calibrate``."""
        return True

    def calibrate(self) -> None:
        """Nothing: ``gensim2 robot calibrate`` does it."""

    def configure(self) -> None:
        """Nothing: limits are those of the configuration."""

    def get_observation(self) -> dict[str, Any]:
        """The arm's last word, and the newest pictures."""
        profile = self._puppet.profile
        q = self._puppet.state().q[list(profile.arm_columns)]
        pictures = {name: frame.colors for name, frame in self._puppet.frames().items() if name in self._puppet.cameras}
        return {**dict(zip(self._joints, map(float, q), strict=True)), GRIPPER: self._gripper, **pictures}

    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        """Ask for a target; return what the arm was sent last."""
        self._gripper = float(action[GRIPPER])
        sent = self._puppet.send([float(action[name]) for name in self._joints], self._gripper)
        return {**dict(zip(self._joints, map(float, sent), strict=True)), GRIPPER: self._gripper}

    def disconnect(self) -> None:
        """Let the arm come to rest, and leave it."""
        self._puppet.close()
