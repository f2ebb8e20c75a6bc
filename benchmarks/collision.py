"""Compare the CPU time of collision checks by gensim2 and by coal, for a Panda among convex hulls.

    python benchmarks/collision.py [--hulls 100] [--configurations 2000] [--repeats 5]

Both libraries get the same robot hulls, self-collision pairs and obstacles: random hulls of 24 points, 3 to 8 cm in
diameter, within the arm's reach. The libraries are measured alternately on one core. coal uses Pinocchio's broad phase
(a dynamic AABB tree) and stops at the first contact. The script prints the median CPU time for a configuration
(microseconds), the ratio, the time in units of a Pinocchio frame Jacobian, and the number of configurations on which
the results differ.
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
from collections.abc import Callable

import numpy as np
import pinocchio as pin
from contacts import Obstacle
from kinematics import spent_us
from parts import hull, part
from peers import Arm, panda_files
from sampling import Stages

import gensim2_kpam as kpam

Array = np.ndarray

#: Solver config, which a problem must have. Collision checks do not depend on the config.
CONFIG = {
    "constraint_list": [
        {
            "type": "point2point_constraint",
            "keypoint_name": "tool_head",
            "target_keypoint_name": "articulated_object_head",
            "tolerance": 1e-3,
        }
    ],
    "pre_actuation_motions": [["translate_z", -0.1], ["translate_z", -0.1]],
    "post_actuation_motions": [],
}


def strewn(count: int, draw: np.random.Generator) -> list[Array]:
    """Return vertices (24, 3) of random hulls in the base frame, m, at least 25 cm from the base's axis."""
    sets: list[Array] = []
    while len(sets) < count:
        center = draw.uniform([-0.8, -0.8, 0.0], [0.8, 0.8, 1.1])
        if np.hypot(center[0], center[1]) > 0.25:
            points = draw.normal(size=(24, 3))
            points /= np.linalg.norm(points, axis=1, keepdims=True)
            sets.append(center + draw.uniform(0.015, 0.04) * points)
    return sets


def our_problem(q_start: Array, sets: list[Array]) -> kpam.KeypointProblem:
    """Return a gensim2_kpam problem with the obstacles."""
    urdf, srdf = panda_files()
    shapes = [kpam.Shape.convex_hull(points) for points in sets]
    return kpam.KeypointProblem(
        kpam.Robot.from_urdf(urdf, hand_link="panda_hand", srdf=srdf),
        kpam.SolverConfig(CONFIG),
        q_start,
        tool_keypoints={"tool_head": np.array([0.0, 0.0, 0.105])},
        object_keypoints={"articulated_object_head": np.array([0.5, 0.0, 0.3])},
        T_base_object=np.eye(4),
        bodies=[kpam.Body("clutter", "object_body", shapes, np.eye(4))],
    )


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return 1 if the results differ on more than 1 % of the configurations."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hulls", type=int, default=100)
    parser.add_argument("--configurations", type=int, default=2000)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--core", type=int, default=0, help="CPU core on which the measurement runs")
    options = parser.parse_args(arguments)
    os.sched_setaffinity(0, {options.core})
    arm, draw = Arm(), np.random.default_rng(0)
    q_start = np.array([0.0, -0.32, 0.0, -2.61799, 0.0, 2.23, 0.785398, 0.04, 0.04])
    sets = strewn(options.hulls, draw)
    obstacle = Obstacle("clutter", "object_body", [part(hull(points), np.eye(4)) for points in sets], np.eye(4))
    stages = Stages(arm, [obstacle], q_start)
    data = stages.checks[stages.APPROACH]
    for index in range(len(stages.model.collisionPairs)):
        data.activateCollisionPair(index)
        data.collisionRequests[index].security_margin = 0.0
    manager = pin.BroadPhaseManager_DynamicAABBTreeCollisionManager(arm.model, stages.model, data)
    problem = our_problem(q_start, sets)
    q = draw.uniform(arm.lower, arm.upper, (options.configurations, 9))
    q[:, 7:] = 0.04
    rows = list(q)

    def in_coal() -> list[bool]:
        return [pin.computeCollisions(arm.model, arm.data, manager, row, True) for row in rows]

    def jacobians() -> None:
        for row in rows:
            pin.computeFrameJacobian(arm.model, arm.data, row, arm.hand, pin.LOCAL_WORLD_ALIGNED)

    work: dict[str, Callable[[], object]] = {
        "gensim2": lambda: problem.scene.in_collision(q),
        "coal behind Pinocchio's broad phase": in_coal,
        "Pinocchio frame Jacobian": jacobians,
    }
    times: dict[str, list[float]] = {name: [] for name in work}
    for _ in range(options.repeats):
        for name, run in work.items():
            times[name].append(spent_us(run, len(q)))
    median = {name: statistics.median(values) for name, values in times.items()}
    for name, value in median.items():
        print(f"{name:45s} {value:.3f} us")
    ours, coal, jacobian = median.values()
    print(f"{'ratio to coal':45s} {coal / ours:.2f}")
    print(f"{'our check in Pinocchio Jacobians':45s} {ours / jacobian:.1f}")
    hits, expected = np.asarray(problem.scene.in_collision(q)), np.asarray(in_coal())
    print(f"{'configurations in collision':45s} {expected.sum()} of {len(q)}")
    print(f"{'configurations with different results':45s} {(hits != expected).sum()}")
    return int((hits != expected).mean() > 0.01)


if __name__ == "__main__":
    sys.exit(main())
