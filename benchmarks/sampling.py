"""A sampling planner that shares nothing with gensim2's: Newton steps on Pinocchio, coal collisions, RRT-Connect."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pinocchio as pin
from contacts import Obstacle
from peers import HAND_LINKS, Arm
from rules import BOX, Keyframe, constraint_errors, rotation

Array = np.ndarray
Free = Callable[[Array], bool]

#: Overlap let pass while planning, metres; the checker lets 1 mm pass.
MARGIN = -5e-4
#: Longest joint step that is checked in free space, rad (the largest joint); and the hand's step on fixed paths, m.
JOINT_STEP, HAND_STEP, TURN_STEP = 0.03, 4e-3, 0.03
HELD_AGAINST = tuple(f"panda_link{index}" for index in range(6))


class Stages:
    """Collision checks of the motion's three parts: before contact, hand may touch, object moves."""

    APPROACH, CONTACT, MOTION = range(3)

    def __init__(self, arm: Arm, obstacles: list[Obstacle], q_start: Array) -> None:
        self.arm = arm
        self.model = pin.GeometryModel()
        self.fingers = q_start[7:]
        links = {name: self._add_link(name, parts) for name, parts in arm.parts.items()}
        pairs: list[tuple[int, int, int]] = []
        for one, two in arm.self_pairs:
            pairs += [(a, b, self.MOTION) for a in links[one] for b in links[two]]
        moving = {name: shapes for name, shapes in links.items() if name != "panda_link0"}
        held = [obstacle for obstacle in obstacles if obstacle.role == "attached"]
        if held:
            shapes = self._add_parts("panda_hand", held[0].parts, held[0].pose)
            pairs += [(a, b, self.MOTION) for name in HELD_AGAINST for a in shapes for b in links[name]]
            moving["held"] = shapes
        for obstacle in obstacles:
            if obstacle.role == "attached":
                continue
            bodies = [self._add("universe", each.shape, obstacle.pose @ each.pose) for each in obstacle.parts]
            for name, shapes in moving.items():
                of_hand = name in HAND_LINKS or name == "held"
                if obstacle.role == "target" and of_hand:
                    continue
                last = self.MOTION
                if obstacle.role == "moving_link":
                    last = self.APPROACH if of_hand else self.CONTACT
                pairs += [(a, b, last) for a in shapes for b in bodies]
        for a, b, _ in pairs:
            self.model.addCollisionPair(pin.CollisionPair(a, b))
        self.checks = []
        for stage in range(3):
            data = pin.GeometryData(self.model)
            for index, (_, _, last) in enumerate(pairs):
                data.collisionRequests[index].security_margin = MARGIN
                if last < stage:
                    data.deactivateCollisionPair(index)
            self.checks.append(data)
        # What overlaps at the start may persist; the checker sees to it that it does not deepen.
        pin.computeCollisions(arm.model, arm.data, self.model, self.checks[0], q_start, False)
        for index in range(len(pairs)):
            if self.checks[0].collisionResults[index].isCollision():
                self.checks[0].deactivateCollisionPair(index)

    def _add(self, frame: str, shape: Any, pose: Array) -> int:
        index = self.arm.model.getFrameId(frame)
        parent = self.arm.model.frames[index]
        placement = parent.placement * pin.SE3(pose)
        name = f"{self.model.ngeoms}"
        return self.model.addGeometryObject(pin.GeometryObject(name, parent.parentJoint, index, placement, shape))

    def _add_link(self, name: str, parts: list[Any]) -> list[int]:
        return [self._add(name, each.shape, each.pose) for each in parts]

    def _add_parts(self, frame: str, parts: list[Any], pose: Array) -> list[int]:
        return [self._add(frame, each.shape, pose @ each.pose) for each in parts]

    def free(self, stage: int) -> Free:
        """Return the check of one part of the motion, on (9,) joints."""
        data = self.checks[stage]

        def check(q: Array) -> bool:
            return not pin.computeCollisions(self.arm.model, self.arm.data, self.model, data, q, True)

        return check


