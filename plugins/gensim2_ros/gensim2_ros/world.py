"""The world of a planning scene: collision objects, attached objects, the octomap, clouds and frames."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

import gensim2_kpam as kpam

from .arm import Arm
from .collision_matrix import AllowedCollisions
from .points import cloud_points, occupied_cells
from .poses import Array, inverse, matrix, transform
from .refusals import ErrorCode, RefusedError
from .shapes import Part, parts_of

ADD, REMOVE, APPEND, MOVE = 0, 1, 2, 3
#: Names of the octomap (MoveIt's) and of the point cloud among the bodies.
OCTOMAP, CLOUD = "<octomap>", "<cloud>"
#: Points and cells of the octomap further from the base than this (m) along an axis are left out, because no arm on a
#: fixed base gets there.
REACH = 100.0


@dataclass(frozen=True)
class Item:
    """A collision object.

    Attributes:
        name: id of the object.
        pose: (4, 4) in the planning frame, or in the frame of ``link`` if the object is attached.
        parts: shapes with their poses in the object's frame.
        subframes: poses (4, 4) of named frames in the object's frame.
        link: link to which the object is attached.
    """

    name: str
    pose: Array
    parts: tuple[Part, ...]
    subframes: Mapping[str, Array] = field(default_factory=dict)
    link: str | None = None


@dataclass(frozen=True)
class World:
    """Objects and frames around an arm. Every method that changes the world returns a new one.

    Example:
        ```python
        world = World(arm).updated(planning_scene, q)
        scene = world.scene(q)  # of the solver
        ```
    """

    arm: Arm
    items: Mapping[str, Item] = field(default_factory=dict)
    transforms: Mapping[str, Array] = field(default_factory=dict)
    matrix: AllowedCollisions = field(default_factory=AllowedCollisions)
    octomap: kpam.Body | None = None
    cloud: kpam.Body | None = None

    def updated(self, scene: Any, q: Array) -> World:
        """Return the world after a ``moveit_msgs/msg/PlanningScene``, which replaces it or is a difference to it.

        The robot state comes before the objects of the world, as in MoveIt, so that one message can detach an object
        and give it a new pose.

        Args:
            scene: the message. Its robot state must have been applied to ``q``.
            q: (n,) current joints, for frames of moving links.

        Raises:
            RefusedError: the scene needs something that the solver cannot do; names the field.
        """
        if scene.robot_model_name not in ("", self.arm.robot.name):
            raise RefusedError(
                ErrorCode.INVALID_ROBOT_STATE,
                "robot_model_name",
                f"{scene.robot_model_name!r} is another robot than {self.arm.robot.name!r}",
            )
        for k, each in enumerate(scene.link_padding):
            _must_be(float(each.padding), 0.0, f"link_padding[{k}].padding")
        for k, each in enumerate(scene.link_scale):
            _must_be(float(each.scale), 1.0, f"link_scale[{k}].scale")
        world = self if scene.is_diff else World(self.arm, items=self.items, cloud=self.cloud)
        world = world._with_transforms(scene.fixed_frame_transforms, q)
        world = world.with_state(scene.robot_state, "robot_state", q)
        if not scene.is_diff:
            world = replace(world, items=world._attached())
        if len(scene.allowed_collision_matrix.entry_names) or len(scene.allowed_collision_matrix.default_entry_names):
            allowed = AllowedCollisions.from_message(scene.allowed_collision_matrix, "allowed_collision_matrix")
            allowed.check(self.arm.unchecked)
            world = replace(world, matrix=allowed)
        for k, message in enumerate(scene.world.collision_objects):
            world = world._with_object(message, f"world.collision_objects[{k}]", q)
        if scene.world.octomap.octomap.id:
            world = world._with_octomap(scene.world.octomap, q)
        if world.items is not self.items or world.octomap is not self.octomap:
            # Bodies that the solver does not accept are refused now, not in the next plan.
            world.scene(np.nan_to_num(q))
        return world

    def with_state(self, state: Any, where: str, q: Array) -> World:
        """Return the world after the attached objects of a ``moveit_msgs/msg/RobotState``.

        As in MoveIt, a state that has joints and is no difference removes all attached objects that it does not name.
        """
        world = self
        if state.joint_state.name and not state.is_diff:
            world = replace(world, items={name: item for name, item in self.items.items() if item.link is None})
        for k, message in enumerate(state.attached_collision_objects):
            world = world._with_attached(message, f"{where}.attached_collision_objects[{k}]", q)
        return world

    def with_cloud(self, message: Any, radius: float, q: Array) -> World:
        """Return the world with the points of a ``sensor_msgs/msg/PointCloud2`` as spheres.

        Points within 2 cm of the robot at joints ``q`` (n,) or of attached objects are left out, and so are points
        more than 100 m away along an axis of the base. The cloud replaces the cloud before.

        Args:
            message: the cloud.
            radius: radius of the spheres, m.
            q: (n,) joints at the time of the cloud.
        """
        pose = self.frame(message.header.frame_id, q, "header.frame_id")
        points = cloud_points(message) @ pose[:3, :3].T + pose[:3, 3]
        points = points[np.abs(points).max(axis=1, initial=0.0) <= REACH]
        points = points[~replace(self, octomap=None, cloud=None).scene(q).own_points(q, points)]
        if not len(points):
            return replace(self, cloud=None)
        spheres = _within("data", lambda: kpam.Shape.point_cloud(points, radius))
        return replace(self, cloud=kpam.Body(CLOUD, "rigid", [spheres], np.eye(4)))

    def frame(self, name: str, q: Array, where: str) -> Array:
        """Return the pose (4, 4) of a frame in the planning frame: a link, an object, ``object/subframe``, or a fixed
        transform of the planning scene. An empty name is the planning frame.

        Raises:
            RefusedError: the frame is unknown, or a joint above it has no value.
        """
        name = plain(name)
        if name == "" or name in self.arm.base_frames:
            return np.eye(4)
        if name in self.transforms:
            return self.transforms[name]
        if name in self.arm.chains:
            return self._link(name, q, where)
        item, sub = self.owner(name), name.partition("/")[2]
        if item is None or (item.name != name and sub not in item.subframes):
            raise RefusedError(
                ErrorCode.FRAME_TRANSFORM_FAILURE,
                where,
                f"{name!r} is no link, object, subframe or fixed transform; transform the message to "
                f"{self.arm.base_frames[0]!r}",
            )
        pose = item.pose if item.link is None else self._link(item.link, q, where) @ item.pose
        return pose if item.name == name else pose @ item.subframes[sub]

    def owner(self, name: str) -> Item | None:
        """Return the object of a frame ``object`` or ``object/subframe``, or None if there is no such object."""
        return self.items.get(name) or self.items.get(name.partition("/")[0])

    def moves(self, name: str) -> bool:
        """Return whether motions move a frame: a link behind a joint of the group, or a frame of an attached object."""
        name = plain(name)
        if name in self.arm.base_frames or name in self.transforms:
            return False
        if name in self.arm.chains:
            return not self.arm.is_fixed(name)
        item = self.owner(name)
        return item is not None and item.link is not None

    def scene(self, q: Array) -> kpam.Scene:
        """Return the solver's scene; ``q`` (n,) includes the finger joints, which place the objects attached to
        fingers.

        Objects that the collision matrix allows to touch every link and every attached object are left out.

        Raises:
            RefusedError: the solver does not accept an object; names the object.
        """
        others = [*self.arm.robot.link_names, *self._attached()]
        bodies = []
        for item in self.items.values():
            pose = item.pose if item.link is None else self.arm.in_hand(item.link, q) @ item.pose
            body = _body(item, pose)
            if item.link is not None or not self.matrix.allows_all(item.name, others):
                bodies.append(body)
        if self.octomap is not None and not self.matrix.allows_all(OCTOMAP, others):
            bodies.append(self.octomap)
        if self.cloud is not None:
            bodies.append(self.cloud)
        return _within("planning_scene", lambda: kpam.Scene(self.arm.robot, bodies))

    def _attached(self) -> dict[str, Item]:
        return {name: item for name, item in self.items.items() if item.link is not None}

    def _link(self, link: str, q: Array, where: str) -> Array:
        names = self.arm.robot.joint_names
        unknown = [name for name in self.arm.chains[link] if np.isnan(q[names.index(name)])]
        if unknown:
            raise RefusedError(
                ErrorCode.INVALID_ROBOT_STATE,
                where,
                f"the pose of {link!r} needs the joints {sorted(unknown)}; send their JointState first",
            )
        return self.arm.robot.forward_kinematics(np.nan_to_num(q), link)

    def _with_transforms(self, messages: Any, q: Array) -> World:
        world = self
        for k, message in enumerate(messages):
            where = f"fixed_frame_transforms[{k}]"
            parent = world.frame(message.header.frame_id, q, f"{where}.header.frame_id")
            pose = parent @ transform(message.transform, f"{where}.transform")
            world = replace(world, transforms={**world.transforms, plain(message.child_frame_id): pose})
        return world

    def _with_object(self, message: Any, where: str, q: Array) -> World:
        """Apply a CollisionObject."""
        operation, name = _byte(message.operation), str(message.id)
        known = self.items.get(name)
        if operation == REMOVE:
            kept = {key: item for key, item in self.items.items() if item.link is not None or name not in ("", key)}
            return replace(self, items=kept)
        if name == "" or (known is not None and known.link is not None):
            raise _no_object(f"{where}.id", f"{name!r} is {'attached' if name else 'no name'}; use another id")
        if operation not in (ADD, APPEND, MOVE):
            raise _no_object(f"{where}.operation", f"{operation} is no operation; use 0 (add) to 3 (move)")
        frame = self.frame(message.header.frame_id, q, f"{where}.header.frame_id")
        if operation == MOVE:
            if known is None:
                raise _no_object(f"{where}.id", f"there is no object {name!r} to move; add it first")
            return self._with_items(_moved(known, message, where, frame))
        item = self._item(message, where, frame)
        if operation == APPEND and known is not None:
            back = inverse(known.pose) @ item.pose
            parts = tuple(Part(part.build, back @ part.pose) for part in item.parts)
            subframes = {key: back @ pose for key, pose in item.subframes.items()}
            item = replace(known, parts=(*known.parts, *parts), subframes={**known.subframes, **subframes})
        return self._with_items(item)

    def _with_attached(self, message: Any, where: str, q: Array) -> World:
        """Apply an AttachedCollisionObject."""
        link, name, inner = message.link_name, str(message.object.id), f"{where}.object"
        operation = _byte(message.object.operation)
        if operation == REMOVE:
            return self._released(link, name, q, inner)
        if link not in self.arm.chains:
            raise RefusedError(ErrorCode.INVALID_LINK_NAME, f"{where}.link_name", f"there is no link {link!r}")
        if not self.arm.moves_with_hand(link):
            raise RefusedError(
                ErrorCode.INVALID_LINK_NAME,
                f"{where}.link_name",
                f"motions move {link!r} relative to the hand {self.arm.hand_link!r}; objects can be attached only to "
                "the hand and links that move with it",
            )
        if operation not in (ADD, APPEND):
            raise _no_object(f"{inner}.operation", f"{operation} cannot attach; use 0 (add), 2 (append) or 1 (remove)")
        at, known = self._link(link, q, where), self.items.get(name)
        shapes = (*message.object.primitives, *message.object.meshes, *message.object.planes)
        if not shapes:
            if known is None:
                raise _no_object(f"{inner}.id", f"there is no object {name!r}, and the message has no shapes")
            if known.link is not None:
                at_known = self._link(known.link, q, where) @ known.pose
                return self._with_items(replace(known, pose=inverse(at) @ at_known, link=link))
            return self._with_items(replace(known, pose=inverse(at) @ known.pose, link=link))
        frame = self.frame(message.object.header.frame_id, q, f"{inner}.header.frame_id")
        item = self._item(message.object, inner, inverse(at) @ frame, link)
        if operation == APPEND and known is not None:
            raise _no_object(f"{inner}.operation", "append is not supported for attached objects; use 0 (add)")
        return self._with_items(item)

    def _released(self, link: str, name: str, q: Array, where: str) -> World:
        world = self
        found = [
            item
            for item in self.items.values()
            if item.link is not None and name in ("", item.name) and link in ("", item.link)
        ]
        if name and not found:
            raise _no_object(f"{where}.id", f"no object {name!r} is attached")
        for item in found:
            pose = self._link(str(item.link), q, where) @ item.pose
            world = world._with_items(replace(item, pose=pose, link=None))
        return world

    def _with_octomap(self, message: Any, q: Array) -> World:
        frame = self.frame(message.header.frame_id, q, "world.octomap.header.frame_id")
        pose = frame @ matrix(message.origin, "world.octomap.origin")
        where = "world.octomap.octomap"
        centres, sides = _within(where, lambda: occupied_cells(message.octomap))
        near = np.abs(centres @ pose[:3, :3].T + pose[:3, 3]).max(axis=1, initial=0.0) - sides <= REACH
        if not near.any():
            return replace(self, octomap=None)
        cubes = _within(
            where, lambda: kpam.Body(OCTOMAP, "rigid", [kpam.Shape.octree(centres[near], sides[near])], pose)
        )
        return replace(self, octomap=cubes)

    def _item(self, message: Any, where: str, frame: Array, link: str | None = None) -> Item:
        """Return the object of a CollisionObject whose header is at ``frame`` (4, 4)."""
        name = str(message.id)
        if name in (OCTOMAP, CLOUD) or name in self.arm.chains:
            kind = "a link of the robot" if name in self.arm.chains else "a reserved name"
            raise _no_object(f"{where}.id", f"{name!r} is {kind}; use another id")
        own, parts = matrix(message.pose, f"{where}.pose"), parts_of(message, where)
        if not parts:
            raise _no_object(where, "has neither primitives nor meshes nor planes")
        names = list(message.subframe_names)
        poses = [matrix(each, f"{where}.subframe_poses[{k}]") for k, each in enumerate(message.subframe_poses)]
        if len(names) != len(poses):
            raise _no_object(f"{where}.subframe_poses", f"has {len(poses)} poses for {len(names)} names")
        subframes = dict(zip(names, poses, strict=True))
        if len(parts) == 1 and np.array_equal(own, np.eye(4)):
            # MoveIt takes the pose of the only shape for the pose of the object.
            own, parts = parts[0].pose, [Part(parts[0].build, np.eye(4))]
        return Item(name, frame @ own, tuple(parts), subframes, link)

    def _with_items(self, *items: Item) -> World:
        return replace(self, items={**self.items, **{item.name: item for item in items}})


def plain(name: str) -> str:
    """Return the name of a frame without the leading slash that some nodes send."""
    return name.removeprefix("/")


def _moved(known: Item, message: Any, where: str, frame: Array) -> Item:
    """Return an object after a CollisionObject with the operation MOVE."""
    shapes = (*message.primitives, *message.meshes, *message.planes)
    if shapes:
        raise _no_object(where, "moves an object and has shapes; leave the shapes out, or add the object")
    pose = matrix(message.pose, f"{where}.pose")
    poses = [
        matrix(each, f"{where}.{kind}_poses[{k}]")
        for kind in ("primitive", "mesh", "plane")
        for k, each in enumerate(getattr(message, f"{kind}_poses"))
    ]
    if not poses:
        return replace(known, pose=frame @ pose)
    if len(poses) != len(known.parts):
        raise _no_object(where, f"has {len(poses)} poses for the {len(known.parts)} shapes of {known.name!r}")
    if len(poses) == 1 and np.array_equal(pose, np.eye(4)):
        return replace(known, pose=frame @ poses[0])
    parts = tuple(Part(part.build, each) for part, each in zip(known.parts, poses, strict=True))
    return replace(known, pose=frame @ pose, parts=parts)


def _body(item: Item, pose: Array) -> kpam.Body:
    role: Any = "rigid" if item.link is None else "attached"
    where = f"object {item.name!r}"
    return _within(where, lambda: kpam.Body(item.name, role, [part.build(part.pose) for part in item.parts], pose))


def _within(where: str, make: Callable[[], Any]) -> Any:
    """Call ``make``, and name the place in the message in its errors."""
    try:
        return make()
    except kpam.ProblemError as error:
        raise _no_object(where, str(error)) from error
    except RefusedError as error:
        raise RefusedError(error.code, f"{where}.{error.field}", error.message) from error


def _no_object(where: str, message: str) -> RefusedError:
    return RefusedError(ErrorCode.INVALID_OBJECT_NAME, where, message)


def _must_be(value: float, wanted: float, where: str) -> None:
    if value != wanted:
        raise RefusedError(
            ErrorCode.COLLISION_CHECKING_UNAVAILABLE,
            where,
            f"must be {wanted}, not {value}; set the planner's margin, which applies to all links",
        )


def _byte(value: Any) -> int:
    """Return the number of a field of type ``byte``, which rclpy represents as bytes."""
    return value[0] if isinstance(value, bytes) else int(value)
