"""Read a USD file with ``usd-core``, and write a URDF file with meshes, in the process of one untrusted object.

This module first copies the source folder's USD files with a size limit; the library opens only copies. The rules:

- Each prim with ``PhysicsRigidBodyAPI`` becomes a link. Prims outside all rigid bodies form the static part of the
  scene. If a joint names a prim of the static part, the static part becomes the root link. The scene must have exactly
  one group of connected links with a revolute or prismatic joint. This group becomes the object.
- Prims with ``PhysicsCollisionAPI`` become collision shapes, and so do the prims below them in the same link. Visible
  prims with the purpose ``default`` or ``render`` become visual shapes. If a link has only collision shapes, its
  collision shapes also serve as visual shapes. If a link has only visual shapes, its visual shapes also serve as
  collision shapes.
- Lengths are converted to metres with ``metersPerUnit``, and masses to kilograms with ``kilogramsPerUnit``. If
  ``upAxis`` is y, the model is rotated so that z points up, as with the option ``--up y``. In the file, the front of
  such a model must face the z direction.
- Colours come from ``UsdPreviewSurface`` or ``displayColor``. The conversion ignores textures, drives, contact
  materials and animation.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdPhysics, UsdShade

from gensim2.core.foreign.archive import DAMAGED, open_zip
from gensim2.core.foreign.library import read_by_library
from gensim2.core.foreign.limits import (
    LARGEST_VALUE,
    MAX_OBJECT,
    MAX_OBJECT_FILES,
    MAX_TRIANGLES,
    MAX_USD_LAYERS,
    MAX_USD_PRIMS,
)
from gensim2.core.foreign.tree import megabytes, open_regular
from gensim2.objects.library.folder import ObjectFolder
from gensim2.objects.library.urdf import T_FROM_Y_UP
from gensim2.objects.library.urdf_writer import UrdfWriter
from gensim2.objects.physics import Inertial, inertial
from gensim2.objects.shapes import Look, Mesh, hull_mesh, pose
from gensim2.objects.types import Array, AssetError

LAYERS = (".usd", ".usda", ".usdc")
AXES: Mapping[str, Array] = {"X": np.eye(3)[0], "Y": np.eye(3)[1], "Z": np.eye(3)[2]}
SHAPES = ("Cube", "Sphere", "Cylinder", "Capsule", "Cone", "Mesh")
"""Types of prims that can be imported."""
SHEAR = 1e-4
"""Maximum relative deviation of the scales of two axes that count as equal, and of perpendicular axes."""


def read(source: Path, scratch: Path) -> tuple[Path, bool]:
    """Convert a file as :func:`gensim2.objects.library.usd.convert` does."""
    copies = scratch / "usd"
    copies.mkdir()
    return _Converter(source, _Copier(source, copies).open(), scratch).write()


class _Copier:
    """Copies a USD file and the files to which it refers, after checking that they lie in its folder."""

    def __init__(self, source: Path, copies: Path) -> None:
        self._file, self._copies = source, copies
        self._tree, self._size = ObjectFolder(source.parent), 0
        self._done: set[str] = set()

    def open(self) -> Any:
        """Return the stage of the copied files."""
        root = self._file.name
        if self._file.suffix == ".usdz":
            root = self._unpack()
        self._copy(root)
        with read_by_library(self._file, "correct the USD file", "the USD stage cannot be composed"):
            stage = Usd.Stage.Open(str(self._copies / root))
            errors = stage.GetCompositionErrors()
        if errors:
            raise AssetError(f"the USD stage cannot be composed: {str(errors[0])[:300]}", file=self._file)
        return stage

    def _unpack(self) -> str:
        """Unpack a usdz package into a folder, and return the name of its first layer."""
        unpacked = self._copies.parent / "package"
        unpacked.mkdir()
        try:
            with open_regular(self._file) as stream, open_zip(stream, MAX_OBJECT_FILES) as archive:
                members = archive.infolist()
                if sum(member.file_size for member in members) > MAX_OBJECT:
                    raise AssetError(f"holds over {megabytes(MAX_OBJECT)}", file=self._file)
                for member in members:
                    path = unpacked / _plain(member.filename, self._file)
                    path.parent.mkdir(parents=True, exist_ok=True)
                    if not member.is_dir():
                        with archive.open(member) as content:
                            path.write_bytes(content.read(member.file_size))
        except DAMAGED as error:
            raise AssetError(f"is not a usdz package: {error}", file=self._file) from error
        if not members or PurePosixPath(members[0].filename).suffix not in LAYERS:
            raise AssetError("the first file in the package must be a USD file", file=self._file)
        self._tree = ObjectFolder(unpacked)
        return members[0].filename

    def _copy(self, root: str) -> None:
        waiting = [root]
        while waiting:
            name = waiting.pop()
            if name in self._done:
                continue
            if len(self._done) >= MAX_USD_LAYERS:
                raise AssetError(f"refers to over {MAX_USD_LAYERS} files", file=self._file)
            self._done.add(name)
            content = self._tree.read(name, MAX_OBJECT)
            self._size += len(content)
            if self._size > MAX_OBJECT:
                wrong = f"the file and the files that it refers to are larger than {megabytes(MAX_OBJECT)} in total"
                raise AssetError(wrong, file=self._file)
            copy = self._copies / name
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_bytes(content)
            with read_by_library(self._file, "correct the USD file", f"USD cannot read {name[:80]}"):
                layer = Sdf.Layer.FindOrOpen(str(copy))
                if layer is None:
                    raise ValueError("the file is not a USD file")
                # an empty path stands for the file itself
                found = [str(each) for each in layer.GetCompositionAssetDependencies() if each]
            for each in found:
                beside = os.path.normpath(PurePosixPath(name).parent / _plain(each, self._file))
                if PurePosixPath(beside).suffix not in LAYERS:
                    remedy = f"refer to {', '.join(LAYERS)}"
                    raise AssetError("is not a USD file", file=self._file, field=each[:80], remedy=remedy)
                waiting.append(beside)


def _plain(name: str, file: Path) -> str:
    """Return the relative path of a referenced file; refuse URLs, absolute paths, expressions, packages, arguments."""
    if not name or name.startswith("/") or any(sign in name for sign in ":`[]\\\0") or not name.isprintable():
        remedy = "refer to a file by a relative path, and copy the file into the folder"
        raise AssetError("the reference is not a relative path", file=file, field=repr(name[:80]), remedy=remedy)
    if os.path.normpath(name).startswith("..") and file.suffix == ".usdz":
        raise AssetError("lies outside the package", file=file, field=repr(name[:80]))
    return name


@dataclass
class _Joint:
    """A joint of the scene.

    Attributes:
        name: name of the prim.
        kind: ``revolute``, ``continuous``, ``prismatic`` or ``fixed``.
        bodies: paths of the two links; ``""`` is the static part of the scene.
        frames: pose (4, 4) of the joint frame in each of the two links, as posed in the file.
        axis: (3,) joint axis in the joint frame, along or about which positive values move the second link.
        limits: rad or m; None for a continuous or fixed joint.
    """

    name: str
    kind: str
    bodies: tuple[str, str]
    frames: tuple[Array, Array]
    axis: Array
    limits: tuple[float, float] | None


@dataclass
class _Link:
    """A link: its prim, its pose (4, 4) without scale, and its visual and collision prims."""

    prim: Any
    T: Array
    seen: list[Any] = field(default_factory=list)
    solid: list[Any] = field(default_factory=list)


STATIC = ""
"""Path that stands for the static part of the scene."""


class _Converter:
    def __init__(self, source: Path, stage: Any, scratch: Path) -> None:
        self._file, self._stage, self._urdf = source, stage, UrdfWriter(scratch)
        self._poses, self._looks = UsdGeom.XformCache(), dict[str, Look]()
        self._metres = self._positive(UsdGeom.GetStageMetersPerUnit(stage), "metersPerUnit")
        self._kilograms = self._positive(UsdPhysics.GetStageKilogramsPerUnit(stage), "kilogramsPerUnit")
        y_up = UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.y
        self._upright = T_FROM_Y_UP if y_up else np.eye(4)
        self._links: dict[str, _Link] = {}
        self._anchors: set[str] = set()
        self._triangles = 0
        self._is_convex = True

    def write(self) -> tuple[Path, bool]:
        prims = list(itertools.islice(self._traversed(), MAX_USD_PRIMS + 1))
        if len(prims) > MAX_USD_PRIMS:
            raise AssetError(f"has over {MAX_USD_PRIMS} prims", file=self._file)
        for prim in prims:
            if prim.HasAPI(UsdPhysics.RigidBodyAPI) and _flag(UsdPhysics.RigidBodyAPI(prim).GetRigidBodyEnabledAttr()):
                self._links[str(prim.GetPath())] = _Link(prim, self._pose(prim))
        self._links[STATIC] = _Link(self._stage.GetPseudoRoot(), self._upright)
        joints = [joint for prim in prims if (joint := self._joint(prim)) is not None]
        members = self._members(joints)
        if self._anchors:
            self._links[STATIC].T = self._pose(self._stage.GetPrimAtPath(min(self._anchors)))
        for prim in prims:
            if prim.IsA(UsdGeom.Gprim) or prim.IsA(UsdGeom.PointInstancer):
                self._sort_in(prim, members)
        self._add_links(joints, members)
        return self._urdf.write(), self._is_convex

    def _traversed(self) -> Iterator[Any]:
        yield from Usd.PrimRange.Stage(self._stage, Usd.TraverseInstanceProxies())

    def _body(self, prim: Any) -> str:
        """Return the path of the link that a prim belongs to."""
        while prim and not prim.IsPseudoRoot():
            if str(prim.GetPath()) in self._links:
                return str(prim.GetPath())
            prim = prim.GetParent()
        return STATIC

    def _pose(self, prim: Any) -> Array:
        """Return the pose (4, 4) of a prim in a world with metres and z up, without its scale."""
        return _unscaled(self._matrix(prim))

    def _matrix(self, prim: Any) -> Array:
        """Return the transform (4, 4) of a prim's points to a world with metres and z up."""
        found = np.array(self._poses.GetLocalToWorldTransform(prim), float).T
        if not np.isfinite(found).all() or np.abs(found).max() > LARGEST_VALUE:
            raise self._error("has no finite transform", prim)
        length = np.diag([self._metres, self._metres, self._metres, 1.0])
        return np.asarray(self._upright @ length @ found)

    def _joint(self, prim: Any) -> _Joint | None:
        if not prim.IsA(UsdPhysics.Joint):
            return None
        joint = UsdPhysics.Joint(prim)
        if not _flag(joint.GetJointEnabledAttr()):
            return None
        targets = []
        for relation in (joint.GetBody0Rel(), joint.GetBody1Rel()):
            paths = relation.GetTargets()
            target = self._stage.GetPrimAtPath(paths[0]) if paths else self._stage.GetPseudoRoot()
            if len(paths) > 1 or not target:
                raise self._error("must name one existing prim", prim, relation.GetName())
            targets.append(target)
        one, other = (self._body(target) for target in targets)
        if one == other:
            return None
        anchors = [str(each.GetPath()) for each, body in zip(targets, (one, other), strict=True) if body == STATIC]
        kind, axis, limits = self._motion(prim)
        if kind == "fixed" and "/" in anchors:
            # this joint only fixes the root link in the world, where gensim2 fixes it anyway
            return None
        self._anchors |= set(anchors) - {"/"}
        frames = (
            self._joint_frame(prim, targets[0], joint.GetLocalPos0Attr(), joint.GetLocalRot0Attr()),
            self._joint_frame(prim, targets[1], joint.GetLocalPos1Attr(), joint.GetLocalRot1Attr()),
        )
        return _Joint(str(prim.GetPath()), kind, (one, other), frames, axis, limits)

    def _joint_frame(self, joint: Any, target: Any, position: Any, rotation: Any) -> Array:
        """Return the pose (4, 4) in the world of a joint frame that the file gives relative to ``target``."""
        matrix = self._matrix(target)
        T = _unscaled(matrix)
        T[:3, 3] = (matrix @ [*position.Get(), 1.0])[:3]
        T[:3, :3] = T[:3, :3] @ self._rotation(rotation.Get(), joint)
        return self._finite(T, joint)

    def _motion(self, prim: Any) -> tuple[str, Array, tuple[float, float] | None]:
        """Return kind, axis and limits of a joint."""
        if prim.IsA(UsdPhysics.FixedJoint):
            return "fixed", AXES["X"], None
        turns = prim.IsA(UsdPhysics.RevoluteJoint)
        if not turns and not prim.IsA(UsdPhysics.PrismaticJoint):
            remedy = "an object has revolute, prismatic and fixed joints; disable other joints"
            raise self._error(f"is a {prim.GetTypeName()}", prim, remedy=remedy)
        joint = UsdPhysics.RevoluteJoint(prim) if turns else UsdPhysics.PrismaticJoint(prim)
        axis = AXES.get(str(joint.GetAxisAttr().Get()))
        if axis is None:
            raise self._error("must be X, Y or Z", prim, "physics:axis")
        unit = np.pi / 180 if turns else self._metres
        lower, upper = (unit * float(each.Get()) for each in (joint.GetLowerLimitAttr(), joint.GetUpperLimitAttr()))
        if np.isnan([lower, upper]).any():
            raise self._error("is not a number", prim, "physics:lowerLimit, physics:upperLimit")
        if lower >= upper:  # the USD specification defines such a joint as locked
            return "fixed", axis, None
        if not np.isfinite([lower, upper]).all():
            return ("continuous" if turns else "prismatic"), axis, None
        return ("revolute" if turns else "prismatic"), axis, (lower, upper)

    def _members(self, joints: list[_Joint]) -> set[str]:
        """Return the links of the group that contains the moving joints."""
        group = {link: link for link in self._links}

        def top(link: str) -> str:
            while group[link] != link:
                link = group[link]
            return link

        for joint in joints:
            group[top(joint.bodies[0])] = top(joint.bodies[1])
        found = {top(joint.bodies[0]) for joint in joints if joint.kind != "fixed"}
        if len(found) != 1:
            remedy = "leave one object in the file, and join its static parts and moving parts to one body"
            wrong = f"the file must contain exactly one object with moving joints, but contains {len(found)}"
            raise AssetError(wrong, file=self._file, remedy=remedy)
        (chosen,) = found
        return {link for link in self._links if top(link) == chosen}

    def _sort_in(self, prim: Any, members: set[str]) -> None:
        """Add a visible shape to the visuals of its link, and a colliding shape to the collisions. Skip other links."""
        body = self._body(prim)
        if body not in members or (body == STATIC and not self._is_anchored(prim)):
            return
        solid = self._collides(prim, body)
        image = UsdGeom.Imageable(prim)
        seen = (
            image.ComputePurpose() in (UsdGeom.Tokens.default_, UsdGeom.Tokens.render)
            and image.ComputeVisibility() != UsdGeom.Tokens.invisible
        )
        if not (seen or solid):
            return
        if str(prim.GetTypeName()) not in SHAPES:
            raise self._error("has a type that cannot be imported", prim, remedy=f"use {', '.join(SHAPES)}")
        link = self._links[body]
        if seen:
            link.seen.append(prim)
        if solid:
            link.solid.append(prim)

    def _is_anchored(self, prim: Any) -> bool:
        path = prim.GetPath()
        return any(path.HasPrefix(anchor) for anchor in self._anchors)

    def _collides(self, prim: Any, body: str) -> bool:
        """Return whether a shape, or a prim between it and its link, is a collision shape."""
        while prim and not prim.IsPseudoRoot():
            if prim.HasAPI(UsdPhysics.CollisionAPI):
                return _flag(UsdPhysics.CollisionAPI(prim).GetCollisionEnabledAttr())
            if str(prim.GetPath()) == body:
                return False
            prim = prim.GetParent()
        return False

    def _add_links(self, joints: list[_Joint], members: set[str]) -> None:
        """Write the links, from the root outwards. The frame of a link is the frame of the joint to its parent link."""
        joints = [joint for joint in joints if joint.bodies[0] in members]
        root = self._root(joints, members)
        T_root = np.eye(4)
        T_root[:3, 3] = self._links[root].T[:3, 3]
        names = {root: self._urdf.name(self._links[root].prim.GetName() if root else "base", "link")}
        self._fill(self._urdf.link(names[root]), self._links[root], T_root)
        frames, waiting, rest = {root: T_root}, [root], joints
        while waiting:
            parent = waiting.pop(0)
            here = [joint for joint in rest if parent in joint.bodies]
            rest = [joint for joint in rest if parent not in joint.bodies]
            for joint in here:
                above = joint.bodies.index(parent)
                child = joint.bodies[1 - above]
                if child in frames:
                    raise AssetError("the joint closes a loop of joints", file=self._file, field=joint.name[:80])
                frames[child] = joint.frames[1 - above]
                names[child] = self._urdf.name(child, "link")
                T = np.linalg.inv(frames[parent]) @ joint.frames[above]
                element = self._urdf.join(
                    joint.kind, self._urdf.name(joint.name, "joint"), names[parent], names[child], T
                )
                if joint.kind != "fixed":
                    limits = joint.limits
                    # If the joint's first body is the child link, the joint values change their sign.
                    if above == 1 and limits is not None:
                        limits = -limits[1], -limits[0]
                    self._urdf.move(element, joint.axis, limits)
                self._fill(self._urdf.link(names[child]), self._links[child], frames[child])
                waiting.append(child)

    def _root(self, joints: list[_Joint], members: set[str]) -> str:
        """Return the root link: the static part if in ``members``, else the articulation root or one without parent."""
        if STATIC in members:
            return STATIC
        for link in self._links:
            if link in members and self._links[link].prim.HasAPI(UsdPhysics.ArticulationRootAPI):
                return link
        below = {joint.bodies[1] for joint in joints}
        return next((link for link in self._links if link in members - below), min(members))

    def _fill(self, element: Any, link: _Link, T_link: Array) -> None:
        """Write the shapes and the inertia of a link whose frame is ``T_link`` (4, 4) in the world."""
        T_from_world: Array = np.asarray(np.linalg.inv(T_link), dtype=np.float64)
        hulls: list[Array] = []
        for kind, prims in (("visual", link.seen or link.solid), ("collision", link.solid or link.seen)):
            for prim in prims:
                hulls += self._add_shape(element, kind, prim, T_from_world)
        found = self._inertial(link, T_from_world, hulls)
        if found is not None:
            T = pose(found.center)
            self._urdf.weigh(element, found.mass, T, found.inertia)

    def _add_shape(self, element: Any, kind: str, prim: Any, T_from_world: Array) -> list[Array]:
        """Write a shape.

        Return a list with the points (N, 3) of a collision shape, link frame; empty for visual shapes.
        """
        matrix, look = T_from_world @ self._matrix(prim), self._look(prim)
        solid = kind == "collision"
        primitive = self._primitive(prim, matrix)
        points, faces = self._triangles_of(prim)
        points = points @ matrix[:3, :3].T + matrix[:3, 3]
        if np.linalg.det(matrix[:3, :3]) < 0:
            faces = faces[:, ::-1]
        if primitive is not None:
            self._urdf.add_primitive(element, kind, *primitive, look.rgba)
        else:
            with read_by_library(self._file, "correct the mesh", f"{str(prim.GetPath())[:80]} has no volume"):
                mesh = Mesh(points, faces, look)
                if solid and self._is_hull(prim):
                    mesh = hull_mesh(points, look)
                elif solid:
                    self._is_convex = False
            self._urdf.add_mesh(element, kind, np.eye(4), mesh)
        return [points] if solid else []

    def _primitive(self, prim: Any, matrix: Array) -> tuple[Array, str, Array] | None:
        """Return pose, kind and size of a shape that is a URDF primitive.

        Return None for other shapes and for sheared primitives.
        """
        kind = str(prim.GetTypeName())
        if kind not in ("Cube", "Sphere", "Cylinder", "Capsule"):
            return None
        scale = np.linalg.norm(matrix[:3, :3], axis=0)
        unit = matrix[:3, :3] / scale.clip(min=1e-12)
        if np.abs(unit.T @ unit - np.eye(3)).max() > SHEAR:
            return None
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = unit, matrix[:3, 3]
        if np.linalg.det(unit) < 0:
            T[:3, 2] *= -1.0  # a mirrored cube, sphere, cylinder or capsule has the same shape as the original
        if kind == "Cube":
            return T, "box", scale * self._positive_of(prim, "size")
        if kind == "Sphere":
            return (
                (T, "sphere", scale[:1] * self._positive_of(prim, "radius"))
                if np.ptp(scale) < SHEAR * scale[0]
                else None
            )
        long = self._axis(prim)
        # rotation that turns the URDF's z axis to the shape's axis of symmetry
        turned = np.roll(np.eye(3), 2 - long, axis=1)
        T[:3, :3] = T[:3, :3] @ turned
        across = np.delete(scale, long)
        if np.ptp(across) > SHEAR * across[0] or (kind == "Capsule" and np.ptp(scale) > SHEAR * scale[0]):
            return None
        size = [across[0] * self._positive_of(prim, "radius"), scale[long] * self._positive_of(prim, "height")]
        return T, kind.lower(), np.array(size)

    def _axis(self, prim: Any) -> int:
        axis = str(prim.GetAttribute("axis").Get())
        if axis not in AXES:
            raise self._error("must be X, Y or Z", prim, "axis")
        return list(AXES).index(axis)

    def _is_hull(self, prim: Any) -> bool:
        """Return whether the prim's collision shape is convex: no mesh, or a mesh with convex approximation."""
        if str(prim.GetTypeName()) != "Mesh":
            return True
        chosen = UsdPhysics.MeshCollisionAPI(prim).GetApproximationAttr().Get()
        return chosen in (
            UsdPhysics.Tokens.convexHull,
            UsdPhysics.Tokens.boundingCube,
            UsdPhysics.Tokens.boundingSphere,
        )

    def _triangles_of(self, prim: Any) -> tuple[Array, Any]:
        """Return vertices (V, 3) and triangles (F, 3) of a shape in its own frame."""
        from trimesh import creation

        kind = str(prim.GetTypeName())
        if kind == "Mesh":
            return self._mesh(prim)
        if kind == "Cube":
            mesh = creation.box(np.full(3, self._positive_of(prim, "size")))
            return np.asarray(mesh.vertices), np.asarray(mesh.faces, np.int64)
        radius = self._positive_of(prim, "radius")
        if kind == "Sphere":
            mesh = creation.icosphere(3, radius)
            return np.asarray(mesh.vertices), np.asarray(mesh.faces, np.int64)
        height = self._positive_of(prim, "height")
        if kind == "Cylinder":
            mesh = creation.cylinder(radius, height)
        elif kind == "Capsule":
            mesh = creation.capsule(radius=radius, height=height, count=(16, 16))
        else:
            mesh = creation.cone(radius, height)
            mesh.vertices -= [0.0, 0.0, height / 2]
        turned = np.roll(np.eye(3), 2 - self._axis(prim), axis=1)
        return np.asarray(mesh.vertices) @ turned.T, np.asarray(mesh.faces, np.int64)

    def _mesh(self, prim: Any) -> tuple[Array, Any]:
        mesh = UsdGeom.Mesh(prim)
        names = ("points", "faceVertexCounts", "faceVertexIndices", "holeIndices")
        points, counts, indices, holes = (np.asarray(prim.GetAttribute(name).Get() or ()) for name in names)
        self._triangles += int(np.maximum(counts - 2, 0).sum()) if counts.size else 0
        if self._triangles > MAX_TRIANGLES:
            raise AssetError(f"has over {MAX_TRIANGLES} triangles", file=self._file)
        if points.size == 0 or not np.isfinite(points).all() or np.abs(points).max() > LARGEST_VALUE:
            raise self._error(f"must have points below {LARGEST_VALUE:g}", prim, "points")
        valid = counts.size and counts.min() >= 3 and counts.sum() == indices.size
        if not valid or indices.min() < 0 or indices.max() >= len(points):
            raise self._error("must index the points by faces of three or more corners", prim, "faceVertexIndices")
        starts, kept = np.cumsum(counts) - counts, np.ones(len(counts), bool)
        if holes.size:
            kept[holes[(holes >= 0) & (holes < len(counts))]] = False
        faces = []
        for corner in range(1, int(counts.max()) - 1):
            own = starts[kept & (counts > corner + 1)]
            faces.append(np.stack([indices[own], indices[own + corner], indices[own + corner + 1]], axis=1))
        found = np.concatenate(faces).astype(np.int64)
        if mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded:
            found = found[:, ::-1]
        return points.astype(float), found

    def _inertial(self, link: _Link, T_from_world: Array, hulls: list[Array]) -> Inertial | None:
        """Return the inertia of a link.

        Values that the file lacks come from the hulls. Return None without mass and density.
        """
        prim = link.prim
        if not prim.HasAPI(UsdPhysics.MassAPI):
            return None
        mass_of = UsdPhysics.MassAPI(prim)
        mass, density = (float(each.Get()) for each in (mass_of.GetMassAttr(), mass_of.GetDensityAttr()))
        if not (0 <= mass * self._kilograms <= LARGEST_VALUE and 0 <= density <= LARGEST_VALUE / self._kilograms):
            raise self._error("is out of range", prim, "physics:mass, physics:density")
        if mass == 0 and density == 0:
            return None
        with read_by_library(
            self._file, "correct the collision shapes", f"link {str(prim.GetPath())[:80]} has no volume"
        ):
            even = inertial(hulls, 1.0)
        mass *= self._kilograms
        if mass == 0:
            mass = even.mass * density * self._kilograms / self._metres**3
        center, inertia = even.center, even.inertia * mass / even.mass
        T = T_from_world @ self._pose(prim)
        authored = np.array(mass_of.GetCenterOfMassAttr().Get(), float)
        # by default this attribute is not finite, which means that the centre of mass is computed from the shapes
        if np.isfinite(authored).all():
            center = (T_from_world @ self._matrix(prim) @ [*authored, 1.0])[:3]
        diagonal = np.array(mass_of.GetDiagonalInertiaAttr().Get(), float) * self._kilograms * self._metres**2
        if diagonal.any():
            axes = T[:3, :3] @ self._rotation(mass_of.GetPrincipalAxesAttr().Get(), prim)
            inertia = axes @ np.diag(diagonal) @ axes.T
        return Inertial(mass, self._finite(center, prim), self._finite(inertia, prim))

    def _look(self, prim: Any) -> Look:
        """Return the colour of a shape: the colour of its preview surface, else its display colour."""
        material = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0]
        color: Any = None
        opacity: Any = None
        if material:
            shader = UsdShade.Shader(material.ComputeSurfaceSource()[0])
            if shader and shader.GetIdAttr().Get() == "UsdPreviewSurface":
                color, opacity = (_value(shader, name) for name in ("diffuseColor", "opacity"))
        if color is None:
            shown = UsdGeom.Gprim(prim)
            colors, opacities = shown.GetDisplayColorAttr().Get(), shown.GetDisplayOpacityAttr().Get()
            color = np.mean(colors, axis=0) if colors else None
            opacity = np.mean(opacities) if opacities else None
        rgba = np.array([*(Look().rgba[:3] if color is None else color), 1.0 if opacity is None else opacity], float)
        if not np.isfinite(rgba).all():
            raise self._error("has a colour that is not a number", prim)
        red, green, blue, alpha = rgba.clip(0.0, 1.0).tolist()
        return Look((red, green, blue, alpha))

    def _positive(self, value: float, name: str) -> float:
        if not 1e-6 <= value <= LARGEST_VALUE:
            wrong = f"must lie between 1e-06 and {LARGEST_VALUE:g}, but is {value:g}"
            raise AssetError(wrong, file=self._file, field=name)
        return float(value)

    def _positive_of(self, prim: Any, name: str) -> float:
        value = float(prim.GetAttribute(name).Get())
        if not 0 < value <= LARGEST_VALUE:
            raise self._error(f"must be a positive number, but is {value:g}", prim, name)
        return value

    def _rotation(self, quaternion: Any, prim: Any) -> Array:
        """Return the rotation (3, 3) of a USD quaternion; the zero quaternion, USD's default, gives the identity."""
        from scipy.spatial.transform import Rotation

        found = np.array([*quaternion.GetImaginary(), quaternion.GetReal()], float)
        if not found.any():
            return np.eye(3)
        self._finite(found, prim)
        if np.linalg.norm(found) < SHEAR:
            raise self._error("has a quaternion that is not a rotation", prim)
        return np.asarray(Rotation.from_quat(found).as_matrix())

    def _finite(self, values: Array, prim: Any) -> Array:
        if not np.isfinite(values).all() or np.abs(values).max() > LARGEST_VALUE:
            raise self._error("has a number that is not finite or too large", prim)
        return values

    def _error(self, wrong: str, prim: Any, attribute: str = "", remedy: str | None = None) -> AssetError:
        field = f"{str(prim.GetPath())[-80:]} {attribute}".strip()
        return AssetError(wrong, file=self._file, field=field, remedy=remedy)


def _flag(attribute: Any) -> bool:
    return attribute.Get() is not False


def _value(shader: Any, name: str) -> Any:
    """Return the constant value of a shader's input; None if it comes from a texture or is not set."""
    given = shader.GetInput(name)
    return None if not given or given.HasConnectedSource() else given.Get()


def _unscaled(matrix: Array) -> Array:
    """Return the rotation and translation (4, 4) of a transform with a scale."""
    from scipy.linalg import polar

    T = np.array(matrix, float)
    T[:3, :3] = polar(T[:3, :3])[0]
    if np.linalg.det(T[:3, :3]) < 0:
        T[:3, :3] = -T[:3, :3]
    return T
