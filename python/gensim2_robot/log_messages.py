"""Define the schemas of log messages.

:class:`~gensim2_robot.log.Log` writes messages and ``log_reader`` reads them. Measurements of devices and actions of
policies may contain NaN; descriptions of cameras and settings must not.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

from gensim2.core.errors import InputError
from gensim2.core.foreign.limits import MAX_CAMERA_PIXELS, MAX_HEAD, MAX_JOINTS, MAX_MESSAGE
from gensim2.core.validation import input_error
from gensim2.perception import ObservationSpec
from gensim2.perception.camera_record import CameraRecord
from gensim2_robot.devices import ArmMode, CameraFrame

_Type = Literal["uint8", "uint16", "int16", "int32", "int64", "float32", "float64", "bool"]
_Shape = Annotated[list[Annotated[int, Field(ge=0, le=MAX_MESSAGE, strict=True)]], Field(max_length=8)]


class _Head(BaseModel):
    plain: dict[str, Any]
    arrays: dict[str, tuple[_Type, _Shape]]


def pack(plain: Mapping[str, Any], arrays: Mapping[str, npt.NDArray[Any]]) -> bytes:
    kept = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    told = {name: [array.dtype.name, list(array.shape)] for name, array in kept.items()}
    head = json.dumps({"plain": plain, "arrays": told}).encode()
    return b"".join([struct.pack("<I", len(head)), head, *(array.data for array in kept.values())])


def unpack(data: bytes) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
    """Unpack a message that :func:`pack` has packed.

    Raises:
        InputError: the data are not a packed message, or are damaged.
    """
    try:
        (length,) = struct.unpack_from("<I", data)
        if length > MAX_HEAD:
            raise ValueError(f"the message header has {length} bytes, but the limit is {MAX_HEAD}")
        head = _Head.model_validate(json.loads(data[4 : 4 + length], parse_int=_whole))
        arrays, at = {}, 4 + length
        for name, (kind, shape) in head.arrays.items():
            count = 1
            for size in shape:
                # A shape may exceed the data. The ValueError for such a shape is handled below. A huge count would give
                # an OverflowError instead, so the count is limited.
                count = min(count * size, len(data) + 1)
            found = np.frombuffer(data, dtype=kind, count=count, offset=at)
            arrays[name] = found.reshape(shape).copy()  # a view would keep the whole message in memory
            at += arrays[name].nbytes
        if at != len(data):
            raise ValueError(f"the data have {len(data) - at} extra bytes after the end of the message")
        return head.plain, arrays
    except ValidationError as error:
        raise input_error(error, within="message") from error
    except (struct.error, ValueError, RecursionError) as error:
        raise InputError(f"is damaged: {error}", field="message") from error


def _whole(digits: str) -> int:
    """Convert digits to an integer. Integers of more than 64 bits raise an error: arrays cannot store them."""
    if len(digits) > 20 or not -(2**63) <= (value := int(digits)) < 2**64:
        raise ValueError("an integer has more than 64 bits")
    return value


def _array(kind: str, dimensions: int) -> AfterValidator:
    """Return a validator for non-empty arrays of a ``dtype.kind`` or a dtype name, with this number of dimensions."""

    def check(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        if kind not in (values.dtype.kind, values.dtype.name) or values.ndim != dimensions:
            needed = f"the array must have the type {kind!r} and {dimensions} dimensions"
            raise ValueError(f"{needed}, but has the type {values.dtype.name} and the shape {values.shape}")
        return values

    return AfterValidator(check)


def _joint_count(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    if not 1 <= len(values) <= MAX_JOINTS:
        raise ValueError(f"the array must have values for 1 to {MAX_JOINTS} joints, but has {len(values)}")
    return values


Joints = Annotated[np.ndarray, _array("f", 1), AfterValidator(_joint_count)]


class LogMessage(BaseModel):
    """Base class of messages.

    An array in a mapping is stored under the names of the field and the key, such as ``posed/left``.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, arbitrary_types_allowed=True)


class About(LogMessage):
    """First message of each file of a log.

    Attributes:
        language: instruction that was given to the policy.
        pixels: images are reduced before observations, to at least this number of pixels. None: they are not reduced,
            as in 0.1.
        observation: observation spec of the policy, as returned by :meth:`ObservationSpec.to_dict`.
        cameras: cameras in the log. The pose of a camera on a link is in the frame of the link.
        task, controller, arm, speed, margin, seed: settings of the run, for information only.
    """

    schema_version: Literal[1] = 1
    robot: Annotated[str, Field(max_length=400)]
    language: Annotated[str, Field(max_length=10_000)]
    observation: dict[str, Any]
    cameras: list[CameraRecord]
    pixels: float | None = None
    task: str = ""
    controller: dict[str, Any] = {}
    arm: str = ""
    speed: float | None = None
    margin: float | None = None
    seed: int | None = None

    @model_validator(mode="after")
    def _can_be_observed(self) -> About:
        if len({camera.name for camera in self.cameras}) < len(self.cameras):
            raise ValueError("two cameras have the same name, but a name must not occur twice")
        if sum(camera.width * camera.height for camera in self.cameras) > MAX_CAMERA_PIXELS:
            raise ValueError(f"the cameras of the log have more than {MAX_CAMERA_PIXELS} pixels in total")
        if self.pixels is not None and not self.pixels >= 1:
            raise ValueError("the field 'pixels' must be at least 1")
        try:
            self.spec()
        except InputError as error:
            raise ValueError(str(error)) from error
        return self

    def spec(self) -> ObservationSpec:
        return ObservationSpec.of(self.observation)


