"""Specification of observations, one value that data sets, controllers and checkpoints carry."""

from __future__ import annotations

import re
import reprlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

from gensim2.core.errors import InputError
from gensim2.perception.cameras import PLACES
from gensim2.perception.cloud import CloudSettings

Modality = Literal["pointcloud", "rgb", "depth", "segmentation"]
MODALITIES: tuple[Modality, ...] = get_args(Modality)
CAMERAS: tuple[str, ...] = tuple(PLACES)
"""The fixed ones; a robot may carry others (:class:`~gensim2.robots.MountedCamera`)."""

_NAME = re.compile(r"[a-z][a-z0-9_]{0,39}")


@dataclass(frozen=True)
class ObservationSpec:
    """Modalities, cameras and cloud settings of an observation, beside what each one holds: time, joints, tool pose,
    gripper, the sentence.

    Attributes:
        modalities: ``pointcloud``, ``depth`` and ``segmentation`` by ray casting, ``rgb`` by the renderer; none of
            them: the robot's own state alone.
        cameras: names of those that are used: the fixed ones in their order, then the robot's own as they were given.
        cloud: how point clouds are made; its noise is on depth pictures, too.
    """

    modalities: tuple[Modality, ...] = ("pointcloud",)
    cameras: tuple[str, ...] = CAMERAS
    cloud: CloudSettings = field(default_factory=CloudSettings)

    def __post_init__(self) -> None:
        own = [word for word in self.cameras if word not in CAMERAS and _NAME.fullmatch(str(word))]
        choices = (("modalities", self.modalities, MODALITIES), ("cameras", self.cameras, (*CAMERAS, *own)))
        for name, given, known in choices:
            unknown = [word for word in given if word not in known]
            if unknown or len(set(given)) < len(given) or (name == "cameras" and not given):
                beside = " or names of the robot's own" if name == "cameras" else ""
                said = ", ".join(map(str, given)) or "nothing"
                raise InputError(f"must be some of {', '.join(known)}{beside}, each once, is {said}", field=name)
            # One spelling of one spec, however it was given.
            object.__setattr__(self, name, tuple(word for word in known if word in given))

    @property
    def casts(self) -> bool:
        """Whether any of it comes from rays."""
        rays = {"depth", "segmentation"} if self.is_privileged else {"pointcloud", "depth", "segmentation"}
        return bool(rays & set(self.modalities))

    @property
    def is_privileged(self) -> bool:
        """Whether the cloud is made of what only a simulator knows."""
        return "pointcloud" in self.modalities and self.cloud.source != "depth"

    @property
    def is_proprioceptive(self) -> bool:
        """Whether no camera is looked through."""
        return not self.modalities

    @staticmethod
    def of(values: ObservationSpec | Mapping[str, Any] | None) -> ObservationSpec:
        """A spec from plain data, as :meth:`to_dict` gives it; fields of :class:`CloudSettings` may stand in it
        directly. None: the default.

        Raises:
            InputError: there is no such setting, or it cannot be so.
        """
        try:
            return ObservationSpec._of(values)
        except (TypeError, ValueError, OverflowError) as error:  # a value of another type than its setting's
            raise InputError(f"cannot be so: {error}", field="observation") from error

    @staticmethod
    def _of(values: ObservationSpec | Mapping[str, Any] | None) -> ObservationSpec:
        if isinstance(values, ObservationSpec):
            return values
        if not isinstance(values, Mapping | None):
            raise InputError(f"must be a mapping, got {reprlib.repr(values)}", field="observation")
        given = dict(values or {})
        found: dict[str, Any] = {}
        for name in ("modalities", "cameras"):
            if name in given:
                words = given.pop(name)
                words = (words,) if isinstance(words, str) else words
                if not isinstance(words, list | tuple) or not all(isinstance(word, str) for word in words):
                    raise InputError(f"must be a list of names, got {reprlib.repr(words)}", field=f"observation.{name}")
                found[name] = tuple(words)
        cloud = given.pop("cloud", None)
        if isinstance(cloud, CloudSettings) and not given:
            return ObservationSpec(**found, cloud=cloud)
        if not isinstance(cloud, Mapping | None):
            raise InputError(f"must be a mapping, got {reprlib.repr(cloud)}", field="observation.cloud")
        return ObservationSpec(**found, cloud=CloudSettings.of({**(cloud or {}), **given}))

    def to_dict(self) -> dict[str, Any]:
        """Plain data, for JSON."""
        return {"modalities": list(self.modalities), "cameras": list(self.cameras), "cloud": self.cloud.to_dict()}

    def require(self, other: ObservationSpec, what: str, *, of: str) -> None:
        """Refuse to use with one spec what goes by another.

        Args:
            other: the spec that must be this one.
            what: goes by ``other``, for the message.
            of: what goes by this one.

        Raises:
            InputError: names the first field that differs, and both values.
        """
        mine, theirs = _flat(self.to_dict()), _flat(other.to_dict())
        for name in mine:
            if mine[name] != theirs[name]:
                raise InputError(
                    f"{what} has {theirs[name]!r}, {of} has {mine[name]!r}",
                    field=f"observation.{name}",
                    remedy="observe both alike",
                )


def _flat(values: Mapping[str, Any]) -> dict[str, Any]:
    cloud = {f"cloud.{name}": value for name, value in values["cloud"].items()}
    return {name: value for name, value in values.items() if name != "cloud"} | {"cloud.source": "depth"} | cloud
