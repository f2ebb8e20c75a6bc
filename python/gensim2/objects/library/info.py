"""Read and check an object's ``info.json``, field by field."""

from __future__ import annotations

import reprlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from gensim2.core.arrays import Array
from gensim2.core.foreign.limits import LARGEST_VALUE, LONGEST_TEXT, MAX_KEYPOINTS
from gensim2.objects.library.folder import ObjectFolder
from gensim2.objects.library.urdf import plain_name
from gensim2.objects.shapes import transform
from gensim2.objects.types import AssetError, Keypoint

INFO = "info.json"
UNSTATED = "unstated"  # value for a model whose author states no licence terms
FIELDS = ("keypoints", "keypoint_descriptions", "scale", "axis", "joint_position_range", "collision", "license")
OWN_NOTES = ("imported",)  # fields that the importer adds for the user
SMALLEST_SCALE = 1e-6
NARROWEST = 1e-4  # m or rad: a joint with a smaller range counts as immovable


@dataclass(frozen=True)
class Info:
    """Fields of ``info.json``. A field that is missing in the file is None.

    Attributes:
        keypoints: unscaled positions (3,) by name; at least one.
        descriptions: descriptions of keypoints by name.
        scale: length in metres of one unit.
        joint_range: lower and upper joint value in rad or m.
        convex: whether every collision mesh is already convex.
        unknown: names of unknown fields in the file.
    """

    file: Path
    keypoints: dict[str, Array]
    descriptions: dict[str, str]
    scale: float | None
    axis: Literal["x", "y", "z"] | None
    joint_range: tuple[float, float] | None
    convex: bool
    license: str | None
    unknown: tuple[str, ...] = field(default=())


def read_info(folder: ObjectFolder) -> Info:
    """Read the ``info.json`` of an object.

    Raises:
        AssetError: the file is missing, not JSON or without usable keypoints, or a field is invalid.
    """
    value, file = folder.read_json(INFO), folder.path / INFO
    points = value.get("keypoints")
    if not isinstance(points, dict) or not points:
        raise AssetError("no keypoints", file=file, field="keypoints", remedy="name at least one point")
    if len(points) > MAX_KEYPOINTS:
        wrong = f"the file has {len(points)} keypoints, more than {MAX_KEYPOINTS}"
        raise AssetError(wrong, file=file, field="keypoints")
    keypoints = {
        plain_name(name, file, "keypoints"): numbers(point, 3, file, f"keypoints.{name}")
        for name, point in points.items()
    }
    limits = value.get("joint_position_range")
    return Info(
        file=file,
        keypoints=keypoints,
        descriptions=_descriptions(value.get("keypoint_descriptions"), file),
        scale=_scale(value.get("scale"), file),
        axis=_axis(value.get("axis"), file),
        joint_range=None if limits is None else _range(limits, file),
        convex=_convex(value.get("collision"), file),
        license=_text(value.get("license"), file, "license"),
        unknown=tuple(sorted(name[:40] for name in value if name not in (*FIELDS, *OWN_NOTES))),
    )


def numbers(value: Any, count: int, file: Path, name: str) -> Array:
    """Convert a JSON list of finite numbers to an array (``count``,).

    Raises:
        AssetError: the value is not a list of ``count`` finite numbers, or a number exceeds ``LARGEST_VALUE``.
    """
    wanted = {2: "two finite numbers", 3: "three finite numbers"}[count]
    if not isinstance(value, list) or len(value) != count or not all(is_number(v) for v in value):
        raise AssetError(f"not {wanted}", file=file, field=name)
    return np.array(value, float)


def is_number(value: Any) -> bool:
    """Return whether a JSON value is a finite number of at most ``LARGEST_VALUE``."""
    return isinstance(value, int | float) and not isinstance(value, bool) and -LARGEST_VALUE <= value <= LARGEST_VALUE


def _descriptions(value: Any, file: Path) -> dict[str, str]:
    if value is None:
        return {}
    if not isinstance(value, dict):
        raise AssetError("must be a mapping from keypoint names to phrases", file=file, field="keypoint_descriptions")
    found = {name: _text(text, file, f"keypoint_descriptions.{name[:40]}") for name, text in value.items()}
    return {name: text for name, text in found.items() if text}


def _text(value: Any, file: Path, name: str) -> str | None:
    if value is None:
        return None
    if not isinstance(value, str):
        raise AssetError(f"the value {reprlib.repr(value)} is not text", file=file, field=name)
    text = " ".join(value.split())
    if not text.isprintable() or len(text) > LONGEST_TEXT:
        remedy = f"up to {LONGEST_TEXT} printable characters"
        raise AssetError(f"{reprlib.repr(text)} cannot be printed", file=file, field=name, remedy=remedy)
    return text or None


