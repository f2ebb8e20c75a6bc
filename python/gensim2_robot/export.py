"""Export a log as a video, a picture and a Foxglove file."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from gensim2.core.errors import InputError
from gensim2.core.files import replacing
from gensim2.data.video import write_video
from gensim2.perception.camera_record import CameraRecord
from gensim2.perception.observation import CLOUD
from gensim2.perception.raycast.kinematics import Tree, read_urdf
from gensim2.perception.raycast.shapes import read_links
from gensim2.planning.show import quaternion
from gensim2.robots import robot
from gensim2_robot.log_messages import (
    About,
    AnswerMessage,
    AnyMessage,
    ArmMessage,
    ClocksMessage,
    PictureMessage,
    SentMessage,
    WatchMessage,
)
from gensim2_robot.log_reader import messages
from gensim2_robot.watch import State

Frame = npt.NDArray[np.uint8]

FILM, STILL, FOXGLOVE, LAYOUT = "film.mp4", "still.png", "foxglove.mcap", "foxglove_layout.json"
FRAMES_PER_SECOND = 10
HEIGHT, CAPTION = 240, 24
"""Height of a camera's picture and of a line of text in the video, pixels; their sum is a multiple of 16."""
SHARES = (1 / 6, 1 / 2, 5 / 6)
"""Moments that the picture shows, as shares of the motion of the arm's joints in the first episode."""
GREY = {"r": 0.8, "g": 0.8, "b": 0.8, "a": 1.0}


def export(folder: Path, out: Path) -> dict[str, Any]:
    """Write a video of a log, a picture of three moments, and a Foxglove file with a layout.

    The picture shows three instants: a sixth, a half and five sixths of the motion of the first episode. If nothing
    moves, they are parts of its duration.

    Args:
        folder: folder of the log.

    Returns:
        ``seconds``: duration of the log; ``frames``: number of frames in the video; ``files``: written files.

    Raises:
        InputError: the log does not exist, is damaged, or has no pictures.

    Example:
        ```python
        export(Path("runs/robot-20270101-120000"), Path("robot-film"))
        ```
    """
    shown = _Film()
    out.mkdir(parents=True, exist_ok=True)
    with replacing(out / FOXGLOVE) as path, path.open("wb") as stream:
        writer = _Foxglove(stream)
        for _, message in messages(folder):
            writer.add(message)
            shown.look(message)
        writer.close()
    if not shown.times:
        raise InputError("the log has no pictures", file=folder)
    stills: list[Frame] = []
    wanted = shown.moments(SHARES)
    with replacing(out / FILM) as path:
        write_video(path, _kept(shown.frames(folder), wanted, stills), FRAMES_PER_SECOND)
    with replacing(out / STILL) as path:
        path.write_bytes(_encoded(np.concatenate(stills), ".png"))
    (out / LAYOUT).write_bytes(files("gensim2_robot").joinpath(LAYOUT).read_bytes())
    written = [str(out / name) for name in (FILM, STILL, FOXGLOVE, LAYOUT)]
    seconds = round(shown.times[-1] - shown.times[0], 3)
    return {"schema_version": 1, "seconds": seconds, "frames": len(shown.times), "files": written}


def _kept(frames: Iterator[Frame], wanted: set[int], stills: list[Frame]) -> Iterator[Frame]:
    for number, frame in enumerate(frames):
        if number in wanted:
            stills.append(frame)
        yield frame


def _encoded(picture: Frame, suffix: str) -> bytes:
    import cv2

    return bytes(cv2.imencode(suffix, picture[..., ::-1])[1])


