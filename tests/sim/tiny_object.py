"""A hand-made articulated object: a hollow crate with a hinged or sliding lid, for simple calculations."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
import trimesh

from gensim2.objects.types import ArticulatedObject, Keypoint, MovingJoint, Placement

LID_MASS = 0.3
LID_LENGTH = 0.2

_BODY = {  # name: (half extents, centre), metres; the crate is 0.2 x 0.2 x 0.1, walls 1 cm
    "floor": ((0.1, 0.1, 0.005), (0.0, 0.0, 0.005)),
    "left": ((0.1, 0.005, 0.045), (0.0, 0.095, 0.055)),
    "right": ((0.1, 0.005, 0.045), (0.0, -0.095, 0.055)),
    "front": ((0.005, 0.09, 0.045), (-0.095, 0.0, 0.055)),
    "back": ((0.005, 0.09, 0.045), (0.095, 0.0, 0.055)),
}
_LID = ((0.1, 0.1, 0.004), (-0.1, 0.0, 0.004))  # in the lid's frame, whose origin is on the hinge


def make_crate(
    folder: Path,
    *,
    joint_type: Literal["revolute", "prismatic"] = "revolute",
    friction: float = 0.5,
    damping: float = 0.0,
    number: int = 0,
) -> ArticulatedObject:
    """Write the URDF and meshes below ``folder`` and return the instance.

    The lid's hinge is along y at the back edge, 0.102 m above the table; opening lifts the lid's front edge. The
    prismatic crate's lid slides up instead.
    """
    folder.mkdir(parents=True, exist_ok=True)
    hulls: dict[str, list[np.ndarray]] = {"body": [], "lid": []}
    elements: dict[str, str] = {"body": "", "lid": ""}
    for link, name, (half, centre) in [
        *(("body", name, shape) for name, shape in _BODY.items()),
        ("lid", "plate", _LID),
    ]:
        mesh = trimesh.creation.box(2 * np.array(half))
        mesh.apply_translation(centre)
        mesh.export(folder / f"{name}.obj")
        hulls[link].append(np.asarray(mesh.vertices, dtype=np.float64))
        geometry = f'<geometry><mesh filename="{name}.obj"/></geometry>'
        elements[link] += f"<visual>{geometry}</visual><collision>{geometry}</collision>"
    revolute = joint_type == "revolute"
    axis, upper = ((0.0, 1.0, 0.0), 1.5) if revolute else ((0.0, 0.0, 1.0), 0.2)
    origin = np.array([0.1, 0.0, 0.102])
    inertial = (
        '<inertial><origin xyz="{0}"/><mass value="{1}"/>'
        '<inertia ixx="{2}" iyy="{2}" izz="{2}" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    body_inertial = inertial.format("0 0 0.05", 1.0, 0.01)
    lid_inertial = inertial.format("-0.1 0 0", LID_MASS, 0.001)
    urdf = folder / "mobility.urdf"
    urdf.write_text(
        f"""<?xml version="1.0"?>
<robot name="crate">
  <link name="base"/>
  <link name="body">{body_inertial}{elements["body"]}</link>
  <link name="lid">{lid_inertial}{elements["lid"]}</link>
  <joint name="root" type="fixed"><parent link="base"/><child link="body"/></joint>
  <joint name="hinge" type="{joint_type}"><parent link="body"/><child link="lid"/>
    <origin xyz="0.1 0 0.102"/><axis xyz="{" ".join(map(str, axis))}"/>
    <limit lower="0" upper="{upper}" effort="100" velocity="10"/>
    <dynamics friction="{friction}" damping="{damping}"/></joint>
</robot>
"""
    )
    T_root_child = np.eye(4)
    T_root_child[:3, 3] = origin
    frame = np.eye(4)  # y up, z out of the front
    frame[:3, :3] = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    return ArticulatedObject(
        asset_class="crate",
        id=str(number),
        source="generated",
        urdf=urdf,
        joint=MovingJoint(
            name="hinge",
            type=joint_type,
            child_link="lid",
            origin=origin,
            axis=np.array(axis),
            lower=0.0,
            upper=upper,
            friction=friction,
            damping=damping,
            T_root_child=T_root_child,
        ),
        keypoints={
            "articulated_object_head": Keypoint("lid", np.array([-0.2, 0.0, 0.0]), "front edge of the lid"),
            "articulated_object_inside_base": Keypoint("base", np.array([0.0, 0.0, 0.01]), "floor of the crate"),
        },
        T_link_object=frame,
        object_axis="x",
        hulls={link: tuple(parts) for link, parts in hulls.items()},
        placement=Placement(position=np.array([0.0, 0.0, 0.0]), quaternion=np.array([1.0, 0.0, 0.0, 0.0])),
        default_openness=0.5,
        mass=1.3,
        license="made for the tests",
        content_hash=f"crate-{joint_type}-{friction}-{damping}-{number}",
    )
