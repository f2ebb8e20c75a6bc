"""Compare the CPU time of forward kinematics and hand Jacobians in batches with Pinocchio's.

    python benchmarks/kinematics.py [--count 100000] [--repeats 5]

The libraries are measured alternately on one core. The script prints the median CPU time for a configuration
(microseconds), the ratio, and the largest difference of the results. Pinocchio is called from Python for each
configuration, which adds some tenths of a microsecond to each call.
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import time
from collections.abc import Callable

import numpy as np
import pinocchio as pin
from peers import Arm, panda_files

import gensim2_kpam as kpam

Array = np.ndarray


def spent_us(work: Callable[[], object], count: int) -> float:
    """Return the CPU microseconds of ``work`` divided by ``count``."""
    begin = time.process_time()
    work()
    return 1e6 * (time.process_time() - begin) / count


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return 1 if the results differ by more than 1e-9."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=100_000, help="number of configurations in a batch")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--core", type=int, default=0, help="CPU core on which the measurement runs")
    options = parser.parse_args(arguments)
    os.sched_setaffinity(0, {options.core})
    arm = Arm()
    urdf, srdf = panda_files()
    robot = kpam.Robot.from_urdf(urdf, hand_link="panda_hand", srdf=srdf)
    q = np.random.default_rng(0).uniform(arm.lower, arm.upper, (options.count, 9))
    rows = list(q)
    model, data, hand = arm.model, arm.data, arm.hand

    def pinocchio_poses() -> None:
        for row in rows:
            pin.framesForwardKinematics(model, data, row)

    def pinocchio_hand_poses() -> None:
        for row in rows:
            pin.forwardKinematics(model, data, row)
            pin.updateFramePlacement(model, data, hand)

    def pinocchio_jacobians() -> None:
        for row in rows:
            pin.computeFrameJacobian(model, data, row, hand, pin.LOCAL_WORLD_ALIGNED)

    work: dict[str, Callable[[], object]] = {
        "gensim2 poses": lambda: robot.forward_kinematics(q),
        "Pinocchio hand poses": pinocchio_hand_poses,
        "Pinocchio poses of all frames": pinocchio_poses,
        "gensim2 Jacobians": lambda: robot.jacobian(q),
        "Pinocchio Jacobians": pinocchio_jacobians,
    }
    times: dict[str, list[float]] = {name: [] for name in work}
    for _ in range(options.repeats):
        for name, run in work.items():
            times[name].append(spent_us(run, options.count))
    median = {name: statistics.median(values) for name, values in times.items()}
    for name, value in median.items():
        print(f"{name:40s} {value:.3f} us")
    print(f"{'ratio, poses':40s} {median['Pinocchio hand poses'] / median['gensim2 poses']:.2f}")
    print(f"{'ratio, Jacobians':40s} {median['Pinocchio Jacobians'] / median['gensim2 Jacobians']:.2f}")
    sample = q[:1000]
    poses = np.array([arm.hand_pose(row) for row in sample])
    jacobians = np.array([arm.jacobian(row) for row in sample])
    off = max(
        float(np.abs(robot.forward_kinematics(sample) - poses).max()),
        float(np.abs(robot.jacobian(sample) - jacobians).max()),
    )
    print(f"{'largest difference, 1000 configurations':40s} {off:.2e}")
    return int(off > 1e-9)


if __name__ == "__main__":
    sys.exit(main())
