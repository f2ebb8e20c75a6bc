"""Convert cameras to plain data, for a robot's logs (JSON) and for requests to a policy server (arrays)."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from gensim2.core.errors import InputError
from gensim2.perception.camera import Camera

_CALIBRATED = {"depth_scale": 1.0, "depth_bias": 0.0}
Matrix = Annotated[list[list[float]], BeforeValidator(lambda value: getattr(value, "tolist", lambda: value)())]
"""Rows of numbers; arrays are accepted too."""


class CameraRecord(BaseModel):
    """A :class:`~gensim2.perception.Camera` as plain data, with the same attributes."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    name: Annotated[str, Field(min_length=1, max_length=100)]
    width: int
    height: int
    intrinsic: Matrix
    T_base_camera: Matrix
    far: float
    link: str | None
    depth_scale: float = _CALIBRATED["depth_scale"]
    depth_bias: float = _CALIBRATED["depth_bias"]

    @model_validator(mode="after")
    def _is_a_camera(self) -> CameraRecord:
        try:
            self.camera()
        except InputError as error:
            raise ValueError(str(error)) from error
        return self

    @staticmethod
    def of(camera: Camera) -> CameraRecord:
        return CameraRecord(**{name: getattr(camera, name) for name in CameraRecord.model_fields})

    def camera(self) -> Camera:
        """Return the camera that this record describes.

        Raises:
            InputError: a value has the wrong shape or is out of range.
        """
        arrays = {name: np.array(getattr(self, name), dtype=np.float64) for name in ("intrinsic", "T_base_camera")}
        return Camera(**{name: getattr(self, name) for name in CameraRecord.model_fields} | arrays)

    @staticmethod
    def message(camera: Camera) -> dict[str, Any]:
        """Return the camera's attributes as a dict in which matrices are arrays, for a request to a policy server. The
        attributes ``depth_scale`` and ``depth_bias`` are omitted if they have their default values, because policy
        servers of gensim2 0.2 do not know these attributes.
        """
        told = {name: getattr(camera, name) for name in CameraRecord.model_fields}
        return {name: value for name, value in told.items() if name not in _CALIBRATED or value != _CALIBRATED[name]}
