"""A measurement keeps the values of its instant, even if it is read later."""

from __future__ import annotations

import pickle

import numpy as np

from gensim2.sim.headless import HeadlessEnv


def test_what_is_looked_at_later_is_what_was_there() -> None:
    lane = HeadlessEnv("PlaceGolfBallIntoDrawer", assets="builtin", instances=["5"])
    lane.reset(0)
    # Change everything: the arm sinks forward, the drawer is moved, the ball is pushed.
    action = np.array([*lane.profile.reset_qpos[:7], 1.0], dtype=np.float32) + 0.3
    at_once, later = lane.measure(), lane.measure()
    seen = {name: dict(points) for name, points in at_once.keypoints.items()} | {"hand": dict(at_once.gripper)}
    part = lane.parts["drawer"]
    for _ in range(10):
        lane.step(action)
    part.articulation.qpos = np.array([part.model.joint.upper], dtype=np.float32)
    lane.nudge("ball", dx=0.05)
    now = lane.measure()
    for name, points in seen.items():
        then = later.gripper if name == "hand" else later.keypoints[name]
        moved = now.gripper if name == "hand" else now.keypoints[name]
        assert list(then) == list(points)
        assert all(np.array_equal(then[key], point) for key, point in points.items()), name
        assert any(np.linalg.norm(moved[key] - point) > 0.01 for key, point in points.items()), name
    copy = pickle.loads(pickle.dumps(later))
    assert type(copy.gripper) is dict
    assert np.array_equal(copy.point("ball"), later.point("ball"))
