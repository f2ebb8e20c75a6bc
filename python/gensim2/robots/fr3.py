"""Profile of the Franka Research 3, which has the links of the Panda but different joint limits."""

from __future__ import annotations

from dataclasses import replace

from gensim2.robots.description import read_description, stored
from gensim2.robots.panda import panda, panda_files
from gensim2.robots.profile import RobotFiles, RobotProfile

LIMITS = (
    (-2.7437, 2.7437, 2.62, 87.0),
    (-1.7837, 1.7837, 2.62, 87.0),
    (-2.9007, 2.9007, 2.62, 87.0),
    (-3.0421, -0.1518, 2.62, 87.0),
    (-2.8065, 2.8065, 5.26, 12.0),
    (0.5445, 4.5169, 4.18, 12.0),
    (-3.0159, 3.0159, 5.26, 12.0),
)
"""Lower and upper position (rad), velocity (rad/s) and torque (N m) of each joint, as published by Franka."""


def fr3_files() -> RobotFiles:
    """Write a description of the Franka Research 3 into the user's cache folder, and return the paths of its files.

    The description is ManiSkill's description of the Panda with the joint limits of the Research 3.

    Raises:
        InputError: the cache folder cannot be written to.
    """
    source = panda_files()
    root = read_description(source.urdf)
    joints = {str(joint.get("name")): joint for joint in root.findall("joint")}
    for number, values in enumerate(LIMITS, start=1):
        limit = joints[f"panda_joint{number}"].find("limit")
        assert limit is not None, "a joint of the Panda"
        limit.attrib.update(zip(("lower", "upper", "velocity", "effort"), map(repr, values), strict=True))
    return stored("fr3", root, source.srdf.read_text(encoding="utf-8"))


def fr3() -> RobotProfile:
    """Return the robot profile: the Panda's profile with the joint limits and files of the Research 3."""
    known = panda()
    return replace(
        known,
        name="fr3",
        files=fr3_files,
        simulation=replace(known.simulation, agent="fr3"),
        # The velocity limits of the Research 3 depend on the joint position. A URDF cannot express this.
        solver={**known.solver, "limits": "fr3"},
    )