def solve_pose(arm: Arm, q: Array, target: Array, steps: int = 12) -> Array | None:
    """Newton steps from q to a hand pose, joints kept inside; None where they do not arrive (0.1 mm, 0.001 rad)."""
    q, middle = q.copy(), 0.5 * (arm.lower + arm.upper)[:7]
    for _ in range(steps):
        here = arm.hand_pose(q)
        twist = np.concatenate([target[:3, 3] - here[:3, 3], pin.log3(target[:3, :3] @ here[:3, :3].T)])
        if np.linalg.norm(twist[:3]) < 1e-4 and np.linalg.norm(twist[3:]) < 1e-3:
            return q
        jacobian = arm.jacobian(q)[:, :7]
        inverse = jacobian.T @ np.linalg.inv(jacobian @ jacobian.T + 1e-6 * np.eye(6))
        centre = np.minimum(q[:7] - arm.lower[:7], arm.upper[:7] - q[:7]) < 0.1
        away = np.where(centre, 0.05 * (middle - q[:7]), 0.0)
        step = inverse @ twist + away - inverse @ (jacobian @ away)
        step *= min(1.0, 0.3 / max(np.abs(step).max(), 1e-12))
        q[:7] = np.clip(q[:7] + step, arm.lower[:7], arm.upper[:7])
    return None


def constraint_rows(problem: dict[str, Any], arm: Arm, q: Array) -> tuple[Array, Array]:
    """Residuals of the config's constraints at q and their Jacobian with respect to the 7 arm joints."""
    hand, jacobian = arm.hand_pose(q), arm.jacobian(q)[:, :7]
    turn, origin = hand[:3, :3], hand[:3, 3]
    target = {name: np.asarray(point) for name, point in problem["object_keypoints_base"].items()}
    tool = {name: np.asarray(point) for name, point in problem["tool_keypoints_hand"].items()}
    axes = {
        "world": np.linalg.inv(np.asarray(problem["T_world_base"]))[:3, :3],
        "object": np.asarray(problem["T_base_object"])[:3, :3],
    }
    residuals, rows = [], []
    for entry in problem["config"]["constraint_list"]:
        if entry["type"] == "point2point_constraint":
            arm_of = turn @ tool[entry["keypoint_name"]]
            residuals.append(arm_of + origin - target[entry["target_keypoint_name"]])
            rows.append(jacobian[:3] - pin.skew(arm_of) @ jacobian[3:])
            continue
        own = turn @ (tool[entry["axis_to_keypoint_name"]] - tool[entry["axis_from_keypoint_name"]])
        if entry["type"].startswith("keypoint_axis"):
            to, start = entry["target_axis_to_keypoint_name"], entry["target_axis_from_keypoint_name"]
            other = target[to] - target[start]
        else:
            other = axes.get(entry["target_axis_frame"], axes["world"]) @ np.asarray(entry["target_axis"], dtype=float)
        own, other = own / np.linalg.norm(own), other / np.linalg.norm(other)
        wanted = entry["target_inner_product"]
        turning = -pin.skew(own) @ jacobian[3:]
        if abs(wanted) > 0.999:
            residuals.append(0.3 * (own - np.sign(wanted) * other))
            rows.append(0.3 * turning)
        else:
            residuals.append(np.array([0.3 * (own @ other - wanted)]))
            rows.append(0.3 * (other @ turning)[None])
    return np.concatenate(residuals), np.concatenate(rows)


def actuation_poses(problem: dict[str, Any], arm: Arm, draw: np.random.Generator) -> Iterator[Array | None]:
    """Random solutions of the constraints, without end; None for every start that leads nowhere."""
    q_current = np.asarray(problem["q_current"])
    first = True
    while True:
        q = q_current.copy()
        if not first:
            q[:7] = draw.uniform(arm.lower[:7], arm.upper[:7])
        first = False
        for _ in range(60):
            residual, rows = constraint_rows(problem, arm, q)
            if np.abs(residual).max() < 2e-5:
                break
            square = rows @ rows.T + 1e-6 * np.eye(len(residual))
            step = -rows.T @ np.linalg.solve(square, residual)
            step *= min(1.0, 0.4 / max(np.abs(step).max(), 1e-12))
            q[:7] = np.clip(q[:7] + step, arm.lower[:7], arm.upper[:7])
        hand = arm.hand_pose(q)
        inside = np.all(hand[:3, 3] >= BOX[:, 0]) and np.all(hand[:3, 3] <= BOX[:, 1])
        yield q if inside and not constraint_errors(problem, hand) else None


