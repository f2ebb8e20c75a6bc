"""The planner's references are recorded beside the commands, which a drive may change."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gensim2.data.episode_file import read_episode, write_episode
from gensim2.perception.observation import tool_pose
from gensim2.rollout.chain import ChainController
from gensim2.rollout.run import run
from gensim2.sim.headless import HeadlessEnv
from gensim2.tasks.library import load_strategies, load_task

TASK = "PlaceGolfBallIntoDrawer"


def test_the_reference_is_the_plan_without_the_drives_lag_and_says_how_hard_the_fingers_press(tmp_path: Path) -> None:
    env = HeadlessEnv(TASK, assets="builtin")
    controller = ChainController(load_task(TASK), load_strategies(TASK), env.profile)
    result = run(env, controller, seed=3, record=True)
    recording = result.recording
    assert recording is not None
    found = recording.reference
    meant = np.isfinite(found["joint_positions"]).all(axis=1)
    assert 0.7 < meant.mean() < 1.0, "while the scene settles nothing is meant"
    q = recording.env_states["articulations"]["panda"][1:, 13:20]
    behind = np.abs(found["joint_positions"] - q)[meant].max(axis=1)
    ahead = np.abs(recording.actions[:, :7] - q)[meant].max(axis=1)
    assert np.median(behind) < 0.5 * np.quantile(ahead, 0.75), (
        "the arm is where it is meant to be, not where it is sent"
    )
    assert np.quantile(behind, 0.9) < 0.05
    moving = meant[1:] & meant[:-1]
    step = np.diff(found["joint_positions"], axis=0)[moving] * env.profile.control_hz
    assert np.median(np.abs(step - found["joint_velocities"][1:][moving])) < 1e-4
    joints = np.append(found["joint_positions"][meant][5], [0.04, 0.04]).astype(np.float32)
    assert np.allclose(found["tool_pose"][meant][5], tool_pose(env.profile, joints), atol=1e-6)
    width, force = found["gripper"].T
    pressed = np.isfinite(force)
    assert pressed.any()
    assert (force[pressed] > 0).all()
    fingers = recording.env_states["articulations"]["panda"][:-1, 20:22].sum(axis=1)
    assert np.allclose(width[pressed], fingers[pressed], atol=1e-6), "the pads stay on what they hold"
    assert width[pressed].max() < 0.045 < width[~pressed & meant].max(), "no wider than the ball"
    write_episode(tmp_path / "000000.h5", result.episode, recording)
    again = read_episode(tmp_path / "000000.h5").recording
    assert again is not None
    for name, array in found.items():
        assert again.reference[name].tobytes() == array.tobytes()
