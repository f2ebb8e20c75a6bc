"""Define the messages between a client and the policy server. A message is a msgpack map of plain values and arrays.

The client sends ``hello`` with its token and protocol version, and the server answers ``welcome`` or ``refused``. Then
each numbered request gets an answer with the same number: ``ready`` to ``reset``, ``action`` to ``act``, or ``error``.
:func:`decode` limits bytes and values, and :func:`read_message` checks the kind and schema of a message.
"""

from __future__ import annotations

import re
import reprlib
from collections.abc import Mapping
from typing import Annotated, Any, Literal, TypeVar, get_args

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from gensim2.core.errors import InputError, required
from gensim2.core.validation import input_error
from gensim2.perception import Observation, PointCloud
from gensim2.perception.camera_record import CameraRecord

VERSION = 1
MAX_HELLO = 4 << 10
"""Maximum size of a client's first message, bytes; the server reads this message before the client is authenticated."""
MAX_BYTES = 16 << 20
"""Maximum size of a request, bytes. A cloud of 1,024 points takes 15 kB, three depth images of 640 x 480 1.8 MB."""
MAX_ANSWER = 64 << 10
"""Maximum size of an answer, bytes; an action with an observation spec takes less than 2 kB."""
MAX_VALUES = 10_000
"""Maximum number of values in a message; an array counts as one value."""
MAX_ITEMS = 1000
"""Largest number of entries in a list or map."""
MAX_TEXT = 16 << 10
"""Longest string, bytes."""
MAX_DIMENSIONS = 4
TOKEN = "GENSIM2_POLICY_TOKEN"
"""Environment variable with the token; a command-line option would be visible to all users of the machine."""
TOKEN_LENGTH = 16
"""Smallest length of a token, characters."""
PORT = 8321

_ARRAY = "__array__"
_INTEGERS = ("uint8", "uint16", "int16", "int32", "int64")
_FLOATS = ("float32", "float64")
_TYPES = (*_INTEGERS, *_FLOATS, "bool")
_URL = re.compile(r"wss?://[^\s/?#@]+(/[^\s@]*)?")


class RemoteError(InputError):
    """A policy server or client is unreachable, too late, refuses the connection, or sends an invalid message."""


def is_url(text: str) -> bool:
    """Return whether a text is the URL of a policy server."""
    return _URL.fullmatch(text) is not None


def encode(message: Mapping[str, Any]) -> bytes:
    found: bytes = required("msgpack", "remote").packb(dict(message), default=_plain, use_bin_type=True)
    return found


def decode(data: Any, max_bytes: int = MAX_BYTES, sender: str = "The sender") -> dict[str, Any]:
    """Decode a message.

    Args:
        data: received data.
        max_bytes: largest allowed size.
        sender: name of the sender for error messages.

    Raises:
        RemoteError: the data are not a valid message, or have too many bytes or values.
    """
    if not isinstance(data, bytes):
        raise RemoteError(f"{sender} sent a text message, but must send a binary message")
    if len(data) > max_bytes:
        raise RemoteError(f"{sender} sent a message of {len(data)} bytes, but the limit is {max_bytes}")
    library, counter = required("msgpack", "remote"), _Counter()
    try:
        found = library.unpackb(
            data,
            raw=False,
            strict_map_key=True,
            object_pairs_hook=counter.mapping,
            list_hook=counter.items,
            max_array_len=MAX_ITEMS,
            max_map_len=MAX_ITEMS,
            max_str_len=MAX_TEXT,
            max_bin_len=max_bytes,
            max_ext_len=0,
        )
    except (ValueError, TypeError, RecursionError, library.UnpackException) as error:
        raise RemoteError(f"{sender} sent a damaged message: {error or type(error).__name__}") from error
    if not isinstance(found, dict) or not isinstance(found.get("kind"), str):
        raise RemoteError(f"{sender} sent a message without a kind")
    return found


class _Counter:
    """Counts a message's values while it is decoded, because Python objects can need 70 bytes per byte."""

    def __init__(self) -> None:
        self._count = 0

    def items(self, values: list[Any]) -> list[Any]:
        self._add(len(values))
        return values

    def mapping(self, pairs: list[tuple[str, Any]]) -> Any:
        self._add(2 * len(pairs))
        found = dict(pairs)
        if len(found) < len(pairs):
            raise ValueError("a map contains a key twice")
        return _array(found[_ARRAY]) if list(found) == [_ARRAY] else found

    def _add(self, count: int) -> None:
        self._count += count
        if self._count > MAX_VALUES:
            raise ValueError(f"the message contains more than {MAX_VALUES} values")


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return {_ARRAY: [value.dtype.name, list(value.shape), np.ascontiguousarray(value).tobytes()]}
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"a value of type {type(value).__name__} cannot be sent")


def _array(value: Any) -> npt.NDArray[Any]:
    if not isinstance(value, list) or len(value) != 3:
        raise ValueError("an array must have a type, a shape and bytes")
    kind, shape, data = value
    if not isinstance(kind, str) or kind not in _TYPES or not isinstance(shape, list) or not isinstance(data, bytes):
        raise ValueError("an array must have a type, a shape and bytes")
    if len(shape) > MAX_DIMENSIONS or not all(type(each) is int and 0 <= each <= MAX_BYTES for each in shape):
        raise ValueError("the shape of an array is invalid")
    found: npt.NDArray[Any] = np.frombuffer(data, dtype=kind)
    return found.reshape(shape)


