"""Generated objects: every number gives a valid one, and always the same."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from gensim2.core.seeding import rng
from gensim2.inspection.checks import geometric_findings
from gensim2.objects import Library
from gensim2.objects.generators.blueprint import Blueprint
from gensim2.objects.generators.classes import drawer, faucet, object_classes
from gensim2.objects.generators.classes._common import turn_about
from gensim2.objects.generators.generate import blueprint, blueprint_hash, generate
from gensim2.objects.known import JOINT_TYPES
from gensim2.objects.meshwork.convexes import ConvexBlock, depth_inside
from gensim2.objects.physics import hull_moments
from gensim2.objects.shapes import transform

CLASSES = sorted(object_classes())
PAPER_COUNTS = {
    "bag_lift": 2,
    "bag_move": 2,
    "bag_swing": 2,
    "bottle_cap": 2,
    "box_move": 1,
    "box_rotate": 13,
    "bucket_lift": 5,
    "bucket_move": 2,
    "bucket_swing": 26,
    "coffee_machine": 2,
    "dishwasher": 3,
    "door": 2,
    "drawer": 20,
    "faucet": 13,
    "kitchen_pot": 3,
    "laptop_move": 3,
    "laptop_rotate": 44,
    "microwave": 10,
    "oven": 4,
    "refrigerator": 2,
    "safe_move": 2,
    "safe_rotate": 15,
    "stapler_move": 3,
    "stapler_press": 3,
    "suitcase_move": 3,
    "suitcase_rotate": 4,
    "switch": 2,
    "toaster_move": 10,
    "toaster_press": 10,
    "toilet": 2,
    "trash_can": 3,
    "washing_machine": 2,
    "window_push": 2,
    "window_rotate": 2,
}


def test_every_class_of_the_paper_is_there() -> None:
    assert sorted(PAPER_COUNTS) == CLASSES == sorted(JOINT_TYPES)


@pytest.mark.parametrize("name", CLASSES)
def test_class_is_one_of_the_paper(name: str) -> None:
    known = object_classes()[name]
    assert known.joint_type == JOINT_TYPES[name]
    assert known.count >= PAPER_COUNTS[name]
    assert blueprint(name, 0).joint_type == known.joint_type


@pytest.mark.parametrize("name", CLASSES)
@settings(max_examples=4, deadline=None)
@given(number=st.integers(0, 10**6))
@example(number=10**6)
def test_any_number_gives_a_valid_object(name: str, number: int) -> None:
    model = generate(name, number)
    hulls = model.body.hulls + model.moving.hulls
    assert model.moving.hulls
    assert model.moving.meshes
    for hull in hulls:
        assert np.isfinite(hull).all()
        volume, _, _ = hull_moments(hull)
        assert volume > 1e-9
        assert np.ptp(hull, axis=0).max() < 0.8  # the highest are walls around doors and refrigerators
    assert model.upper > model.lower
    assert np.linalg.norm(model.axis) == pytest.approx(1)
    assert "articulated_object_head" in model.keypoints
    for key, point in model.keypoints.items():
        assert point.link == ("base" if "base" in key else "link_0")
        assert np.isfinite(point.position).all()
        assert point.description


@pytest.mark.parametrize("name", CLASSES)
@settings(max_examples=2, deadline=None)
@given(number=st.integers(0, 10**6))
def test_prepared_object_passes_the_geometric_checks(library: Library, name: str, number: int) -> None:
    assert geometric_findings(library.load(name, str(number))) == []


HOLLOW = {"box_rotate": 0.0, "drawer": 1.0, "microwave": 0.0, "safe_rotate": 0.0}


@pytest.mark.parametrize("name", sorted(HOLLOW))
@pytest.mark.parametrize("number", ["0", "7"])
def test_cavity_is_open(library: Library, name: str, number: str) -> None:
    """A 2 cm cube at the middle of the cavity touches nothing."""
    instance = library.load(name, number)
    T = instance.link_pose(HOLLOW[name])
    inside = next(k for n, k in instance.keypoints.items() if "inside" in n)
    center = inside.position if "base" in inside.link else transform(T, inside.position[None])[0]
    if name == "box_rotate":  # its keypoint is above the rim
        center = instance.hulls["base"][0].mean(axis=0) + np.array([0, 0, 0.03])
    probe = center + 0.01 * np.array([[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)])
    blocks = [ConvexBlock.of(h) for h in instance.hulls["base"]]
    blocks += [ConvexBlock.of(transform(T, h)) for h in instance.hulls["link_0"]]
    assert depth_inside(probe, blocks).max() == 0.0


@pytest.mark.parametrize(("make", "count"), [(faucet.sweeping, 300), (faucet.mixer, 100), (drawer.table, 100)])
def test_nothing_meets_what_moves_past_it(make: Callable[[np.random.Generator], Blueprint], count: int) -> None:
    deepest, lowest, covered = 0.0, 0.0, 0.0
    for seed in range(count):
        draw = np.random.default_rng(seed)
        made = make(draw)
        standing = [ConvexBlock.of(solid.hull) for solid in made.body if solid.hull is not None]
        bottom = min(float(solid.hull[:, 1].min()) for solid in made.body if solid.hull is not None)
        lowest = max(lowest, made.body[0].hull[:, 1].min() - bottom if make is faucet.sweeping else 0.0)
        if make is faucet.sweeping:
            under = np.asarray(made.keypoints["articulated_object_bottom_base"][0])
            covered = max(covered, float(depth_inside(under[None], standing).max()))
        for q in np.linspace(*made.limits, 7):
            for solid in made.moving:
                if solid.hull is not None:
                    shares = draw.dirichlet(np.ones(len(solid.hull)), 40)
                    points = np.concatenate([solid.hull, shares @ solid.hull])
                    if made.joint_type == "prismatic":
                        points = points + q * np.asarray(made.joint_axis)
                    else:
                        points = transform(turn_about(made.joint_origin, made.joint_axis, q), points)
                    deepest = max(deepest, float(depth_inside(points, standing).max()))
    assert deepest < 1e-4
    assert lowest == pytest.approx(0.0, abs=1e-6)  # stands on the ground
    assert covered == 0.0


def test_same_hash_in_another_process() -> None:
    here = {name: blueprint_hash(name, 3, blueprint(name, 3)) for name in CLASSES}
    code = (
        "from gensim2.objects.generators.classes import object_classes as c\n"
        "from gensim2.objects.generators.generate import blueprint as b, blueprint_hash as h\n"
        "print({n: h(n, 3, b(n, 3)) for n in c()})"
    )
    there = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONHASHSEED": "17", "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    assert there.stdout.strip() == str(here)


def test_numbers_differ() -> None:
    for name in CLASSES:
        hashes = {blueprint_hash(name, i, blueprint(name, i)) for i in range(3)}
        assert len(hashes) == 3


@pytest.mark.parametrize("name", [name for name in CLASSES if object_classes()[name].others])
def test_built_in_instances_are_of_the_first_make_and_those_behind_them_of_all(name: str) -> None:
    known = object_classes()[name]

    def makes(number: int) -> set[int]:
        found = blueprint_hash(name, number, blueprint(name, number))
        drawn = [make(rng(0, f"assets/{name}", number)) for make in (known.build, *known.others)]
        return {k for k, each in enumerate(drawn) if blueprint_hash(name, number, each) == found}

    assert all(makes(number) == {0} for number in range(known.count))
    behind = [makes(number) for number in range(known.count, known.count + 24)]
    assert all(len(each) == 1 for each in behind)
    assert set().union(*behind) == set(range(1 + len(known.others)))
