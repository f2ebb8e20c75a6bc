"""Reader of the GenSim2 release's folder layout: ``<class>/<id>/{mobility.urdf, info.json, textured_objs/}``.

Rules for what is odd, each noted in the instance's warnings:

- links joined by fixed joints become one: the body in the root frame, and the moving link;
- a mesh file that is missing or unreadable is left out and counted;
- a collision file that is one slanted triangle has no hull, and PhysX drops it: it becomes a plate, and is counted;
- ``joint_position_range`` replaces the limits; prismatic limits of the URDF are scaled, the range is not;
- no ``scale``: the median of the class;
- keypoints with colour names only: the one nearest to the moving link becomes ``articulated_object_head``; where none
  lies within 3 cm, that keypoint is derived from the moving link's geometry;
- no ``axis``: the axis of the object frame that is closest to the joint's.
"""

from __future__ import annotations

import hashlib
import json
import statistics
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull, QhullError

from gensim2.assets.cache import cached_hulls, source_digest
from gensim2.assets.clearance import Motion, decompose_pair
from gensim2.assets.errors import AssetError
from gensim2.assets.keypoints import object_axis, read_keypoints
from gensim2.assets.model import LinkGeometry, Model
from gensim2.assets.objfile import read_obj
from gensim2.assets.shapes import Mesh, rotation, transform

Array = npt.NDArray[np.float64]

LICENSE = "PartNet-Mobility terms of use: non-commercial research only"
FALLBACK_SCALE = 0.25
FARTHEST = 10.0  # m or rad from the origin: what is beyond is a mistake, and no grid could hold it
SOLID_CORNERS = 4  # a collision file with fewer has no volume
HULL_MODULES = ("clearance", "convexes", "decompose", "voidspace")
READER_MODULES = (*HULL_MODULES, "keypoints", "objfile", "real")


@dataclass(frozen=True)
class MeshElement:
    """A visual or collision element: mesh file and pose in its link, unscaled."""

    file: Path
    T: Array


@dataclass(frozen=True)
class UrdfJoint:
    name: str
    type: str
    parent: str
    child: str
    T: Array
    axis: Array
    limits: tuple[float, float] | None


def _vector(text: str | None, file: Path, field: str, default: str) -> Array:
    try:
        value = np.array([float(x) for x in (text or default).split()])
    except ValueError as error:
        raise AssetError("not three numbers", file=file, field=field) from error
    if value.shape != (3,) or not np.isfinite(value).all():
        raise AssetError("not three finite numbers", file=file, field=field)
    return value


def _origin(element: ET.Element | None, file: Path, field: str) -> Array:
    T = np.eye(4)
    if element is not None:
        roll, pitch, yaw = _vector(element.get("rpy"), file, f"{field}.rpy", "0 0 0")
        T[:3, :3] = rotation((0, 0, 1), yaw) @ rotation((0, 1, 0), pitch) @ rotation((1, 0, 0), roll)
        T[:3, 3] = _vector(element.get("xyz"), file, f"{field}.xyz", "0 0 0")
    return T


def mesh_elements(link: ET.Element, kind: str, file: Path) -> list[MeshElement]:
    found = []
    for element in link.findall(kind):
        mesh = element.find("geometry/mesh")
        if mesh is None or not mesh.get("filename"):
            raise AssetError("only mesh geometry is read", file=file, field=f"link {link.get('name')}: {kind}")
        where = _origin(element.find("origin"), file, f"link {link.get('name')}: {kind}.origin")
        name = Path(str(mesh.get("filename")))
        if name.is_absolute() or ".." in name.parts or "\0" in str(name):
            raise AssetError(f"{name} lies outside the folder", file=file, field=f"link {link.get('name')}: {kind}")
        found.append(MeshElement(file.parent / name, where))
    return found


