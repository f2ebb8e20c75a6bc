"""Random complete problems (arm, scene, start velocity, held object, moving joint) for the solver and the checker."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import coal
import numpy as np
from constraints import parallel, point_to_point
from contacts import Hinge, Obstacle
from mechanism import Mechanism
from parts import Part, part, shape_distance, transform
from recheck import Question

import gensim2_kpam as kpam
from gensim2.core import seeding

from .random_arms import RandomArm, random_arm
from .six_arms import ARMS, six_arm

Array = np.ndarray


@dataclass
class Solid:
    """A shape for the solver and the checker; a cloud has ``points`` with its size as their radius."""

    kind: str
    size: list[float]
    points: Array | None = None

    def ours(self) -> list[kpam.Shape]:
        """Return it for the solver."""
        if self.points is not None:
            return [kpam.Shape.point_cloud(self.points, self.size[0])]
        if self.kind == "box":
            return [kpam.Shape.box(self.size)]
        if self.kind == "sphere":
            return [kpam.Shape.sphere(self.size[0])]
        make = kpam.Shape.capsule if self.kind == "capsule" else kpam.Shape.cylinder
        return [make(self.size[0], self.size[1])]

    def theirs(self) -> list[Part]:
        """Return it for the checker."""
        if self.points is not None:
            poses = np.tile(np.eye(4), (len(self.points), 1, 1))
            poses[:, :3, 3] = self.points
            return [part(coal.Sphere(self.size[0]), pose) for pose in poses]
        if self.kind == "box":
            return [part(coal.Box(*(2.0 * np.array(self.size))), np.eye(4))]
        if self.kind == "sphere":
            return [part(coal.Sphere(self.size[0]), np.eye(4))]
        make = coal.Capsule if self.kind == "capsule" else coal.Cylinder
        return [part(make(self.size[0], self.size[1]), np.eye(4))]

    def as_cloud(self, draw: np.random.Generator, radius: float = 0.01) -> Solid:
        """Return points with a radius on the faces of this box."""
        half = np.array(self.size)
        points = draw.uniform(-half, half, (int(draw.integers(40, 120)), 3))
        axis = draw.integers(0, 3, len(points))
        rows = np.arange(len(points))
        points[rows, axis] = np.sign(points[rows, axis]) * half[axis]
        return Solid("cloud", [radius], points)


@dataclass
class Thing:
    """A body of the scene: a solid at a pose in the base frame, or in the hand frame if it is attached."""

    name: str
    role: str
    solid: Solid
    pose: Array


@dataclass
class RandomProblem:
    """A problem as plain values; :meth:`ours` is the solver's problem and :meth:`question` the checker's."""

    number: int
    arm: RandomArm
    mechanism: Mechanism
    config: dict[str, Any]
    q_start: Array
    keypoints: dict[str, Array]
    T_base_object: Array
    joint: tuple[str, Array, Array, float, float, float] | None
    things: list[Thing]
    start_velocity: Array
    acceleration: float
    jerk: float
    options: dict[str, Any] = field(default_factory=dict)

    def ours(self, folder: Path) -> kpam.KeypointProblem:
        """Return the solver's problem; the URDF is written to ``folder``."""
        robot = robot_of(self.arm, folder)
        count = len(self.q_start)
        return kpam.KeypointProblem(
            robot,
            kpam.SolverConfig(self.config),
            self.q_start,
            tool_keypoints={"tip": self.arm.tip, "behind": self.arm.tip - [0.0, 0.0, 0.05]},
            object_keypoints=self.keypoints,
            T_base_object=self.T_base_object,
            joint=None if self.joint is None else kpam.Joint(*self.joint),  # type: ignore[arg-type]
            object_axis="z",
            bodies=[
                kpam.Body(thing.name, thing.role, thing.solid.ours(), thing.pose)  # type: ignore[arg-type]
                for thing in self.things
            ],
            options={  # type: ignore[arg-type]
                "velocity_scale": 1.0,
                "acceleration_scale": 1.0,
                "velocity_limits": self.mechanism.velocity,
                "acceleration_limits": np.full(count, self.acceleration),
                "jerk_limits": np.full(count, self.jerk),
                "workspace": None,
                "num_seeds": 12,
                "candidates": 6,
                "extra_seeds": 12,
                "samples": 200,
                **({"start_velocity": self.start_velocity} if self.start_velocity.any() else {}),
                **self.options,
            },
        )

    def question(self) -> Question:
        """Return the same problem for the checker."""
        count = len(self.q_start)
        return Question(
            self.mechanism,
            self.q_start,
            self.mechanism.velocity,
            np.full(count, self.acceleration),
            np.full(count, self.jerk),
            self.start_velocity,
            np.zeros(count),
            [Obstacle(thing.name, thing.role, thing.solid.theirs(), thing.pose) for thing in self.things],
            gripper=self.config["gripper"],
            let_go=self.config.get("let_go", 0.0),
            hinge=None if self.joint is None else Hinge(self.joint[0] == "revolute", self.joint[1], self.joint[2]),
            contact=self.arm.tip,
            after=self.config["post_actuation_motions"],
            margin=self.options.get("margin", 0.005),
            contact_depth=self.options.get("contact_depth", 0.003),
        )


