"""Collect images of the arm at rest in several poses, by moving an arm or by reading a log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from gensim2.core.arrays import Array
from gensim2.core.errors import GenSim2Error, InputError
from gensim2.core.foreign.limits import MAX_PICTURES, MAX_POSE_BYTES, MAX_POSES, MAX_STATES
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.core.seeding import rng
from gensim2.perception import Camera
from gensim2_robot.arm import LimitedArm
from gensim2_robot.arm_limits import CYCLE, ArmLimits
from gensim2_robot.calibration.surfaces import ArmView
from gensim2_robot.clocks import Clock
from gensim2_robot.devices import CameraDriver, CameraFrame
from gensim2_robot.log_messages import ArmMessage, PictureMessage
from gensim2_robot.log_reader import messages

SPREAD = np.array([0.9, 0.5, 0.6, 0.6, 0.8, 0.8, 1.0])
"""Maximum offset (rad) of the joints of a random pose from the reset pose. The array is resized to the number of joints
of the arm.
"""
LOWEST = 0.25
"""Minimum height (m) of the tool above the table, because the objects on the table are unknown."""
STILL, UNMOVED_SECONDS = 0.02, 0.3
"""Speed (rad/s) below which the arm is at rest, and time (s) for which it must be at rest before images are used."""
ARRIVED = 0.05
"""Maximum joint error (rad) at which a pose counts as reached."""
PATIENCE = 60.0
"""Time limit (s) to reach a pose."""
PICTURES = 5
"""Number of images of each camera and pose, whose median is used."""
TRIES = 10_000


@dataclass(frozen=True, eq=False)
class Station:
    """Images of the arm in one pose.

    Attributes:
        q: (n,) all active joints.
        frames: images by camera.
    """

    q: Array
    frames: Mapping[str, tuple[CameraFrame, ...]]

    def view(self, camera: Camera) -> ArmView:
        """Return the median depth of a camera by pixel.

        The depth is 0 where at most half of the images have a measurement.
        """
        depths = np.stack([camera.metres(frame.depth) for frame in self.frames[camera.name]]).astype(np.float64)
        there = 2 * (depths > 0).sum(axis=0) > len(depths)
        depths[depths == 0] = np.nan
        found = np.zeros(there.shape, dtype=np.float32)
        found[there] = np.nanmedian(depths[:, there], axis=0)
        return ArmView(self.q, found)


def draw_poses(limits: ArmLimits, count: int, seed: int) -> list[Array]:
    """Return ``count`` random arm poses (m,) within the limits, with the tool high above the table.

    Raises:
        InputError: too few poses are within the limits.
    """
    draw = rng(seed, "calibration poses")
    home = np.array(limits.profile.reset_qpos)[list(limits.profile.arm_columns)]
    spread = np.resize(SPREAD, len(home))
    low = np.maximum(limits.low, [-np.inf, -np.inf, LOWEST])
    found: list[Array] = []
    for _ in range(TRIES):
        q = home + draw.uniform(-1.0, 1.0, len(home)) * spread
        tool = limits.tool(q[None])[0]
        inside = (q > limits.lower).all() and (q < limits.upper).all()
        if inside and (tool > low).all() and (tool < limits.high).all() and limits.is_clear(q[None]):
            found.append(q)
            if len(found) == count:
                return found
    raise InputError(f"found only {len(found)} of {count} poses within the arm's limits", field="poses")


def take(
    arm: LimitedArm, cameras: CameraDriver, clock: Clock, poses: Sequence[Array], progress: Progress = NULL_PROGRESS
) -> list[Station]:
    """Move the arm to each pose, within the limits of the arm, and take images.

    Raises:
        RefusedError: the arm is outside its limits, or the contact force is too large.
        GenSim2Error: the arm or a camera does not answer, or too few poses are reached.
    """
    walk = _Walk(arm, cameras, clock)
    walk.begin()
    found = []
    for number, pose in enumerate(poses):
        if walk.to(pose):
            found.append(walk.look())
            progress.message(f"pose {number + 1} of {len(poses)}")
        else:
            progress.message(f"pose {number + 1} of {len(poses)} is out of reach and is skipped")
    return found


class _Walk:
    """Moves the arm from pose to pose, with one command in each cycle."""

    def __init__(self, arm: LimitedArm, cameras: CameraDriver, clock: Clock) -> None:
        self._arm, self._cameras, self._clock = arm, cameras, clock
        self._next = clock.now() + CYCLE
        self._names = [camera.name for camera in cameras.cameras]

    def begin(self) -> None:
        until = self._clock.now() + PATIENCE
        while self._arm.state() is None:
            self._tick(until, "the arm has sent no state")
        self._arm.begin(self._where())

    def to(self, pose: Array) -> bool:
        """Move to a pose and return whether the arm is at rest there."""
        until, still = self._clock.now() + PATIENCE, 0.0
        while self._clock.now() < until:
            frames = self._tick()
            del frames  # images of a moving arm are not used
            self._arm.command(pose, 1.0, self._clock.now())
            sent = self._arm.sent
            state = self._arm.state()
            assert sent is not None
            assert state is not None
            stands = sent.is_at_rest and np.abs(state.v).max() < STILL
            still = still + CYCLE if stands else 0.0
            if still > UNMOVED_SECONDS:
                return bool(np.abs(self._where() - pose).max() < ARRIVED)
        return False

    def look(self) -> Station:
        """Take new images of the current pose and return them."""
        begun, found = self._clock.now(), {name: list[CameraFrame]() for name in self._names}
        joints = []
        while min(map(len, found.values())) < PICTURES:
            for frame in self._tick(begun + PATIENCE, "a camera has sent no pictures"):
                if frame.captured >= begun:
                    found[frame.camera].append(frame)
            self._arm.hold(self._clock.now())
            state = self._arm.state()
            assert state is not None
            joints.append(state.q)
        frames = {name: tuple(each[:PICTURES]) for name, each in found.items()}
        return Station(np.mean(joints, axis=0), frames)

    def _where(self) -> Array:
        state = self._arm.state()
        assert state is not None
        return self._arm.joints(state.q)

    def _tick(self, until: float = np.inf, trouble: str = "") -> Sequence[CameraFrame]:
        self._clock.wait(self._next)
        self._next = self._clock.now() + CYCLE
        if self._clock.now() > until:
            raise GenSim2Error(f"timeout after {PATIENCE:g} s: {trouble}")
        self._arm.poll()
        return self._cameras.poll()


def read_standing(folder: Path, pictures: int = PICTURES) -> list[Station]:
    """Read the poses at rest from a log. For each pose and camera, read up to ``pictures`` images.

    The log is read twice: first to find the times at rest, and then to read only the images that are returned.

    Raises:
        InputError: the log is missing or damaged, the arm never rests, or there are too many poses.
    """
    times, joints, speeds, taken = [], [], [], list[_Taken]()
    for _, message in messages(folder):
        if isinstance(message, ArmMessage):
            times.append(message.time)
            joints.append(message.q)
            speeds.append(float(np.abs(message.v).max()))
        elif isinstance(message, PictureMessage):
            size = message.depth.nbytes + message.colors.nbytes
            taken.append(_Taken(len(taken), message.camera, message.captured, size))
        for count, most, what in (
            (len(times), MAX_STATES, "states of the arm"),
            (len(taken), MAX_PICTURES, "pictures"),
        ):
            if count > most:
                raise InputError(f"the log has more than {most} {what}", file=folder, remedy="make a shorter log")
    if len({len(q) for q in joints}) > 1:
        raise InputError("the messages of the arm do not all have the same number of joints", file=folder, field="/arm")
    names, wanted = {each.camera for each in taken}, set[int]()
    found: list[tuple[Array, dict[str, list[_Taken]]]] = []
    size = 0
    for q, shown in _stood(np.array(times), joints, np.array(speeds), taken):
        if set(shown) == names and all(np.abs(q - each).max() > ARRIVED for each, _ in found):
            kept = {name: each[:pictures] for name, each in shown.items()}
            found.append((q, kept))
            wanted |= {each.index for some in kept.values() for each in some}
            size += sum(each.size for some in kept.values() for each in some)
            if size > MAX_POSE_BYTES or len(found) > MAX_POSES:
                said = f"the arm stands in {len(found)} poses or more, {size >> 20} MiB of pictures"
                raise InputError(f"{said}: too many", file=folder, remedy="make a shorter log")
    if not found:
        raise InputError("the arm is never at rest while all cameras record", file=folder)
    pictures_only = (message for _, message in messages(folder) if isinstance(message, PictureMessage))
    frames = {number: message.frame() for number, message in enumerate(pictures_only) if number in wanted}
    return [
        Station(q, {name: tuple(frames[each.index] for each in some) for name, some in shown.items()})
        for q, shown in found
    ]


@dataclass(frozen=True)
class _Taken:
    """Reference to an image in a log: the image's index among all images, and its size in bytes."""

    index: int
    camera: str
    captured: float
    size: int


def _stood(
    times: npt.NDArray[np.float64], joints: list[Array], speeds: npt.NDArray[np.float64], taken: list[_Taken]
) -> list[tuple[Array, dict[str, list[_Taken]]]]:
    """Return the joint positions and images of each interval in which the arm was at rest."""
    order = np.argsort(times, kind="stable")
    times = times[order]
    # ``moved[i]`` counts the states before state i in which the arm was moving or its speed was NaN.
    moved = np.concatenate([[0], np.cumsum(~(speeds[order] <= STILL))])
    found: list[tuple[Array, dict[str, list[_Taken]]]] = []
    open_until = -np.inf
    for picture in sorted(taken, key=lambda each: each.captured):
        first = int(np.searchsorted(times, picture.captured - UNMOVED_SECONDS, "left"))
        end = int(np.searchsorted(times, picture.captured + UNMOVED_SECONDS, "right"))
        if end - first < 2 or moved[end] > moved[first]:
            open_until = -np.inf
            continue
        if picture.captured > open_until:
            found.append((joints[order[first + (end - first) // 2]], {}))
        open_until = picture.captured + 1.0
        found[-1][1].setdefault(picture.camera, []).append(picture)
    return found
