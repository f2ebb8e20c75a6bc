"""Sample initial states of scenes from a seed and reset options, in the same way for every simulator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from gensim2.core.arrays import Array
from gensim2.core.errors import InputError
from gensim2.core.seeding import rng
from gensim2.objects import RigidObject
from gensim2.objects.meshwork.convexes import ConvexBlock, depth_inside, surface_samples
from gensim2.objects.placement import work_keypoint
from gensim2.objects.types import BODY, ArticulatedObject
from gensim2.robots import RobotProfile
from gensim2.scenes.arguments import ObjectSource
from gensim2.scenes.default_pose import default_pose
from gensim2.scenes.footprint import gap_between, hulls_in_root, keypoint_in_root, outline, square, swept_points
from gensim2.scenes.physics import DEFAULT_PHYSICS, PRESETS, PhysicsSource, PhysicsSwitches
from gensim2.scenes.randomize import (
    AS_IT_IS,
    Draw,
    Factors,
    draw_factors,
    draw_object,
    draw_start,
    openness_at_reset,
    placed,
    redraw_placement,
)
from gensim2.scenes.reset_options import ObjectOptions
from gensim2.tasks.presets import DEFAULT_PRESET, Preset, PresetName, preset
from gensim2.tasks.spec import TABLE, ObjectSpec, TaskSpec

MAX_DRAWS = 100
"""Maximum number of random placements for the same objects."""
MAX_CHOICES = 10
"""Maximum number of random choices of the objects of one scene."""
GAP = 0.02
"""Minimum gap between the outlines of two objects, m."""
PAPER = preset(DEFAULT_PRESET)
"""Randomization preset with exactly the task's ranges."""


class PlacementError(InputError):
    """The objects of a scene cannot be placed."""


@dataclass(frozen=True)
class PlacedObject:
    """An object with its pose in the initial state.

    Attributes:
        position: (3,) position of the root in the world frame, m.
        quaternion: (4,) orientation of the root in the world frame, (w, x, y, z).
        yaw: random rotation about the vertical, rad.
        openness: openness of the joint, 0..1; None for a rigid object.
        default_pose: source of the default pose that was randomized; None if the pose was given.
        factors: random factors on the object's physical properties.
    """

    model: ArticulatedObject | RigidObject
    position: Array
    quaternion: Array
    yaw: float
    openness: float | None
    default_pose: PhysicsSource | None = None
    factors: Factors = AS_IT_IS

    @property
    def joint_value(self) -> float:
        """Joint value (rad or m) at ``openness``; 0 for a rigid object."""
        if not isinstance(self.model, ArticulatedObject) or self.openness is None:
            return 0.0
        joint = self.model.joint
        return joint.lower + self.openness * (joint.upper - joint.lower)

    def point(self) -> Array:
        """Return the object's last keypoint (3,) in the world frame, the point that criteria measure."""
        if isinstance(self.model, ArticulatedObject):
            local = keypoint_in_root(self.model, list(self.model.keypoints)[-1], self.joint_value)
        else:
            local = list(self.model.keypoints.values())[-1].position
        return self.in_world(local)

    def hulls_in_world(self) -> list[Array]:
        """Return the vertices (N, 3) of each of the object's convex hulls in the world frame, m."""
        return [self.in_world(hull) for hull in hulls_in_root(self.model, self.joint_value)]

    def in_world(self, point: Array) -> Array:
        """Transform points (3,) or (N, 3) from the root frame to the world frame."""
        return np.asarray(Rotation.from_quat(self.quaternion, scalar_first=True).apply(point) + self.position)


@dataclass(frozen=True)
class InitialState:
    """Sampled initial state of a scene.

    Attributes:
        objects: objects by name, in the task's order.
        draws: number of samples until the objects were apart, within reach and clear of the robot.
        start: (n,) positions of all active joints of the robot at the start, rad or m.
    """

    objects: Mapping[str, PlacedObject]
    draws: int
    start: tuple[float, ...]
    randomization: PresetName

    @property
    def has_rigid_objects(self) -> bool:
        return bool(self.rigid_classes)

    @property
    def rigid_classes(self) -> tuple[str, ...]:
        models = (thing.model for thing in self.objects.values())
        return tuple(model.asset_class for model in models if isinstance(model, RigidObject))


