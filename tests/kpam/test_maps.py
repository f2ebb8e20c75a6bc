"""Voxels and signed distance fields as obstacles: their distances are those of boxes, and wrong arrays are refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gensim2_kpam as kpam
from gensim2.core.seeding import rng

UR5E = Path(__file__).parents[2] / "examples" / "robots" / "ur5e.urdf"
ORIGIN = np.array([0.1, -0.4, 0.0])
SIZE = 0.05


@pytest.fixture(scope="module")
def ur5e() -> kpam.Robot:
    return kpam.Robot.from_urdf(UR5E, hand_link="flange")


def turned() -> np.ndarray:
    """Return the pose of a rotated map."""
    c, s = np.cos(0.4), np.sin(0.4)
    return np.array([[c, -s, 0, 0.05], [s, c, 0, -0.1], [0, 0, 1, 0.02], [0, 0, 0, 1.0]])


def separate(occupied: np.ndarray, pose: np.ndarray) -> kpam.Body:
    """Return a body with a separate box for each voxel, slightly longer along one axis, so that it is no voxel."""
    shapes = []
    for index in np.argwhere(occupied):
        at = np.eye(4)
        at[:3, 3] = ORIGIN + SIZE * (index + 0.5)
        shapes.append(kpam.Shape.box([SIZE / 2, SIZE / 2, SIZE / 2 + 2e-7], at))
    return kpam.Body("map", "rigid", shapes, pose)


def voxels(occupied: np.ndarray, pose: np.ndarray) -> kpam.Body:
    return kpam.Body("map", "rigid", [kpam.Shape.voxels(occupied, SIZE, ORIGIN)], pose)


def test_distances_of_voxels_are_those_of_boxes(ur5e: kpam.Robot) -> None:
    draw = rng(1, "voxels")
    hits = 0
    for pose in (np.eye(4), turned()):
        occupied = draw.random((14, 16, 12)) < 0.04
        occupied[6:12, 3:9, :6] = True  # a solid block
        q = draw.uniform(-2.5, 2.5, (300, 6))
        q[:, 1] = draw.uniform(-2.5, -0.2, 300)
        ours, theirs = (kpam.Scene(ur5e, [body(occupied, pose)]) for body in (voxels, separate))
        found, wanted = ours.distance(q, 0.3), theirs.distance(q, 0.3)
        free = wanted > 0
        np.testing.assert_allclose(found[free], wanted[free], atol=2e-6)
        # Cubes of several voxels may be overlapped more deeply than each of the voxels.
        assert (found[~free] <= wanted[~free] + 2e-6).all()
        near = np.abs(wanted) < 2e-6
        assert (ours.in_collision(q) == theirs.in_collision(q))[~near].all()
        hits += int(ours.in_collision(q).sum())
    assert 20 < hits < 580


def test_motions_keep_the_margin_from_voxels(ur5e: kpam.Robot) -> None:
    occupied = np.zeros((14, 16, 20), dtype=bool)
    occupied[7:9, 7:9, :] = True  # a post in front of the arm
    scene = kpam.Scene(ur5e).with_body(voxels(occupied, np.eye(4)))
    start, goal = [0.8, -1.2, 1.5, -1.9, -1.6, 0], [-0.8, -1.2, 1.5, -1.9, -1.6, 0]
    motion = scene.plan_to(start, goal, margin=0.01)
    assert motion.status == "solved"
    assert motion.trajectory is not None
    q = motion.trajectory.sample_every(0.005)
    assert kpam.Scene(ur5e, [separate(occupied, np.eye(4))]).distance(q).min() > 0.01 - 1e-4 or motion.nearer
    straight = np.linspace(start, goal, 200)
    assert scene.in_collision(straight).any()
    # Without the map the same robot moves through the place of the post.
    assert not scene.without_body("map").in_collision(straight).any()


def test_leaves_of_several_sizes_are_cubes(ur5e: kpam.Robot) -> None:
    draw = rng(2, "leaves")
    centers, sizes = draw.uniform([0.2, -0.6, 0], [0.8, 0.6, 0.8], (120, 3)), draw.choice([0.02, 0.04, 0.08], 120)
    q = draw.uniform(-2.5, 0, (200, 6))

    def at(center: np.ndarray) -> np.ndarray:
        pose = np.eye(4)
        pose[:3, 3] = center
        return pose

    shapes = [kpam.Shape.box([h / 2, h / 2, h / 2 + 2e-7], at(c)) for c, h in zip(centers, sizes, strict=True)]
    wanted = kpam.Scene(ur5e, [kpam.Body("map", "rigid", shapes, np.eye(4))]).distance(q, 0.3)
    leaves = kpam.Body("map", "rigid", [kpam.Shape.octree(centers, sizes)], np.eye(4))
    np.testing.assert_allclose(kpam.Scene(ur5e, [leaves]).distance(q, 0.3), wanted, atol=3e-6)


def test_a_distance_field_hides_no_obstacle(ur5e: kpam.Robot) -> None:
    """The obstacle is a sphere, whose distances are exact."""
    center, radius = np.array([0.5, 0.1, 0.4]), 0.12
    grid = np.stack(np.meshgrid(*[np.arange(n) for n in (20, 24, 20)], indexing="ij"), axis=-1)
    points = ORIGIN + SIZE * (grid + 0.5)
    distances = np.clip(np.linalg.norm(points - center, axis=-1) - radius, -0.1, 0.1).astype(np.float32)
    q = rng(3, "sdf").uniform(-2.5, 0, (300, 6))
    pose = np.eye(4)
    pose[:3, 3] = center
    wanted = kpam.Scene(ur5e, [kpam.Body("ball", "rigid", [kpam.Shape.sphere(radius)], pose)]).distance(q, 0.5)
    field = kpam.Body("ball", "rigid", [kpam.Shape.sdf(distances, SIZE, ORIGIN)], np.eye(4))
    found = kpam.Scene(ur5e, [field]).distance(q, 0.5)
    free = (found > 0) & (wanted > 0)
    assert (found[free] <= wanted[free] + 1e-6).all()
    assert (found[wanted <= 0] <= 0).all()
    # The obstacle grows by a voxel's diagonal at most.
    assert (found >= wanted - np.sqrt(3) * SIZE - 1e-6)[free].all()
    distances[:5] = np.nan
    known = kpam.Scene(
        ur5e, [kpam.Body("ball", "rigid", [kpam.Shape.sdf(distances, SIZE, ORIGIN, unknown="free")], np.eye(4))]
    )
    np.testing.assert_allclose(known.distance(q, 0.5)[free], found[free], atol=1e-6)
    blocked = kpam.Scene(ur5e, [kpam.Body("ball", "rigid", [kpam.Shape.sdf(distances, SIZE, ORIGIN)], np.eye(4))])
    assert blocked.in_collision(q).sum() > known.in_collision(q).sum()


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: kpam.Shape.voxels(np.zeros((2, 2), dtype=bool), 0.1), "occupied"),
        (lambda: kpam.Shape.voxels(np.zeros((2, 2, 2)), 0.1), "occupied"),
        (lambda: kpam.Shape.voxels(np.zeros((2, 2, 2), dtype=bool), 0.0), "voxel_size"),
        (lambda: kpam.Shape.voxels(np.zeros((2, 2, 2), dtype=bool), float("nan")), "voxel_size"),
        (lambda: kpam.Shape.voxels(np.zeros((2, 2, 2), dtype=bool), 0.1, [0, 0, float("inf")]), "origin[2]"),
        (lambda: kpam.Shape.octree([[0.0, 0.0, 0.0]], [0.1, 0.1]), "sizes"),
        (lambda: kpam.Shape.octree([[0.0, 0.0, 0.0]], 0.0), "sizes[0]"),
        (lambda: kpam.Shape.sdf(np.zeros((2, 2), dtype=np.float32), 0.1), "distances"),
        (lambda: kpam.Shape.sdf(np.zeros((2, 2, 2), dtype=int), 0.1), "distances"),
        (lambda: kpam.Shape.sdf(np.full((2, 2, 2), np.inf), 0.1), "distances[0, 0, 0]"),
        (lambda: kpam.Shape.sdf(np.zeros((2, 2, 2)), 0.1, threshold=float("inf")), "threshold"),
        (lambda: kpam.Shape.sdf(np.zeros((2, 2, 2)), 0.1, unknown="maybe"), "unknown"),  # type: ignore[arg-type]
    ],
)
def test_unusable_maps_are_refused(make: Any, field: str) -> None:
    with pytest.raises(kpam.ProblemError) as caught:
        make()
    assert caught.value.field == field


def test_a_map_without_obstacles_is_none(ur5e: kpam.Robot) -> None:
    empty = kpam.Body("map", "rigid", [kpam.Shape.voxels(np.zeros((3, 0, 2), dtype=bool), 0.1)], np.eye(4))
    assert not kpam.Scene(ur5e).with_body(empty).in_collision([0.8, -1.2, 1.5, -1.9, -1.6, 0])
    with pytest.raises(kpam.ProblemError, match="not a body"):
        kpam.Scene(ur5e).without_body("map")


def test_every_byte_of_a_boolean_array_counts(ur5e: kpam.Robot) -> None:
    # A mask of 0 and 255 that is viewed as bool keeps its bytes.
    mask = np.full((20, 20, 20), 255, dtype=np.uint8)
    mask[:10] = 0
    found = kpam.Body("map", "rigid", [kpam.Shape.voxels(mask.view(bool), 0.04, [-0.4, -0.4, 0.0])], np.eye(4))
    wanted = kpam.Body("map", "rigid", [kpam.Shape.voxels(mask > 0, 0.04, [-0.4, -0.4, 0.0])], np.eye(4))
    q = rng(5, "voxels").uniform(-2.5, 2.5, (100, 6))
    distances = kpam.Scene(ur5e, [wanted]).distance(q, 0.3)
    assert (distances <= 0).any()
    np.testing.assert_array_equal(kpam.Scene(ur5e, [found]).distance(q, 0.3), distances)


def test_an_object_is_lifted_from_a_table_of_voxels(ur5e: kpam.Robot) -> None:
    q, up = np.array([0.3, -1.2, 1.5, -1.9, -1.6, 0]), np.array([0.3, -1.4, 1.5, -1.9, -1.6, 0])
    hand = ur5e.forward_kinematics(q)[:3, 3]
    for seed in range(5):
        place = np.eye(4)
        place[:3, 3] = hand - [0.0, 0.0, 0.12]
        place[:2, 3] += rng(seed, "lift").uniform(-0.05, 0.05, 2)
        corner = hand - [0.3, 0.3, 0.25]
        table = kpam.Shape.voxels(np.ones((12, 12, 2), dtype=bool), 0.05, corner)
        thing = kpam.Body("thing", "rigid", [kpam.Shape.box([0.03, 0.03, 0.03])], place)
        scene = kpam.Scene(ur5e, [kpam.Body("table", "rigid", [table], np.eye(4)), thing]).attached("thing", q)
        assert abs(scene.distance(q)) < 1e-7  # the object stands on the table
        assert scene.plan_to(q, up).status == "solved"