class _Film:
    """Makes the frames of a video: all cameras side by side with titles, the time and the watchdog's state."""

    def __init__(self) -> None:
        self.times: list[float] = []
        self._cameras: tuple[CameraRecord, ...] = ()
        self._seen: set[str] = set()
        self._begin: int | None = None  # first frame of the first episode
        self._end: int | None = None  # number of frames at the end of the first episode
        self._final = ""  # state of the watchdog at the end of the log
        self._q: npt.NDArray[np.float64] | None = None
        self._motion = 0.0
        self._motions: list[float] = []  # motion of the joints before each time in self.times, rad
        # Camera whose first image arrives last. Frames are made at the times of its images.
        self._last = ""

    def look(self, message: AnyMessage) -> None:
        """Process a message in the first pass over the log, which collects times, states and cameras."""
        if isinstance(message, About):
            self._cameras = tuple(message.cameras)
        elif isinstance(message, WatchMessage):
            self._final = _said(message)
            if message.state == State.RUNNING and self._begin is None:
                self._begin = len(self.times)
            elif message.state == State.IDLE and self._begin is not None and self._end is None:
                self._end = len(self.times)
        elif isinstance(message, ArmMessage):
            if np.isfinite(message.q).all():
                self._motion += 0.0 if self._q is None else float(np.abs(message.q - self._q).sum())
                self._q = message.q
        elif isinstance(message, PictureMessage):
            if not self._last:
                self._seen.add(message.camera)
                self._last = message.camera if len(self._seen) == len(self._cameras) else ""
            is_due = not self.times or message.captured >= self.times[-1] + 0.999 / FRAMES_PER_SECOND
            if is_due and message.camera == self._last:
                self.times.append(message.captured)
                self._motions.append(self._motion)

    def moments(self, shares: Sequence[float]) -> set[int]:
        """Return the frames at shares of the joints' motion, or of the time without one, in the first episode."""
        whole = slice(self._begin, self._end)
        episode = whole if self.times[whole] else slice(None)
        motions, times = self._motions[episode], self.times[episode]
        motion = np.array(motions if motions[-1] > motions[0] else times)
        wanted = motion[0] + np.array(shares) * (motion[-1] - motion[0])
        return {(episode.start or 0) + int(frame) for frame in np.searchsorted(motion, wanted)}

    def frames(self, folder: Path) -> Iterator[Frame]:
        """Yield the video frame for each time in ``self.times``, in a second pass over the log."""
        pictures: dict[str, Frame] = {}
        watch, rest = "", iter(self.times)
        due = next(rest)
        for _, message in messages(folder):
            if isinstance(message, WatchMessage):
                watch = _said(message)
            elif isinstance(message, PictureMessage):
                pictures[message.camera] = message.colors
                if message.captured == due and message.camera == self._last:
                    # A run ends after its last picture, so the last frame shows the state at the end.
                    said = self._final if due == self.times[-1] else watch
                    yield self._frame(pictures, due - self.times[0], said)
                    due = next(rest, np.inf)

    def _frame(self, pictures: Mapping[str, Frame], time: float, watch: str) -> Frame:
        import cv2

        columns = []
        for camera in self._cameras:
            wide = 16 * max(round(camera.width * HEIGHT / camera.height / 16), 1)
            resized = cv2.resize(pictures[camera.name], (wide, HEIGHT), interpolation=cv2.INTER_AREA)
            resized[:, -2:] = 24
            columns.append(np.concatenate([_line(camera.name, wide), resized]))
        row = np.concatenate(columns, axis=1)
        return np.concatenate([row, _line(f"{time:.1f} s  {watch}", row.shape[1])])


def _said(message: WatchMessage) -> str:
    return f"{message.state}: {message.reason}"


def _line(text: str, width: int) -> Frame:
    import cv2

    drawn = np.full((CAPTION, width, 3), 24, np.uint8)
    plain = text.encode("ascii", "replace").decode()  # the font has only ASCII characters
    cv2.putText(drawn, plain, (8, 17), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (235, 238, 242), 1, cv2.LINE_AA)
    return drawn