def sample_initial_state(
    task: TaskSpec,
    library: ObjectSource,
    instances: Mapping[str, Sequence[str]],
    seed: int,
    options: Mapping[str, ObjectOptions],
    robot: RobotProfile,
    physics: PhysicsSwitches = PRESETS[DEFAULT_PHYSICS],
    randomization: Preset = PAPER,
) -> InitialState:
    """Sample the initial state of a scene. Values given in ``options`` replace the sampled values.

    If ``physics`` allows, placements are sampled up to ``MAX_DRAWS`` times. In an accepted placement, the robot
    overlaps no object at its start. Several objects are ``GAP`` apart, including the space of their moving parts, and
    within reach, and rigid objects are clear of the robot's space. If no placement is accepted, other objects are
    chosen, up to ``MAX_CHOICES`` times. ``options`` stay fixed. A random start of the robot is sampled again, too.

    A second generator samples the additional values of a preset, so that the task's values do not depend on the preset.

    Args:
        task: task with the ranges.
        instances: ids to choose from, by object.
        seed: seed of the reset.
        options: checked reset options by object.
        physics: physics settings, which determine the default poses and whether placements are sampled repeatedly.
        randomization: preset, which scales the task's ranges and may randomize additional values.

    Raises:
        InputError: an instance does not exist, or its files cannot be used.
        PlacementError: the objects cannot be placed.
    """
    generator = rng(seed, task.name)
    again = physics.redraw == "placement"
    sampled = [name for name in task.objects if options[name].get("instance") is None and len(instances[name]) > 1]
    choices = MAX_CHOICES if again and sampled else 1
    for choice in range(choices):
        draws: dict[str, Draw] = {}
        models: dict[str, ArticulatedObject | RigidObject] = {}
        for name, spec in task.objects.items():
            draws[name] = draw_object(generator, spec.randomization, randomization, instances[name])
            chosen = options[name].get("instance")
            # ``chosen`` must be an id. A word such as ``train`` selects ids but is not an id itself, so it is rejected.
            if chosen is not None and chosen not in library.choose(spec.asset_class, chosen):
                raise InputError(f"{spec.asset_class} has no instance {chosen!r}", field="instance")
            models[name] = library.load(spec.asset_class, chosen or draws[name].instance, physics.hulls)
        factors, start = _vary(task, models, seed, robot, randomization)
        room = _Room(task, models, options, robot, start) if again and len(models) > 1 else None
        starts = rng(seed, f"{task.name}/{randomization.name}/start") if again and randomization.varies else None
        checked = [name for name in models if again and (starts is not None or _is_drawn(options[name]))]
        for count in range(1, MAX_DRAWS + 1):
            objects = _stand_all(task, models, draws, options, physics.poses, factors)
            if objects is not None and (room is None or room.holds(objects)):
                hulls = [objects[name].hulls_in_world() for name in checked]
                clear = clear_start(starts, start, robot, hulls) if checked else start
                if clear is not None:
                    return InitialState(objects, choice * MAX_DRAWS + count, clear, randomization.name)
            for name, spec in task.objects.items():
                draws[name] = redraw_placement(generator, spec.randomization, randomization, draws[name])
    names = ", ".join(f"{name} ({model_id(model)})" for name, model in models.items())
    raise PlacementError(
        f"none of {choices * MAX_DRAWS} random placements with seed {seed} leaves enough space, the last for {names}",
        field="objects",
        remedy="move the positions in place.at farther apart, or choose other instances",
    )


def _is_drawn(options: ObjectOptions) -> bool:
    """Return whether the placement of an object is sampled, and not given in the reset options."""
    return not {"pose", "offset"} & set(options)


def _vary(
    task: TaskSpec,
    models: Mapping[str, ArticulatedObject | RigidObject],
    seed: int,
    robot: RobotProfile,
    randomization: Preset,
) -> tuple[dict[str, Factors], tuple[float, ...]]:
    """Sample the mass and friction factors of the objects and the start configuration of the robot for a preset."""
    if not randomization.varies:
        return dict.fromkeys(task.objects, AS_IT_IS), robot.reset_qpos
    generator = rng(seed, f"{task.name}/{randomization.name}")
    factors = {name: draw_factors(generator, isinstance(model, ArticulatedObject)) for name, model in models.items()}
    return factors, draw_start(generator, robot)


