"""The keypose head on made-up scenes: it learns them, does not average over strategies, and is invariant to yaw."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from gensim2.core.errors import InputError
from gensim2.perception import Observation, PointCloud
from gensim2.perception.observation import CLOUD as OBSERVED
from gensim2.perception.observation import Proprioception
from gensim2.policy.checkpoint import PolicyCheckpoint
from gensim2.policy.config import PolicyConfig, TrainConfig
from gensim2.policy.export import export_policy, exported
from gensim2.policy.frames import SEEN, inputs_of, proprio_size, turn_matrix
from gensim2.policy.heads.keypose import SECONDS, KeyposeHead, _turned
from gensim2.policy.keypose.answers import answers, order_of_points
from gensim2.policy.keypose.data import read_planned
from gensim2.policy.keypose.program import ACTUATION
from gensim2.policy.keypose.source import PlannedSource, _either_way_round
from gensim2.policy.keypose.training import POLICY, TRAINING, read_ways, train_keypose
from gensim2.policy.network import CLOUD, PROPRIO, TEXT, fresh_network
from gensim2.policy.remote.protocol import ObservationMessage, decode, encode, observation_to_message
from gensim2.policy.source import SENTENCE
from gensim2.robots import robot

from .made_up import made_up, written

SIZES = {"seen_points": 48, "spread_points": 16, "width": 32, "hidden": 64, "layers": 1}
SMALL = PolicyConfig.of({**POLICY.to_dict(), **SIZES})
SHORT = TrainConfig.of({**TRAINING.to_dict(), "steps": 250, "batch": 16, "save_every": 1000, "dropout": 0.0})


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("keypose")
    source = PlannedSource([read_planned(written(made_up(), folder / "data"))])
    train_keypose(source, folder / "policy", policy=SMALL, training=SHORT)
    return folder / "policy"


def seen(row: int, yaw: float = 0.0) -> Observation:
    """Return the observation of an example, with robot and scene turned about the base."""
    arrays, profile = made_up().arrays, robot("panda")
    xyz = arrays["points"][row].astype(np.float32) * np.float32(1e-4)
    q = arrays["joints"][row].astype(np.float64)
    q[0] += yaw
    cloud = (turn_matrix(torch.tensor(yaw)).numpy() @ xyz.T).T.astype(np.float32)
    return Observation(
        step=0,
        time=0.0,
        language="push the bar",
        arrays=Proprioception(profile, q, np.zeros_like(q), 1.0),
        cloud=PointCloud(cloud, np.zeros(cloud.shape, np.uint8), None),
        cameras={},
    )


def test_new_tasks_are_drawn_five_times_as_often_as_known_ones() -> None:
    planned = made_up(4)
    others = [
        replace(planned, record=planned.record.model_copy(update={"language": language, "task": language.title()}))
        for language in ("pull", "lift")
    ]
    drawn = [
        np.bincount(PlannedSource([planned, *others], known).draw(np.random.default_rng(0), 3000)[SENTENCE]) / 3000
        for known in (0, 1)
    ]
    assert np.allclose(drawn, [[1 / 3, 1 / 3, 1 / 3], [1 / 11, 5 / 11, 5 / 11]], atol=0.03)


def test_two_folders_of_a_task_share_what_is_due_to_it() -> None:
    planned = made_up(4)
    other = replace(planned, record=planned.record.model_copy(update={"language": "pull", "task": "Pull"}))
    drawn = [
        np.bincount(PlannedSource(each, known).draw(np.random.default_rng(0), 3000)[SENTENCE]) / 3000
        for each, known in (([planned, other, other], 0), ([planned, other, other], 1))
    ]
    assert np.allclose(drawn, [[1 / 2, 1 / 2], [1 / 6, 5 / 6]], atol=0.03)


def test_two_folders_of_a_task_are_drawn_by_their_examples() -> None:
    few, many = made_up(4), made_up(12)
    marked = replace(few, arrays={**few.arrays, "seconds": few.arrays["seconds"] * 0 + 99})
    drawn = PlannedSource([marked, many]).draw(np.random.default_rng(0), 4000)[SECONDS]
    assert float((drawn == 99).all(-1).float().mean()) == pytest.approx(1 / 4, abs=0.03)


def test_it_learns_where_the_hand_acts_and_when_nothing_is_left(trained: Path) -> None:
    policy, arrays = PolicyCheckpoint.load(trained), made_up().arrays
    misses, right = [], 0
    for row in range(16):
        best = answers(policy, seen(row), policy.row_of("push the bar", trained))[0]
        done = arrays["way"][row] < 0
        right += (best.way == 2) == done
        if not done:
            misses.append(np.linalg.norm(best.program.positions[ACTUATION] - arrays["positions"][row, ACTUATION]))
    assert right == 16
    assert np.median(misses) < 0.015  # the goals are 0.2 m apart


def test_a_yaw_of_robot_and_scene_turns_the_answer_exactly(trained: Path) -> None:
    policy, yaw = PolicyCheckpoint.load(trained), 0.7
    row = policy.row_of("push the bar", trained)
    (one, *_), (turned, *_) = answers(policy, seen(0), row), answers(policy, seen(0, yaw), row)
    R = turn_matrix(torch.tensor(yaw, dtype=torch.float64)).numpy()
    assert one.way == turned.way
    assert np.allclose(one.program.positions @ R.T, turned.program.positions, atol=1e-4)
    assert np.allclose(R @ one.program.rotations, turned.program.rotations, atol=1e-3)


def test_a_tool_pose_with_swapped_fingers_is_turned_by_half_a_turn() -> None:
    turns = Rotation.random(40, random_state=0)
    poses = np.column_stack([np.zeros((40, 3)), turns.as_quat(scalar_first=True)])
    found = Rotation.from_quat(_either_way_round(poses, np.random.default_rng(0))[:, 3:], scalar_first=True)
    angle = (turns.inv() * found).magnitude()
    assert 8 < (angle > 1.0).sum() < 32
    swapped = turns.as_matrix() @ np.diag([-1.0, -1.0, 1.0])
    assert np.allclose(found.as_matrix()[angle > 1.0], swapped[angle > 1.0], atol=1e-6)
    assert np.allclose(angle[angle < 1.0], 0.0, atol=1e-6)


def test_the_first_look_has_points_of_what_is_small() -> None:
    config = PolicyConfig.of({**SMALL.to_dict(), "seen_points": 8, "spread_points": 4, "points": 400})
    network = fresh_network(config, 7, (0,), 0)
    cloud = 0.2 * torch.rand(1, 400, 3, generator=torch.Generator().manual_seed(0))
    cloud[0, 317] = torch.tensor([0.1, 0.6, 0.0])
    batch = {CLOUD: cloud[:, None], PROPRIO: torch.zeros(1, 1, proprio_size(config, 7)), TEXT: torch.zeros(1, 0)}
    context = network.context(batch)
    assert (context.points[0] == cloud[0, 317]).all(-1).any()
    assert context.points.shape == (1, 12, 3)
    assert context.features is not None
    assert context.features.shape[:2] == (1, 12)


def test_the_sentence_alone_has_a_say_in_what_is_meant() -> None:
    config = PolicyConfig.of({**SMALL.to_dict(), "text": "small", "ways": 3})
    network = fresh_network(config, 7, (24, 12), 0)
    head = network.head
    assert isinstance(head, KeyposeHead)
    assert head.hears is not None
    rng = torch.Generator().manual_seed(0)
    batch = {
        CLOUD: torch.rand(1, 1, 64, 3, generator=rng),
        PROPRIO: torch.zeros(1, 1, proprio_size(config, 7)),
        TEXT: torch.randint(0, 200, (1, 24, 12), generator=rng),
    }
    with torch.no_grad():
        head.hears.bias.copy_(torch.tensor([0.0, 9.0, 0.0]))
        first = network(batch, torch.zeros(1, 0))[0, 0]
    assert first[1] == 1
    assert first[0] > 0.9
    # Older policies and those of a single task have no such term.
    assert fresh_network(PolicyConfig.of({**config.to_dict(), "hears": False}), 7, (24, 12), 0).head.hears is None
    assert fresh_network(SMALL, 7, (0,), 0).head.hears is None


def test_a_hand_turned_by_half_a_turn_is_the_same_hand() -> None:
    rotations = torch.linalg.qr(torch.randn(1, 3, 3, generator=torch.Generator().manual_seed(0)))[0][:, None]
    half = rotations @ torch.diag(torch.tensor([-1.0, -1.0, 1.0]))
    quarter = rotations @ torch.tensor([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert _turned(half, rotations).item() < 1e-9
    assert _turned(quarter, rotations).item() > 1.0


def test_a_checkpoint_says_what_its_classes_mean(trained: Path) -> None:
    policy = PolicyCheckpoint.load(trained)
    assert [(way.language, way.step, way.name) for way in read_ways(trained, policy)] == [
        ("push the bar", 0, "one"),
        ("push the bar", 0, "other"),
    ]
    assert policy.action.kind == "keypose"
    assert policy.config.ways == 3
    assert policy.data.episodes == 16


def test_an_export_says_the_order_of_the_points_and_what_its_classes_mean(trained: Path, tmp_path: Path) -> None:
    export_policy(trained, tmp_path / "policy.pt2", "torch")
    about = json.loads((tmp_path / "policy.pt2.json").read_text())
    policy = PolicyCheckpoint.load(trained)
    assert about["points_order"] == order_of_points(96).tolist() != list(range(96))
    assert [each and each["name"] for each in about["classes"]] == ["one", "other", None]
    # In this order the exported graph gives the controller's results.
    shown = seen(0)
    tensors = {name: torch.from_numpy(np.asarray(shown[name], dtype=np.float32))[None, None] for name in SEEN}
    tensors[OBSERVED] = tensors[OBSERVED][:, :, about["points_order"]]
    inputs = inputs_of(tensors, policy.config, policy.action.arm)
    found = exported(tmp_path / "policy.pt2", "torch")({CLOUD: inputs.cloud, PROPRIO: inputs.proprio})
    best = answers(policy, shown, policy.row_of("push the bar", trained))[0]
    assert found[0, 0, :2].tolist() == pytest.approx([best.chance, best.way], abs=1e-4)


def test_poses_are_taught_in_the_turned_frame_alone(tmp_path: Path) -> None:
    other = PolicyConfig.of({**SMALL.to_dict(), "frame": "base"})
    with pytest.raises(InputError, match="frame: must be turned"):
        train_keypose(PlannedSource([made_up(4)]), tmp_path, policy=other, training=SHORT)


def test_a_head_with_more_ways_keeps_those_that_it_knows() -> None:
    few, many = (
        fresh_network(PolicyConfig.of({**SMALL.to_dict(), "ways": ways, "points": 96}), 7, (0,), seed).eval()
        for ways, seed in ((3, 0), (5, 1))
    )
    many.head.load_state_dict(many.head.grown(few.head.state_dict()))
    summary = torch.randn(4, SMALL.width)
    known, grown = few.head.way(summary), many.head.way(summary)
    assert grown.shape == (4, 5)
    assert torch.allclose(grown[:, [0, 1, -1]], known, atol=1e-6)
    assert torch.equal(many.head.of_way.weight[[0, 1, -1]], few.head.of_way.weight)
    assert torch.equal(many.head.heat.weight, few.head.heat.weight)
    assert not torch.equal(grown[:, 2], known[:, -1])


@pytest.mark.filterwarnings("error:The given NumPy array is not writable")
def test_arrays_that_cannot_be_written_are_read_without_a_warning(trained: Path) -> None:
    policy = PolicyCheckpoint.load(trained)
    sent = decode(encode({"kind": "x", "o": observation_to_message(seen(0))}))["o"]
    shown = ObservationMessage.model_validate(sent).value()  # arrays on the memory of a message, as in a server
    assert answers(policy, shown, policy.row_of("push the bar", trained))
