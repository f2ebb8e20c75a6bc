"""Load your own robots from Python files, and use their names in environments.

python examples/09_a_robot_of_your_own.py
"""

from pathlib import Path

import gensim2

ROBOTS = Path(__file__).with_name("robots")
"""A UR5e with the Panda's hand, and an xArm7 whose gripper has one motor, mimic joints and passive hinges."""


def main() -> None:
    for file in (ROBOTS / "ur5e.py", ROBOTS / "xarm7.py"):
        name = gensim2.load_robot(file)
        robot = gensim2.robot(name)
        print(f"{robot.name}: {robot.arm_size} arm joints, opens {robot.gripper.widest:.3f} m, {robot.control_hz} Hz")
        env = gensim2.make_env("OpenDrawer", assets="builtin", robot=name)
        env.reset(seed=0)
        for _ in range(robot.control_hz):  # one second without motion
            *_, info = env.step(robot.rest_action)
        openness = float(next(iter(info["openness"].values()))[0])
        print(f"after a second: openness {openness:.2f}, {env.action_space.shape[0]} numbers")
        env.close()


if __name__ == "__main__":
    main()
