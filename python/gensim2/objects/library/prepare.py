"""Write a model as a folder that SAPIEN and urdf-rs can load directly."""

from __future__ import annotations

from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
import numpy.typing as npt
import trimesh
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from gensim2.core.arrays import Array
from gensim2.objects.model import LinkGeometry, Model
from gensim2.objects.physics import GRAVITY, Inertial, class_rule, inertial, joint_resistance
from gensim2.objects.placement import place
from gensim2.objects.shapes import Look, Mesh, hull_mesh
from gensim2.objects.types import ArticulatedObject, MovingJoint

Faces = npt.NDArray[np.int64]

CREASE = np.cos(np.radians(35))
# placeholders: urdf-rs requires these limits, but the objects of the release have none
EFFORT_LIMIT, VELOCITY_LIMIT = 100.0, 10.0


def rpy_from_matrix(R: Array) -> Array:
    """Convert a rotation (3, 3) to roll, pitch and yaw (3,) as in URDF. Yaw is 0 in gimbal lock."""
    return np.asarray(Rotation.from_matrix(R).as_euler("xyz", suppress_warnings=True))


def numbers(values: Array) -> str:
    """Format values as an XML attribute with nine digits."""
    return " ".join(f"{v:.9g}" for v in np.asarray(values, float) + 0.0)


def box_of(hull: Array) -> tuple[Array, Array] | None:
    """Return the pose (4, 4) and size (3,) of the box whose corners are the vertices (N, 3).

    Return None if they are not a box.

    Physics engines test boxes faster than meshes, and boxes need no preprocessing.
    """
    if len(hull) != 8:
        return None
    center = hull.mean(axis=0)
    offsets = hull - center
    edges = np.linalg.norm(hull - hull[0], axis=1)
    order = np.argsort(edges, kind="stable")
    R = np.zeros((3, 3))
    found: list[Array] = []
    for i in order[1:]:
        edge = (hull[i] - hull[0]) / edges[i]
        if all(abs(float(edge @ other)) < 1e-6 for other in found):
            found.append(edge)
            if len(found) == 3:
                break
    if len(found) < 3:
        return None
    R[:, 0], R[:, 1] = found[0], found[1]
    R[:, 2] = np.cross(R[:, 0], R[:, 1])
    local = np.abs(offsets @ R)
    half = local.max(axis=0)
    if half.min() <= 0 or (np.abs(local - half) > 1e-6).any():
        return None
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, center
    return T, 2 * half


def write_hull(path: Path, points: Array) -> None:
    """Write the convex hull of (N, 3) points as Wavefront OBJ."""
    mesh = hull_mesh(points, Look())
    corners, order = np.unique(mesh.vertices, axis=0, return_inverse=True)
    faces = order.ravel()[mesh.faces]
    lines = [f"v {x:.7g} {y:.7g} {z:.7g}" for x, y, z in corners]
    lines += [f"f {a} {b} {c}" for a, b, c in faces + 1]
    path.write_text("\n".join(lines) + "\n")


def creased(vertices: Array, faces: Faces) -> tuple[Array, Faces]:
    """Duplicate the vertices along every edge that is sharper than ``CREASE``, and return the new surface.

    Renderers smooth the shading over faces that share a vertex, which suits a bottle but not a box.

    Args:
        vertices: (N, 3).
        faces: (M, 3).
    """
    n = len(faces)
    if n == 0:
        return vertices, faces
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-18)[:, None]
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, edge = np.unique(edges, axis=0, return_inverse=True)
    edge = edge.ravel()
    order = np.argsort(edge, kind="stable")
    owner, same = order // 3, edge[order[1:]] == edge[order[:-1]]
    left, right = owner[:-1][same], owner[1:][same]
    smooth = np.einsum("ij,ij->i", normals[left], normals[right]) > CREASE
    # Adjacent faces share the vertices of smooth edges only.
    corner_of = np.arange(3 * n).reshape(-1, 3)
    pairs = []
    for i in range(3):
        for j in range(3):
            shared = smooth & (faces[left, i] == faces[right, j])
            pairs.append(np.stack([corner_of[left[shared], i], corner_of[right[shared], j]], axis=1))
    joined = np.concatenate(pairs)
    graph = coo_matrix((np.ones(len(joined)), (joined[:, 0], joined[:, 1])), shape=(3 * n, 3 * n))
    count, label = connected_components(graph, directed=False)
    split = np.zeros((count, 3))
    split[label] = corners.reshape(-1, 3)
    return split, label.reshape(-1, 3).astype(np.int64)


