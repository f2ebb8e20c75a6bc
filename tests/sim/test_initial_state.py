"""Placement of several objects: apart, at rest, within reach, and reproducible by the seed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull
from scipy.spatial.distance import cdist

from gensim2.core.errors import InputError
from gensim2.objects.types import ArticulatedObject
from gensim2.robots import robot
from gensim2.scenes.arguments import as_library, chosen_instances
from gensim2.scenes.footprint import gap_between, hulls_in_root, outline, swept_points
from gensim2.scenes.initial_state import GAP, MAX_DRAWS, InitialState, PlacementError, sample_initial_state
from gensim2.scenes.reset_options import read_options
from gensim2.sim.headless import HeadlessEnv
from gensim2.tasks.library import load_task
from gensim2.tasks.parse import parse_task
from gensim2.tasks.spec import TaskSpec

PANDA = robot("panda")
HOLD = np.array([*PANDA.reset_qpos[:7], 1.0], dtype=np.float32)
# As in the original's long tasks.
CONTAINER = {"randomization": {"x": 0.05, "y": [0.0, 0.05], "openness_mean": 0.5}}
BESIDE = {"place": {"at": [-0.2, -0.45]}, "randomization": {"x": 0.1, "y": 0.1}}


def _task(objects: Mapping[str, Any]) -> TaskSpec:
    first = next(iter(objects))
    done = {"type": "distance_gripper_rigidbody", "rigid": first}
    step = {"name": "do", "object": first, "strategies": ["any"], "done": [done]}
    return parse_task({"name": "Place", "description": "place it", "objects": objects, "steps": [step]})


def _set_up(task: TaskSpec, seed: int, options: Mapping[str, Any] | None = None, library: Any = None) -> InitialState:
    library = library or as_library("builtin")
    instances = chosen_instances(library, task, "all")
    return sample_initial_state(task, library, instances, seed, read_options(options, tuple(task.objects)), PANDA)


def _distance(first: np.ndarray, second: np.ndarray) -> float:
    """Return the distance of two convex outlines, by points 1 mm apart along their edges."""

    def dense(corners: np.ndarray) -> np.ndarray:
        following = np.roll(corners, -1, axis=0)
        return np.concatenate(
            [np.linspace(a, b, int(np.linalg.norm(b - a) / 0.001) + 2) for a, b in zip(corners, following, strict=True)]
        )

    return float(cdist(dense(first), dense(second)).min())


@pytest.mark.parametrize("container", ["drawer", "box_rotate", "refrigerator", "safe_rotate"])
@pytest.mark.parametrize("rigid", ["golf_ball", "cracker_box"])
def test_long_horizon_scenes_are_apart_at_rest_and_within_reach(container: str, rigid: str) -> None:
    task = _task({"container": {"class": container, **CONTAINER}, "thing": {"class": rigid, **BESIDE}})
    draws = []
    for seed in range(20):
        setup = _set_up(task, seed)
        draws.append(setup.draws)
        outlines = [outline(swept_points(p.model), p.position, p.quaternion) for p in setup.objects.values()]
        assert _distance(*outlines) > GAP - 0.001
        thing = setup.objects["thing"]
        assert np.linalg.norm(thing.position[:2] - np.array(PANDA.base_position)[:2]) < PANDA.reach + 0.01
        low = np.concatenate([thing.in_world(hull) for hull in hulls_in_root(thing.model, 0.0)])[:, 2].min()
        assert abs(low) < 0.002
        assert abs(thing.position[0] + 0.2) <= 0.1
        assert abs(thing.position[1] + 0.45) <= 0.1
    assert np.mean(draws) < 3


def test_placements_are_drawn_again_until_they_keep_apart_and_it_is_counted() -> None:
    crowded = {"place": {"at": [-0.1, 0.0]}, "randomization": {"x": 0.12, "y": 0.3}}
    task = _task({name: {"class": name, **crowded} for name in ("apple", "mug", "bowl", "cup")})
    setups = [_set_up(task, seed) for seed in range(30)]
    assert max(setup.draws for setup in setups) > 1
    for seed, setup in enumerate(setups):
        things = list(setup.objects.values())
        outlines = [outline(swept_points(p.model), p.position, p.quaternion) for p in things]
        for index, first in enumerate(outlines):
            assert all(_distance(first, second) > GAP - 0.001 for second in outlines[:index])
        again = _set_up(task, seed)
        assert again.draws == setup.draws
        assert all(np.array_equal(again.objects[n].position, p.position) for n, p in setup.objects.items())


def test_an_object_that_is_alone_is_never_drawn_again() -> None:
    task = _task({"cup": {"class": "cup", "place": {"at": [0.6, 0.6]}}})
    assert _set_up(task, 0).draws == 1


def test_a_tall_object_keeps_clear_of_the_hand_at_rest_and_all_of_the_base() -> None:
    task = _task(
        {
            "cracker_box": {
                "class": "cracker_box",
                "place": {"at": [-0.2, 0.0]},
                "randomization": {"x": 0.3, "y": 0.3},
            },
            "golf_ball": {"class": "golf_ball", "place": {"at": [-0.5, 0.0]}, "randomization": {"x": 0.3, "y": 0.3}},
        }
    )
    hand = PANDA.gripper_with(PANDA.reset_qpos)["tool_head"]
    below = 0
    for seed in range(40):
        setup = _set_up(task, seed)
        ball = setup.objects["golf_ball"].position
        assert np.linalg.norm(ball[:2] - np.array(PANDA.base_position)[:2]) > 0.12
        below += np.linalg.norm(ball[:2] - hand[:2]) < 0.12
        box = setup.objects["cracker_box"]
        top = box.in_world(swept_points(box.model))[:, 2].max()
        assert top < hand[2] - 0.02 or np.linalg.norm(box.position[:2] - hand[:2]) > 0.12
    assert below > 0  # low objects may be there


def test_no_room_is_an_error_that_names_the_objects() -> None:
    there = {"place": {"at": [0.0, 0.0]}, "randomization": {"x": 0.01, "y": 0.01}}
    task = _task({"bowl": {"class": "bowl", **there}, "mug": {"class": "mug", **there}})
    with pytest.raises(
        PlacementError,
        match=r"100 random placements with seed 5 leaves enough space, the last for bowl \(bowl\), mug \(mug\)",
    ):
        _set_up(task, 5)
    # Unless options place one or both of them elsewhere.
    away = _set_up(task, 5, {"offset": {"mug": [0.0, 0.3, 0.0]}})
    assert away.draws == 1
    both = _set_up(task, 5, {"offset": {"mug": [0.0, 0.0, 0.0], "bowl": [0.0, 0.0, 0.0]}})
    assert np.array_equal(both.objects["mug"].position[:2], [0.0, 0.0])


def test_other_objects_are_chosen_if_the_first_ones_find_no_room() -> None:
    """With this seed, the first box and the first drawer are too large to stand side by side."""
    task, library, seed = load_task("MoveRubiksCubeFromBoxToDrawer"), as_library("builtin"), 1971019364
    instances, free = chosen_instances(library, task, "new"), read_options({}, tuple(task.objects))
    setup = sample_initial_state(task, library, instances, seed, free, PANDA)
    assert setup.draws > MAX_DRAWS
    assert setup.objects["box"].model.id != "106" or setup.objects["drawer"].model.id != "83"
    # A chosen object is kept.
    fixed = read_options({"instance": {"box": "106", "drawer": "83"}}, tuple(task.objects))
    with pytest.raises(PlacementError, match="none of 100 random placements"):
        sample_initial_state(task, library, instances, seed, fixed, PANDA)


def test_an_option_for_one_object_shifts_nothing_of_the_others() -> None:
    task = _task({"drawer": {"class": "drawer", **CONTAINER}, "ball": {"class": "golf_ball", **BESIDE}})
    plain = _set_up(task, 2)
    assert plain.draws == 1
    other = _set_up(task, 2, {"instance": {"drawer": "3"}, "openness": {"drawer": 0.9}})
    assert np.array_equal(plain.objects["ball"].position, other.objects["ball"].position)
    assert other.objects["drawer"].openness == 0.9
    model = other.objects["drawer"].model
    assert isinstance(model, ArticulatedObject)
    assert model.id == "3"


def test_an_option_may_name_a_generated_object_that_is_not_listed() -> None:
    """A demonstration with such an object is replayed by its id."""
    task = _task({"drawer": {"class": "drawer"}})
    assert _set_up(task, 0, {"instance": {"drawer": "4711"}}).objects["drawer"].model.id == "4711"
    with pytest.raises(InputError, match="instance"):
        _set_up(task, 0, {"instance": {"drawer": "train"}})


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"openness": 0.5}, "openness: must be a mapping from the name of each object to its value"),
        ({"openness": {"drower": 0.5}}, "openness: there is no object 'drower' "),
        ({"openness": {"drawer": 1.5}}, "openness.drawer: must lie in 0..1"),
        ({"openness": {"ball": 0.5}}, "openness: golf_ball has no joint"),
        ({"instance": {"ball": "1"}}, "instance: no instance '1' of golf_ball"),
        (
            {"pose": {"ball": [0, 0, 0, 1, 0, 0, 0]}, "offset": {"ball": [0, 0, 0]}},
            "offset: must not be given together",
        ),
    ],
)
def test_options_of_several_objects_name_them(options: dict[str, Any], expected: str) -> None:
    task = _task({"drawer": {"class": "drawer"}, "ball": {"class": "golf_ball", **BESIDE}})
    with pytest.raises(InputError) as caught:
        _set_up(task, 0, options)
    assert expected in str(caught.value)


def test_a_caller_chooses_among_the_instances_that_a_task_takes() -> None:
    objects = {
        "first": {"class": "drawer"},
        "second": {"class": "drawer", "instances": ["4", "8"]},
        "ball": {"class": "golf_ball"},
    }
    library, task = as_library("builtin"), _task(objects)
    everything = library.instances("drawer")
    assert chosen_instances(library, task, "all") == {"first": everything, "second": ("4", "8"), "ball": ("0",)}
    assert chosen_instances(library, task, "7")["first"] == ("7",)
    test = library.choose("drawer", "test")
    assert chosen_instances(library, task, "test") == {"first": test, "second": ("8",), "ball": ("0",)}
    assert chosen_instances(library, task, {"second": "7"}) == {"first": everything, "second": ("7",), "ball": ("0",)}
    with pytest.raises(InputError, match="instances: there is no object 'third'"):
        chosen_instances(library, task, {"third": "7"})
    with pytest.raises(
        InputError,
        match="accepts only the instances 4, 8 of drawer, but none of these instances is in the selection new",
    ):
        chosen_instances(library, task, "new")


def test_what_a_task_takes_may_differ_by_where_objects_come_from(crates: Callable[..., Any]) -> None:
    objects = {
        "crate": {"class": "crate", "instances": {"real": ["1"]}},
        "drawer": {"class": "drawer", "instances": {"real": ["19179"]}},
    }
    chosen = chosen_instances(crates(2), _task(objects), "all")
    assert chosen == {"crate": ("1",), "drawer": as_library("builtin").instances("drawer")}


def test_an_object_in_another_lies_on_its_floor_and_stays(crates: Callable[..., Any]) -> None:
    """The crate's measured point is 1 cm above its bottom, on its floor; the box's is above its rim."""
    inside = {"randomization": {"x": 0.03, "y": 0.03}}
    task = _task(
        {
            "crate": {"class": "crate", "randomization": {"openness_mean": 0.9}},
            "ball": {"class": "golf_ball", "place": {"on": "crate"}, **inside},
            "box": {"class": "box_rotate", "place": {"at": [-0.2, 0.45]}, "randomization": {"openness_mean": 1.0}},
            "lemon": {"class": "lemon", "place": {"on": "box"}, **inside},
        }
    )
    lane = HeadlessEnv(task, assets=crates(friction=2.0))
    for seed in range(3):
        lane.reset(seed)
        placed = lane.initial_state.objects["ball"]
        bottom = np.concatenate([placed.in_world(hull) for hull in hulls_in_root(placed.model, 0.0)])[:, 2].min()
        assert bottom == pytest.approx(0.01, abs=0.001)
        before = lane.measure()
        for _ in range(20):
            lane.step(HOLD)
        after = lane.measure()
        for name in ("ball", "lemon"):
            assert np.linalg.norm(after.poses[name][:3] - before.poses[name][:3]) < 0.01
            assert after.speeds[name][0] < 0.01
        # Inside the walls, and not in the floor.
        lemon = after.poses["lemon"][2]
        assert 0.01 < lemon < before.point("box")[2]


def test_an_object_that_finds_no_room_in_another_is_refused(crates: Callable[..., Any]) -> None:
    task = _task({"crate": {"class": "crate"}, "box": {"class": "cracker_box", "place": {"on": "crate"}}})
    with pytest.raises(PlacementError):
        _set_up(task, 0, {"openness": {"crate": 0.0}}, crates())


_corner = st.tuples(st.floats(-1, 1), st.floats(-1, 1))
_corners = st.lists(_corner, min_size=4, max_size=12, unique=True).map(np.array)


@given(_corners, _corners, st.tuples(st.floats(-3, 3), st.floats(-3, 3)), st.floats(0.0, 0.3))
def test_outlines_that_keep_apart_do(first: np.ndarray, second: np.ndarray, shift: Any, gap: float) -> None:
    outlines = []
    for corners in (first, second + np.array(shift)):
        spread = np.linalg.svd(corners - corners.mean(axis=0))[1]
        if spread[-1] < 0.05:
            return
        outlines.append(corners[ConvexHull(corners).vertices])
    # Directions of separating lines: a finer, independent search than over the edges.
    angles = np.linspace(0.0, 2 * np.pi, 721)
    normals = np.column_stack([np.cos(angles), np.sin(angles)])
    widest = float(((outlines[1] @ normals.T).min(axis=0) - (outlines[0] @ normals.T).max(axis=0)).max())
    if gap_between(*outlines) >= gap:
        assert widest > gap - 0.02
    if widest < -0.001:
        assert gap_between(*outlines) < gap


def test_the_strip_between_two_outlines_lies_along_an_edge() -> None:
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    assert gap_between(square, square + np.array([1.1, 0.5])) >= 0.099
    assert gap_between(square, square + np.array([1.1, 0.5])) < 0.101
    # From corner to corner the separation is smaller than the distance, and never larger.
    assert gap_between(square, square + np.array([1.1, 1.1])) >= 0.099
    assert gap_between(square, square + np.array([1.1, 1.1])) < 0.12
