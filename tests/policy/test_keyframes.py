"""Keyframes of demonstrations, the pointer to them, and arms that are perturbed."""

from __future__ import annotations

import made_up
import numpy as np
import pytest
import torch

from gensim2.core.errors import InputError
from gensim2.perception.observation import GRIPPER, STATE, TOOL_POSE, tool_pose
from gensim2.policy.augment import off_its_way
from gensim2.policy.heads.actions import ACTION
from gensim2.policy.keyframes import KEY_POSITIONS, KEY_ROTATIONS, keyframes, next_keyframes, taught_frames
from gensim2.policy.network import CLOUD as CLOUD_INPUT
from gensim2.policy.network import PROPRIO
from gensim2.policy.pointer import KeyframePointer
from gensim2.policy.rotations import matrix_of_quaternion
from gensim2.policy.train import train_policy
from gensim2.robots import robot

HZ = 20.0


def _stops(*at: int, waits: int = 6) -> np.ndarray:
    """Return targets (T, 2) that rise by 0.3 rad per segment, at rest at these steps and for a while at both ends."""
    parts, begin = [np.zeros(waits)], 0
    for number, stop in enumerate(at):
        share = np.arange(1, stop - begin + 1) / (stop - begin)
        parts.append(0.3 * (number + (1 - np.cos(np.pi * share)) / 2))
        begin = stop
    parts.append(np.full(waits, 0.3 * len(at)))
    one = np.concatenate(parts).astype(np.float32)
    return np.column_stack([one, 0.5 * one])


def test_keyframes_are_where_the_arm_stands_still() -> None:
    actions = _stops(12, 24, 40)
    found = keyframes(actions, HZ)
    assert len(found) == 3
    assert np.abs(found - (np.array([12, 24, 40]) + 5)).max() <= 2
    assert keyframes(np.zeros((7, 2), np.float32), HZ).tolist() == [6]


def test_the_next_keyframes_end_with_the_last() -> None:
    ahead = next_keyframes(np.array([4, 9]), 11, 2)
    assert ahead[0].tolist() == [4, 9]
    assert ahead[2].tolist() == [4, 9]
    assert ahead[3].tolist() == [9, 9]  # the first keyframe is the next
    assert ahead[10].tolist() == [9, 9]


def test_waiting_at_either_end_is_not_taught() -> None:
    actions = _stops(12, 24, waits=10)
    still = np.full(len(actions), 0.08, np.float32)
    rows = np.flatnonzero(taught_frames(actions, still, HZ))
    moves = np.flatnonzero(np.abs(np.diff(actions, axis=0)).max(1) * HZ > 0.1)
    assert 0 < rows[0] < moves[0] <= rows[0] + 1
    assert moves[-1] < rows[-1] < len(actions) - 1
    assert len(rows) == rows[-1] - rows[0] + 1
    assert taught_frames(np.zeros((7, 2), np.float32), still[:7], HZ).all()


def test_fingers_that_close_before_the_arm_sets_off_are_taught() -> None:
    actions = _stops(12, 24, waits=10)
    widths = np.zeros(len(actions), np.float32)
    widths[:3] = (0.08, 0.05, 0.02)
    rows = np.flatnonzero(taught_frames(actions, widths, HZ))
    assert rows[:3].tolist() == [0, 1, 2]  # without frames in which everything waits
    assert rows[3] > 7


