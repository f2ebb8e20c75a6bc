"""Real objects in the environment: they load completely, stay at rest, and their scenes are plausible."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gensim2.objects import Library, open_library
from gensim2.rollout.motion import changes
from gensim2.rollout.no_op import no_op_baseline
from gensim2.sim.headless import HeadlessEnv
from gensim2.tasks.library import load_task, task_names

pytestmark = pytest.mark.real


@pytest.fixture(scope="module")
def real_library(real_assets: Path) -> Library:
    return open_library(str(real_assets))


@pytest.mark.parametrize("name", task_names("paper"))
def test_a_real_object_stands_still_for_five_seconds_and_can_be_planned_for(
    name: str, real_assets: Path, real_library: Library
) -> None:
    # One object per class for all tasks, because the decomposition into hulls is done at the first use.
    instances = {role: min(real_library.instances(used.asset_class)) for role, used in load_task(name).objects.items()}
    lane = HeadlessEnv(name, assets=real_assets, instances=instances)
    result = no_op_baseline(lane, 1, steps=100)
    assert not result.success
    for moved in changes(result.start, result.end).values():
        assert not moved.exceeds(0.01, 0.01)
    lane.reset(1)
    scene = lane.scene_state()
    for role, thing in scene.objects.items():
        placed = lane.initial_state.objects[role]
        assert placed.model.source == "real" or placed.model.asset_class == "gold_bar"  # its mesh is missing there
        # Nothing is below the table's surface or in the air.
        heights = [
            np.min(hull @ body.T_base_body[2, :3]) + body.T_base_body[2, 3]
            for body in thing.bodies
            for hull in body.hulls
        ]
        assert min(heights) > -0.002
        assert all(0.1 < np.linalg.norm(point) < 1.3 for point in thing.keypoints.values())
        if placed.model.joint is not None:
            assert sum(len(body.hulls) for body in thing.bodies) == sum(map(len, placed.model.hulls.values()))
