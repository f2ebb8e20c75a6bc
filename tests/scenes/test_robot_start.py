"""Initial robot poses that overlap no object."""

from __future__ import annotations

import numpy as np
from scipy.spatial import Delaunay

from gensim2.core.seeding import rng
from gensim2.robots import robot
from gensim2.scenes.arguments import as_library, chosen_instances
from gensim2.scenes.initial_state import MAX_STARTS, InitialState, clear_start, sample_initial_state
from gensim2.scenes.randomize import draw_start
from gensim2.scenes.reset_options import read_options
from gensim2.tasks.library import load_task

PANDA = robot("panda")
CUBE = 0.03 * (2.0 * np.stack(np.meshgrid([0, 1], [0, 1], [0, 1]), axis=-1).reshape(-1, 3) - 1.0)


def _at_hand(start: tuple[float, ...], forward: float) -> np.ndarray:
    """Return a cube of 6 cm around a point in front of or behind the tool head, in the world."""
    return CUBE + PANDA.gripper_with(start)["tool_head"] + np.array([forward, 0.0, 0.0])


def _vertices_inside(q: tuple[float, ...], cube: np.ndarray) -> bool:
    """Return whether a vertex of the hand or of a finger is inside the cube."""
    for link in ("panda_hand", "panda_leftfinger", "panda_rightfinger"):
        T_world_link = PANDA.T_world_base @ PANDA.model.forward_kinematics(np.array(q), link)
        points = PANDA.model.surface(link)[0].reshape(-1, 3) @ T_world_link[:3, :3].T + T_world_link[:3, 3]
        if ((points > cube.min(axis=0)) & (points < cube.max(axis=0))).all(axis=1).any():
            return True
    return False


def test_a_start_that_is_clear_stays_and_nothing_is_drawn() -> None:
    generator = rng(0, "start")
    before = generator.bit_generator.state
    assert clear_start(generator, PANDA.reset_qpos, PANDA, [[_at_hand(PANDA.reset_qpos, 0.3)]]) == PANDA.reset_qpos
    assert generator.bit_generator.state == before


def test_a_start_in_an_object_is_drawn_again() -> None:
    found = set()
    assert _vertices_inside(PANDA.reset_qpos, _at_hand(PANDA.reset_qpos, 0.0) + np.array([0.02, 0.02, 0.02]))
    for seed in range(5):
        cube = _at_hand(PANDA.reset_qpos, 0.0) + np.array([0.02, 0.02, 0.02])
        start = clear_start(rng(seed, "start"), PANDA.reset_qpos, PANDA, [[cube]])
        again = rng(seed, "start")
        drawn = [draw_start(again, PANDA) for _ in range(MAX_STARTS - 1)]
        assert start is None or start in drawn
        if start is not None:
            assert not _vertices_inside(start, cube)
            found.add(drawn.index(start))
    assert found


def test_there_is_no_start_where_the_object_is_everywhere() -> None:
    assert clear_start(rng(0, "start"), PANDA.reset_qpos, PANDA, [[10.0 * CUBE]]) is None
    assert clear_start(None, PANDA.reset_qpos, PANDA, [[_at_hand(PANDA.reset_qpos, 0.0) + 0.02]]) is None
    assert clear_start(None, PANDA.reset_qpos, PANDA, [[_at_hand(PANDA.reset_qpos, 0.3)]]) == PANDA.reset_qpos


def _hand_vertices(start: tuple[float, ...]) -> np.ndarray:
    """Return the vertices (N, 3) of the hand and the fingers in the world."""
    found = []
    for link in ("panda_hand", "panda_leftfinger", "panda_rightfinger"):
        T_world_link = PANDA.T_world_base @ PANDA.model.forward_kinematics(np.array(start), link)
        found.append(PANDA.model.surface(link)[0].reshape(-1, 3) @ T_world_link[:3, :3].T + T_world_link[:3, 3])
    return np.concatenate(found)


def test_the_only_object_of_a_scene_is_placed_clear_of_the_robot() -> None:
    task = load_task("OpenRefrigeratorDoor")
    near = {"at": [-0.06, 0.0]}
    [(name, spec)] = task.objects.items()
    spec = spec.model_copy(update={"place": spec.place.model_copy(update=near)})
    task = task.model_copy(update={"objects": {name: spec}})
    library = as_library("builtin")
    instances = chosen_instances(library, task, "all")

    def sampled(seed: int, **options: object) -> InitialState:
        given = read_options(options, (name,))
        return sample_initial_state(task, library, instances, seed, given, PANDA)

    again = 0
    for seed in range(12):
        state = sampled(seed)
        again += state.draws > 1
        hand = _hand_vertices(state.start)
        for hull in state.objects[name].hulls_in_world():
            assert (Delaunay(hull).find_simplex(hand) < 0).all()
    assert again
    # A placement that the caller gives is kept, also inside the robot.
    tool = PANDA.gripper_with(PANDA.reset_qpos)["tool_head"]
    inside = sampled(0, pose=[*tool[:2], 0.2, 1.0, 0.0, 0.0, 0.0])
    assert inside.draws == 1
    assert np.array_equal(inside.objects[name].position[:2], tool[:2])