def urdf_joints(root: ET.Element, file: Path) -> list[UrdfJoint]:
    found = []
    for joint in root.findall("joint"):
        name = joint.get("name") or ""
        parent, child, limit, axis = (joint.find(k) for k in ("parent", "child", "limit", "axis"))
        if parent is None or child is None:
            raise AssetError("a joint needs a parent and a child", file=file, field=f"joint {name}")
        limits = None
        if limit is not None and limit.get("lower") is not None and limit.get("upper") is not None:
            low, high, _ = _vector(f"{limit.get('lower')} {limit.get('upper')} 0", file, f"joint {name}: limit", "")
            limits = (float(low), float(high))
        found.append(
            UrdfJoint(
                name,
                joint.get("type") or "",
                parent.get("link") or "",
                child.get("link") or "",
                _origin(joint.find("origin"), file, f"joint {name}: origin"),
                _vector(None if axis is None else axis.get("xyz"), file, f"joint {name}: axis", "1 0 0"),
                limits,
            )
        )
    return found


def read_info(folder: Path) -> dict[str, Any]:
    """``info.json`` of an instance.

    Raises:
        AssetError: missing, not JSON, or without usable keypoints.
    """
    file = folder / "info.json"
    try:
        info = json.loads(file.read_text())
    except OSError as error:
        raise AssetError(f"cannot read: {error.strerror}", file=file) from error
    except ValueError as error:
        raise AssetError(f"not JSON: {error}", file=file) from error
    if not isinstance(info, dict) or not isinstance(info.get("keypoints"), dict) or not info["keypoints"]:
        raise AssetError("no keypoints", file=file, field="keypoints", remedy="name at least one point")
    for name, point in info["keypoints"].items():
        try:
            value = np.array(point, float)
        except (TypeError, ValueError):
            value = np.zeros(0)
        if value.shape != (3,) or not np.isfinite(value).all():
            raise AssetError("not three finite numbers", file=file, field=f"keypoints.{name}")
    return info


def _scale(folder: Path, info: dict[str, Any], warnings: list[str]) -> float:
    scale = info.get("scale")
    if scale is None:
        others = []
        for other in sorted(folder.parent.iterdir()):
            if other != folder and (other / "info.json").is_file():
                value = read_info(other).get("scale")
                if isinstance(value, int | float):
                    others.append(float(value))
        scale = statistics.median(others) if others else FALLBACK_SCALE
        source = "the median of its class" if others else "the default"
        warnings.append(f"no scale: {scale:g}, {source}")
    if not isinstance(scale, int | float) or not np.isfinite(scale) or scale <= 0:
        raise AssetError("not a positive number", file=folder / "info.json", field="scale")
    return float(scale)


class MeshReader:
    """Mesh files of one instance, each read once; what cannot be read is noted."""

    def __init__(self, base: Path) -> None:
        self._base, self._read = base, {}  # type: tuple[Path, dict[Path, list[Mesh] | None]]
        self.bad: dict[str, str] = {}

    def get(self, element: MeshElement, scale: float, T: Array) -> list[Mesh]:
        """Meshes of an element in the frame that ``T`` (unscaled) maps its link to, scaled."""
        if element.file not in self._read:
            try:
                self._read[element.file] = read_obj(element.file)
            except (OSError, ValueError, IndexError) as error:
                self._read[element.file] = None
                reason = "missing" if isinstance(error, FileNotFoundError) else str(error)
                self.bad[element.file.relative_to(self._base).as_posix()] = reason
        place = T @ element.T
        return [
            Mesh(scale * transform(place, m.vertices), m.faces, m.look)
            for m in self._read[element.file] or []
            if len(m.faces)
        ]


def _hulls(solid: dict[str, list[Mesh]], motion: Motion, warnings: list[str]) -> dict[str, list[Array]]:
    """Convex parts of both links, from the cache where the same meshes were taken apart before."""
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


def _engines_drop(meshes: list[Mesh]) -> bool:
    """Whether the meshes of one collision file are too little for a hull: under four corners, and not even flat along
    an axis, which PhysX takes for a box."""
    if not meshes:
        return False
    corners = np.unique(np.concatenate([mesh.vertices for mesh in meshes]), axis=0)
    return len(corners) < SOLID_CORNERS and float(np.ptp(corners, axis=0).min()) > 1e-6


def declared_license(folder: Path) -> str | None:
    """The terms that ``info.json`` of an instance states, if any; what is wrong with the file shows at loading."""
    try:
        value = json.loads((folder / "info.json").read_text())
    except (OSError, ValueError):
        return None
    terms = value.get("license") if isinstance(value, dict) else None
    return terms if isinstance(terms, str) and terms else None