@cache
def known_robot(file: Path, hand: str, srdf: Path | None) -> kpam.Robot:
    """Return the robot of a file, which is read once."""
    return kpam.Robot.from_urdf(file, hand_link=hand, srdf=srdf)


def robot_of(arm: RandomArm, folder: Path) -> kpam.Robot:
    """Return the solver's robot; a URDF without a file is written to ``folder``."""
    if arm.file is not None:
        return known_robot(arm.file, arm.hand, arm.srdf)
    path = folder / "arm.urdf"
    path.write_text(arm.urdf)
    return kpam.Robot.from_urdf(path, hand_link=arm.hand)


def random_problem(number: int) -> RandomProblem:
    """Return problem ``number`` of a fixed sequence, each with its own arm."""
    draw = seeding.rng(number, "random problems")
    arm = random_arm(draw)
    return problem_on(arm, Mechanism(arm.urdf, Path(), arm.hand), number, draw)


def arm_problem(number: int, robots: Path) -> RandomProblem:
    """Return problem ``number`` of a fixed sequence on six arms in turn; some obstacles are clouds."""
    arm, mechanism = six_arm(ARMS[number % len(ARMS)], robots)
    problem = problem_on(arm, mechanism, number, seeding.rng(number, "problems on six arms"))
    draw = seeding.rng(number, "clouds")
    for thing in problem.things:
        if thing.role in ("rigid", "object_body") and thing.solid.kind == "box" and draw.random() < 0.5:
            # Its points extend beyond the box by their radius.
            thing.solid = thing.solid.as_cloud(draw, 0.004)
    if problem.start_velocity.any() and draw.random() < 0.2:
        # Put a joint exactly at its limit, which may be rounded.
        shares = np.abs(problem.start_velocity) / mechanism.velocity
        problem.start_velocity = problem.start_velocity / shares.max()
        if draw.random() < 0.5:
            problem.start_velocity = problem.start_velocity.astype(np.float32).astype(np.float64)
    return problem