def between_poses(one: Keyframe, two: Keyframe) -> list[Array]:
    """Hand poses on the line or arc from one keyframe to the next, the last included."""
    start, end = one.pose, two.pose
    poses = []
    if two.turn is not None:
        center, axis, angle = two.turn
        reach = float(np.linalg.norm(start[:3, 3] - center)) + 0.2
        count = max(1, int(np.ceil(max(abs(angle) * reach / HAND_STEP, abs(angle) / TURN_STEP))))
        basis = np.linalg.svd(axis[None])[2]
        frame = np.column_stack([basis[1], basis[2], axis])
        if np.linalg.det(frame) < 0.0:
            frame[:, 0] *= -1.0
        for share in np.arange(1, count + 1) / count:
            turned = frame @ rotation("z", share * angle) @ frame.T
            pose = np.eye(4)
            pose[:3, :3] = turned @ start[:3, :3]
            pose[:3, 3] = center + turned @ (start[:3, 3] - center)
            poses.append(pose)
        return poses
    count = max(1, int(np.ceil(np.linalg.norm(end[:3, 3] - start[:3, 3]) / HAND_STEP)))
    for share in np.arange(1, count + 1) / count:
        pose = end.copy()
        pose[:3, 3] = start[:3, 3] + share * (end[:3, 3] - start[:3, 3])
        poses.append(pose)
    return poses


def follow(arm: Arm, q: Array, poses: list[Array], free: Free) -> list[Array] | None:
    """Joint path along hand poses, continuous from q; None where it leaves the limits, jumps or collides."""
    path = [q]
    for pose in poses:
        found = solve_pose(arm, path[-1], pose)
        if found is None or np.abs(found - path[-1]).max() > 0.25 or not free(found):
            return None
        path.append(found)
    return path


def edge(one: Array, two: Array, free: Free) -> bool:
    """Whether the straight joint line is free, its first point not looked at."""
    count = max(1, int(np.ceil(np.abs(two - one).max() / JOINT_STEP)))
    # From the middle outwards finds collisions sooner.
    order = sorted(range(1, count + 1), key=lambda index: abs(index - count / 2))
    return all(free(one + index / count * (two - one)) for index in order)


def rrt_connect(
    arm: Arm, start: Array, goal: Array, free: Free, draw: np.random.Generator, until: Callable[[], bool]
) -> list[Array] | None:
    """Two trees that grow towards each other in joint space.

    Args:
        arm: for its limits.
        start, goal: (9,) free configurations with the same fingers.
        free: the check.
        draw: random numbers.
        until: says when to give up.
    """
    if edge(start, goal, free):
        return [start, goal]

    def sample() -> Array:
        out = start.copy()
        out[:7] = draw.uniform(arm.lower[:7], arm.upper[:7])
        return out

    path = connect(start, goal, free, sample, until)
    return None if path is None else shorten(path, free, draw)


def connect(
    start: Array, goal: Array, free: Free, sample: Callable[[], Array], until: Callable[[], bool]
) -> list[Array] | None:
    """Search a path with two trees, one from each end; return None if ``until`` ends the search."""
    trees: list[tuple[list[Array], list[int]]] = [([start], [-1]), ([goal], [-1])]
    reach = 0.6
    turn = 0
    while not until():
        nodes, parents = trees[turn]
        new = extend(nodes, parents, sample(), free, reach)
        if new is not None:
            others, other_parents = trees[1 - turn]
            meeting = nodes[new]
            while not until():
                reached = extend(others, other_parents, meeting, free, reach)
                if reached is None:
                    break
                if np.array_equal(others[reached], meeting):
                    one = branch(nodes, parents, new)
                    two = branch(others, other_parents, reached)
                    return [*reversed(one), *two[1:]] if turn == 0 else [*reversed(two), *one[1:]]
        turn = 1 - turn
    return None


def extend(nodes: list[Array], parents: list[int], target: Array, free: Free, reach: float) -> int | None:
    """Grow a tree one step towards a target; the new node's index, or None."""
    near = int(np.argmin(((np.array(nodes) - target) ** 2).sum(axis=1)))
    difference = target - nodes[near]
    length = np.linalg.norm(difference)
    new = target if length <= reach else nodes[near] + reach / length * difference
    if length < 1e-12 or not edge(nodes[near], new, free):
        return None
    nodes.append(new)
    parents.append(near)
    return len(nodes) - 1


def branch(nodes: list[Array], parents: list[int], index: int) -> list[Array]:
    """From a node back to its root."""
    path = []
    while index >= 0:
        path.append(nodes[index])
        index = parents[index]
    return path


def shorten(path: list[Array], free: Free, draw: np.random.Generator, tries: int = 20) -> list[Array]:
    """Leave out nodes between which the straight line is free."""
    for _ in range(tries):
        if len(path) < 3:
            break
        low, high = sorted(draw.choice(len(path), 2, replace=False))
        if high - low > 1 and edge(path[low], path[high], free):
            path = [*path[: low + 1], *path[high:]]
    return path
