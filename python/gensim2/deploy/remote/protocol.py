"""Messages between a loop and a controller elsewhere: maps of plain values and arrays, as msgpack.

The loop speaks first (``hello``: version and token), the server answers (``welcome`` or ``refused``), then each request
(``reset``, ``act``) has one answer (``ready``, ``action``, ``error``) with its number.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.errors import GenSim2Error, MissingExtraError
from gensim2.observations import Camera, Observation, PointCloud

VERSION = 1
MAX_BYTES = 16 << 20
"""Of one message: a cloud of 1,024 points has 15 kB, three depth pictures of 640 x 480 1.8 MB."""
TOKEN = "GENSIM2_POLICY_TOKEN"
"""Environment variable that holds the token: a command line is read by everybody on a machine."""
TOKEN_LENGTH = 16
"""Characters of a token at least."""
PORT = 8321

_ARRAY = "__array__"
_TYPES = ("uint8", "uint16", "int16", "int32", "int64", "float32", "float64", "bool")
_URL = re.compile(r"wss?://[^\s/?#@]+(/[^\s@]*)?")


class RemoteError(GenSim2Error):
    """A controller elsewhere cannot be reached, refuses, is late, or says what cannot be understood."""


def msgpack() -> Any:
    """The module.

    Raises:
        MissingExtraError: it is not installed.
    """
    try:
        import msgpack
    except ImportError as error:
        raise MissingExtraError("msgpack", "robot") from error
    return msgpack


def is_url(text: str) -> bool:
    """Whether a text names a controller elsewhere."""
    return _URL.fullmatch(text) is not None


def encode(message: Mapping[str, Any]) -> bytes:
    """A message as bytes."""
    found: bytes = msgpack().packb(dict(message), default=_plain, use_bin_type=True)
    return found


def decode(data: Any) -> dict[str, Any]:
    """A message from bytes.

    Raises:
        RemoteError: they are none.
    """
    if not isinstance(data, bytes):
        raise RemoteError("a message must be binary")
    if len(data) > MAX_BYTES:
        raise RemoteError(f"a message has {len(data)} bytes, {MAX_BYTES} at most")
    try:
        found = msgpack().unpackb(data, raw=False, object_hook=_array, strict_map_key=True)
    except MissingExtraError:
        raise
    except (ValueError, TypeError, KeyError, RecursionError, msgpack().UnpackException) as error:
        raise RemoteError(f"a message is damaged: {error}") from error
    if not isinstance(found, dict) or not isinstance(found.get("kind"), str):
        raise RemoteError("a message says no kind")
    return found


def observation_to_message(observation: Observation) -> dict[str, Any]:
    """Plain values and arrays of an observation."""
    cloud = observation.cloud
    return {
        "step": observation.step,
        "time": observation.time,
        "language": observation.language,
        "arrays": dict(observation.arrays),
        "cloud": None if cloud is None else {"xyz": cloud.xyz, "rgb": cloud.rgb, "segmentation": cloud.segmentation},
        "cameras": [
            {
                "name": camera.name,
                "width": camera.width,
                "height": camera.height,
                "intrinsic": camera.intrinsic,
                "T_base_camera": camera.T_base_camera,
                "far": camera.far,
                "link": camera.link,
            }
            for camera in observation.cameras.values()
        ],
    }


def observation_of(data: Any) -> Observation:
    """An observation from plain values and arrays.

    Raises:
        RemoteError: it is none.
    """
    try:
        cloud = data["cloud"]
        cameras = [Camera(**each) for each in data["cameras"]]
        return Observation(
            int(data["step"]),
            float(data["time"]),
            str(data["language"]),
            {str(name): np.asarray(array) for name, array in data["arrays"].items()},
            None if cloud is None else PointCloud(cloud["xyz"], cloud["rgb"], cloud["segmentation"]),
            {camera.name: camera for camera in cameras},
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise RemoteError(f"an observation cannot be so: {error}") from error


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return {_ARRAY: [value.dtype.name, list(value.shape), np.ascontiguousarray(value).tobytes()]}
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} is no plain value")


def _array(value: dict[str, Any]) -> Any:
    if _ARRAY not in value:
        return value
    kind, shape, data = value[_ARRAY]
    if kind not in _TYPES or len(value) != 1 or not all(isinstance(each, int) and each >= 0 for each in shape):
        raise ValueError("an array cannot be so")
    found: npt.NDArray[Any] = np.frombuffer(data, dtype=kind).reshape(shape)
    return found
