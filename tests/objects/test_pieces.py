"""Collision parts as in the original: each connected piece of a file as its hull."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from gensim2.objects import open_library
from gensim2.objects.meshwork.decompose import piece_hulls
from gensim2.objects.physics import hull_moments
from gensim2.objects.types import BODY


def mesh(shape: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray]:
    return np.asarray(shape.vertices, float), np.asarray(shape.faces, np.int64)


def shell() -> trimesh.Trimesh:
    """An open box of 10 cm with walls of 5 mm, in one connected piece."""
    outer, inner = np.array([0.1, 0.1, 0.1]), np.array([0.09, 0.09, 0.095])
    v = np.array([[x, y, z] for z in (0.0, 1.0) for y in (-0.5, 0.5) for x in (-0.5, 0.5)])
    out = v * outer
    inside = v * inner + [0, 0, 0.005]
    sides = [(0, 1, 5, 4), (1, 3, 7, 5), (3, 2, 6, 7), (2, 0, 4, 6)]
    faces = [quad for a, b, c, d in sides for quad in ((a, b, c), (a, c, d))] + [(0, 2, 1), (1, 2, 3)]
    inner_faces = [(8 + a, 8 + c, 8 + b) for a, b, c in faces]
    rim = [f for a, b in ((4, 5), (5, 7), (7, 6), (6, 4)) for f in ((a, b, 8 + b), (a, 8 + b, 8 + a))]
    return trimesh.Trimesh(np.concatenate([out, inside]), np.array([*faces, *inner_faces, *rim]), process=False)


def test_a_piece_is_filled_and_pieces_are_kept_apart() -> None:
    far = trimesh.creation.box((0.02, 0.02, 0.02), transform=trimesh.transformations.translation_matrix([1, 0, 0]))
    hulls, dropped = piece_hulls([mesh(trimesh.util.concatenate([shell(), far]))])
    assert dropped == 0
    volumes = sorted(hull_moments(hull)[0] for hull in hulls)
    assert volumes == pytest.approx([0.02**3, 0.1**3], rel=1e-6)  # the cavity, 77 % of it, is filled


def test_flat_and_tiny_pieces_are_left_out_and_thin_ones_made_thick() -> None:
    flat = np.array([[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0]], float)
    square = (
        flat @ trimesh.transformations.rotation_matrix(0.4, [1, 2, 3])[:3, :3].T,
        np.array([[0, 1, 2], [0, 2, 3]]),
    )
    tiny = mesh(trimesh.creation.box((4e-4, 4e-4, 4e-4)))
    thin = mesh(trimesh.creation.box((0.1, 0.1, 0.001)))
    hulls, dropped = piece_hulls([square, tiny, thin])
    assert (len(hulls), dropped) == (1, 2)
    assert np.ptp(hulls[0], axis=0).min() == pytest.approx(0.003)


def test_a_folders_rigid_object_has_its_cavity_or_not_by_the_rule(tmp_path: Path) -> None:
    folder = tmp_path / "rigidbody_objs" / "models" / "tub"
    folder.mkdir(parents=True)
    shell().export(folder / "collision.obj")
    (folder / "info.json").write_text('{"scale": 1.0, "keypoints": {"rigidbody_object_head": [0, 0, 0.1]}}')
    library = open_library(tmp_path)
    open_, whole = library.load("tub", "0"), library.load("tub", "0", "original")
    filled = [sum(hull_moments(hull)[0] for hull in thing.hulls[BODY]) for thing in (open_, whole)]
    assert len(whole.hulls[BODY]) == 1
    assert filled[0] < 0.5e-3 < filled[1] == pytest.approx(1e-3, rel=1e-3)
    assert open_.content_hash == whole.content_hash
    assert library.load("tub", "0") is open_


def test_a_generated_object_is_the_same_by_both_rules() -> None:
    library = open_library("builtin")
    default, original = library.load("drawer", "0"), library.load("drawer", "0", "original")
    assert default.hulls.keys() == original.hulls.keys()
    for name, hulls in default.hulls.items():
        assert all((a == b).all() for a, b in zip(hulls, original.hulls[name], strict=True))
