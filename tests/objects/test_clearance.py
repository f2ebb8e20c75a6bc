"""Convex parts of two links do not overlap and stay close to their own meshes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gensim2.core.arrays import Array
from gensim2.objects.library.prepare import creased, prepare
from gensim2.objects.meshwork.clearance import Motion, cut_by_plane, decompose_pair
from gensim2.objects.meshwork.convexes import ConvexBlock, depth_inside
from gensim2.objects.meshwork.decompose import MAX_HULLS, MAX_HULLS_FOR_CLEARANCE, Faces, connected_pieces, decompose
from gensim2.objects.meshwork.voidspace import Overlap, VoidSpace, links_overlap
from gensim2.objects.model import LinkGeometry, Model
from gensim2.objects.shapes import Look, Mesh, Solid, box, hull_mesh
from gensim2.objects.types import Keypoint

LOOK = Look()
SLIDE = Motion(np.eye(4), np.array([0.0, 0.0, 1.0]), revolute=False, lower=0.0, upper=0.05)
Part = tuple[Array, Faces]


def mesh(low: tuple[float, float, float], high: tuple[float, float, float]) -> Part:
    """Return the surface of a box."""
    corners = np.array(
        [(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])], float
    )
    made = hull_mesh(corners, LOOK)
    return made.vertices, made.faces


def grooved_block() -> Part:
    """Return one connected surface: a block with a groove, 4 mm wide and 8 mm deep, along x in its upper face."""
    outline = [(-0.05, -0.03), (0.05, -0.03), (0.05, 0.03), (0.002, 0.03), (0.002, 0.022), (-0.002, 0.022)]
    outline += [(-0.002, 0.03), (-0.05, 0.03)]
    n = len(outline)
    vertices = np.array([(x, y, z) for x in (-0.06, 0.06) for y, z in outline])
    faces = [(i, (i + 1) % n, n + (i + 1) % n) for i in range(n)]
    faces += [(i, n + (i + 1) % n, n + i) for i in range(n)]
    caps = [(0, 5, 7), (5, 6, 7), (0, 1, 5), (1, 4, 5), (1, 2, 4), (2, 3, 4)]
    faces += caps + [(a + n, c + n, b + n) for a, b, c in caps]
    return vertices, np.array(faces, np.int64)


def deepest(moving: list[Array], body: list[Array], motion: Motion) -> float:
    """Return how deep corners and a grid of points of the moving hulls are inside the body's hulls, over the motion."""
    blocks = [ConvexBlock.of(hull) for hull in body]
    grid = np.linspace(0, 1, 15)
    worst = 0.0
    for hull in moving:
        low, high = hull.min(axis=0), hull.max(axis=0)
        points = np.array([low + (high - low) * (a, b, c) for a in grid for b in grid for c in grid])
        points = points[ConvexBlock.of(hull).depth(points) >= 0]
        for share in np.linspace(0, 1, 9):
            worst = max(worst, float(depth_inside(points + SLIDE.at(share)[:3, 3], blocks).max()))
    return worst


def test_a_narrow_groove_is_kept_clear_for_what_slides_in_it() -> None:
    groove, blade = grooved_block(), mesh((-0.05, -0.0008, 0.024), (0.05, 0.0008, 0.06))
    alone = decompose(connected_pieces([groove])).hulls
    pair = decompose_pair([groove], [blade], SLIDE)
    assert deepest(pair.moving, alone, SLIDE) > 0.002, "the groove is too wide to show anything"
    assert deepest(pair.moving, pair.body, SLIDE) <= 0.001
    blocks = [ConvexBlock.of(hull) for hull in pair.body]
    solid = np.array([[0.0, 0.03, 0.0], [0.0, -0.03, 0.02], [0.04, 0.0, 0.0]])
    assert (depth_inside(solid, blocks) > 0).all(), "the block around the groove stays"


def test_meshes_that_overlap_are_not_cut() -> None:
    block, plug = mesh((-0.05, -0.05, -0.03), (0.05, 0.05, 0.03)), mesh((-0.01, -0.01, 0.02), (0.01, 0.01, 0.06))
    pair = decompose_pair([block], [plug], SLIDE)
    (body,), (moving,) = pair.body, pair.moving
    np.testing.assert_allclose([body.min(axis=0), body.max(axis=0)], [block[0].min(axis=0), block[0].max(axis=0)])
    np.testing.assert_allclose([moving.min(axis=0), moving.max(axis=0)], [plug[0].min(axis=0), plug[0].max(axis=0)])


def test_a_sheet_does_not_cover_its_own_hole() -> None:
    frame = [
        mesh((-0.2, -0.2, 0.0), (0.2, -0.15, 0.001)),
        mesh((-0.2, 0.15, 0.0), (0.2, 0.2, 0.001)),
        mesh((-0.2, -0.15, 0.0), (-0.15, 0.15, 0.001)),
        mesh((0.15, -0.15, 0.0), (0.2, 0.15, 0.001)),
    ]
    whole = np.concatenate([vertices for vertices, _ in frame])
    count = np.cumsum([0] + [len(vertices) for vertices, _ in frame[:-1]])
    faces = np.concatenate([part + start for (_, part), start in zip(frame, count, strict=True)])
    hulls = decompose(connected_pieces([(whole, faces)]), VoidSpace(frame)).hulls
    blocks = [ConvexBlock.of(hull) for hull in hulls]
    assert depth_inside(np.array([[0.0, 0.0, 0.0005], [0.1, 0.1, 0.0005]]), blocks).max() == 0
    assert (depth_inside(np.array([[0.175, 0.0, 0.0005], [0.0, 0.175, 0.0005]]), blocks) > 0).all()