def _declares_convex(info: dict[str, Any], folder: Path) -> bool:
    """Whether ``info.json`` says that every collision element is convex as it is."""
    word = info.get("collision")
    if word not in (None, "convex"):
        raise AssetError(
            f"{word!r} is not known", file=folder / "info.json", field="collision", remedy='"convex", or leave it out'
        )
    return word == "convex"


def _declared_hulls(meshes: list[Mesh], folder: Path) -> list[Array]:
    """Hulls of meshes that are said to be convex."""
    hulls = []
    for mesh in meshes:
        try:
            hulls.append(mesh.vertices[ConvexHull(mesh.vertices).vertices])
        except (QhullError, ValueError) as error:
            raise AssetError("a collision piece has no volume", file=folder / "info.json", field="collision") from error
    return hulls


def fingerprint(folder: Path) -> str:
    """Hex digest of every file of an instance."""
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            digest.update(path.relative_to(folder).as_posix().encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()


def read_model(folder: Path, asset_class: str, content_hash: str, expected_type: str | None) -> Model:
    """Read one instance.

    Args:
        folder: ``<class>/<id>``.
        expected_type: joint type that the class is known for, to note a contradiction.

    Raises:
        AssetError: the instance cannot be used; names the file and the field.
    """
    file = folder / "mobility.urdf"
    warnings: list[str] = []
    info = read_info(folder)
    scale = _scale(folder, info, warnings)
    try:
        root = ET.parse(file).getroot()
    except OSError as error:
        raise AssetError(f"cannot read: {error.strerror}", file=file) from error
    except ET.ParseError as error:
        raise AssetError(f"not XML: {error}", file=file) from error
    links = {link.get("name") or "": link for link in root.findall("link")}
    joints = urdf_joints(root, file)
    movable = [j for j in joints if j.type != "fixed"]
    if len(movable) != 1:
        raise AssetError(
            f"{len(movable)} movable joints, one is needed",
            file=file,
            field="joint",
            remedy="fix all joints but one",
        )
    joint = movable[0]
    if joint.type not in ("revolute", "prismatic"):
        raise AssetError(f"joint type {joint.type!r}", file=file, field=f"joint {joint.name}: type")
    kind: Literal["revolute", "prismatic"] = "revolute" if joint.type == "revolute" else "prismatic"
    if expected_type and expected_type != kind:
        warnings.append(f"joint is {kind}, the class is known as {expected_type}")

    frames = fixed_frames(links, joints, joint, file)
    meshes = MeshReader(folder)
    seen: dict[str, list[Mesh]] = {group: [] for group in frames}
    solid: dict[str, list[Mesh]] = {group: [] for group in frames}
    first_collision: MeshElement | None = None
    flat: list[str] = []
    convex = _declares_convex(info, folder)
    for group, members in frames.items():
        for name, T in members.items():
            for element in mesh_elements(links[name], "visual", file):
                seen[group] += meshes.get(element, scale, T)
            collisions = mesh_elements(links[name], "collision", file)
            if name == joint.child and collisions:
                first_collision = collisions[0]
            for element in collisions:
                read = meshes.get(element, scale, T)
                if _engines_drop(read):
                    flat.append(element.file.relative_to(folder).as_posix())
                solid[group] += read
    if flat:
        warnings.append(
            f"{len(flat)} collision files are one slanted triangle, which PhysX drops, made a plate: {', '.join(flat)}"
        )
    if meshes.bad:
        missing = [name for name, why in meshes.bad.items() if why == "missing"]
        broken = [f"{name} ({why})" for name, why in meshes.bad.items() if why != "missing"]
        if missing:
            warnings.append(f"{len(missing)} mesh files missing: {', '.join(missing)}")
        if broken:
            warnings.append(f"{len(broken)} mesh files unreadable: {', '.join(broken)}")
    axis = joint.axis / max(float(np.linalg.norm(joint.axis)), 1e-12)
    if np.linalg.norm(joint.axis) < 1e-9:
        raise AssetError("zero axis", file=file, field=f"joint {joint.name}: axis")
    lower, upper = _limits(folder, info, joint, scale, warnings)
    T_root_link = frames["body"][joint.parent] @ joint.T
    T_root_link[:3, 3] *= scale
    extent = max(
        (float(np.abs(m.vertices).max()) for part in (*solid.values(), *seen.values()) for m in part), default=0
    )
    reach = max(float(np.abs(T_root_link[:3, 3]).max()), abs(lower), abs(upper))
    for what, value, field in (("geometry", extent, "scale"), ("joint", reach, "joint_position_range")):
        if not value <= FARTHEST:
            raise AssetError(
                f"its {what} reaches to {value:.3g}, which nothing on a table does",
                file=folder / "info.json",
                field=field,
                remedy=f"stay within {FARTHEST:g} m or rad: see the scale, the range and the joint's origin",
            )
    if convex:
        hulls = {group: _declared_hulls(meshes_of, folder) for group, meshes_of in solid.items()}
    else:
        hulls = _hulls(solid, Motion(T_root_link, axis, kind == "revolute", lower, upper), warnings)
    if not hulls["moving"]:
        raise AssetError("the moving link has no collision geometry", file=file, field=f"link {joint.child}")
    T_link_object = np.eye(4) if first_collision is None else first_collision.T.copy()
    T_link_object[:3, 3] *= scale
    keypoints = read_keypoints(info, scale, T_link_object, joint.child, kind, axis, hulls["moving"], warnings)
    return Model(
        asset_class=asset_class,
        id=folder.name,
        source="real",
        body=LinkGeometry(hulls["body"], seen["body"]),
        moving=LinkGeometry(hulls["moving"], seen["moving"]),
        joint_name=joint.name,
        joint_type=kind,
        moving_link=joint.child,
        T_root_link=T_root_link,
        axis=axis,
        lower=lower,
        upper=upper,
        keypoints=keypoints,
        T_link_object=T_link_object,
        object_axis=object_axis(info, folder, axis, T_link_object),
        content_hash=content_hash,
        license=declared_license(folder) or LICENSE,
        warnings=tuple(warnings),
    )


def fixed_frames(
    links: dict[str, ET.Element], joints: list[UrdfJoint], movable: UrdfJoint, file: Path
) -> dict[str, dict[str, Array]]:
    """Links by what moves them, each with its unscaled pose: body links in the root, moving ones in the child link."""
    children = {j.child for j in joints}
    roots = [name for name in links if name not in children]
    if len(roots) != 1:
        raise AssetError(f"{len(roots)} root links, one is needed", file=file, field="link")
    frames: dict[str, dict[str, Array]] = {
        "body": {roots[0]: np.eye(4)},
        "moving": {movable.child: np.eye(4)},
    }
    for joint in joints:
        for name in (joint.parent, joint.child):
            if name not in links:
                raise AssetError(f"no link {name!r}", file=file, field=f"joint {joint.name}")
    waiting = [j for j in joints if j is not movable]
    while waiting:
        ready = [j for j in waiting if any(j.parent in members for members in frames.values())]
        if not ready:
            raise AssetError("joints form a loop", file=file, field=f"joint {waiting[0].name}")
        for j in ready:
            for members in frames.values():
                if j.parent in members:
                    members[j.child] = members[j.parent] @ j.T
        waiting = [j for j in waiting if j not in ready]
    if movable.parent not in frames["body"]:
        raise AssetError("the movable joint hangs on itself", file=file, field=f"joint {movable.name}")
    return frames


def _limits(
    folder: Path, info: dict[str, Any], joint: UrdfJoint, scale: float, warnings: list[str]
) -> tuple[float, float]:
    own = joint.limits
    if own is not None and joint.type == "prismatic":
        own = (own[0] * scale, own[1] * scale)
    given = info.get("joint_position_range")
    if given is None:
        if own is None:
            raise AssetError("no limits", file=folder / "mobility.urdf", field=f"joint {joint.name}: limit")
        if own[1] <= own[0]:
            raise AssetError("empty range", file=folder / "mobility.urdf", field=f"joint {joint.name}: limit")
        return own
    try:
        low, high = (float(v) for v in given)
    except (TypeError, ValueError) as error:
        raise AssetError("not two numbers", file=folder / "info.json", field="joint_position_range") from error
    if not (np.isfinite([low, high]).all() and low < high):
        raise AssetError("not an increasing range", file=folder / "info.json", field="joint_position_range")
    if own is not None and (low > own[1] or high < own[0]):
        warnings.append(f"range {low:g}..{high:g} is disjoint from the limits {own[0]:g}..{own[1]:g}: the range holds")
    return low, high
