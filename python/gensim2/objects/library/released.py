"""Read the GenSim2 release's folder layout: ``<class>/<id>/{mobility.urdf, info.json, textured_objs/}``.

The reader follows these rules. The warnings of the instance mention repairs of irregular files.

- Links that are connected by fixed joints are merged. Two links remain: the body (root frame) and the moving link.
- A missing or unreadable mesh file is left out. A missing material file is replaced by a default material. The warnings
  state how many files of each kind are affected.
- PhysX ignores a collision file that consists of a single triangle, unless the triangle is perpendicular to a
  coordinate axis. Such an ignored triangle is replaced by a thin plate. The warnings state how many files are affected.
- If ``info.json`` contains ``joint_position_range``, these values replace the joint limits of the URDF file, and they
  are not multiplied by the scale. Otherwise the limits of a prismatic joint in the URDF file are multiplied by the
  scale.
- A missing ``scale`` is replaced by the median scale of the class.
- In some files, the names of all keypoints are colours. The keypoint that is nearest to the moving link is then renamed
  to ``articulated_object_head``, if its distance from the link is at most 3 cm. Otherwise ``articulated_object_head``
  is computed from the geometry of the moving link.
- A missing ``axis`` is replaced by the axis of the object frame that is closest to the joint axis.
"""

from __future__ import annotations

import hashlib
import statistics
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from gensim2.core.arrays import Array
from gensim2.objects.known import JOINT_TYPES
from gensim2.objects.library.cache import cached_hulls, source_digest
from gensim2.objects.library.folder import ObjectFolder
from gensim2.objects.library.info import INFO, NARROWEST, UNSTATED, Info, closest_axis, read_info, read_keypoints
from gensim2.objects.library.meshes import MeshReader, listed
from gensim2.objects.library.urdf import (
    Urdf,
    UrdfJoint,
    fixed_frames,
    movable_joint,
    read_urdf,
    shape_elements,
    unit_axis,
)
from gensim2.objects.meshwork.clearance import Motion, decompose_pair
from gensim2.objects.meshwork.decompose import piece_hulls
from gensim2.objects.model import ROOT_LINK, LinkGeometry, Model
from gensim2.objects.shapes import Mesh
from gensim2.objects.types import AssetError, Hulls

LICENSE = "PartNet-Mobility terms of use: non-commercial research only"
FALLBACK_SCALE = 0.25
# Maximum coordinate (m) and joint value (m or rad). Larger values are mistakes and would exhaust the memory.
FARTHEST = 10.0
SOLID_CORNERS = 4  # a collision file with fewer vertices than this has no volume
HULL_MODULES = (
    "gensim2.objects.meshwork.clearance",
    "gensim2.objects.meshwork.convexes",
    "gensim2.objects.meshwork.decompose",
    "gensim2.objects.meshwork.voidspace",
)
READER_MODULES = (
    *HULL_MODULES,
    "gensim2.core.foreign.tree",
    "gensim2.objects.library.folder",
    "gensim2.objects.library.info",
    "gensim2.objects.library.meshes",
    "gensim2.objects.library.released",
    "gensim2.objects.library.urdf",
)


def _scale(folder: ObjectFolder, info: Info, warnings: list[str]) -> float:
    """Return the scale from ``info.json``, or if it is missing, the median scale of the other objects of the class."""
    if info.scale is not None:
        return info.scale
    others = []
    for other in sorted(folder.path.parent.iterdir()):
        if other != folder.path and (other / INFO).is_file():
            try:
                others.append(read_info(ObjectFolder(other)).scale)
            except AssetError:
                others.append(None)  # loading the other object reports the error in its file
    known = [scale for scale in others if scale is not None]
    scale = statistics.median(known) if known else FALLBACK_SCALE
    warnings.append(f"no scale: {scale:g}, {'the median of its class' if known else 'the default'}")
    return scale


def _hulls(solid: dict[str, list[Mesh]], motion: Motion, warnings: list[str]) -> dict[str, list[Array]]:
    """Return the convex parts of the body and of the moving link.

    The parts come from the cache if the meshes were decomposed before.
    """
    digest = hashlib.sha256(source_digest(*HULL_MODULES).encode())
    for meshes in solid.values():
        for mesh in meshes:
            digest.update(mesh.vertices.tobytes() + b"/" + mesh.faces.tobytes() + b"/")
        digest.update(b"//")
    digest.update(np.round(motion.T_root_link, 9).tobytes() + np.round(motion.axis, 9).tobytes())
    digest.update(repr((motion.revolute, round(motion.lower, 9), round(motion.upper, 9))).encode())

    def make() -> tuple[list[Array], dict[str, int]]:
        pieces = {link: [(mesh.vertices, mesh.faces) for mesh in meshes] for link, meshes in solid.items()}
        pair = decompose_pair(pieces["body"], pieces["moving"], motion)
        counts = {"body": pair.dropped_body, "moving": pair.dropped_moving, "of_body": len(pair.body)}
        return [*pair.body, *pair.moving], counts

    hulls, counts = cached_hulls(digest.hexdigest()[:24], make)
    for link in solid:
        if counts[link]:
            warnings.append(f"{link}: {counts[link]} collision pieces under a millimetre left out")
    return {"body": hulls[: counts["of_body"]], "moving": hulls[counts["of_body"] :]}


