"""Initial state of a scene: drawn from the seed, or given by reset options; the same for every simulator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from gensim2.core.errors import InputError
from gensim2.core.seeding import rng
from gensim2.objects import RigidObject
from gensim2.objects.meshwork.convexes import ConvexBlock, depth_inside, surface_samples
from gensim2.objects.placement import work_keypoint
from gensim2.objects.types import BODY, ArticulatedObject
from gensim2.robots import RobotProfile
from gensim2.scenes.arguments import ObjectSource
from gensim2.scenes.default_pose import default_pose
from gensim2.scenes.footprint import hulls_in_root, keep_apart, keypoint_in_root, outline, square, swept_points
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

Array = npt.NDArray[np.float64]

MAX_DRAWS = 100
"""Of the placements of one scene."""
GAP = 0.02
"""Metres that footprints keep apart."""
PAPER = preset(DEFAULT_PRESET)
"""The task's own ranges."""


class PlacementError(InputError):
    """A scene's objects find no room."""


@dataclass(frozen=True)
class PlacedObject:
    """One object and its pose in the initial state.

    Attributes:
        model: the object.
        position: (3,) of its root in the world, m.
        quaternion: (4,) of its root in the world, (w, x, y, z).
        yaw: what the randomization turned it by about the vertical, rad.
        openness: of its joint, 0..1; None of a rigid object.
        default_pose: whose default pose was randomized; None: its pose was given.
        factors: by what its physics is multiplied.
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
        """Value of the joint (rad or m) at that openness; 0 of a rigid object."""
        if not isinstance(self.model, ArticulatedObject) or self.openness is None:
            return 0.0
        joint = self.model.joint
        return joint.lower + self.openness * (joint.upper - joint.lower)

    def point(self) -> Array:
        """(3,) its last keypoint in the world: the point that criteria go by."""
        if isinstance(self.model, ArticulatedObject):
            local = keypoint_in_root(self.model, list(self.model.keypoints)[-1], self.joint_value)
        else:
            local = list(self.model.keypoints.values())[-1].position
        return self.in_world(local)

    def hulls_in_world(self) -> list[Array]:
        """Vertices (N, 3) of each convex collision part in the world, m."""
        return [self.in_world(hull) for hull in hulls_in_root(self.model, self.joint_value)]

    def in_world(self, point: Array) -> Array:
        """(3,) or (N, 3) points of the root frame in the world."""
        return np.asarray(Rotation.from_quat(self.quaternion, scalar_first=True).apply(point) + self.position)


@dataclass(frozen=True)
class InitialState:
    """Sampled initial state of a scene.

    Attributes:
        objects: by name, in the task's order.
        draws: of the placements, until all kept apart, within reach and clear of the robot.
        start: (n,) all active joints of the robot.
        randomization: name of the preset that all of it was drawn with.
    """

    objects: Mapping[str, PlacedObject]
    draws: int
    start: tuple[float, ...]
    randomization: PresetName

    @property
    def has_rigid_objects(self) -> bool:
        """Whether any of them is rigid."""
        return bool(self.rigid_classes)

    @property
    def rigid_classes(self) -> tuple[str, ...]:
        """Classes of those that are rigid."""
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
    """Draw the scene of ``seed``; what ``options`` name takes the place of what was drawn.

    A single object on the table stands where it was drawn. Several are drawn again, at most ``MAX_DRAWS`` times and
    only where ``physics`` has it so, until they keep ``GAP`` apart (an articulated one with all that its joint sweeps),
    within the robot's reach, and rigid ones clear of the robot at its start. Where the preset draws that start, too, it
    is drawn again as well until the robot overlaps none of the objects (:mod:`gensim2.scenes.initial_state`). What
    options place is taken as it is.

    The task's ranges are drawn from one generator; what a preset draws besides comes from one of its own, so that no
    preset shifts what another draws.

    Args:
        task: whose ranges are drawn from.
        library: of the objects.
        instances: ids to draw from, by object.
        seed: of the reset.
        options: by object, checked.
        robot: that is to reach them.
        physics: whose default poses are randomized, and whether placements are drawn again.
        randomization: what becomes of the task's ranges, and what is drawn besides.

    Raises:
        InputError: there is no such instance, or its files cannot be used.
        PlacementError: there is no room for all of them.
    """
    generator = rng(seed, task.name)
    draws: dict[str, Draw] = {}
    models: dict[str, ArticulatedObject | RigidObject] = {}
    for name, spec in task.objects.items():
        draws[name] = draw_object(generator, spec.randomization, randomization, instances[name])
        chosen = options[name].get("instance")
        if chosen is not None and chosen not in library.choose(spec.asset_class, chosen):  # a word is no id
            raise InputError(f"{spec.asset_class} has no instance {chosen!r}", field="instance")
        models[name] = library.load(spec.asset_class, chosen or draws[name].instance, physics.hulls)
    factors, start = _vary(task, models, seed, robot, randomization)
    again = physics.redraw == "placement"
    room = _Room(task, models, options, robot, start) if again and len(models) > 1 else None
    starts = rng(seed, f"{task.name}/{randomization.name}/start") if again and randomization.varies else None
    for count in range(1, MAX_DRAWS + 1):  # the first that can stand counts where there is no room to keep
        objects = _stand_all(task, models, draws, options, physics.poses, factors)
        if objects is not None and (room is None or room.holds(objects)):
            hulls = [thing.hulls_in_world() for thing in objects.values()]
            clear = start if starts is None else clear_start(starts, start, robot, hulls)
            if clear is not None:
                return InitialState(objects, count, clear, randomization.name)
        for name, spec in task.objects.items():
            draws[name] = redraw_placement(generator, spec.randomization, randomization, draws[name])
    names = ", ".join(f"{name} ({model_id(model)})" for name, model in models.items())
    raise PlacementError(
        f"{MAX_DRAWS} draws of seed {seed} found no room for {names}",
        field="objects",
        remedy="give place.at farther apart, or other instances",
    )


def _vary(
    task: TaskSpec,
    models: Mapping[str, ArticulatedObject | RigidObject],
    seed: int,
    robot: RobotProfile,
    randomization: Preset,
) -> tuple[dict[str, Factors], tuple[float, ...]]:
    """Draw what a preset varies besides the task's ranges: factors of each object's physics, and the robot's start."""
    if not randomization.varies:
        return dict.fromkeys(task.objects, AS_IT_IS), robot.reset_qpos
    generator = rng(seed, f"{task.name}/{randomization.name}")
    factors = {name: draw_factors(generator, isinstance(model, ArticulatedObject)) for name, model in models.items()}
    return factors, draw_start(generator, robot)


