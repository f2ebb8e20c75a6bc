"""Convert a URDF, MJCF or USD file, or a PartNet-Mobility folder, to an object of a library.

An object of a library has one movable joint, its real size and keypoints. An imported model may lack these. A
PartNet-Mobility model has ``mobility.urdf``, ``textured_objs/``, ``semantics.txt`` and ``meta.json``, many joints, no
keypoints, and a bounding box with a diagonal of 2 units.

The import converts the joints by these rules:

- One joint stays movable. If the user names no joint, this is the only movable joint of the model, or else the only
  joint that has the joint type of the class.
- Every other joint is fixed at zero or, if its range does not include zero, at the limit that is closest to zero.
- If the movable joint is continuous, it gets the range from 0 to 90 degrees.
- If the movable joint rests at its upper limit and opens downwards, it is reversed, so that openness 0 is the resting
  position.

With scale ``auto``, the longest side is as long as in generated objects of the class, or 0.3 m if there are none.

The import proposes two keypoints. The head keypoint is the point that the hand contacts, and the tail keypoint lies at
the opposite end of the moving part:

- The head is the middle of the meshes named "handle". If the model has no such mesh, the head is the middle of one end
  of the moving part. For a revolute joint, this end is the one farthest from the axis. For a prismatic joint, it is the
  end that is in front when the part moves outwards. If the objects of the class are pushed (the class name ends with
  ``_move`` or ``_push``), it is the opposite end.
- For a revolute joint, the tail is the middle of the region that is nearest to the axis. For a prismatic joint, the
  tail is the middle of the end that does not contain the head.
- Head and tail are then moved to the nearest points of the surface.

On the GenSim2 release, the median distance of proposed heads from annotated ones is 12 mm, and 85 % are within 5 cm.

Instead of these proposals, a new object can get the keypoints of another object of its class. Each keypoint is then
placed at the same position relative to the bounding box of its link (:mod:`~gensim2.objects.library.transfer`).

The file ``info.json`` stores the scale, the keypoints and the joint range, and the user can edit these values there.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import reprlib
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any, Literal

import numpy as np

from gensim2.core.arrays import Array
from gensim2.core.errors import InputError
from gensim2.core.foreign.geometry import MAX_URDF
from gensim2.core.foreign.limits import LARGEST_VALUE, LONGEST_TEXT, MAX_OBJECT, MAX_OBJECT_JSON
from gensim2.core.foreign.names import RULE, is_name
from gensim2.objects.generators.classes import object_classes
from gensim2.objects.generators.generate import generate
from gensim2.objects.known import JOINT_TYPES
from gensim2.objects.library import mjcf, usd
from gensim2.objects.library.catalogue import open_library
from gensim2.objects.library.export import MESHES, write_folder
from gensim2.objects.library.folder import ObjectFolder
from gensim2.objects.library.info import UNSTATED, closest_axis, derived_head
from gensim2.objects.library.meshes import MeshReader
from gensim2.objects.library.prepare import EFFORT_LIMIT, VELOCITY_LIMIT, numbers, rpy_from_matrix
from gensim2.objects.library.transfer import RelativeKeypoint, on_surface, relative_keypoints
from gensim2.objects.library.urdf import (
    MOVABLE,
    T_FROM_Y_UP,
    URDF,
    Urdf,
    UrdfJoint,
    fixed_frames,
    parse_urdf,
    shape_elements,
    unit_axis,
)
from gensim2.objects.shapes import Mesh, pose, transform
from gensim2.objects.types import AssetError, MissingFileError, joint_motion

OTHER_SIZE = 0.3  # m, assumed longest side of an object whose class has no generated objects
CONTINUOUS_RANGE = (0.0, math.pi / 2)
PUSHED = ("_move", "_push")  # name endings of classes whose objects are pushed from behind
PREFIX = "articulated_object_"  # prefix of keypoint names
COMPANIONS = ("semantics.txt", "meta.json", "mobility_v2.json", "bounding_box.json")

Up = Literal["y", "z"]


@dataclass(frozen=True)
class Imported:
    """Result of an import.

    Attributes:
        joint: name of the movable joint.
        fixed: names of the joints that were fixed.
        scale: scale of lengths.
        notes: rules that were applied, one sentence each.
    """

    folder: Path
    joint: str
    fixed: tuple[str, ...]
    scale: float
    notes: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return a dictionary for JSON."""
        return {
            "folder": str(self.folder),
            "joint": self.joint,
            "fixed": list(self.fixed),
            "scale": self.scale,
            "notes": list(self.notes),
        }


