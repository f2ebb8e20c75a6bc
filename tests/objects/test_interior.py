"""Free space inside containers, found from their collision hulls."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from gensim2.objects import open_library
from gensim2.objects.meshwork.interior import InnerBox, inner_box
from gensim2.objects.types import ArticulatedObject

Array = npt.NDArray[np.float64]


def _box(instance: ArticulatedObject) -> tuple[InnerBox | None, tuple[Array, ...], Array]:
    """Return the free space, the hulls around it and the vertical, in the containing link's frame."""
    point = list(instance.keypoints.values())[-1]
    moving = point.link == instance.joint.child_link
    R_root_link = instance.joint.T_root_child[:3, :3] if moving else np.eye(3)
    up = (instance.placement.rotation @ R_root_link).T @ np.array([0.0, 0.0, 1.0])
    hulls = instance.hulls[point.link]
    return inner_box(hulls, point.position, up), hulls, up


def _check(instance: ArticulatedObject) -> None:
    box, hulls, up = _box(instance)
    assert box is not None, instance.id
    corners = np.concatenate(hulls)
    low, high = corners.min(axis=0), corners.max(axis=0)
    assert (box.low > low - 0.01).all()
    assert (box.high < high + 0.01).all()
    middle, half = (box.low + box.high) / 2, (box.high - box.low) / 2
    assert (2 * half > 0.02).all()
    assert box.contains(middle)
    axis = int(np.argmax(np.abs(up)))
    step = np.sign(up[axis]) * np.eye(3)[axis]
    # Below the floor, above the rim and beyond the walls is outside.
    assert not box.contains(middle - (half[axis] + 0.02) * step)
    assert not box.contains(middle + (half[axis] + 0.02) * step)
    for side in (i for i in range(3) if i != axis):
        assert not box.contains(middle + (half[side] + 0.01) * np.eye(3)[side])
    # The free space is large: each of its sides is at least half of the link's.
    for side in range(3):
        assert 2 * half[side] > 0.35 * (high - low)[side]
    # It is free: almost none of it is inside a hull.
    grid = np.stack(np.meshgrid(*[np.linspace(-0.8, 0.8, 7)] * 3), axis=-1).reshape(-1, 3) * half + middle
    assert np.mean([any(_is_inside(hull, point) for hull in hulls) for point in grid]) < 0.15


def _is_inside(hull: Array, point: Array) -> bool:
    low, high = hull.min(axis=0), hull.max(axis=0)
    if not ((low < point) & (point < high)).all():
        return False
    from scipy.spatial import ConvexHull

    planes = ConvexHull(hull).equations
    return bool((planes[:, :3] @ point + planes[:, 3] < 0).all())


@pytest.mark.parametrize(
    ("asset_class", "count"), [("drawer", 12), ("box_rotate", 12), ("safe_rotate", 4), ("refrigerator", 1)]
)
def test_generated_containers_have_a_room_inside(asset_class: str, count: int) -> None:
    library = open_library("builtin")
    for name in library.instances(asset_class)[:count]:
        _check(library.load(asset_class, name))


def test_what_contains_nothing_has_none() -> None:
    library = open_library("builtin")
    for name in library.instances("faucet")[:8]:
        assert _box(library.load("faucet", name))[0] is None


@pytest.mark.real
@pytest.mark.parametrize(
    ("asset_class", "ids"),  # instances that `tests/real` prepares as well
    [
        ("drawer", ("19179", "20453")),
        ("box_rotate", ("100141", "100664")),
        ("refrigerator", ("11178",)),
    ],
)
def test_real_containers_have_a_room_inside(asset_class: str, ids: tuple[str, ...], real_assets: Path) -> None:
    library = open_library(real_assets)
    for name in ids:
        assert _box(library.load(asset_class, name))[0] is not None, name


def test_what_lies_flat_on_the_floor_of_a_large_container_is_inside() -> None:
    def slab(*sides: tuple[float, float]) -> Array:
        return np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 3)

    x, y, z = (-0.3, 0.3), (-0.3, 0.3), (0.0, 0.9)
    hulls = (
        slab(x, y, (0.0, 0.031)),
        slab(x, y, (0.87, 0.9)),
        slab((0.27, 0.3), y, z),
        slab(x, (-0.3, -0.27), z),
        slab(x, (0.27, 0.3), z),
    )
    box = inner_box(hulls, np.array([0.0, 0.0, 0.04]), np.array([0.0, 0.0, 1.0]))
    assert box is not None
    assert box.contains(np.array([0.0, 0.0, 0.033]))
    assert not box.contains(np.array([0.0, 0.0, 0.029]))
    assert box.contains(np.array([0.268, 0.0, 0.1]))
    assert not box.contains(np.array([-0.31, 0.0, 0.1]))  # open in front, where the link ends
