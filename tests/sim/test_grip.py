"""What fingers hold, in physics: a bar between them, let go of by the table, at the original's friction of 0.3."""

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
from gensim2.sim.physics import named_physics

FRICTION = 0.3
HALF_LENGTH, HALF_WIDTH, HALF_HEIGHT = 0.044, 0.0192, 0.0112
#: Control steps until the fingers have closed, and in which the bar hangs between them.
CLOSING, HANGING = 16, 24
#: Metres by which what is held may creep meanwhile.
CREEP = 0.003


def crept(tmp_path: Path, slope: float, mass: float, force: float | None = None) -> float:
    """Metres by which a bar moves in the hand whose sides slope by so many degrees, at a force that is kept."""
    profile, physics = robot("panda"), named_physics("original")
    system = physics.new_system(profile)
    scene = sapien.Scene([system])
    arm = Arm(scene, profile, physics)
    arm.put((*profile.reset_qpos[:7], 0.03, 0.03))
    top = HALF_WIDTH - 2 * HALF_HEIGHT * np.tan(np.radians(slope))
    ends = ((HALF_WIDTH, -HALF_HEIGHT), (top, HALF_HEIGHT))
    corners = [(x, y, z) for x in (-HALF_LENGTH, HALF_LENGTH) for w, z in ends for y in (-w, w)]
    file = tmp_path / "bar.obj"
    trimesh.convex.convex_hull(np.array(corners)).export(file)
    builder = scene.create_actor_builder()
    builder.add_convex_collision_from_file(str(file), material=physx.PhysxMaterial(FRICTION, FRICTION, 0.1))
    inertia = mass / 3 * np.array([HALF_WIDTH**2, HALF_LENGTH**2, HALF_LENGTH**2])
    builder.set_mass_and_inertia(mass, sapien.Pose(), inertia)
    # Upside up between the fingers, which point down: their tips are 2 mm below its middle.
    start = arm._tool.entity.pose * sapien.Pose([0.0, 0.0, 0.0075], [0.0, 1.0, 0.0, 0.0])
    builder.set_initial_pose(start)
    bar = builder.build(name="bar")
    body = bar.find_component_by_type(physx.PhysxRigidDynamicComponent)

    def in_hand() -> npt.NDArray[np.float64]:
        return np.asarray((arm._tool.entity.pose.inv() * bar.pose).p, dtype=np.float64)

    margin = np.arctan(FRICTION) - np.radians(slope)
    presses = grip_force(mass, margin) if force is None else force
    at_start = in_hand()
    for step in range(CLOSING + HANGING):
        opening = arm.reader.finger_opening
        touches = opening < 2 * HALF_WIDTH + 0.002
        command = grip_on(opening, presses if touches else 3.0, profile)
        arm.drive([*profile.reset_qpos[:7], command])
        for _ in range(5):
            if step < CLOSING:  # as if it stood on the table
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
