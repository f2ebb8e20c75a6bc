"""Clouds of what only a simulator knows: the true places of keypoints and of the corners of boxes, in a set order."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.core.errors import InputError
from gensim2.objects import ObjectModel
from gensim2.perception.cloud import FARTHEST, PointCloud, from_steps, to_steps
from gensim2.perception.raycast.scene import RaycastScene

Array = npt.NDArray[np.float64]


class KnownPoints:
    """Points of the objects of a scene, which stand for its whole state.

    Of each object in the task's order: the eight corners of the box of what moves, in the frame of the link that the
    joint moves; the eight of what stands still, in the root's; its keypoints by name. Of a rigid object one box and
    the keypoints. The list is repeated from its beginning until there are as many as the cloud has.

    Args:
        scene: with these objects.
        objects: by name, in the task's order.
        count: N, points of the cloud.

    Raises:
        InputError: the objects have more points than the cloud.
    """

    def __init__(self, scene: RaycastScene, objects: Mapping[str, ObjectModel], count: int) -> None:
        self._scene = scene
        #: Of each point the object and the link that it goes along with, and (3,) its place in that link's frame.
        self._points: list[tuple[str, str, Array]] = []
        for name, model in objects.items():
            for link, points in _boxes(scene, name, model):
                self._points += [(name, link, point) for point in points]
            for _, keypoint in sorted(model.keypoints.items()):
                link = name if model.joint is None else keypoint.link  # a rigid object is one link of its own name
                self._points.append((name, link, np.asarray(keypoint.position, dtype=np.float64)))
        if len(self._points) > count:
            message = f"is {count}, and the objects' keypoints and corners are {len(self._points)}"
            raise InputError(message, field="observation.points", remedy=f"give at least {len(self._points)}")
        self._rows = np.arange(count) % len(self._points)
        self._ids = np.array([scene.ids(name, [link])[0] for name, link, _ in self._points], dtype=np.int16)

    def at(self, states: Mapping[str, Any]) -> list[PointCloud]:
        """Clouds of T recorded instants, in the robot's base frame.

        Args:
            states: ManiSkill's ``env_states``, T rows an array.

        Raises:
            InputError: they are not of this scene.
        """
        places = dict.fromkeys((name, link) for name, link, _ in self._points)  # many points go along with each
        frames = {(name, link): self._scene.link_poses(states, name, link) for name, link in places}
        placed = [
            frames[name, link][:, :3, :3] @ point + frames[name, link][:, :3, 3] for name, link, point in self._points
        ]
        xyz = np.clip(np.stack(placed, axis=1)[:, self._rows], -FARTHEST, FARTHEST).astype(np.float32)
        colours, ids = np.zeros((len(self._rows), 3), np.uint8), self._ids[self._rows]
        return [PointCloud(from_steps(to_steps(points)), colours, ids) for points in xyz]


def _boxes(scene: RaycastScene, name: str, model: ObjectModel) -> list[tuple[str, Array]]:
    """Of what moves and of what stands still of an object: a link, and (8, 3) corners of the box in its frame."""
    if model.joint is None:
        return [(name, _corners(np.concatenate([hull for hulls in model.hulls.values() for hull in hulls])))]
    tree = scene.tree(name)
    at_zero = dict(zip(tree.names, tree.poses(np.eye(4)[None], np.zeros((1, 1)))[0], strict=True))
    found = []
    for moves in (True, False):
        frame = model.joint.child_link if moves else tree.names[0]
        links = [link for link, still in zip(tree.names, tree.still, strict=True) if still is not moves]
        hulls = []
        for link in links:
            T = np.linalg.inv(at_zero[frame]) @ at_zero[link]
            hulls += [hull @ T[:3, :3].T + T[:3, 3] for hull in model.hulls.get(link, ())]
        if hulls:
            found.append((frame, _corners(np.concatenate(hulls))))
    return found


def _corners(points: Array) -> Array:
    """(8, 3) corners of the box of points (n, 3) along the axes."""
    ends = np.stack([points.min(0), points.max(0)])
    return np.array([[ends[i, 0], ends[j, 1], ends[k, 2]] for i, j, k in itertools.product((0, 1), repeat=3)])