def import_object(
    source: Path,
    library: Path,
    asset_class: str,
    name: str,
    *,
    joint: str | None = None,
    scale: float | Literal["auto"] = "auto",
    up: Up = "z",
    keypoints: Mapping[str, Sequence[float]] | None = None,
    like: str | None = None,
    license: str = UNSTATED,
    replace: bool = False,
) -> Imported:
    """Write ``library/articulated_objs/<asset_class>/<name>`` from a model in another format.

    Args:
        source: URDF, MJCF or USD file, or a PartNet-Mobility folder, which contains ``mobility.urdf``.
        library: folder of objects; created if missing.
        name: id of the object.
        joint: name of the joint that stays movable.
        scale: length in metres of one unit of the model, or ``"auto"`` (see the rules above).
        up: axis of the root frame that points up. The front of the object faces z if it is y, and -x if it is z. USD
            files state the axis themselves.
        keypoints: positions (3,) by name, in the model's units. A keypoint with ``base`` in its name is in the root
            frame, and other keypoints are in the frame of the moving link. These keypoints replace automatic keypoints.
            The prefix ``articulated_object_`` may be omitted, as in ``head``.
        like: id of an object of the class in ``library``. The new object gets its keypoints.
        license: licence terms of the model.
        replace: replace an existing object, even if the user edited its files.

    Raises:
        InputError: the source cannot be read; the joint is unknown or ambiguous; a name is not a valid folder name; a
            keypoint is not three numbers; the object exists already; or the object ``like`` cannot be loaded.
    """
    for field, word in (("class", asset_class), ("name", name)):
        if not is_name(word):
            raise InputError(f"{reprlib.repr(word)} is not a valid folder name", field=field, remedy=RULE)
    if scale != "auto" and not (math.isfinite(scale) and scale > 0):
        raise InputError(f"must be a positive number, but is {scale}", field="scale")
    if not (license.strip() and license.isprintable() and len(license) <= LONGEST_TEXT):
        remedy = f"1 to {LONGEST_TEXT} printable characters, such as CC BY 4.0"
        raise InputError(f"{reprlib.repr(license)} is not a licence text", field="license", remedy=remedy)
    given = {_full_name(key): _checked(key, value) for key, value in (keypoints or {}).items()}
    shared = None if like is None else relative_keypoints(open_library(library).load_articulated(asset_class, like))
    if up == "y" and source.suffix in usd.SUFFIXES:
        raise InputError("this option does not apply to a USD file", field="up", remedy="set upAxis in the file")
    with as_urdf(source) as (file, is_convex):
        model = _Source(file, asset_class, joint, up)
        size = model.scale() if scale == "auto" else scale
        info = model.info(size, given, shared) | {"license": license}
        if is_convex:
            info["collision"] = "convex"

        def write(folder: Path) -> None:
            model.copy_files(folder)
            ET.indent(model.root)
            ET.ElementTree(model.root).write(folder / URDF, encoding="utf-8", xml_declaration=True)
            (folder / "info.json").write_text(json.dumps(info, indent=2, allow_nan=False) + "\n")

        target = write_folder(library / "articulated_objs" / asset_class / name, write, replace)
    return Imported(target, model.joint.name, tuple(model.fixed), size, tuple(model.notes))


def _full_name(keypoint: str) -> str:
    if keypoint.startswith(PREFIX) or not is_name(keypoint):
        return keypoint
    return PREFIX + keypoint