def test_a_link_of_many_pieces_has_40_hulls_and_up_to_60_where_the_other_link_passes() -> None:
    size, step = 0.007, 0.015
    pieces = [mesh((x, y, 0.0), (x + size, y + size, size)) for x in step * np.arange(10) for y in step * np.arange(8)]
    assert len(decompose(pieces).hulls) == MAX_HULLS == 40
    grid = np.arange(0.0, 0.2, 0.002)
    between = np.array([(x, y, size / 2) for x in grid for y in grid])

    def clear(pieces: list[Part]) -> VoidSpace:
        space = VoidSpace(pieces)
        space.keep_clear(between[space.is_free(between)])
        return space

    assert len(decompose(pieces, clear(pieces)).hulls) == MAX_HULLS_FOR_CLEARANCE == 60
    assert len(decompose(pieces[:50], clear(pieces[:50])).hulls) == 50


def test_cut_by_plane() -> None:
    cube = np.array([[x, y, z] for x in (0, 0.1) for y in (0, 0.1) for z in (0, 0.1)], float)
    up = np.array([0.0, 0.0, 1.0])
    cut = cut_by_plane(cube, up, 0.04)
    assert cut is not None
    np.testing.assert_allclose([cut.min(axis=0), cut.max(axis=0)], [[0, 0, 0], [0.1, 0.1, 0.04]], atol=1e-12)
    assert cut_by_plane(cube, up, 0.2) is cube
    assert cut_by_plane(cube, up, -0.01) is None
    thin = cut_by_plane(cube, up, 0.001)
    assert thin is not None
    np.testing.assert_allclose([thin[:, 2].min(), thin[:, 2].max()], [-0.002, 0.001], atol=1e-9)


def overlapping(folder: Path, hull: Solid, seen: Solid) -> Overlap:
    """Return the overlap of an object whose body is a block and whose moving link is simulated as ``hull`` and drawn as
    ``seen``.
    """
    block = box((0, 0, 0), (0.1, 0.1, 0.06), LOOK, 0.0)
    assert block.hull is not None
    assert block.mesh is not None
    assert hull.hull is not None
    assert seen.mesh is not None
    folder.mkdir()
    model = Model(
        asset_class="drawer",
        id="1",
        source="real",
        body=LinkGeometry([block.hull], [block.mesh]),
        moving=LinkGeometry([hull.hull], [seen.mesh]),
        joint_name="joint",
        joint_type="prismatic",
        moving_link="slider",
        T_root_link=np.eye(4),
        axis=np.array([0.0, 0.0, 1.0]),
        lower=0.0,
        upper=0.05,
        keypoints={"articulated_object_head": Keypoint("slider", np.zeros(3), "head")},
        T_link_object=np.eye(4),
        object_axis="z",
        content_hash="0",
        license="none",
    )
    return links_overlap(prepare(model, folder), 0.001)


def test_overlap_is_blamed_on_the_model_or_on_its_convex_parts(tmp_path: Path) -> None:
    deep = box((0, 0, 0.04), (0.04, 0.04, 0.03), LOOK, 0.0)  # 5 mm into the block
    clear = box((0, 0, 0.05), (0.04, 0.04, 0.03), LOOK, 0.0)  # 5 mm above it
    model = overlapping(tmp_path / "model", deep, deep)
    assert model.meshes == pytest.approx(0.005, abs=1e-4)
    assert model.parts == pytest.approx(0.005, abs=1e-4)
    assert model.filled == 0
    parts = overlapping(tmp_path / "parts", deep, clear)
    assert parts.meshes == 0
    assert parts.filled == pytest.approx(0.005, abs=1e-4)
    assert overlapping(tmp_path / "none", clear, clear) == Overlap(0.0, 0.0, 0.0)


def test_shading_is_split_at_sharp_edges_only() -> None:
    vertices, faces = mesh((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    split, renumbered = creased(vertices, faces)
    assert len(split) == 24, "three normals at each corner of a box"
    np.testing.assert_array_equal(split[renumbered], vertices[faces])
    angle = 2 * np.pi * np.arange(24) / 24
    barrel = np.array([(np.cos(t), np.sin(t), z) for z in (0.0, 1.0) for t in angle])
    side = [(i, (i + 1) % 24, 24 + i) for i in range(24)] + [
        ((i + 1) % 24, 24 + (i + 1) % 24, 24 + i) for i in range(24)
    ]
    smooth, _ = creased(barrel, np.array(side, np.int64))
    assert len(smooth) == 48, "one normal at each point of a barrel"


def test_creased_takes_an_empty_mesh() -> None:
    empty = Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int64), LOOK)
    assert len(creased(empty.vertices, empty.faces)[1]) == 0
