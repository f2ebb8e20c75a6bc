"""Two Panda arms on one base carry a box together in MuJoCo. The hands press on two sides; only friction holds it.

python examples/11_two_arms.py
"""

import sys
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import gensim2_kpam as kpam

sys.path.insert(0, str(Path(__file__).with_name("robots")))
import dual_panda

LEFT, RIGHT = "left_panda_hand", "right_panda_hand"
HALF, MASS = np.array([0.08, 0.12, 0.06]), 0.6  # half the size of the box, m; kg
START, END, TURN = np.array([0.5, 0.0, 0.2]), np.array([0.55, 0.2, 0.45]), 0.3  # centres of the box, m; rotation, rad
FINGERTIP, PRESS = 0.1129, 0.006  # fingertips from the hand, m; the hands' targets lie 6 mm inside the box
REST = [0.0, -0.32, 0.0, -2.2, 0.0, 1.9, 0.785398, 0.01, 0.01] * 2


def pose(rotation: object, position: object) -> np.ndarray:
    return np.block([[np.asarray(rotation), np.reshape(position, (3, 1))], [np.zeros((1, 3)), 1.0]])


def hands(center: np.ndarray, gap: float, turn: float = 0.0) -> dict[str, np.ndarray]:
    """Return the poses of both hands, whose fingers are ``gap`` (m) away from two sides of the box."""
    box, away = pose(Rotation.from_euler("z", turn).as_matrix(), center), HALF[1] + FINGERTIP + gap
    pointing = {s: np.column_stack([[0, 0, -1], [s, 0, 0], [0, -s, 0]]) for s in (1, -1)}  # z against the box
    return {name: box @ pose(pointing[s], [0, s * away, 0]) for name, s in ((LEFT, 1), (RIGHT, -1))}


def main() -> None:
    Path("dual_panda.urdf").write_text(dual_panda.dual_panda())
    robot = kpam.Robot.from_urdf("dual_panda.urdf", hand_link=LEFT, joints=dual_panda.arm_joints("left", "right"))
    box = kpam.Body("box", "rigid", [kpam.Shape.box(HALF)], pose(np.eye(3), START))
    below = START - [0, 0, HALF[2] + dual_panda.TABLE[2] + 0.002]  # 2 mm lower, because the box rests on the table
    table = kpam.Body("table", "table", [kpam.Shape.box(dual_panda.TABLE)], pose(np.eye(3), below))
    scene, limits = kpam.Scene(robot, [box, table]), {"limits": "plain", "velocity_scale": 0.5}
    simulation = dual_panda.Simulation(dual_panda.dual_panda(), robot.joint_names, HALF, START, MASS)
    simulation.reset(REST)
    # Reach both sides, and press on them: the second motion is planned without the box.
    reach = scene.plan_to(REST, hands(START, 0.03), **limits)
    press = kpam.Scene(robot, [table]).plan_to(reach.trajectory.positions[-1], hands(START, -PRESS), **limits)
    # Lift, move and turn the box with the left hand. The right hand keeps its pose relative to the left hand.
    q, up = press.trajectory.positions[-1], START + np.array([0, 0, 0.15])
    way = [hands(up + s * (END - up), -PRESS, s * TURN)[LEFT] for s in np.linspace(0, 1, 21)]
    carry = scene.attached("box", q).plan_along(q, way, second_link=RIGHT, acceleration_scale=0.3, **limits)
    for name, motion in {"reach": reach, "press": press, "carry": carry}.items():
        print(f"{name}: {motion.status}, {motion.trajectory.duration:.2f} s")
        simulation.follow(motion.trajectory)
    error = np.linalg.inv(pose(Rotation.from_euler("z", TURN).as_matrix(), END)) @ simulation.box()
    angle = np.degrees(Rotation.from_matrix(error[:3, :3]).magnitude())
    print(f"box: {1e3 * np.linalg.norm(error[:3, 3]):.1f} mm and {angle:.2f} degrees from its goal")


if __name__ == "__main__":
    main()