def test_an_arm_off_its_way_is_led_back() -> None:
    config = made_up.policy(keyframes=2)
    batch = dict(made_up.MadeUpSource(config).draw(np.random.default_rng(3), 40))
    batch[GRIPPER][:, :, 0], batch[GRIPPER][:, :, 1] = 0.08, 1.0
    batch[GRIPPER][:10, :, 0], batch[GRIPPER][:10, :, 1] = 0.03, -1.0  # these hold an object
    found = off_its_way(batch, robot("panda"), made_up.training(arm_noise=0.05), torch.Generator().manual_seed(0))
    moved = (found[STATE] - batch[STATE]).abs().amax((1, 2))
    assert (moved[:10] == 0).all()
    assert 0.2 < (moved[10:] > 0).float().mean() < 0.8
    assert moved.max() < 0.3
    for row in torch.flatten(torch.nonzero(moved)).tolist():
        for frame in range(config.history):
            expected = tool_pose(robot("panda"), found[STATE][row, frame].numpy())
            assert np.allclose(found[TOOL_POSE][row, frame].numpy(), expected, atol=1e-6)
    targets = [each[ACTION][..., :7] + each[STATE][:, -1, None, :7] for each in (batch, found)]
    assert torch.allclose(*targets, atol=1e-6)
    places, turns = [], []
    for each in (batch, found):
        pose = each[TOOL_POSE][:, -1]
        R = matrix_of_quaternion(pose[:, 3:])
        places.append(each[KEY_POSITIONS] @ R.transpose(1, 2) + pose[:, None, :3])
        turns.append(R[:, None] @ each[KEY_ROTATIONS])
    assert torch.allclose(*places, atol=1e-5, equal_nan=True)
    assert torch.allclose(*turns, atol=1e-5)


def test_a_pointer_learns_where_the_brightest_point_is() -> None:
    config = made_up.policy(keyframes=1, history=1)
    generator, torch_seed = torch.Generator().manual_seed(1), torch.random.get_rng_state()
    torch.manual_seed(0)
    pointer = KeyframePointer(config, 4)
    torch.random.set_rng_state(torch_seed)
    optimizer = torch.optim.Adam(pointer.parameters(), 3e-3)
    errors = []
    for _ in range(200):
        points = 0.3 * torch.rand(32, 24, 3, generator=generator)
        bright = torch.randint(24, (32,), generator=generator)
        features = torch.cat([torch.nn.functional.one_hot(bright, 24)[..., None].float(), points / 0.3], -1)
        true = points[torch.arange(32), bright][:, None]
        pointed = pointer(points, features, torch.zeros(32, 3 * config.width), points, generator)
        loss = pointer.loss(pointed, {KEY_POSITIONS: true, KEY_ROTATIONS: torch.eye(3).expand(32, 1, 3, 3)})
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        errors.append(float((pointed.places - true).norm(dim=-1).mean().detach()))
    assert np.mean(errors[:5]) > 0.08
    assert np.mean(errors[-5:]) < 0.02


def test_what_is_not_known_teaches_the_pointer_nothing() -> None:
    config = made_up.policy(keyframes=2)
    pointer = KeyframePointer(config, 4)
    points = torch.rand(3, 24, 3)
    pointed = pointer(points, torch.rand(3, 24, 4), torch.zeros(3, 3 * config.width), points)
    nothing = {KEY_POSITIONS: torch.full((3, 2, 3), torch.nan), KEY_ROTATIONS: torch.full((3, 2, 3, 3), torch.nan)}
    assert pointer.loss(pointed, nothing) == 0.0


def test_training_of_arms_off_their_way_wants_clouds_without_the_robot(tmp_path: object) -> None:
    config = made_up.policy()
    source = made_up.MadeUpSource(config)
    with pytest.raises(InputError, match="clouds without the robot"):
        train_policy(source, config, made_up.training(arm_noise=0.05), tmp_path / "policy")  # type: ignore[operator]
    with pytest.raises(InputError, match="keyframes"):
        made_up.policy(head="keypose", keyframes=2)


def test_the_points_of_the_first_look_are_spread_over_the_cloud() -> None:
    from gensim2.policy.network import fresh_network

    config = made_up.policy(keyframes=1, seen_points=6, text="none", history=1)
    network = fresh_network(config, 7, (0,), 0)
    batch = {CLOUD_INPUT: torch.rand(2, 1, 24, 9), PROPRIO: torch.rand(2, 1, 18)}
    rows = network._any_of(batch[CLOUD_INPUT].flatten(0, 1), None)
    assert rows.tolist() == [[2, 6, 10, 14, 18, 22]] * 2
    drawn = network._any_of(batch[CLOUD_INPUT].flatten(0, 1), torch.Generator().manual_seed(0))
    assert (drawn // 4 == torch.arange(6)).all()