def model_id(model: ArticulatedObject | RigidObject) -> str:
    """Class and id of an object, for people."""
    return model.asset_class if isinstance(model, RigidObject) else f"{model.asset_class}/{model.id}"


def _stand_all(
    task: TaskSpec,
    models: Mapping[str, ArticulatedObject | RigidObject],
    draws: Mapping[str, Draw],
    options: Mapping[str, ObjectOptions],
    poses: PhysicsSource,
    factors: Mapping[str, Factors],
) -> dict[str, PlacedObject] | None:
    """Every object where it was drawn; None where one has no room on what it stands on."""
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
    """The object where it was drawn; None where what it stands on has no room for it there."""
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
    """Whether objects that were drawn may stand together."""

    def __init__(
        self,
        task: TaskSpec,
        models: Mapping[str, ArticulatedObject | RigidObject],
        options: Mapping[str, ObjectOptions],
        robot: RobotProfile,
        start: tuple[float, ...],
    ) -> None:
        self._on = {name: spec.place.on for name, spec in task.objects.items()}
        self._drawn = {name for name in models if not {"pose", "offset"} & set(options[name])}
        self._points = {name: swept_points(model) for name, model in models.items()}
        self._base = np.array(robot.base_position)
        self._reach = robot.reach
        tool, space = robot.gripper_with(start)["tool_head"], robot.footprint
        self._base_half = space.base_half
        self._hand, self._hand_bottom = square(tool, space.hand_half), float(tool[2]) - space.hand_drop

    def holds(self, objects: Mapping[str, PlacedObject]) -> bool:
        """Whether all that was drawn keeps apart, clear of the robot at its start and within its reach."""
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
                if not keep_apart(outlines[name], outlines[other], GAP):
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
        if isinstance(thing.model, ArticulatedObject):  # its own placement sees to that
            return True
        if not keep_apart(outlines[name], square(self._base, self._base_half), GAP):
            return False
        low = thing.in_world(self._points[name])[:, 2].max() < self._hand_bottom
        return bool(low or keep_apart(outlines[name], self._hand, GAP))


MAX_STARTS = 10
"""Starts that are tried for one placement of the objects."""


def clear_start(
    generator: np.random.Generator, start: tuple[float, ...], robot: RobotProfile, hulls: Sequence[Sequence[Array]]
) -> tuple[float, ...] | None:
    """Return ``start``, or the first of those drawn after it at which the robot overlaps no object.

    Args:
        generator: of the further starts.
        start: (n,) all active joints.
        robot: that stands there.
        hulls: by object, (N, 3) vertices of its convex collision parts in the world, m.

    Returns:
        (n,) joints; None where ``MAX_STARTS`` of them overlap an object.
    """
    import gensim2_kpam as kpam  # here: specs of scenes are read without the solver

    T_base_world = np.linalg.inv(robot.T_world_base)
    bodies = [
        kpam.Body(
            f"object_{index}", "rigid", [kpam.Shape.convex_hull(np.ascontiguousarray(h)) for h in parts], T_base_world
        )
        for index, parts in enumerate(hulls)
    ]
    scene = kpam.Scene(robot.model, bodies)
    for _ in range(MAX_STARTS):
        if not scene.in_collision(np.array(start)):
            return start
        start = draw_start(generator, robot)
    return None


CLOSE = 0.0005
"""Metres by which an object reaches into what it stands on at most; physics takes that for contact."""
STEP = 0.005
"""Metres between the heights that are tried; the first that is not free is halved off down to ``CLOSE``."""
ABOVE = 0.02
"""Metres above the measured point from which an object is lowered."""


def set_down(thing: PlacedObject, support: PlacedObject) -> PlacedObject | None:
    """``thing`` lowered over the measured point of ``support`` until it touches that.

    Args:
        thing: at rest on the table, where it is to stand in x and y.
        support: what it is to stand on or in.

    Returns:
        None where there is no room above the point, or nothing to stand on below it.
    """
    blocks = [ConvexBlock.of(support.in_world(hull)) for hull in hulls_in_root(support.model, support.joint_value)]
    hulls = hulls_in_root(thing.model, thing.joint_value)
    surface = thing.in_world(np.concatenate([surface_samples(hull) for hull in hulls]))

    def is_free(height: float) -> bool:
        return bool(depth_inside(surface + np.array([0.0, 0.0, height]), blocks).max() <= CLOSE)

    free = float(support.point()[2]) + ABOVE
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
