"""Collision meshes of links that are decomposed into convex parts."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

import gensim2_kpam as kpam

# A C-shaped profile (m) with a slanted inner side. Its opening points along x, and it is 0.1 m deep.
PROFILE = [(0, 0), (0.2, 0), (0.2, 0.06), (0.07, 0.06), (0.05, 0.25), (0.15, 0.25), (0.15, 0.3), (0, 0.3)]
# Triangles of the profile: the lower arm, the back and the upper arm.
TRIANGLES = [(0, 1, 3), (1, 2, 3), (0, 3, 4), (0, 4, 7), (4, 5, 7), (5, 6, 7)]
TOLERANCE = 0.01


def c_shape() -> trimesh.Trimesh:
    """Return the closed mesh of a C-shaped link."""
    n = len(PROFILE)
    vertices = [(x, y, z) for y in (0.0, 0.1) for x, z in PROFILE]
    near = list(TRIANGLES)
    far = [(n + c, n + b, n + a) for a, b, c in TRIANGLES]
    sides = [t for i in range(n) for j in [(i + 1) % n] for t in ((i, n + i, j), (j, n + i, n + j))]
    mesh = trimesh.Trimesh(vertices, [*near, *far, *sides])
    assert mesh.is_watertight
    return mesh


def robot(folder: Path, kind: str = "stl", **arguments: float) -> kpam.Robot:
    """Return an arm with one C-shaped link, whose mesh is stored in a file of the given kind. The link is turned and
    mirrored, so that these are tested too.
    """
    c_shape().export(folder / f"c.{kind}")
    (folder / "arm.urdf").write_text(
        '<robot name="arm"><link name="base"/><link name="bar"><collision><origin xyz="0 0 0.1" rpy="0 0 0.3"/>'
        f'<geometry><mesh filename="c.{kind}" scale="1 -1 1"/></geometry></collision></link>'
        '<joint name="j" type="revolute"><parent link="base"/><child link="bar"/><axis xyz="0 0 1"/>'
        '<limit lower="-2" upper="2" effort="1" velocity="1"/></joint></robot>'
    )
    return kpam.Robot.from_urdf(folder / "arm.urdf", hand_link="bar", **arguments)  # type: ignore[arg-type]


def in_link(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points (N, 3) of the mesh in the frame of the link."""
    turn = trimesh.transformations.rotation_matrix(0.3, [0, 0, 1])
    return points * [1, -1, 1] @ turn[:3, :3].T + [0, 0, 0.1]


def parts(surface: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Return the planes (M, 4) of each convex part of a link's surface (N, 3, 3), whose triangles are in order."""
    found: list[NDArray[np.float64]] = []
    start, open_edges = 0, set[frozenset[bytes]]()
    for k, corners in enumerate(surface):
        for a, b in ((0, 1), (1, 2), (2, 0)):
            open_edges ^= {frozenset((corners[a].tobytes(), corners[b].tobytes()))}
        if not open_edges:
            found.append(np.asarray(ConvexHull(surface[start : k + 1].reshape(-1, 3)).equations))
            start = k + 1
    assert start == len(surface)
    return found


@pytest.mark.parametrize("kind", ["stl", "obj", "ply", "dae", "glb"])
def test_parts_contain_the_mesh_and_stay_near_it(tmp_path: Path, kind: str) -> None:
    found = parts(robot(tmp_path, kind, mesh_tolerance=TOLERANCE).surface("bar")[0])
    assert 3 <= len(found) <= 6
    mesh, rng = c_shape(), np.random.default_rng(0)
    low, high = mesh.bounds
    inside = rng.uniform(low, high, (6000, 3))
    x, z = inside[:, 0], inside[:, 2]
    # The profile's inner side leads from (0.07, 0.06) to (0.05, 0.25).
    solid = (z < 0.06) | (x < 0.07 - (z - 0.06) * 0.02 / 0.19) | ((z > 0.25) & (x < 0.15))
    for points in (inside[solid], trimesh.sample.sample_surface(mesh, 3000, seed=0)[0], mesh.vertices):
        heights = [(in_link(points) @ p[:, :3].T + p[:, 3]).max(axis=1) for p in found]
        assert np.min(heights, axis=0).max() < 1e-6  # m; glTF stores single precision

    free = inside[~solid & (trimesh.proximity.closest_point(mesh, inside)[1] > TOLERANCE)]
    heights = [(in_link(free) @ p[:, :3].T + p[:, 3]).max(axis=1) for p in found]
    assert len(free) > 1000
    assert np.min(heights, axis=0).min() > 0


def test_the_opening_of_a_link_is_free_only_with_a_tolerance(tmp_path: Path) -> None:
    center = in_link(np.array([[0.1, 0.05, 0.16]]))[0]
    pose = trimesh.transformations.translation_matrix(center)
    ball = kpam.Body("ball", "rigid", [kpam.Shape.sphere(0.02)], pose)
    whole, fine = robot(tmp_path), robot(tmp_path, mesh_tolerance=TOLERANCE)
    assert kpam.Scene(whole, [ball]).in_collision([0.0])
    assert not kpam.Scene(fine, [ball]).in_collision([0.0])
    assert kpam.Scene(fine, [ball]).in_collision([0.6])  # an arm of the C passes through the ball
    assert len(parts(robot(tmp_path, mesh_tolerance=0.2).surface("bar")[0])) == 1
    again = pickle.loads(pickle.dumps(fine))
    assert np.array_equal(again.surface("bar")[0], fine.surface("bar")[0])


@pytest.mark.parametrize("tolerance", [0.0, -0.01, float("nan"), float("inf")])
def test_a_tolerance_that_is_no_distance_is_refused(tmp_path: Path, tolerance: float) -> None:
    with pytest.raises(kpam.UrdfError, match="mesh_tolerance"):
        robot(tmp_path, mesh_tolerance=tolerance)