def problem_on(arm: RandomArm, mechanism: Mechanism, number: int, draw: np.random.Generator) -> RandomProblem:
    """Return a problem for an arm; ``number`` seeds the parts that were added to the generator later."""
    q_start = start(draw, mechanism)
    things = [Thing("table", "table", Solid("box", [1.5, 1.5, 0.02]), at([0.0, 0.0, -0.021]))]
    if draw.random() < 0.3:
        grip = at(arm.tip + np.array([0.0, 0.0, 0.03]))
        things.append(Thing("held", "attached", solid(draw, 0.015, 0.05), grip))
    q_goal = goal(draw, mechanism, q_start, things)
    hand = mechanism.hand_poses(q_goal)[0]
    point = hand[:3, :3] @ arm.tip + hand[:3, 3]
    independent = sorted(mechanism.movers(arm.hand))
    config: dict[str, Any] = {
        "constraint_list": [point_to_point("tip", "goal", 1e-3 if len(independent) > 2 else 0.02)]
    }
    if len(independent) > 4 and draw.random() < 0.6:
        config["constraint_list"].append(
            parallel("behind", "tip", hand[:3, 2].tolist(), float(draw.choice([0.05, 0.3])))
        )
    T_base_object, joint = moving_joint(draw, mechanism, q_goal)
    config |= motions(draw, mechanism, joint is not None)
    config["gripper"] = str(draw.choice(["open", "closed", "grasp"]))
    config |= letting_go(seeding.rng(number, "letting go"), mechanism)
    options: dict[str, Any] = {}
    if draw.random() < 0.1:
        times = np.cumsum(draw.uniform(3.0, 6.0, 8)).round(2).tolist()
        before, after = len(config["pre_actuation_motions"]), len(config["post_actuation_motions"])
        config["pre_actuation_times"], config["actuation_time"] = times[:before], times[before]
        config["post_actuation_times"] = times[before + 1 : before + 1 + after]
    if draw.random() < 0.3:
        options["allow_partial"] = True
    # The target point is inside most of the objects that may be touched.
    more = seeding.rng(number, "margins")
    options["contact_depth"] = 0.003 if more.random() < 0.3 else None
    options["start_depth"] = 1.0
    options["margin"] = float(more.choice([0.005, 0.005, 0.002, 0.02]))
    if joint is not None and draw.random() < 0.6:
        things.append(Thing("flap", "moving_link", solid(draw, 0.01, 0.06), at(point)))
    elif draw.random() < 0.3:
        things.append(Thing("goal", "target", solid(draw, 0.01, 0.04), at(point)))
    things += scene(draw, mechanism, q_start, q_goal)
    velocity = start_velocity(draw, mechanism, q_start)
    acceleration = float(np.exp(draw.uniform(np.log(2.0), np.log(20.0))))
    jerk = acceleration * float(np.exp(draw.uniform(np.log(5.0), np.log(300.0))))
    return RandomProblem(
        number,
        arm,
        mechanism,
        config,
        q_start,
        {"goal": point},
        T_base_object,
        joint,
        things,
        velocity,
        acceleration,
        jerk,
        options,
    )


def at(point: Any) -> Array:
    """Return a pose without rotation."""
    pose = np.eye(4)
    pose[:3, 3] = point
    return pose


def solid(draw: np.random.Generator, least: float, limit: float) -> Solid:
    kind = str(draw.choice(["box", "sphere", "capsule", "cylinder"]))
    count = {"box": 3, "sphere": 1, "capsule": 2, "cylinder": 2}[kind]
    return Solid(kind, draw.uniform(least, limit, count).tolist())


def ranges(mechanism: Mechanism) -> tuple[Array, Array]:
    """Return ranges (n,) of independent joints in which their mimics keep their limits; half a turn if continuous."""
    lower, upper = np.maximum(mechanism.lower, -3.0), np.minimum(mechanism.upper, 3.0)
    for follower, coupling in mechanism.couplings.items():
        if not np.isfinite(mechanism.lower[follower]):
            continue
        ends = (np.array([mechanism.lower[follower], mechanism.upper[follower]]) - coupling.offset) / coupling.factor
        lower[coupling.source] = max(lower[coupling.source], ends.min())
        upper[coupling.source] = min(upper[coupling.source], ends.max())
    return lower, np.maximum(lower, upper)


def configuration(draw: np.random.Generator, mechanism: Mechanism) -> Array:
    """Return joints within all limits."""
    lower, upper = ranges(mechanism)
    return mechanism.coupled(draw.uniform(lower, upper))