def write_visual(path: Path, meshes: list[Mesh]) -> None:
    """Write the meshes of a link as one GLB file. Each appearance has one primitive with its material."""
    by_look: dict[Look, list[Mesh]] = {}
    for mesh in meshes:
        by_look.setdefault(mesh.look, []).append(mesh)
    scene = trimesh.Scene()
    for number, (look, group) in enumerate(by_look.items()):
        offsets = np.cumsum([0] + [len(m.vertices) for m in group[:-1]])
        vertices, faces = creased(
            np.concatenate([m.vertices for m in group]),
            np.concatenate([m.faces + o for m, o in zip(group, offsets, strict=True)]),
        )
        material = PBRMaterial(
            name=f"look_{number}",
            baseColorFactor=[round(255 * c) for c in look.rgba],
            metallicFactor=look.metallic,
            roughnessFactor=look.roughness,
            alphaMode="BLEND" if look.rgba[3] < 1 else None,
            doubleSided=True,
        )
        shape = trimesh.Trimesh(vertices, faces, process=False, visual=TextureVisuals(material=material))
        scene.add_geometry(shape, geom_name=f"part_{number}", node_name=f"part_{number}")
    path.write_bytes(scene.export(file_type="glb"))


def _link(name: str, geometry: LinkGeometry, mass: Inertial, folder: Path) -> list[str]:
    lines = [f"  <link name={quoteattr(name)}>"]
    i = mass.inertia
    lines += [
        "    <inertial>",
        f'      <origin xyz="{numbers(mass.center)}"/>',
        f'      <mass value="{mass.mass:.9g}"/>',
        f'      <inertia ixx="{i[0, 0]:.9g}" ixy="{i[0, 1]:.9g}" ixz="{i[0, 2]:.9g}"'
        f' iyy="{i[1, 1]:.9g}" iyz="{i[1, 2]:.9g}" izz="{i[2, 2]:.9g}"/>',
        "    </inertial>",
    ]
    if geometry.meshes:
        write_visual(folder / "visual" / f"{name}.glb", geometry.meshes)
        lines.append(f'    <visual><geometry><mesh filename="visual/{name}.glb"/></geometry></visual>')
    for number, hull in enumerate(geometry.collides):
        box = box_of(hull)
        if box is not None:
            T, size = box
            lines.append(
                f'    <collision><origin xyz="{numbers(T[:3, 3])}" rpy="{numbers(rpy_from_matrix(T[:3, :3]))}"/>'
                f'<geometry><box size="{numbers(size)}"/></geometry></collision>'
            )
            continue
        file = f"collision/{name}_{number}.obj"
        write_hull(folder / file, hull)
        lines.append(f'    <collision><geometry><mesh filename="{file}"/></geometry></collision>')
    return [*lines, "  </link>"]


def prepare(model: Model, folder: Path) -> ArticulatedObject:
    """Write ``mobility.urdf`` and its meshes into ``folder``, and return the prepared instance."""
    rule = class_rule(model.asset_class)
    placement = place(model, rule)
    body, moving = (inertial(part.hulls, rule.density) for part in (model.body, model.moving))
    R_world_root = placement.rotation
    gravity = (R_world_root @ model.T_root_link[:3, :3]).T @ GRAVITY
    friction, damping = joint_resistance(
        model.joint_type, model.axis, np.zeros(3), moving, model.lower, model.upper, gravity
    )
    (folder / "visual").mkdir()
    (folder / "collision").mkdir()
    lines = ['<?xml version="1.0"?>', f"<robot name={quoteattr(f'{model.asset_class}_{model.id}')}>"]
    lines += _link(model.root_link, model.body, body, folder)
    lines += _link(model.moving_link, model.moving, moving, folder)
    lines += [
        f"  <joint name={quoteattr(model.joint_name)} type={quoteattr(model.joint_type)}>",
        f'    <origin xyz="{numbers(model.T_root_link[:3, 3])}"'
        f' rpy="{numbers(rpy_from_matrix(model.T_root_link[:3, :3]))}"/>',
        f"    <parent link={quoteattr(model.root_link)}/>",
        f"    <child link={quoteattr(model.moving_link)}/>",
        f'    <axis xyz="{numbers(model.axis)}"/>',
        f'    <limit lower="{model.lower:.9g}" upper="{model.upper:.9g}"'
        f' effort="{EFFORT_LIMIT:g}" velocity="{VELOCITY_LIMIT:g}"/>',
        f'    <dynamics friction="{friction:.6g}" damping="{damping:.6g}"/>',
        "  </joint>",
        "</robot>",
    ]
    (folder / "mobility.urdf").write_text("\n".join(lines) + "\n")
    return ArticulatedObject(
        asset_class=model.asset_class,
        id=model.id,
        source=model.source,
        urdf=folder / "mobility.urdf",
        joint=MovingJoint(
            name=model.joint_name,
            type=model.joint_type,
            child_link=model.moving_link,
            origin=model.T_root_link[:3, 3].copy(),
            axis=model.T_root_link[:3, :3] @ model.axis,
            lower=model.lower,
            upper=model.upper,
            friction=friction,
            damping=damping,
            T_root_child=model.T_root_link,
        ),
        keypoints=model.keypoints,
        T_link_object=model.T_link_object,
        object_axis=model.object_axis,
        hulls={model.root_link: tuple(model.body.collides), model.moving_link: tuple(model.moving.collides)},
        placement=placement,
        default_openness=rule.default_openness,
        mass=body.mass + moving.mass,
        license=model.license,
        content_hash=model.content_hash,
        warnings=model.warnings,
    )