def _checked(name: str, values: Sequence[float]) -> Array:
    field = f"keypoint {reprlib.repr(name)}"
    if not is_name(name):
        raise InputError("this is not a valid name of a keypoint", field=field, remedy=RULE)
    try:
        found = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        found = np.zeros(0)
    if found.shape != (3,) or not (np.abs(found) <= LARGEST_VALUE).all():
        wrong = f"{reprlib.repr(values)} is not a list of three numbers"
        raise InputError(wrong, field=field, remedy="give x, y and z")
    return found


class _Source:
    """A model in its original units, in which all joints except one are fixed.

    Args:
        source: URDF file, or a folder with ``mobility.urdf``.
        asset_class: class of the object.
        joint: name of the joint that stays movable; None: selected by the rules in the module's docstring.
        up: axis of the root frame that points up.
    """

    def __init__(self, source: Path, asset_class: str, joint: str | None, up: Up) -> None:
        self._is_folder = source.is_dir()
        self.file = source / URDF if self._is_folder else source
        self.folder, self.asset_class = ObjectFolder(self.file.parent), asset_class
        self.notes: list[str] = []
        self.fixed: list[str] = []
        try:
            content = self.folder.read(self.file.name, MAX_URDF)
        except MissingFileError as error:
            raise AssetError(
                error.message, file=error.file, remedy=f"give a URDF file, or a folder with {URDF}"
            ) from error
        written = parse_urdf(content, self.file)
        self.root = _editable(content, self.file)
        if up == "y":
            _turn(self.root, written)
        self.semantics = _semantics(self.folder)
        chosen = self._choose(written.joints, joint)
        by_name = {joint.name: joint for joint in written.joints}
        for element in self.root.findall("joint"):
            each = by_name.get(str(element.get("name")))
            if each is None:
                continue  # This joint is not from the file: it was added to turn the model upright, and it is fixed.
            if each is chosen:
                self._settle(element, each)
            elif each.type != "fixed":
                self._fix(element, each)
        urdf = parse_urdf(ET.tostring(self.root, encoding="utf-8"), self.file)
        self.joint = next(j for j in urdf.joints if j.name == chosen.name)
        self.axis = unit_axis(self.joint, self.file)
        frames = fixed_frames(urdf, self.joint)
        self._T_root_parent = frames["body"][self.joint.parent]
        self._T_root = T_FROM_Y_UP if up == "y" else np.eye(4)
        reader = MeshReader(self.folder)
        self.geometry: dict[str, list[Mesh]] = {"body": [], "moving": []}
        self.handles: list[Mesh] = []
        for group, members in frames.items():
            for name, T in members.items():
                seen, solid = (shape_elements(urdf, name, kind) for kind in ("visual", "collision"))
                for part in seen:
                    looked_at = reader.get(part, 1.0, T)
                    if group == "moving" and "handle" in (part.label or ""):
                        self.handles += looked_at
                for part in solid:
                    self.geometry[group] += reader.get(part, 1.0, T)
        self.notes += reader.warnings()
        self.files = reader.files
        if not self.geometry["moving"]:
            raise AssetError(
                f"the link that the joint {self.joint.name} moves has no collision geometry",
                file=self.file,
                field=f"link {self.joint.child}",
                remedy="; ".join(reader.warnings())
                or "give the link collision elements, or choose another joint with --joint",
            )
        first = shape_elements(urdf, self.joint.child, "collision")
        self._T_link_object = first[0].T if first else np.eye(4)

    def _choose(self, joints: Sequence[UrdfJoint], name: str | None) -> UrdfJoint:
        movable = {j.name: j for j in joints if j.type in MOVABLE}
        listed = "; ".join(f"{j.name} ({', '.join([j.type, *self._meaning(j.child)])})" for j in movable.values())
        if not movable:
            raise AssetError("the file has no movable joint", file=self.file, field="joint")
        if name is not None:
            if name not in movable:
                wrong = f"the file has no movable joint {reprlib.repr(name)}"
                raise AssetError(wrong, file=self.file, field="joint", remedy=f"choose one of {listed}")
            return movable[name]
        known = JOINT_TYPES.get(self.asset_class)
        fitting = [j for j in movable.values() if known in (None, _kind(j))]
        if len(movable) == 1:
            return next(iter(movable.values()))
        if len(fitting) == 1:
            self.notes.append(
                f"{fitting[0].name} stays movable: it is the only {known} joint, the type of {self.asset_class}"
            )
            return fitting[0]
        raise AssetError(
            f"the file has {len(movable)} movable joints, so one of them must be chosen",
            file=self.file,
            field="joint",
            remedy=f"choose one of these joints with --joint: {listed}",
        )

    def _meaning(self, link: str) -> list[str]:
        return [self.semantics[link]] if link in self.semantics else []

    def _fix(self, element: ET.Element, joint: UrdfJoint) -> None:
        field = f"joint {joint.name}"
        if joint.type not in MOVABLE:
            raise AssetError(f"unsupported type {reprlib.repr(joint.type)}", file=self.file, field=f"{field}: type")
        value = 0.0
        if joint.type != "continuous" and joint.limits is not None:
            value = min(max(0.0, min(joint.limits)), max(joint.limits))
        axis = joint.axis / max(float(np.linalg.norm(joint.axis)), 1e-12)
        motion = pose(value * axis) if joint.type == "prismatic" else pose(axis=axis, angle=value)
        _replace(element, "origin", _origin(joint.T @ motion))
        for tag in ("axis", "limit", "dynamics", "mimic", "calibration", "safety_controller"):
            for child in element.findall(tag):
                element.remove(child)
        element.set("type", "fixed")
        self.fixed.append(joint.name)

    def _settle(self, element: ET.Element, joint: UrdfJoint) -> None:
        """Add missing limits of the movable joint, and reverse the joint if it opens downwards."""
        limits = joint.limits
        if joint.type == "continuous":
            element.set("type", "revolute")
            limits = CONTINUOUS_RANGE
            self.notes.append(f"{joint.name} is continuous: its range is 0 to 90 degrees")
        if joint.mimics is not None:
            self.notes.append(f"{joint.name} no longer follows {joint.mimics}, which is fixed")
            for mimic in element.findall("mimic"):
                element.remove(mimic)
        if limits is None:
            raise AssetError("no limits", file=self.file, field=f"joint {joint.name}: limit")
        lower, upper = limits
        if not lower < upper:
            raise AssetError("empty range", file=self.file, field=f"joint {joint.name}: limit")
        if lower < 0 and upper <= 1e-6:
            lower, upper = -upper + 0.0, -lower
            _replace(element, "axis", ET.Element("axis", xyz=numbers(-joint.axis)))
            self.notes.append(f"{joint.name} rests at its upper limit: its axis is reversed")
        limit = ET.Element(
            "limit",
            lower=f"{lower:.9g}",
            upper=f"{upper:.9g}",
            effort=f"{EFFORT_LIMIT:g}",
            velocity=f"{VELOCITY_LIMIT:g}",
        )
        _replace(element, "limit", limit)

    def copy_files(self, target: Path) -> None:
        """Copy meshes, materials, pictures and metadata; a missing mesh is reported when the object is loaded."""
        (target / MESHES).mkdir(exist_ok=True)
        beside = (*self.folder.names("images"), *COMPANIONS) if self._is_folder else ()
        for name in (*self.files, *beside):
            if self.folder.has(name):
                copy = target / os.path.normpath(name)
                copy.parent.mkdir(parents=True, exist_ok=True)
                copy.write_bytes(self.folder.read(name, MAX_OBJECT))

    def scale(self) -> float:
        """Return the scale factor that gives the closed object the typical length of generated objects of its class."""
        T = self._T_root_parent @ self.joint.T
        body = [m.vertices for m in self.geometry["body"]]
        points = np.concatenate([*body, *(transform(T, m.vertices) for m in self.geometry["moving"])])
        longest = float(np.ptp(points, axis=0).max())
        if not longest > 0:
            raise AssetError("no extent", file=self.file)
        wanted = usual_size(self.asset_class)
        self.notes.append(f"scaled so that its longest side is {wanted:.2g} m")
        return float(f"{wanted / longest:.4g}")

    def info(
        self, scale: float, given: Mapping[str, Array], shared: Mapping[str, RelativeKeypoint] | None = None
    ) -> dict[str, Any]:
        """Return the fields of ``info.json``. Missing keypoints come from ``shared`` or from the geometry."""
        T_object_link = np.asarray(np.linalg.inv(self._T_link_object), float)
        points, texts = self._proposed() if shared is None else self._transferred(shared, scale)
        written = {
            name: point if "base" in name else transform(T_object_link, point[None])[0]
            for name, point in {**points, **given}.items()
        }
        written |= {name: self._T_root @ [*point, 1.0] for name, point in given.items() if "base" in name}
        lower, upper = self.joint.limits or (0.0, 0.0)
        length = scale if self.joint.type == "prismatic" else 1.0
        return {
            "keypoints": {name: point[:3].round(9).tolist() for name, point in written.items()},
            "keypoint_descriptions": {name: text for name, text in texts.items() if name not in given},
            "scale": scale,
            "axis": closest_axis(self.axis, self._T_link_object),
            "joint_position_range": [lower * length + 0.0, upper * length + 0.0],
            "imported": {"joint": self.joint.name, "fixed": self.fixed, "notes": self.notes},
        }

    def _transferred(
        self, shared: Mapping[str, RelativeKeypoint], scale: float
    ) -> tuple[dict[str, Array], dict[str, str]]:
        """Return keypoints relative to the boxes of their links.

        Keypoints of the moving link are in its frame, others in the root frame.
        """
        lower = (self.joint.limits or (0.0, 0.0))[0]
        T_root_moving = self._T_root_parent @ self.joint.T @ joint_motion(_kind(self.joint), self.axis, lower)
        places = {True: (self.geometry["moving"], T_root_moving), False: (self.geometry["body"], np.eye(4))}
        for name, each in shared.items():
            if not places[each.is_moving][0]:
                message = f"the link of the keypoint {name} has no collision geometry"
                raise AssetError(message, file=self.file, remedy="import the object without --like")
        points = {name: each.on(*places[each.is_moving], scale) for name, each in shared.items()}
        return points, {name: each.description for name, each in shared.items()}

    def _proposed(self) -> tuple[dict[str, Array], dict[str, str]]:
        """Return positions and descriptions of the automatic keypoints, in the frame of the moving link."""
        joint = self.joint
        axis = self.axis
        vertices = [m.vertices for m in self.geometry["moving"]]
        what = " ".join(self._meaning(joint.child)).replace("_", " ") or joint.child
        if joint.type == "revolute":
            head, head_text = (
                derived_head(vertices, joint.type, axis),
                f"the edge of the {what} farthest from its hinge",
            )
            tail, tail_text = _near_axis(np.concatenate(vertices), axis), f"the middle of the {what} at its hinge"
        else:
            way = -axis if self.asset_class.endswith(PUSHED) else axis
            ends = (f"the end of the {what} that leads the motion", f"the end of the {what} that trails the motion")
            head_text, tail_text = ends if way is axis else ends[::-1]
            head, tail = (derived_head(vertices, joint.type, sign * way) for sign in (1, -1))
        if self.handles:
            corners = np.concatenate([m.vertices for m in self.handles])
            head, head_text = (corners.min(axis=0) + corners.max(axis=0)) / 2, f"the middle of the handle of the {what}"
        surface = self.handles or self.geometry["moving"]
        points = {
            "articulated_object_head": on_surface(head, surface),
            "articulated_object_tail": on_surface(tail, self.geometry["moving"]),
        }
        return points, {"articulated_object_head": head_text, "articulated_object_tail": tail_text}