def _piece_hulls(solid: dict[str, list[Mesh]], warnings: list[str]) -> dict[str, list[Array]]:
    found = {}
    for link, meshes in solid.items():
        found[link], flat = piece_hulls([(mesh.vertices, mesh.faces) for mesh in meshes])
        if flat:
            warnings.append(f"{link}: {flat} flat collision pieces left out, as the original's engine drops them")
    return found


def _engines_drop(meshes: list[Mesh]) -> bool:
    """Return whether PhysX ignores a mesh: under four distinct vertices, not flat (which becomes a box)."""
    if not meshes:
        return False
    corners = np.unique(np.concatenate([mesh.vertices for mesh in meshes]), axis=0)
    return len(corners) < SOLID_CORNERS and float(np.ptp(corners, axis=0).min()) > 1e-6


def license_of(folder: ObjectFolder) -> str:
    """Return the licence terms of an object.

    ``info.json`` states the terms. If it does not, the terms of PartNet-Mobility apply to a released class with
    ``meta.json``. A faulty ``info.json`` raises no error here, because loading the object reports it.
    """
    try:
        stated = read_info(folder).license
    except AssetError:
        stated = None
    is_released = folder.path.parent.name in JOINT_TYPES and folder.has("meta.json")
    return stated or (LICENSE if is_released else UNSTATED)


def _declared_hulls(meshes: list[Mesh], info: Info) -> list[Array]:
    hulls = []
    for mesh in meshes:
        try:
            hulls.append(mesh.vertices[ConvexHull(mesh.vertices).vertices])
        except (QhullError, ValueError) as error:
            raise AssetError("a collision part has no volume", file=info.file, field="collision") from error
    return hulls


def read_model(
    path: Path, asset_class: str, content_hash: str, expected_type: str | None, rule: Hulls = "default"
) -> Model:
    """Read one instance.

    Args:
        path: ``<class>/<id>``.
        content_hash: hex digest of the instance's files.
        expected_type: usual joint type of the class; a different type causes a warning.
        rule: method for collision parts. Mass, placement and keypoints always use the default method.

    Raises:
        AssetError: the instance cannot be used; the message names the file and the field.
    """
    folder = ObjectFolder(path)
    warnings: list[str] = []
    info = read_info(folder)
    if info.unknown:
        warnings.append(f"{len(info.unknown)} unknown fields of {INFO} not used: {listed(info.unknown)}")
    scale = _scale(folder, info, warnings)
    urdf = read_urdf(folder)
    joint = movable_joint(urdf)
    axis = unit_axis(joint, urdf.file)
    if joint.child == ROOT_LINK:
        wrong = f"the moving link must not be named {ROOT_LINK!r}, because this name is reserved for the fixed link"
        raise AssetError(wrong, file=urdf.file, field=f"link {ROOT_LINK}", remedy="rename the moving link")
    kind: Literal["revolute", "prismatic"] = "revolute" if joint.type == "revolute" else "prismatic"
    if expected_type and expected_type != kind:
        warnings.append(f"joint is {kind}, the class is known as {expected_type}")

    frames = fixed_frames(urdf, joint)
    geometry = _read_geometry(folder, urdf, frames, joint, scale, warnings)
    lower, upper = _limits(info, urdf, joint, scale, warnings)
    T_root_link = frames["body"][joint.parent] @ joint.T
    T_root_link[:3, 3] *= scale
    T_link_object = geometry.T_object.copy()
    T_link_object[:3, 3] *= scale
    within("geometry", geometry.extent(), info.file, "scale")
    within("joint", max(float(np.abs(T_root_link[:3, 3]).max()), -lower, upper), info.file, "joint_position_range")
    for name, point in info.keypoints.items():
        within("keypoint", scale * float(np.abs(point).max()), info.file, f"keypoints.{name}")
    if info.convex:
        hulls = {group: _declared_hulls(meshes, info) for group, meshes in geometry.solid.items()}
    else:
        motion = Motion(T_root_link, axis, kind == "revolute", lower, upper)
        hulls = _hulls(geometry.solid, motion, warnings)
    if not hulls["moving"]:
        raise AssetError(
            "the moving link has no collision geometry", file=urdf.file, field=f"link {joint.child}",
            remedy="; ".join(geometry.unread) or "give it collision elements of some volume",
        )  # fmt: skip
    keypoints = read_keypoints(info, scale, T_link_object, joint.child, kind, axis, hulls["moving"], warnings)
    solid = {} if rule == "default" or info.convex else _piece_hulls(geometry.solid, warnings)
    return Model(
        asset_class=asset_class,
        id=path.name,
        source="real",
        body=LinkGeometry(hulls["body"], geometry.seen["body"], solid.get("body")),
        moving=LinkGeometry(hulls["moving"], geometry.seen["moving"], solid.get("moving")),
        joint_name=joint.name,
        joint_type=kind,
        moving_link=joint.child,
        T_root_link=T_root_link,
        axis=axis,
        lower=lower,
        upper=upper,
        keypoints=keypoints,
        T_link_object=T_link_object,
        object_axis=info.axis or closest_axis(axis, T_link_object),
        content_hash=content_hash,
        license=license_of(folder),
        warnings=tuple(warnings),
    )


