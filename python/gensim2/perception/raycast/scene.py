"""Build the ray-casting scene of a task, and compute the poses of the solids from recorded states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache, cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.core.arrays import Array
from gensim2.objects import ObjectModel, RigidObject
from gensim2.objects.types import ArticulatedObject
from gensim2.perception import Camera, RobotSegments
from gensim2.perception.raycast.caster import Caster, CastSolid, Hits
from gensim2.perception.raycast.kinematics import Tree, pose_matrices, read_urdf, state_rows
from gensim2.perception.raycast.shapes import Surface, read_links, read_mesh
from gensim2.robots import RobotProfile
from gensim2.scenes.table import HALF_SIZE, visible_boxes

TABLE = "table"


class RaycastScene:
    """Robot, table and objects of an episode, without a simulator.

    The scene numbers links and bodies as SAPIEN does, so ray-cast images and SAPIEN's images have the same segmentation
    ids. The numbers start at 1, follow the order in which the environment builds the bodies, and include invisible
    links.

    Args:
        objects: objects by name, in the task's order.
        cameras: cameras from which rays are cast. The pose of a camera on the robot is in the frame of its link.
            Without cameras, the scene reads no meshes and cannot cast rays, but it still computes the poses of the
            links.

    Raises:
        InputError: a file of the robot or of an object cannot be used.
    """

    def __init__(self, profile: RobotProfile, objects: Mapping[str, ObjectModel], cameras: Sequence[Camera]) -> None:
        self.profile, self.cameras = profile, tuple(cameras)
        self._T_base_world = np.linalg.inv(profile.T_world_base)
        self._names: dict[int, tuple[str, str]] = {}
        self._solids: list[CastSolid] = []
        self._trees: dict[str, tuple[Tree, list[int]]] = {}
        self._bodies: list[str] = []
        active = (*profile.arm_joints, *profile.gripper.joints)
        self._add_tree(profile.agent, Tree.of(read_urdf(profile.urdf), active))
        self._add(TABLE, TABLE, _table(), still=True)
        for name, model in objects.items():
            if isinstance(model, ArticulatedObject):
                self._add_tree(name, Tree.of(read_urdf(model.urdf), (model.joint.name,)))
            elif isinstance(model, RigidObject):
                self._bodies.append(name)
                seen = bool(self.cameras) and model.visual is not None
                self._add(name, name, read_mesh(model.visual) if seen else None, still=False)
            else:
                raise TypeError(f"cannot cast rays into an object of type {type(model).__name__}")
        # The cameras on a link do not move in the link's frame. Therefore each link with cameras has its own caster,
        # which casts the rays in the link's frame. The key None stands for the fixed cameras.
        self._casters: dict[str | None, Caster] = {
            link: Caster(self._solids, [camera for camera in self.cameras if camera.link == link])
            for link in dict.fromkeys(camera.link for camera in self.cameras)
        }

    @property
    def names(self) -> Mapping[int, tuple[str, str]]:
        """Owner and link of each segmentation id. The owner is the name of an object, the name of the robot's ManiSkill
        agent, or ``table``.
        """
        return self._names

    @property
    def solids(self) -> tuple[CastSolid, ...]:
        """Solids, in the order of :meth:`poses`."""
        return tuple(self._solids)

    def tree(self, name: str) -> Tree:
        """Return the kinematic tree of an articulated object, or of the robot. ``name`` is the object's name, or the
        name of the robot's ManiSkill agent.
        """
        return self._trees[name][0]

    def link_poses(self, states: Mapping[str, Any], name: str, link: str) -> Array:
        """Return the poses (T, 4, 4) of an object's link, or of a rigid object, in the base frame.

        Args:
            states: ManiSkill's ``env_states``, T rows per array.
            name: name of the object.
            link: name of the link; ignored for a rigid object.

        Raises:
            InputError: the states belong to a different scene.
        """
        if name in self._bodies:
            rows = state_rows(states, "actors", name, 13)
            return np.asarray(self._T_base_world @ pose_matrices(rows[:, :7]))
        return self._links(states, name)[:, self.tree(name).names.index(link)]

    def ids(self, owner: str, links: Sequence[str] | None = None) -> tuple[int, ...]:
        """Return the segmentation ids of ``owner``, for the given links or for all links."""
        return tuple(id for id, (who, link) in self._names.items() if who == owner and (links is None or link in links))

    @cached_property
    def robot(self) -> RobotSegments:
        """Return the segmentation ids of the hand (with its descendants) and of the other links of the robot."""
        tree, _ = self._trees[self.profile.agent]
        hanging = {self.profile.hand_link}
        for name, parent in zip(tree.names, tree.parents, strict=True):  # parents come before their children
            if parent >= 0 and tree.names[parent] in hanging:
                hanging.add(name)
        gripper = frozenset(self.ids(self.profile.agent, tuple(hanging)))
        return RobotSegments(gripper, frozenset(self.ids(self.profile.agent)) - gripper)

    def poses(self, states: Mapping[str, Any]) -> Array:
        """Return the poses (T, L, 4, 4) of the solids in the base frame at T recorded instants.

        Args:
            states: ManiSkill's ``env_states``, T rows per array.

        Raises:
            InputError: the states belong to a different scene.
        """
        found: dict[int, Array] = {}
        for name, (_, ids) in self._trees.items():
            links = self._links(states, name)
            found |= {id: links[:, index] for index, id in enumerate(ids)}
        for name in self._bodies:
            found[self.ids(name)[0]] = self.link_poses(states, name, name)
        steps = len(next(iter(found.values())))
        table = np.eye(4)
        table[2, 3] = -HALF_SIZE[2]
        found[self.ids(TABLE)[0]] = np.tile(self._T_base_world @ table, (steps, 1, 1))
        return np.stack([found[solid.id] for solid in self._solids], axis=1)

    def see(self, poses: Array, links: Mapping[str, Array] | None = None) -> tuple[RaycastView, ...]:
        """Cast the rays of all cameras and return one image for each camera.

        Args:
            poses: (L, 4, 4) poses of the solids in the base frame.
            links: (4, 4) pose of each link with cameras, in the base frame.
        """
        found: dict[str, RaycastView] = {}
        for link, caster in self._casters.items():
            T = None if link is None else (links or {})[link]
            hits = caster.cast(poses if T is None else np.linalg.inv(T) @ poses)
            for number, camera in enumerate(caster.cameras):
                placed = camera if T is None else replace(camera, T_base_camera=T @ camera.T_base_camera)
                found[camera.name] = RaycastView(caster, hits, number, placed, poses)
        return tuple(found[camera.name] for camera in self.cameras)

    def _links(self, states: Mapping[str, Any], name: str) -> Array:
        """Return the link poses (T, links, 4, 4) of an articulation in the base frame."""
        tree, _ = self._trees[name]
        count = sum(index >= 0 for index in tree.coordinates)
        rows = state_rows(states, "articulations", name, 13 + 2 * count)
        root = self._T_base_world @ pose_matrices(rows[:, :7])
        return tree.poses(root, rows[:, 13 : 13 + count].astype(np.float64))

    def _add_tree(self, name: str, tree: Tree) -> None:
        surfaces = read_links(tree.file) if self.cameras else {}
        ids = [
            self._add(name, link, surfaces.get(link), still=still)
            for link, still in zip(tree.names, tree.still, strict=True)
        ]
        self._trees[name] = tree, ids

    def _add(self, owner: str, link: str, surface: Surface | None, still: bool) -> int:
        id = len(self._names) + 1
        self._names[id] = owner, link
        if surface is not None:
            self._solids.append(CastSolid(id, surface, still))
        return id


class RaycastView:
    """Image of one camera, from the hits of the camera's rays; colours are computed on demand.

    Args:
        caster: caster of the rays.
        hits: hits of all cameras of the caster.
        number: index of the camera in the caster.
        camera: camera of the image.
        poses: (L, 4, 4) poses of the caster's solids in the base frame.
    """

    def __init__(self, caster: Caster, hits: Hits, number: int, camera: Camera, poses: Array) -> None:
        self._caster, self._hits, self._number, self.camera = caster, hits, number, camera
        self._poses = poses

    def measured(self, camera: Camera, depth: npt.NDArray[np.float32]) -> RaycastView:
        """Return a copy of this image with simulated measurement errors: ``depth`` (H, W), m, replaces the true depth,
        and the pose of ``camera`` replaces the true camera pose.
        """
        found = RaycastView(self._caster, self._hits, self._number, camera, self._poses)
        found.depth = depth
        return found

    @cached_property
    def depth(self) -> npt.NDArray[np.float32]:
        depth = self._hits.depth[self._number]
        return np.where(depth < self.camera.far, depth, np.float32(0.0))

    @cached_property
    def segmentation(self) -> npt.NDArray[np.int16]:
        return self._caster.segmentation(self._hits.face[self._number])

    @property
    def face(self) -> npt.NDArray[np.int32]:
        """Index (H, W) of the visible triangle among the triangles of all solids; -1 for background."""
        return self._hits.face[self._number]

    def normals_at(self, pixels: npt.NDArray[np.int64]) -> npt.NDArray[np.float32]:
        """Return the unit normals (N, 3), base frame, of the surface at the given pixels."""
        return self._caster.normals(self.face.reshape(-1)[pixels], self._poses)

    def colors_at(self, pixels: npt.NDArray[np.int64]) -> npt.NDArray[np.uint8]:
        number, hits = self._number, self._hits
        u, v = (weights[number].reshape(-1)[pixels] for weights in (hits.u, hits.v))
        return self._caster.colors(hits.face[number].reshape(-1)[pixels], u, v)


@cache
def _table() -> Surface | None:
    return Surface.joined([Surface.box(box.center, box.half_size, _bytes(box.color)) for box in visible_boxes()])


def _bytes(color: Sequence[float]) -> tuple[int, ...]:
    return tuple(round(255 * value) for value in color[:3])