class _Foxglove:
    """Writes the messages of a log as JSON, in schemas that Foxglove can display.

    The topics are ``/camera/<name>`` (CompressedImage), ``/cloud`` (PointCloud), ``/tf`` (FrameTransforms with the
    poses of the links in the base frame), ``/robot`` (SceneUpdate with the hulls of the links), and values to plot:
    ``/arm``, ``/sent``, ``/answer``, ``/watch`` and ``/clocks``.
    """

    def __init__(self, stream: BinaryIO) -> None:
        from mcap.writer import Writer

        self._writer: Any = Writer(stream)
        self._writer.start("", "gensim2")
        self._channels: dict[str, int] = {}
        self._tree: Tree | None = None

    def add(self, message: AnyMessage) -> None:
        """Write a message."""
        if isinstance(message, About):
            if self._tree is None:
                self._open_robot(message.robot)
        elif isinstance(message, PictureMessage):
            picture = {"frame_id": message.camera, "format": "jpeg", "data": _encoded(message.colors, ".jpg")}
            self._put(f"/camera/{message.camera}", message.captured, picture, "CompressedImage")
        elif isinstance(message, ArmMessage):
            plain = {
                "force": message.force,
                "mode": str(message.mode),
                "q": message.q.tolist(),
                "v": message.v.tolist(),
            }
            self._put("/arm", message.time, plain)
            self._put_robot(message.time, message.q)
        elif isinstance(message, SentMessage):
            self._put("/sent", message.time, {"q": message.q.tolist(), "gripper": message.gripper})
        elif isinstance(message, AnswerMessage):
            plain = {"number": message.number, "acting_ms": message.acting_ms, "cloud_ms": message.cloud_ms or 0.0}
            self._put("/answer", message.time, {**plain, "done": message.done, "error": message.error or ""})
            if CLOUD in message.seen:
                self._put("/cloud", message.time, _cloud(message.seen[CLOUD]), "PointCloud")
        elif isinstance(message, WatchMessage):
            self._put("/watch", message.time, {"state": message.state, "reason": message.reason})
        elif isinstance(message, ClocksMessage):
            self._put("/clocks", message.time, {"late": message.late, "ages": dict(message.ages)})

    def close(self) -> None:
        """Write the index of the file."""
        self._writer.finish()

    def _open_robot(self, name: str) -> None:
        import trimesh

        profile = robot(name)
        self._tree = tree = Tree.of(read_urdf(profile.urdf), (*profile.arm_joints, *profile.gripper.joints))
        self._entities = []
        for link, surface in read_links(tree.file).items():
            if surface is None or link not in tree.names:
                continue
            hull = trimesh.PointCloud(surface.vertices).convex_hull
            points = [{"x": x, "y": y, "z": z} for x, y, z in hull.vertices.round(4).tolist()]
            triangles = {
                "pose": _pose(np.eye(4)),
                "points": points,
                "color": GREY,
                "indices": hull.faces.ravel().tolist(),
            }
            self._entities.append({"id": link, "frame_id": link, "frame_locked": True, "triangles": [triangles]})

    def _put_robot(self, time: float, q: npt.NDArray[np.float64]) -> None:
        assert self._tree is not None, "a log begins with its robot"
        if not np.isfinite(q).all():
            return
        poses = self._tree.poses(np.eye(4)[None], q[None])[0]
        transforms = []
        for link, pose in zip(self._tree.names, poses, strict=True):
            placed = _pose(pose)
            frames = {"timestamp": _time(time), "parent_frame_id": "base", "child_frame_id": link}
            transforms.append({**frames, "translation": placed["position"], "rotation": placed["orientation"]})
        self._put("/tf", time, {"transforms": transforms}, "FrameTransforms")
        if "/robot" not in self._channels:
            entities = [{**each, "timestamp": _time(time)} for each in self._entities]
            self._put("/robot", time, {"deletions": [], "entities": entities}, "SceneUpdate")

    def _put(self, topic: str, time: float, plain: dict[str, Any], schema: str | None = None) -> None:
        if schema is not None and schema not in ("FrameTransforms", "SceneUpdate"):
            plain = {"timestamp": _time(time), **plain}
        if topic not in self._channels:
            name = f"foxglove.{schema}" if schema else f"gensim2.{topic[1:]}"
            described = json.dumps({"title": name, **_schema(plain)}).encode()
            number = self._writer.register_schema(name, "jsonschema", described)
            self._channels[topic] = self._writer.register_channel(topic, "json", number)
        stamp = int(1e9 * max(time, 0.0))
        data = json.dumps(plain, default=lambda raw: base64.b64encode(raw).decode()).encode()
        self._writer.add_message(self._channels[topic], stamp, data, stamp)


def _time(time: float) -> dict[str, int]:
    seconds, nanoseconds = divmod(int(1e9 * max(time, 0.0)), 10**9)
    return {"sec": seconds, "nsec": nanoseconds}


def _pose(pose: npt.NDArray[np.float64]) -> dict[str, dict[str, float]]:
    w, x, y, z = quaternion(pose).tolist()
    position = dict(zip("xyz", pose[:3, 3].tolist(), strict=True))
    return {"position": position, "orientation": {"x": x, "y": y, "z": z, "w": w}}


def _cloud(cloud: npt.NDArray[Any]) -> dict[str, Any]:
    """Return a cloud (N, 6), positions (m, base frame) and colours (0 to 1), as a Foxglove PointCloud."""
    packed = np.zeros(len(cloud), dtype=[("xyz", "<f4", 3), ("rgba", "u1", 4)])
    packed["xyz"], packed["rgba"] = cloud[:, :3], np.c_[255 * cloud[:, 3:6], np.full(len(cloud), 255)]
    # In Foxglove's numeric types, 7 is FLOAT32 and 1 is UINT8.
    names = {"x": 7, "y": 7, "z": 7, "red": 1, "green": 1, "blue": 1, "alpha": 1}
    offsets = (0, 4, 8, 12, 13, 14, 15)
    fields = [
        {"name": name, "offset": offset, "type": kind}
        for (name, kind), offset in zip(names.items(), offsets, strict=True)
    ]
    return {
        "frame_id": "base",
        "pose": _pose(np.eye(4)),
        "point_stride": packed.itemsize,
        "fields": fields,
        "data": packed.tobytes(),
    }


def _schema(value: Any) -> dict[str, Any]:
    """Return a JSON schema that describes values like ``value``."""
    if isinstance(value, dict):
        return {"type": "object", "properties": {name: _schema(each) for name, each in value.items()}}
    if isinstance(value, list):
        return {"type": "array", "items": _schema(value[0]) if value else {"type": "object"}}
    if isinstance(value, bytes):
        return {"type": "string", "contentEncoding": "base64"}
    kinds: dict[type, str] = {bool: "boolean", int: "integer", float: "number", str: "string"}
    return {"type": kinds[type(value)]}