class ArmMessage(LogMessage):
    """State of the arm at one instant."""

    time: float
    force: float
    mode: ArmMode
    q: Joints
    v: Joints

    @model_validator(mode="after")
    def _has_as_many(self) -> ArmMessage:
        if len(self.q) != len(self.v):
            raise ValueError(f"the message has {len(self.q)} joint positions, but {len(self.v)} velocities")
        return self


class PictureMessage(LogMessage):
    """An image of a camera, with the serial number of the camera. Logs of version 0.1 have no serial numbers."""

    camera: str
    number: int
    captured: float
    serial: Annotated[str, Field(max_length=400)] = ""
    depth: Annotated[np.ndarray, _array("uint16", 2)]
    colors: Annotated[np.ndarray, _array("uint8", 3)]

    def frame(self) -> CameraFrame:
        return CameraFrame(self.camera, self.number, self.captured, self.depth, self.colors, self.serial)


class SentMessage(LogMessage):
    """Command that was sent to the arm."""

    time: float
    gripper: float
    clips: list[str]
    q: Joints


class QuestionMessage(LogMessage):
    """Request to the policy: numbers of the images, and joints at the time of each image."""

    time: float
    number: int
    count: int
    step: int
    gripper: float
    frames: Annotated[dict[str, int], Field(max_length=100)]
    q: Joints
    v: Joints
    posed: dict[str, Joints] = {}

    @model_validator(mode="after")
    def _poses_each_picture(self) -> QuestionMessage:
        if self.posed.keys() != self.frames.keys():
            raise ValueError("the fields 'frames' and 'posed' must name the same cameras")
        return self


class AnswerMessage(LogMessage):
    """Answer of the policy, with all input arrays of the policy. Older logs have no field ``refusal``."""

    time: float
    number: int
    done: bool
    error: str | None
    cloud_ms: float | None
    acting_ms: float
    refusal: str | None = None
    actions: Annotated[np.ndarray, _array("f", 2)]
    seen: dict[str, np.ndarray] = {}


class WatchMessage(LogMessage):
    """State of the watchdog, and the reason for the state."""

    time: float
    state: str
    reason: str


class ClocksMessage(LogMessage):
    """Delay of a period (s), age of each camera's last image (s), and time of day."""

    time: float
    late: float
    ages: dict[str, float]
    wall: float


AnyMessage: TypeAlias = (
    About | ArmMessage | PictureMessage | SentMessage | QuestionMessage | AnswerMessage | WatchMessage | ClocksMessage
)

_CAMERA = "/camera/"
_SCHEMAS: dict[str, type[AnyMessage]] = {
    "/about": About,
    "/arm": ArmMessage,
    "/sent": SentMessage,
    "/question": QuestionMessage,
    "/answer": AnswerMessage,
    "/watch": WatchMessage,
    "/clocks": ClocksMessage,
}


def message_of(topic: str, plain: dict[str, Any], arrays: dict[str, npt.NDArray[Any]]) -> AnyMessage:
    """Return a message of a log.

    Args:
        plain: fields of the message that are not arrays.
        arrays: array fields of the message by name.

    Raises:
        InputError: the topic is unknown, or a field is missing, unknown or invalid.
    """
    schema = PictureMessage if topic.startswith(_CAMERA) else _SCHEMAS.get(topic)
    if schema is None:
        raise InputError("logs have no topic with this name", field=topic)
    fields: dict[str, Any] = {}
    for name, values in arrays.items():
        group, slash, key = name.partition("/")
        if slash and isinstance(fields.setdefault(group, {}), dict):
            fields[group][key] = values
        else:
            fields[name] = values
    if twice := fields.keys() & plain.keys():
        wrong = f"the message has the field {min(twice)!r} twice, as an array and as a plain value"
        raise InputError(wrong, field=topic)
    fields |= plain
    try:
        found = schema.model_validate(fields)
    except ValidationError as error:
        raise input_error(error, within=topic) from error
    if isinstance(found, PictureMessage) and topic != f"{_CAMERA}{found.camera}":
        wrong = f"contains an image from another camera, {found.camera!r}"
        raise InputError(wrong, field=topic)
    return found