def free(mechanism: Mechanism, q: Array, things: list[Thing], room: float) -> bool:
    """Return whether no checked pair is nearer than ``room``; attached objects are left out."""
    placed = {name: poses[0] for name, poses in mechanism.place(q[None]).items()}

    def apart(ones: list[Part], at_one: Array, twos: list[Part], at_two: Array) -> bool:
        return all(
            shape_distance(a.shape, transform(at_one @ a.pose), b.shape, transform(at_two @ b.pose)) > room
            for a in ones
            for b in twos
        )

    return all(
        apart(mechanism.parts[one], placed[one], mechanism.parts[two], placed[two]) for one, two in mechanism.self_pairs
    ) and all(
        apart(mechanism.parts[name], placed[name], thing.solid.theirs(), thing.pose)
        for thing in things
        if thing.role != "attached"
        for name in mechanism.moving_links
    )


def start(draw: np.random.Generator, mechanism: Mechanism) -> Array:
    """Return joints at the start: within the limits or sometimes at one; continuous joints may be a turn further."""
    table = [Thing("table", "table", Solid("box", [1.5, 1.5, 0.02]), at([0.0, 0.0, -0.021]))]
    q = configuration(draw, mechanism)
    for _ in range(15):
        if free(mechanism, q, table, 0.005):
            break
        q = configuration(draw, mechanism)
    if draw.random() < 0.15:
        lower, upper = ranges(mechanism)
        joint = int(draw.choice(sorted(mechanism.movers(mechanism.hand_link))))
        q[joint] = (upper if draw.random() < 0.5 else lower)[joint]
    if draw.random() < 0.2:
        for joint in mechanism.movers(mechanism.hand_link):
            if not any(np.isfinite(mechanism.lower[each]) for each in followers(mechanism, joint)):
                q[joint] += 2.0 * np.pi * draw.integers(-3, 4)
    return mechanism.coupled(q)


def followers(mechanism: Mechanism, joint: int) -> list[int]:
    """Return a joint and its mimics."""
    return [joint, *(each for each, coupling in mechanism.couplings.items() if coupling.source == joint)]


def goal(draw: np.random.Generator, mechanism: Mechanism, q_start: Array, things: list[Thing]) -> Array:
    """Return joints at the actuation pose, free of collisions if one of twenty draws is."""
    share = float(draw.uniform(0.2, 1.0))
    q = q_start
    lower, upper = ranges(mechanism)
    for _ in range(20):
        q = q_start + share * (configuration(draw, mechanism) - q_start)
        q = mechanism.coupled(np.clip(q, lower, upper))
        if free(mechanism, q, things, 0.003):
            break
    return q


def scene(draw: np.random.Generator, mechanism: Mechanism, q_start: Array, q_goal: Array) -> list[Thing]:
    """Return up to five objects that do not collide at start and goal."""
    found: list[Thing] = []
    for index in range(int(draw.integers(0, 6))):
        thing = Thing(
            f"thing{index}", str(draw.choice(["rigid", "object_body"])), solid(draw, 0.02, 0.15), at(place(draw))
        )
        if all(free_of(mechanism, q, thing) for q in (q_start, q_goal)):
            found.append(thing)
    return found


def place(draw: np.random.Generator) -> Array:
    """Return a position within the arm's reach."""
    direction = draw.normal(size=3)
    direction[2] = abs(direction[2])
    return draw.uniform(0.25, 0.9) * direction / np.linalg.norm(direction) + [0.0, 0.0, 0.15]


def free_of(mechanism: Mechanism, q: Array, thing: Thing) -> bool:
    """Return whether the robot keeps 5 mm from an object."""
    placed, shape = mechanism.place(q[None]), thing.solid.theirs()[0].shape
    return all(
        shape_distance(each.shape, transform(placed[name][0] @ each.pose), shape, transform(thing.pose)) > 0.005
        for name in mechanism.moving_links
        for each in mechanism.parts[name]
    )


