"""Objects in the fingers with the original's physics, friction 0.3: a bar that the table no longer supports."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
import sapien
import trimesh
from sapien import physx

from gensim2.planning.actions import grip_force, grip_on
from gensim2.robots import robot
from gensim2.sim.arm import Arm
from gensim2.sim.objects import link_name
from gensim2.sim.physics import named_physics

FRICTION = 0.3
#: Half sizes (m), along the pads, across them and up: of a gold bar and of a wooden block.
GOLD, BLOCK = (0.044, 0.0192, 0.0112), (0.052, 0.0235, 0.0232)
#: Control steps until the fingers are closed, while the bar hangs between them, and while it is carried.
CLOSING, HANGING, CARRYING = 16, 24, 30
#: Amplitude (rad) and period (s) of two swinging joints: up to 1 rad/s, as fast as plans.
SWING, SWING_SECONDS = np.array([0.48, 0.24]), 1.5
#: Allowed displacement (m) of the held object.
CREEP = 0.003


def crept(
    tmp_path: Path,
    slope: float,
    mass: float,
    force: float | None = None,
    *,
    half: tuple[float, float, float] = GOLD,
    middle: tuple[float, float] = (0.0, 0.0075),
    carried: bool = False,
) -> float:
    """Return the displacement (m) in the hand of a bar whose sides have the given slope (degrees), with a constant
    force.

    Args:
        half: half sizes.
        middle: distance (m) of its centre from the middle between the pads: along its length, and along the fingers.
        carried: whether the arm swings.
    """
    profile, physics = robot("panda"), named_physics("original")
    system = physics.new_system(profile)
    scene = sapien.Scene([system])
    arm = Arm(scene, profile, physics)
    arm.put((*profile.reset_qpos[:7], 0.03, 0.03))
    length, width, height = half
    top = width - 2 * height * np.tan(np.radians(slope))
    ends = ((width, -height), (top, height))
    corners = [(x, y, z) for x in (-length, length) for w, z in ends for y in (-w, w)]
    file = tmp_path / "bar.obj"
    trimesh.convex.convex_hull(np.array(corners)).export(file)
    builder = scene.create_actor_builder()
    builder.add_convex_collision_from_file(str(file), material=physx.PhysxMaterial(FRICTION, FRICTION, 0.1))
    inertia = mass / 3 * np.array([width**2 + height**2, length**2 + height**2, length**2 + width**2])
    builder.set_mass_and_inertia(mass, sapien.Pose(), inertia)
    tool = next(link for link in arm.articulation.links if link_name(link) == profile.tool_link)
    # Upright between the fingers, which point down.
    start = tool.entity.pose * sapien.Pose([middle[0], 0.0, middle[1]], [0.0, 1.0, 0.0, 0.0])
    builder.set_initial_pose(start)
    bar = builder.build(name="bar")
    body = bar.find_component_by_type(physx.PhysxRigidDynamicComponent)

    physics.prepare_for_rigid_objects(system, arm.articulation, profile)

    def in_hand() -> npt.NDArray[np.float64]:
        return np.asarray((tool.entity.pose.inv() * bar.pose).p, dtype=np.float64)

    margin = np.arctan(FRICTION) - np.radians(slope)
    presses = grip_force(mass, margin, middle[0]) if force is None else force
    at_start = in_hand()
    for step in range(CLOSING + (CARRYING if carried else HANGING)):
        opening = arm.reader.finger_opening
        touches = opening < 2 * width + 0.002
        command = grip_on(opening, presses if touches else 3.0, profile, arm.reader.finger_stiffness)
        target = np.array(profile.reset_qpos[:7])
        if carried and step > CLOSING:
            turn = 2 * np.pi * (step - CLOSING) / 20 / SWING_SECONDS
            target[[0, 3]] += 0.5 * SWING * (1 - np.cos(turn))
        arm.drive([*target, command])
        for _ in range(5):
            if step < CLOSING:  # keep it as if on the table
                bar.pose = start
                body.linear_velocity = body.angular_velocity = np.zeros(3, dtype=np.float32)
            system.step()
        if step == CLOSING:
            at_start = in_hand()
    return float(np.linalg.norm(in_hand() - at_start))


@pytest.mark.parametrize("mass", [0.006, 0.021])
@pytest.mark.parametrize("slope", [0.0, 10.0])
def test_what_lies_well_within_the_friction_cone_is_held(tmp_path: Path, slope: float, mass: float) -> None:
    assert crept(tmp_path, slope, mass) < CREEP


@pytest.mark.parametrize("force", [0.5, 2.0, 8.0])
def test_sides_beyond_the_friction_cone_slip_however_hard_they_are_pressed(tmp_path: Path, force: float) -> None:
    assert crept(tmp_path, 20.0, 0.006, force) > 0.1


def test_what_is_carried_about_stays_in_the_hand(tmp_path: Path) -> None:
    """With drives of 1000 N/m and 20 N s/m, a block held 2 cm beside its centre moves by 6 mm."""
    assert crept(tmp_path, 0.0, 0.021, half=BLOCK, middle=(0.02, 0.0), carried=True) < CREEP