def _shaped(types: tuple[str, ...], *shape: int | None) -> Any:
    """Return a function that checks that a value is an array of the given type and shape.

    Args:
        types: allowed data types.
        shape: required length of each axis, None for any length. If a shape is given, all numbers must be finite.
    """

    def check(value: Any) -> npt.NDArray[Any]:
        if not isinstance(value, np.ndarray) or value.dtype.name not in types:
            raise ValueError(f"must be an array of {' or '.join(types)}")
        if shape and (
            value.ndim != len(shape) or any(n not in (None, m) for n, m in zip(shape, value.shape, strict=True))
        ):
            wanted = ", ".join("N" if each is None else str(each) for each in shape)
            raise ValueError(f"must be an array of shape ({wanted}), got {value.shape}")
        if shape and value.dtype.kind == "f" and not np.isfinite(value).all():
            raise ValueError("must contain only finite numbers, but contains NaN or infinity")
        return value

    return BeforeValidator(check)


class WireMessage(BaseModel):
    """Base class of messages. Field types are checked strictly, and unknown fields are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, arbitrary_types_allowed=True)


Text = Annotated[str, Field(max_length=2000)]
Word = Annotated[str, Field(max_length=200)]
Number = Annotated[int, Field(ge=0, lt=2**63)]
Finite = Annotated[float, Field(allow_inf_nan=False)]


class Hello(WireMessage):
    """First message of a client; the server checks the token before it reads the other fields."""

    kind: Literal["hello"]
    protocol: Number
    token: Word
    robot: Word | None = None


class Welcome(WireMessage):
    """Answer to a client whose token is valid."""

    kind: Literal["welcome"]
    protocol: Number
    gensim2: Word
    controller: Text
    robot: Word
    action_size: Annotated[int, Field(ge=1, le=MAX_ITEMS)]
    observation: dict[str, Any]


class Refusal(WireMessage):
    """Answer to a client that the server refuses, with the reason."""

    kind: Literal["refused"]
    why: Text


class CloudMessage(WireMessage):
    xyz: Annotated[Any, _shaped(_FLOATS, None, 3)]
    rgb: Annotated[Any, _shaped(("uint8",), None, 3)]
    segmentation: Annotated[Any, _shaped(_INTEGERS, None)] | None


class ObservationMessage(WireMessage):
    step: Number
    time: Finite
    language: Text
    arrays: dict[Word, Annotated[Any, _shaped(_TYPES)]]
    cloud: CloudMessage | None
    cameras: list[CameraRecord]

    def value(self) -> Observation:
        cloud, cameras = self.cloud, [each.camera() for each in self.cameras]
        return Observation(
            self.step,
            self.time,
            self.language,
            self.arrays,
            None if cloud is None else PointCloud(cloud.xyz, cloud.rgb, cloud.segmentation),
            {camera.name: camera for camera in cameras},
        )


class Reset(WireMessage):
    """Request to start an episode."""

    kind: Literal["reset"]
    number: Number
    observation: ObservationMessage
    seed: int


class Act(WireMessage):
    """Request for the next action."""

    kind: Literal["act"]
    number: Number
    observation: ObservationMessage


class Ready(WireMessage):
    """Answer to ``reset``."""

    kind: Literal["ready"]
    number: Number
    observation: dict[str, Any]


class Action(WireMessage):
    """Answer to ``act``; the action is None if the episode is over."""

    kind: Literal["action"]
    number: Number
    action: Annotated[Any, _shaped(("float32",), None)] | None
    observation: dict[str, Any]


class Failure(WireMessage):
    """Answer to a failed request, with the number of the request; None if the server could not read the request."""

    kind: Literal["error"]
    number: Number | None
    why: Text


One = TypeVar("One", bound=WireMessage)
Other = TypeVar("Other", bound=WireMessage)


def read_message(message: Mapping[str, Any], one: type[One], other: type[Other], *, sender: str) -> One | Other:
    """Check that a message matches one of two schemas, and return the parsed message.

    Args:
        message: decoded message.
        one, other: the two schemas.
        sender: name of the sender for error messages.

    Raises:
        RemoteError: the message is of neither kind, or a field is missing, unknown or invalid.
    """
    kinds = {get_args(each.model_fields["kind"].annotation)[0]: each for each in (one, other)}
    kind = message["kind"]
    if kind not in kinds:
        raise RemoteError(f"{sender} sent the message {reprlib.repr(kind)} instead of {' or '.join(kinds)}")
    try:
        return kinds[kind].model_validate(message)
    except ValidationError as error:
        raise RemoteError(f"{sender} sent an invalid {kind} message: {input_error(error)}") from error


def observation_to_message(observation: Observation) -> dict[str, Any]:
    """Return an observation as plain values and arrays for :class:`ObservationMessage`."""
    cloud = observation.cloud
    return {
        "step": observation.step,
        "time": observation.time,
        "language": observation.language,
        "arrays": dict(observation.arrays),
        "cloud": None if cloud is None else {"xyz": cloud.xyz, "rgb": cloud.rgb, "segmentation": cloud.segmentation},
        "cameras": [CameraRecord.message(camera) for camera in observation.cameras.values()],
    }