def _editable(content: bytes, file: Path) -> ET.Element:
    """Parse a URDF and drop its default namespace."""
    try:
        root = ET.XML(content)
    except (ET.ParseError, ValueError, LookupError) as error:
        raise AssetError(f"not XML: {error}", file=file) from error
    for element in root.iter():
        element.tag = element.tag.removeprefix(root.tag.removesuffix("robot"))
    return root


def _turn(root: ET.Element, written: Urdf) -> None:
    """Attach a model whose y axis points up to a new root link whose z axis points up."""
    names = {str(each.get("name")) for each in root.iter() if each.get("name") is not None}
    link, joint = (next(name for name in (base, f"{base}_of_import") if name not in names) for base in ("up", "turn"))
    hanging = {each.child for each in written.joints}
    first = next(name for name in written.links if name not in hanging)
    element = ET.Element("joint", name=joint, type="fixed")
    element.extend([ET.Element("parent", link=link), ET.Element("child", link=first), _origin(T_FROM_Y_UP)])
    root.insert(0, ET.Element("link", name=link))
    root.append(element)


def _kind(joint: UrdfJoint) -> str:
    return "prismatic" if joint.type == "prismatic" else "revolute"


def _origin(T: Array) -> ET.Element:
    return ET.Element("origin", xyz=numbers(T[:3, 3]), rpy=numbers(rpy_from_matrix(T[:3, :3])))