def model_id(model: ArticulatedObject | RigidObject) -> str:
    """Return class and id of an object for error messages."""
    return model.asset_class if isinstance(model, RigidObject) else f"{model.asset_class}/{model.id}"


def _stand_all(
    task: TaskSpec,
    models: Mapping[str, ArticulatedObject | RigidObject],
    draws: Mapping[str, Draw],
    options: Mapping[str, ObjectOptions],
    poses: PhysicsSource,
    factors: Mapping[str, Factors],
) -> dict[str, PlacedObject] | None:
    """Place every object with its sampled offset; return None if an object does not fit on its support."""
    objects: dict[str, PlacedObject] = {}
    for name, spec in task.objects.items():
        thing = _stand(spec, models[name], draws[name], options[name], objects, poses)
        if thing is None:
            return None
        objects[name] = replace(thing, factors=factors[name])
    return objects


def _stand(
    spec: ObjectSpec,
    model: ArticulatedObject | RigidObject,
    draw: Draw,
    options: ObjectOptions,
    before: Mapping[str, PlacedObject],
    poses: PhysicsSource,
) -> PlacedObject | None:
    """Place an object with its sampled offset; return None if the object does not fit on its support."""
    openness = None
    default = default_pose(model, poses)
    if isinstance(model, ArticulatedObject):
        given = options.get("openness")
        mean = openness_at_reset(spec.randomization, draw, default.openness)
        openness = mean if given is None else float(given)
    elif "openness" in options:
        raise InputError(f"{model.asset_class} has no joint", field="openness")
    if "pose" in options:
        pose = np.asarray(options["pose"], dtype=np.float64)
        return PlacedObject(model, pose[:3], pose[3:], 0.0, openness)
    x, y, yaw = map(float, options.get("offset", (draw.x, draw.y, draw.yaw)))
    position = np.array(default.position, dtype=np.float64)
    support = None if spec.place.on == TABLE else before[spec.place.on]
    if spec.place.at is not None:
        position[:2] = spec.place.at
    elif support is not None:
        position[:2] = support.point()[:2]
    quaternion = default.quaternion
    if spec.place.yaw:
        _, quaternion = placed(position, quaternion, 0.0, 0.0, spec.place.yaw)
    thing = PlacedObject(model, *placed(position, quaternion, x, y, yaw), yaw, openness, default.origin)
    return thing if support is None else set_down(thing, support)


class _Room:
    def __init__(
        self,
        task: TaskSpec,
        models: Mapping[str, ArticulatedObject | RigidObject],
        options: Mapping[str, ObjectOptions],
        robot: RobotProfile,
        start: tuple[float, ...],
    ) -> None:
        self._on = {name: spec.place.on for name, spec in task.objects.items()}
        self._drawn = {name for name in models if _is_drawn(options[name])}
        self._points = {name: swept_points(model) for name, model in models.items()}
        self._base = np.array(robot.base_position)
        self._reach = robot.reach
        tool, space = robot.gripper_with(start)["tool_head"], robot.footprint
        self._base_half = space.base_half
        self._hand, self._hand_bottom = square(tool, space.hand_half), float(tool[2]) - space.hand_drop

    def holds(self, objects: Mapping[str, PlacedObject]) -> bool:
        """Return whether the placed objects are apart, clear of the robot's start and within its reach."""
        outlines = {
            name: outline(self._points[name], thing.position, thing.quaternion) for name, thing in objects.items()
        }
        names = list(objects)
        for index, name in enumerate(names):
            if name in self._drawn and not (self._is_near(objects[name]) and self._is_clear(name, objects, outlines)):
                return False
            for other in names[:index]:
                if not {name, other} & self._drawn or self._supports(other, name):
                    continue
                if gap_between(outlines[name], outlines[other]) < GAP:
                    return False
        return True

    def _supports(self, below: str, above: str) -> bool:
        while above in self._on:
            above = self._on[above]
            if above == below:
                return True
        return False

    def _is_near(self, thing: PlacedObject) -> bool:
        if isinstance(thing.model, ArticulatedObject):
            head = keypoint_in_root(
                thing.model, work_keypoint(thing.model.keypoints, thing.model.joint.child_link), thing.joint_value
            )
        else:
            head = np.concatenate(thing.model.hulls[BODY]).mean(axis=0)
        return bool(np.linalg.norm((thing.in_world(head) - self._base)[:2]) <= self._reach)

    def _is_clear(self, name: str, objects: Mapping[str, PlacedObject], outlines: Mapping[str, Array]) -> bool:
        thing = objects[name]
        # Default poses and placement ranges already keep articulated objects away from the robot.
        if isinstance(thing.model, ArticulatedObject):
            return True
        if gap_between(outlines[name], square(self._base, self._base_half)) < GAP:
            return False
        low = thing.in_world(self._points[name])[:, 2].max() < self._hand_bottom
        return bool(low or gap_between(outlines[name], self._hand) >= GAP)


