"""A yaw of scene and robot about the base changes only the targets of the first joint."""

from __future__ import annotations

import made_up
import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from gensim2.core.errors import InputError
from gensim2.perception.observation import CLOUD, STATE, TOOL_POSE, tool_pose
from gensim2.policy.frames import SEEN, check_turns, inputs_of, yawed
from gensim2.policy.network import CLOUD as CLOUD_INPUT
from gensim2.policy.network import PROPRIO, TEXT, fresh_network
from gensim2.policy.text import prepare
from gensim2.robots import robot


def _turned(seen: dict[str, torch.Tensor], angle: float) -> dict[str, torch.Tensor]:
    """Return the observation of the turned scene, by SciPy and the robot's kinematics."""
    found = {name: value.clone() for name, value in seen.items()}
    matrix = torch.from_numpy(Rotation.from_euler("z", angle).as_matrix().astype(np.float32))
    found[CLOUD][..., :3] = seen[CLOUD][..., :3] @ matrix.T
    found[STATE][..., 0] += angle
    rows = found[STATE].reshape(-1, 9).numpy()
    poses = np.array([tool_pose(robot("panda"), row) for row in rows])
    found[TOOL_POSE] = torch.from_numpy(poses.reshape(seen[TOOL_POSE].shape))
    return found


@pytest.fixture
def seen() -> dict[str, torch.Tensor]:
    drawn = made_up.MadeUpSource(made_up.policy()).draw(np.random.default_rng(0), 3)
    return {name: drawn[name] for name in SEEN}


@pytest.mark.parametrize("angle", [-1.3, 0.7])
@pytest.mark.parametrize(
    ("encoder", "keyframes"), [("mlp", 0), ("mlp", 2), ("pointnet", 0), ("pointnext", 0), ("state", 0)]
)
def test_a_turned_scene_has_the_same_relative_actions(
    seen: dict[str, torch.Tensor], encoder: str, keyframes: int, angle: float
) -> None:
    config = made_up.policy(encoder=encoder, keyframes=keyframes, points=made_up.POINTS)
    table = prepare(["open the drawer"], config)
    network = fresh_network(config, 7, table.shape[1:], 0).eval()
    actions = []
    for each in (seen, _turned(seen, angle)):
        inputs = inputs_of(each, config, 7)
        batch = {CLOUD_INPUT: inputs.cloud, PROPRIO: inputs.proprio, TEXT: table.expand(3, -1, -1)}
        with torch.no_grad():
            actions.append(network(batch, torch.zeros(3, 0)))
    assert actions[0].abs().max() > 1e-3
    assert torch.allclose(actions[0], actions[1], atol=1e-5)


def test_in_the_base_frame_a_turned_scene_is_another_one(seen: dict[str, torch.Tensor]) -> None:
    config = made_up.policy(frame="base")
    mine, other = (inputs_of(each, config, 7) for each in (seen, _turned(seen, 0.7)))
    assert not torch.allclose(mine.cloud, other.cloud, atol=1e-2)
    assert not torch.allclose(mine.proprio, other.proprio, atol=1e-2)


def test_the_augmentation_is_such_a_turn(seen: dict[str, torch.Tensor]) -> None:
    found, expected = yawed(seen, torch.full((3,), 0.7)), _turned(seen, 0.7)
    for name in SEEN:
        assert torch.allclose(found[name], expected[name], atol=1e-5), name


def test_a_robot_whose_first_joint_does_not_turn_it_is_refused() -> None:
    check_turns(robot("panda"), made_up.policy())
    with pytest.raises(InputError, match="frame: base"):
        check_turns(robot("fetch"), made_up.policy())
    check_turns(robot("fetch"), made_up.policy(frame="base"))