def _replace(element: ET.Element, tag: str, new: ET.Element) -> None:
    for child in element.findall(tag):
        element.remove(child)
    element.append(new)


def _near_axis(points: Array, axis: Array) -> Array:
    """Return the centre (3,) of the bounding box of the points that lie nearest to an axis.

    The distances of all points from the axis span a range. The points in the lowest 5 % of this range count as nearest.

    Args:
        points: (N, 3) points.
        axis: (3,) unit vector of an axis through the origin.
    """
    distance = np.linalg.norm(points - np.outer(points @ axis, axis), axis=1)
    near = points[distance <= distance.min() + 0.05 * max(float(np.ptp(distance)), 1e-6)]
    return np.asarray((near.min(axis=0) + near.max(axis=0)) / 2)


def usual_size(asset_class: str) -> float:
    """Return the usual longest side (m) of a class.

    The size is the median over three closed generated objects, or ``OTHER_SIZE``.
    """
    if asset_class not in object_classes():
        return OTHER_SIZE
    sides = []
    for number in range(3):
        model = generate(asset_class, number)
        T = model.T_root_link_at(model.lower)
        points = np.concatenate([*model.body.hulls, *(transform(T, hull) for hull in model.moving.hulls)])
        sides.append(float(np.ptp(points, axis=0).max()))
    return median(sides)


