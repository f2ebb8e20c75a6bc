"""Two Panda arms on one base: the URDF, for planning and for MuJoCo, and a simulation in which they hold a box."""

from __future__ import annotations

import copy
import importlib.util
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np

#: Height (m) of both arms' bases above the base link, and their distances (m) to its left and right.
ARMS = {"left": 0.35, "right": -0.35}
#: Collision of the pedestal on which the arms stand: size (m), centre at the base link.
PEDESTAL = "0.2 1.0 0.02"
#: Half the size of the table in the simulation, m.
TABLE = np.array([0.12, 0.05, 0.02])
#: Drives of the joints: stiffness (N m/rad; N/m) and damping (N m s/rad; N s/m). Inertia of the motors, kg m^2 (kg).
STIFFNESS, DAMPING, ARMATURE = 4000.0, 200.0, 0.1


def panda() -> Path:
    """Return the URDF of the Panda in ManiSkill's wheel."""
    spec = importlib.util.find_spec("mani_skill")
    if spec is None or not spec.submodule_search_locations:
        raise SystemExit("mani_skill is not installed; its wheel holds the Panda (pip install 'gensim2[sim]')")
    return Path(spec.submodule_search_locations[0]) / "assets" / "robots" / "panda" / "panda_v2.urdf"


def dual_panda() -> str:
    """Return a URDF with the links and joints of two Pandas, named ``left_...`` and ``right_...``.

    The arms stand side by side, 0.7 m apart, on the link ``base``. The file has no visual meshes, and its collision
    meshes have absolute paths.
    """
    file = panda()
    single = ElementTree.parse(file).getroot()
    robot = ElementTree.Element("robot", name="dual_panda")
    base = ElementTree.SubElement(robot, "link", name="base")
    geometry = ElementTree.SubElement(ElementTree.SubElement(base, "collision"), "geometry")
    ElementTree.SubElement(geometry, "box", size=PEDESTAL)
    for side, y in ARMS.items():
        for element in single:
            if element.tag not in ("link", "joint"):
                continue
            part = copy.deepcopy(element)
            part.set("name", f"{side}_{part.get('name')}")
            for visual in part.findall("visual"):
                part.remove(visual)
            for mesh in part.iter("mesh"):
                mesh.set("filename", str(file.parent / mesh.get("filename", "")))
            for end in (*part.findall("parent"), *part.findall("child")):
                end.set("link", f"{side}_{end.get('link')}")
            for mimic in part.findall("mimic"):
                mimic.set("joint", f"{side}_{mimic.get('joint')}")
            robot.append(part)
        mount = ElementTree.SubElement(robot, "joint", name=f"{side}_mount", type="fixed")
        ElementTree.SubElement(mount, "parent", link="base")
        ElementTree.SubElement(mount, "child", link=f"{side}_panda_link0")
        ElementTree.SubElement(mount, "origin", xyz=f"0 {y} 0.01", rpy="0 0 0")
    return ElementTree.tostring(robot, encoding="unicode")


def arm_joints(*sides: str) -> list[str]:
    """Return the names of the arm joints of the given sides."""
    return [f"{side}_panda_joint{k}" for side in sides for k in range(1, 8)]


class Simulation:
    """Both arms with position-controlled joints and compensated gravity, and a box on a small table.

    Args:
        urdf: text of :func:`dual_panda`.
        joints: names of all joints, in the order of joint vectors.
        half: (3,) half the size of the box, m.
        center: (3,) centre of the box at the start, m.
        mass: mass of the box, kg.
    """

    def __init__(self, urdf: str, joints: list[str], half: np.ndarray, center: np.ndarray, mass: float) -> None:
        spec = mujoco.MjSpec.from_string(urdf)
        spec.option.timestep = 0.002
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        spec.option.cone, spec.option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, 10
        for body in spec.bodies:
            body.gravcomp = 1.0
            for geom in body.geoms:  # hulls of neighbouring links overlap, so the arms collide only with the box
                geom.contype, geom.conaffinity = 2, 1
        for name in joints:
            spec.joint(name).armature = ARMATURE
            drive = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
            drive.set_to_position(kp=STIFFNESS, kv=DAMPING)
        below = center - np.array([0.0, 0.0, half[2] + TABLE[2]])
        solid = mujoco.mjtGeom.mjGEOM_BOX
        spec.worldbody.add_geom(type=solid, size=TABLE, pos=below)
        box = spec.worldbody.add_body(name="box", pos=center)
        box.add_freejoint()
        geom = box.add_geom(type=solid, size=half, mass=mass, friction=[1.0, 0.02, 0.001], condim=4)
        geom.contype, geom.conaffinity = 1, 3
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self._places = [self.model.joint(name).qposadr[0] for name in joints]

    def reset(self, q: Any) -> None:
        """Place the arms at a joint vector."""
        self.data.qpos[self._places] = q
        mujoco.mj_forward(self.model, self.data)

    def follow(self, trajectory: Any) -> None:
        """Let the drives follow a motion, and wait half a second."""
        start = self.data.time
        while self.data.time - start < trajectory.duration + 0.5:
            q, v, _ = trajectory.sample(min(self.data.time - start, trajectory.duration))
            self.data.ctrl[:] = q + DAMPING / STIFFNESS * np.asarray(v)  # compensates the delay of the drives
            mujoco.mj_step(self.model, self.data)

    def box(self) -> np.ndarray:
        """Return the pose (4, 4) of the box."""
        pose = np.eye(4)
        pose[:3, :3] = self.data.body("box").xmat.reshape(3, 3)
        pose[:3, 3] = self.data.body("box").xpos
        return pose


if __name__ == "__main__":
    print(dual_panda())