@dataclass(frozen=True)
class _Geometry:
    """Scaled visual meshes (``seen``) and collision meshes (``solid``) of the body and the moving link.

    ``T_object`` (4, 4) is the unscaled pose of the first collision element of the moving link. ``unread`` has warnings
    about files.
    """

    seen: dict[str, list[Mesh]]
    solid: dict[str, list[Mesh]]
    T_object: Array
    unread: tuple[str, ...]

    def extent(self) -> float:
        meshes = (mesh for part in (*self.solid.values(), *self.seen.values()) for mesh in part)
        return max((float(np.abs(mesh.vertices).max()) for mesh in meshes), default=0.0)


def _read_geometry(
    folder: ObjectFolder,
    urdf: Urdf,
    frames: dict[str, dict[str, Array]],
    joint: UrdfJoint,
    scale: float,
    warnings: list[str],
) -> _Geometry:
    reader = MeshReader(folder)
    seen: dict[str, list[Mesh]] = {group: [] for group in frames}
    solid: dict[str, list[Mesh]] = {group: [] for group in frames}
    T_object: Array = np.eye(4)
    flat: list[str] = []
    for group, members in frames.items():
        for name, T in members.items():
            for element in shape_elements(urdf, name, "visual"):
                seen[group] += reader.get(element, scale, T)
            collisions = shape_elements(urdf, name, "collision")
            if name == joint.child and collisions:
                T_object = collisions[0].T
            for element in collisions:
                read = reader.get(element, scale, T)
                if _engines_drop(read):
                    flat.append(str(element.shape))
                solid[group] += read
    if flat:
        warnings.append(
            f"{len(flat)} collision files consist of one slanted triangle, which PhysX drops, and became "
            f"plates: {listed(flat)}"
        )
    warnings += reader.warnings()
    return _Geometry(seen, solid, T_object, tuple(reader.warnings()))


def within(what: str, value: float, file: Path, field: str) -> None:
    """Check that the largest coordinate or joint value of an object is at most ``FARTHEST`` (m or rad).

    Raises:
        AssetError: the value is too large.
    """
    if not value <= FARTHEST:
        raise AssetError(
            f"the largest value of the {what} is {value:.3g} m or rad, which is too large for a table-top object",
            file=file,
            field=field,
            remedy=f"keep all values within {FARTHEST:g} m or rad; check the scale, joint range and joint origin",
        )


def _limits(info: Info, urdf: Urdf, joint: UrdfJoint, scale: float, warnings: list[str]) -> tuple[float, float]:
    own = joint.limits
    if own is not None and joint.type == "prismatic":
        own = (own[0] * scale, own[1] * scale)
    if info.joint_range is None:
        field = f"joint {joint.name}: limit"
        if own is None:
            raise AssetError("no limits", file=urdf.file, field=field, remedy="write lower and upper")
        if not own[1] - own[0] >= NARROWEST:
            remedy = f"lower and upper, at least {NARROWEST:g} rad or m apart"
            raise AssetError("empty range", file=urdf.file, field=field, remedy=remedy)
        return own
    low, high = info.joint_range
    if own is not None and (low > own[1] or high < own[0]):
        warnings.append(
            f"range {low:g}..{high:g} does not overlap the limits {own[0]:g}..{own[1]:g}; the range is used"
        )
    return low, high
