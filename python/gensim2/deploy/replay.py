"""Replay of a log: observations made today against those given to the controller then, byte for byte."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.deploy.devices import Frame
from gensim2.deploy.eyes import Eyes, Sight, inputs
from gensim2.deploy.packing import unpack
from gensim2.errors import InputError, MissingExtraError
from gensim2.observations import Camera, ObservationSpec
from gensim2.robots import robot

KEPT = 50
"""Newest pictures of a camera that are kept: more than a question can be about when its answer comes."""

Message = tuple[str, dict[str, Any], dict[str, npt.NDArray[Any]]]


@dataclass(frozen=True)
class Replay:
    """Result of a comparison.

    Attributes:
        questions: that were answered.
        compared: arrays.
        clouds: of them point clouds.
        different: names of arrays that came out otherwise, with the number of the question.
        missing: questions whose pictures are in a file that is gone.
    """

    questions: int
    compared: int
    clouds: int
    different: tuple[str, ...]
    missing: int

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {**vars(self), "different": list(self.different)}


def camera_to_dict(camera: Camera) -> dict[str, Any]:
    """Plain data of a camera."""
    return {
        "name": camera.name,
        "width": camera.width,
        "height": camera.height,
        "intrinsic": camera.intrinsic.tolist(),
        "T_base_camera": camera.T_base_camera.tolist(),
        "far": camera.far,
        "link": camera.link,
        "depth_scale": camera.depth_scale,
        "depth_bias": camera.depth_bias,
    }


def camera_of(data: dict[str, Any]) -> Camera:
    """A camera from plain data."""
    return Camera(
        data["name"],
        data["width"],
        data["height"],
        np.array(data["intrinsic"]),
        np.array(data["T_base_camera"]),
        data["far"],
        data["link"],
        data.get("depth_scale", 1.0),
        data.get("depth_bias", 0.0),
    )


def frame_of(plain: dict[str, Any], arrays: dict[str, npt.NDArray[Any]]) -> Frame:
    """A picture as it was logged; those of version 0.1 name no device."""
    serial = plain.get("serial", "")
    return Frame(plain["camera"], plain["number"], plain["captured"], arrays["depth"], arrays["colors"], serial)


def messages(folder: Path) -> Iterator[Message]:
    """All messages of a log, or of one of its files, in order of their times within each file.

    Raises:
        InputError: there is none, or a file is damaged.
        MissingExtraError: mcap is not installed.
    """
    try:
        from mcap.exceptions import McapError
        from mcap.reader import make_reader
    except ImportError as error:
        raise MissingExtraError("mcap", "robot") from error
    files = [folder] if folder.is_file() else sorted(folder.glob("log_*.mcap"))
    if not files:
        raise InputError("holds no log", file=folder, remedy="name the folder of a run: log_000000.mcap lies in it")
    for path in files:
        with path.open("rb") as stream:
            try:
                for _, channel, message in make_reader(stream).iter_messages(log_time_order=False):
                    yield channel.topic, *unpack(message.data)
            except (McapError, InputError, EOFError) as error:
                raise InputError(f"is damaged: {error}", file=path) from error


def about_of(folder: Path) -> dict[str, Any]:
    """Return the header of a log.

    Raises:
        InputError: there is none, or it is damaged.
    """
    for topic, plain, _ in messages(folder):
        if topic == "/about":
            return plain
    raise InputError("does not say what it is about", file=folder)


def replay(folder: Path) -> Replay:
    """Make every observation of a log anew and compare it with what was logged.

    Raises:
        InputError: there is no log, or it is damaged.
    """
    looking: list[Eyes] = []  # at nothing but the robot's own state, then through the cameras
    frames: dict[str, dict[int, Frame]] = {}
    asked: dict[int, tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]] = {}
    questions = compared = clouds = missing = 0
    different: list[str] = []
    for topic, plain, arrays in messages(folder):
        if topic == "/about":
            if not looking:
                cameras = tuple(camera_of(each) for each in plain["cameras"])
                spec = ObservationSpec.of(plain["observation"])
                # Logs of version 0.1 looked at all pixels, and do not say so.
                pixels = plain.get("pixels", np.inf)
                profile = robot(plain["robot"])
                for each in (replace(spec, modalities=()), spec):
                    looking.append(Eyes(each, profile, cameras, plain["language"], pixels))
        elif topic.startswith("/camera/"):
            frame = frame_of(plain, arrays)
            kept = frames.setdefault(frame.camera, {})
            kept.pop(frame.number, None)  # numbers of a device have gaps, and begin anew
            kept[frame.number] = frame
            if len(kept) > KEPT:
                del kept[next(iter(kept))]
        elif topic == "/question":
            asked[plain["number"]] = plain, arrays
        elif topic == "/answer" and plain["number"] in asked and any(name.startswith("seen/") for name in arrays):
            question, joints = asked.pop(plain["number"])
            names = list(question["frames"].items())
            if any(number not in frames.get(name, {}) for name, number in names):
                missing += 1
                continue
            assert looking, "a log begins with what it is about"
            posed = {name: joints[f"posed/{name}"] for name, _ in names}
            shown = tuple(frames[name][number] for name, number in names)
            sight = Sight(question["step"], joints["q"], joints["v"], question["gripper"], shown, posed)
            seen = [name.removeprefix("seen/") for name in arrays if name.startswith("seen/")]
            found: dict[str, npt.NDArray[Any]] = {}
            for eyes in looking:  # pictures that nobody looked at then may show what no cloud is made of
                if not found.keys() >= set(seen):
                    found = inputs(eyes.observe(sight))
            questions += 1
            for name in seen:
                then, now = arrays[f"seen/{name}"], found.get(name)
                compared += 1
                clouds += name == "point_cloud"
                if now is None or then.dtype != now.dtype or then.tobytes() != now.tobytes():
                    different.append(f"{name} of question {question['number']}")
    return Replay(questions, compared, clouds, tuple(different), missing)