MAX_STARTS = 10
"""Number of robot starts that are tried for one placement of the objects."""


def clear_start(
    generator: np.random.Generator | None,
    start: tuple[float, ...],
    robot: RobotProfile,
    hulls: Sequence[Sequence[Array]],
) -> tuple[float, ...] | None:
    """Return a start configuration in which the robot overlaps no object: ``start`` if possible, or else a random one.

    Args:
        generator: generator of the random joints; None: only ``start`` is tested.
        start: (n,) first start joints to test: all active joints, rad or m.
        hulls: for each object, the vertices (N, 3) of its convex hulls in the world frame, m.

    Returns:
        Start joints (n,), rad or m; None if the robot overlaps an object at each of ``MAX_STARTS`` tested starts.
    """
    import gensim2_kpam as kpam  # imported here: reading scenes does not need the solver

    T_base_world = np.linalg.inv(robot.T_world_base)
    bodies = [
        kpam.Body(
            f"object_{index}", "rigid", [kpam.Shape.convex_hull(np.ascontiguousarray(h)) for h in parts], T_base_world
        )
        for index, parts in enumerate(hulls)
    ]
    scene = kpam.Scene(robot.model, bodies)
    if generator is None and kpam.Scene(robot.model, []).in_collision(np.array(start)):
        return start  # The links overlap each other, which says nothing about the objects.
    for _ in range(MAX_STARTS):
        if not scene.in_collision(np.array(start)):
            return start
        if generator is None:
            break
        start = draw_start(generator, robot)
    return None


CLOSE = 0.0005
"""Maximum overlap (m) of an object with its support; physics treats the overlap as contact."""
STEP = 0.005
"""Step (m) between tried heights. The first blocked step is then refined by bisection to ``CLOSE``."""
ABOVE = 0.02
"""Height (m) above the measured point from which an object is lowered."""


def set_down(thing: PlacedObject, support: PlacedObject, above: float = ABOVE) -> PlacedObject | None:
    """Lower an object from above the last keypoint of its support, which the criteria measure, until it touches.

    Args:
        thing: object in its resting pose on the table. The function changes only its height.
        support: the object that ``thing`` will stand on or in.
        above: height (m) above the keypoint where the movement starts.

    Returns:
        The lowered object, or None if the object does not fit above the keypoint or if nothing below supports it.
    """
    blocks = [ConvexBlock.of(support.in_world(hull)) for hull in hulls_in_root(support.model, support.joint_value)]
    hulls = hulls_in_root(thing.model, thing.joint_value)
    surface = thing.in_world(np.concatenate([surface_samples(hull) for hull in hulls]))

    def is_free(height: float) -> bool:
        return bool(depth_inside(surface + np.array([0.0, 0.0, height]), blocks).max() <= CLOSE)

    free = float(support.point()[2]) + above
    if not is_free(free):
        return None
    while is_free(free - STEP):
        free -= STEP
        if free < 0.0:
            return None
    touching = free - STEP
    while free - touching > CLOSE:
        middle = (free + touching) / 2
        free, touching = (middle, touching) if is_free(middle) else (free, middle)
    return replace(thing, position=thing.position + np.array([0.0, 0.0, free]))
