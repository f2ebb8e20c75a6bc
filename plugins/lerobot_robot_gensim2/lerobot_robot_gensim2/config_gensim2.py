"""Configuration of an arm: which devices, which limits."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from lerobot.robots import RobotConfig


@RobotConfig.register_subclass("gensim2")
@dataclass(kw_only=True)
class GenSim2RobotConfig(RobotConfig):
    """An arm by ``--robot.type=gensim2``; fields as the options of ``gensim2 robot run``.

    Attributes:
        robot: name of its profile.
        arm: ``simulated``, or ``franka:HOST``, ``panda:HOST``, ``ur:HOST``, ``xarm:HOST``.
        devices: its cameras: ``simulated``, or ``realsense:NAME=SERIAL,...``.
        calibration: file that says where the cameras are; a real arm needs one to be moved.
        move: whether anything is sent to a real arm; a person at the terminal is asked.
        speed: share of the arm's speed.
        margin: rad that joints keep from the ends of their range.
        force: N that may press on the arm.
        width, height: of the pictures.
        rate: pictures a second.
        task: whose scene a simulated arm stands before.
        seed: of that scene.
    """

    robot: str = "panda"
    arm: str = "simulated"
    devices: str = "simulated"
    calibration: Path | None = None
    move: bool = False
    speed: float = 0.1
    margin: float = 0.1
    force: float = 140.0
    width: int = 320
    height: int = 240
    rate: float = 10.0
    task: str = "CloseBox"
    seed: int = 0