def moving_joint(
    draw: np.random.Generator, mechanism: Mechanism, q_goal: Array
) -> tuple[Array, tuple[str, Array, Array, float, float, float] | None]:
    """Return the object frame and, half of the time, a joint of the object.

    Its axis is one of the arm's own at the goal. If the arm has few joints, it is that of the first one, which the arm
    can always follow.
    """
    placed = mechanism.place(q_goal[None])
    carriers = [link for link in mechanism.links if link.joint in mechanism.movers(mechanism.hand_link)]
    link = carriers[int(draw.integers(len(carriers)))] if able(mechanism) else carriers[0]
    frame, joint = placed[link.name][0], mechanism.joints[link.joint]
    axis = frame[:3, :3] @ joint.axis
    side = np.linalg.svd(axis[None])[2][1]
    T_base_object = np.eye(4)
    T_base_object[:3, :3] = np.column_stack([side, np.cross(axis, side), axis])
    T_base_object[:3, 3] = frame[:3, 3]
    if draw.random() < 0.5:
        return T_base_object, None
    kind = "revolute" if joint.turns else "prismatic"
    return T_base_object, (kind, frame[:3, 3].copy(), axis, 0.0, -1.0, 1.0)


def able(mechanism: Mechanism) -> bool:
    """Return whether the arm can keep an orientation."""
    return len(mechanism.movers(mechanism.hand_link)) >= 6


def swings(mechanism: Mechanism) -> bool:
    """Return whether the joint next to the base turns only the whole arm."""
    first = next(link.joint for link in mechanism.links if link.joint >= 0)
    alone = first not in mechanism.couplings and len(followers(mechanism, first)) == 1
    return alone and mechanism.joints[first].turns


def motions(draw: np.random.Generator, mechanism: Mechanism, jointed: bool) -> dict[str, Any]:
    """Return motions before and after; arms that cannot keep an orientation only turn about the object's axis."""

    def step(scale: float = 1.0) -> float:
        return scale * float(draw.choice([-1.0, 1.0]) * draw.uniform(0.02, 0.06))

    before: list[Any] = []
    after: list[Any] = []
    for _ in range(int(draw.integers(0, 3))):
        if able(mechanism):
            before.append([f"translate_{draw.choice(['x', 'y', 'z'])}", step()] if draw.random() < 0.8 else "move-up")
        elif swings(mechanism):
            before.append(["rotate", step(3.0)])
    for _ in range(int(draw.integers(0, 3))):
        choice = draw.random()
        if jointed and choice < 0.5 and (able(mechanism) or swings(mechanism)):
            after.append(["follow_joint", step(4.0)])
        elif jointed and able(mechanism) and choice < 0.7:
            after.append(["trace_joint", step(2.0)])
        elif able(mechanism):
            after.append([f"translate_{draw.choice(['x', 'y', 'z'])}", step()])
        elif swings(mechanism):
            after.append(["rotate", step(3.0)])
    return {"pre_actuation_motions": before, "post_actuation_motions": after}


def letting_go(draw: np.random.Generator, mechanism: Mechanism) -> dict[str, Any]:
    """Return what happens to a held object; arms that can keep an orientation may move back from it."""
    found: dict[str, Any] = {}
    if draw.random() < 0.3:
        found["gripper"] = str(draw.choice(["hold", "release"]))
    if able(mechanism) and draw.random() < 0.4:
        found["let_go"] = float(draw.uniform(0.01, 0.08))
    return found


def start_velocity(draw: np.random.Generator, mechanism: Mechanism, q_start: Array) -> Array:
    """Return joint velocities within their limits, consistent for mimics; at rest three times in five."""
    velocity = np.zeros(len(q_start))
    if draw.random() < 0.6:
        return velocity
    share = float(draw.choice([0.1, 0.5, 0.95]))
    for joint in mechanism.movers(mechanism.hand_link):
        velocity[joint] = share * draw.uniform(-1.0, 1.0) * mechanism.velocity[joint]
    for follower, coupling in mechanism.couplings.items():
        wanted = coupling.factor * velocity[coupling.source]
        if abs(wanted) > share * mechanism.velocity[follower]:
            velocity[coupling.source] *= share * mechanism.velocity[follower] / abs(wanted)
    for follower, coupling in mechanism.couplings.items():
        velocity[follower] = coupling.factor * velocity[coupling.source]
    return velocity