def _scale(value: Any, file: Path) -> float | None:
    if value is None:
        return None
    if not is_number(value) or not value >= SMALLEST_SCALE:
        remedy = f"metres a unit, {SMALLEST_SCALE:g} to {LARGEST_VALUE:g}"
        raise AssetError("must be a positive number of plausible size", file=file, field="scale", remedy=remedy)
    return float(value)


def _axis(value: Any, file: Path) -> Literal["x", "y", "z"] | None:
    if value is None:
        return None
    if value == "x":
        return "x"
    if value == "y":
        return "y"
    if value == "z":
        return "z"
    raise AssetError(f"{reprlib.repr(value)} is not x, y or z", file=file, field="axis")


def _range(value: Any, file: Path) -> tuple[float, float]:
    low, high = (float(v) for v in numbers(value, 2, file, "joint_position_range"))
    if not high - low >= NARROWEST:
        remedy = f"lower and upper, at least {NARROWEST:g} rad or m apart"
        raise AssetError("must be two increasing numbers", file=file, field="joint_position_range", remedy=remedy)
    return low, high


def _convex(value: Any, file: Path) -> bool:
    if value not in (None, "convex"):
        wrong = f"the value {reprlib.repr(value)} is not supported"
        raise AssetError(wrong, file=file, field="collision", remedy='use "convex", or leave the field out')
    return value is not None


COLOURS = ("blue", "red", "yellow", "green")
# Old files name keypoints by colours. The contact point then is the one that is nearest to the moving link, at most
# ``NEAR`` (m) from it.
NEAR = 0.03
HEAD = "articulated_object_head"


def closest_axis(axis: Array, T_link_object: Array) -> Literal["x", "y", "z"]:
    """Return the axis of the object frame (4, 4) that is closest to a joint axis (3,), both in the link's frame."""
    names: tuple[Literal["x", "y", "z"], ...] = ("x", "y", "z")
    return names[int(np.argmax(np.abs(T_link_object[:3, :3].T @ axis)))]


def derived_head(hulls: Sequence[Array], kind: str, axis: Array) -> Array:
    """Derive the contact point (3,) from the hulls of the moving link.

    The point is in the link's frame, in which the joint axis passes through the origin.

    The contact point is the middle of the region that is farthest from a hinge, or of the front end of a prismatic link
    as it opens.
    """
    points = np.concatenate(list(hulls))
    along = points @ axis
    score = along if kind == "prismatic" else np.linalg.norm(points - np.outer(along, axis), axis=1)
    far = points[score >= score.max() - 0.05 * max(float(np.ptp(score)), 1e-6)]
    return np.asarray((far.min(axis=0) + far.max(axis=0)) / 2)


def read_keypoints(
    info: Info,
    scale: float,
    T_link_object: Array,
    link: str,
    kind: str,
    axis: Array,
    hulls: Sequence[Array],
    warnings: list[str],
) -> dict[str, Keypoint]:
    """Return the keypoints of ``info.json`` in metres.

    Keypoints with ``base`` in their names are fixed to the root, and other keypoints to ``link``.

    Args:
        info: content of ``info.json``.
        scale: length in metres of one unit of the keypoints' coordinates.
        T_link_object: (4, 4) pose of the object frame in the frame of the moving link. The keypoints are given in the
            object frame.
        link: name of the moving link.
        kind: joint type, ``"revolute"`` or ``"prismatic"``.
        axis: (3,) unit joint axis in the moving link's frame.
        hulls: collision hulls of the moving link, each (N, 3) in its frame.
        warnings: list to which the function appends a line for each keypoint that it derives by a rule.
    """
    # Import late: naming objects does not need SciPy.
    from scipy.spatial import cKDTree

    from gensim2.objects.meshwork.convexes import surface_samples

    points = {name: scale * point for name, point in info.keypoints.items()}
    if all(name in COLOURS for name in points):
        surface = cKDTree(np.concatenate([surface_samples(hull) for hull in hulls]))
        gaps = {n: float(surface.query(transform(T_link_object, p[None])[0])[0]) for n, p in points.items()}
        nearest = min(gaps, key=lambda n: gaps[n])
        if gaps[nearest] <= NEAR:
            head = points[nearest]
            rule = f"{nearest!r}, {1000 * gaps[nearest]:.0f} mm from the moving link, is {HEAD}"
        else:
            head = transform(np.asarray(np.linalg.inv(T_link_object), float), derived_head(hulls, kind, axis)[None])[0]
            rule = f"none is near the moving link, so {HEAD} comes from its geometry"
        warnings.append(f"keypoints have colour names only: {rule}")
        points = {HEAD: head}
    found = {}
    for name, point in points.items():
        text = info.descriptions.get(name) or name.replace("_", " ")
        if "base" in name:
            found[name] = Keypoint("base", point, text)
        else:
            found[name] = Keypoint(link, transform(T_link_object, point[None])[0], text)
    return found