def _semantics(folder: ObjectFolder) -> dict[str, str]:
    """Return the names of parts by link from ``semantics.txt``.

    The line ``link_0 hinge rotation_lid`` gives ``rotation_lid`` for ``link_0``.
    """
    try:
        text = folder.read("semantics.txt", MAX_OBJECT_JSON).decode(errors="replace")
    except MissingFileError:
        return {}
    lines = (line.split() for line in text.splitlines())
    return {words[0]: words[2] for words in lines if len(words) == 3}


@contextlib.contextmanager
def as_urdf(source: Path) -> Iterator[tuple[Path, bool]]:
    """Convert an MJCF or USD file to a temporary URDF during the block; yield any other ``source`` itself.

    Yields:
        The URDF file, and whether all collision shapes are known to be convex.

    Raises:
        InputError: the file cannot be imported; errors of the block about the temporary file name ``source``.
        MissingExtraError: the format's reader is not installed.
    """
    if source.suffix not in (*mjcf.SUFFIXES, *usd.SUFFIXES) or source.is_dir():
        yield source, False
        return
    with tempfile.TemporaryDirectory() as scratch:
        try:
            if source.suffix in mjcf.SUFFIXES:
                yield mjcf.convert(source, Path(scratch)), True
            else:
                yield usd.convert(source, Path(scratch))
        except AssetError as error:
            if error.file is None or Path(scratch) not in Path(error.file).parents:
                raise
            raise AssetError(error.message, file=source, field=error.field, remedy=error.remedy) from error
