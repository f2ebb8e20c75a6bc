"""From demonstrations to a policy: a small real data set is decoded, sampled, learned and evaluated."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import made_up
import numpy as np
import pytest
import torch
from disks import can_mount, on_disk
from kept_messages import Messages
from scipy.spatial.transform import Rotation

import gensim2
from gensim2.cli.main import run
from gensim2.core.errors import InputError
from gensim2.core.progress import Progress
from gensim2.data import DataSet
from gensim2.data.formats.columns import XYZ
from gensim2.data.observation_file import read_observation, write_observation
from gensim2.perception import ObservationSpec
from gensim2.perception.observation import CLOUD, STATE
from gensim2.policy import relabels
from gensim2.policy.checkpoint import CheckpointError, PolicyCheckpoint
from gensim2.policy.config import PolicyConfig
from gensim2.policy.controller import PolicyController
from gensim2.policy.decoded import decode
from gensim2.policy.demonstrations import Demonstrations
from gensim2.policy.evaluating import evaluate_policy
from gensim2.policy.frames import SEEN
from gensim2.policy.heads.actions import ACTION
from gensim2.policy.keyframes import KEY_POSITIONS, KEY_ROTATIONS, keyframes, next_keyframes, taught_frames
from gensim2.policy.sentences import sentence_row
from gensim2.policy.source import SENTENCE
from gensim2.policy.training import train
from gensim2.sim import HeadlessEnv

SPEC = ObservationSpec.of({"points": 48, "candidates": 512})
SETTINGS: dict[str, Any] = {**made_up.SMALL, "steps": 2, "batch": 4, "warmup": 1, "history": 1}


@pytest.fixture(autouse=True)
def own_cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """A new cache from which tests may remove files."""
    monkeypatch.setenv("GENSIM2_CACHE", str(tmp_path_factory.getbasetemp() / "own-cache"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two demonstrations of CloseBox, in physics."""
    out = tmp_path_factory.mktemp("demonstrations") / "set"
    gensim2.collect(["CloseBox"], episodes=2, out=out, assets="builtin", workers=0)
    gensim2.render(out, spec=SPEC, workers=0)
    return out


@pytest.fixture(scope="module")
def checkpoint(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A checkpoint of these demonstrations after almost no training."""
    out = tmp_path_factory.mktemp("policy") / "policy"
    train(folder, out=out, settings=SETTINGS)
    return out


def _live(folder: Path) -> tuple[HeadlessEnv, Any]:
    store = DataSet.open(folder).task("CloseBox")
    row = next(row for row in store.rows() if row.held)
    recording = store.read(row).recording
    env = HeadlessEnv("CloseBox", assets="builtin")
    env.reset(recording.seed, recording.reset_options)
    return env, recording


def test_batches_are_the_frames_and_the_chunks_behind_them(folder: Path) -> None:
    config = made_up.policy(history=3, stride=2, horizon=6)
    found = Demonstrations.open([folder], config)
    frames = DataSet.open(folder).frames()
    first = decode([folder]).episodes[0]
    targets = np.array([frames[row]["action"][:7] for row in range(first.steps)])
    widths = np.array([frames[row]["gripper"][0] for row in range(first.steps + 1)])
    taught = np.flatnonzero(taught_frames(np.concatenate([targets, targets[-1:]]), widths, 20.0))
    end = int(taught[-1])
    assert len(taught) <= end < first.steps  # waiting frames at both ends
    rows = np.array([0, 3, end - 2, end])
    batch = found.batch(rows)
    for number, row in enumerate(rows[:-1].tolist()):
        for back in range(3):
            frame = frames[max(0, row - 2 * back)]
            for name in (CLOUD, STATE, "velocity", "tool_pose", "gripper"):
                assert np.array_equal(batch[name][number, 2 - back].numpy(), frame[name]), name
        for ahead in range(6):
            action = frames[min(row + ahead, end)]["action"]
            chunk = batch[ACTION][number, ahead].numpy()
            assert np.allclose(chunk[:7] + frames[row][STATE][:7], action[:7], atol=1e-6)
            assert chunk[7] == action[7]
            assert chunk[8] == (1.0 if row + ahead >= end else -1.0)
    assert (batch[ACTION][-1, :, 8] == 1.0).all()
    assert found.sentences == (gensim2.load_task("CloseBox").description,)
    assert batch[SENTENCE].tolist() == [0] * 4
    drawn = found.draw(np.random.default_rng(0), 500)[STATE][:, -1]
    assert len(torch.unique(drawn[:, :7], dim=0)) > 50
    at_start = (drawn[:, :7] - torch.from_numpy(np.array(frames[0][STATE]))[:7]).abs().amax(1) < 1e-4
    closed = drawn[:, 7:].amax(1) < 1e-3
    assert (at_start & closed).float().mean() < 0.06  # 2 of about 7 waiting frames are used
    assert (at_start & ~closed).float().mean() > 0.01  # the fingers close before the arm moves


def test_an_episode_of_two_data_sets_counts_once(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path / "copy")
    told: list[str] = []

    class Listener(Progress):
        def message(self, text: str) -> None:
            told.append(text)

    twice = decode([folder, tmp_path / "copy"], progress=Listener())
    assert twice.episodes == decode([folder]).episodes
    assert any("occur in several data sets and count once" in text for text in told)


def test_keyframes_are_told_in_the_frame_of_the_tool(folder: Path) -> None:
    found = Demonstrations.open([folder], made_up.policy(history=1, keyframes=2))
    frames = DataSet.open(folder).frames()
    steps = decode([folder]).episodes[0].steps
    targets = np.array([frames[min(row, steps - 1)]["action"][:7] for row in range(steps + 1)])
    rows = np.array([0, 10, 30])
    batch, keys = found.batch(rows), next_keyframes(keyframes(targets, 20.0), steps + 1, 2)
    for number, row in enumerate(rows.tolist()):
        now = _matrix(frames[row]["tool_pose"])
        for ahead in range(2):
            then = np.linalg.inv(now) @ _matrix(frames[int(keys[row, ahead])]["tool_pose"])
            assert np.allclose(batch[KEY_POSITIONS][number, ahead], then[:3, 3], atol=1e-5)
            assert np.allclose(batch[KEY_ROTATIONS][number, ahead], then[:3, :3], atol=1e-5)


def _matrix(pose: np.ndarray) -> np.ndarray:
    found = np.eye(4)
    found[:3, :3] = Rotation.from_quat(pose[3:], scalar_first=True).as_matrix()
    found[:3, 3] = pose[:3]
    return found


def test_a_policy_sees_live_what_it_saw_in_training(folder: Path, checkpoint: Path) -> None:
    env, recording = _live(folder)
    controller = PolicyController(str(checkpoint))
    config = controller._policy.config
    source = Demonstrations.open([folder], config)
    from gensim2.policy.gradient_step import training_batch
    from gensim2.policy.network import CLOUD as CLOUD_INPUT

    class Fixed:
        """Draws the first frames in order."""

        action = source.action

        @staticmethod
        def draw(rng: Any, size: int) -> dict[str, torch.Tensor]:
            return source.batch(np.arange(size))

    draw = np.random.default_rng(0)
    trained = training_batch(Fixed(), config, controller._policy.table, draw, 3)  # type: ignore[arg-type]
    for step in range(3):
        observation = env.observe(controller.observation_spec)
        if step == 0:
            controller.reset(observation, 0)
        controller.act(observation)
        live = controller._batch()
        assert torch.equal(live[CLOUD_INPUT][0], trained[CLOUD_INPUT][step])
        assert torch.equal(live["proprio"][0], trained["proprio"][step])
        env.step(recording.actions[step])


def test_chunks_are_executed_until_the_end_is_marked(folder: Path, checkpoint: Path) -> None:
    env, _ = _live(folder)
    controller = PolicyController(str(checkpoint), execute=2)
    observation = env.observe(controller.observation_spec)
    looks = []

    def network(batch: Any, noise: Any) -> torch.Tensor:  # a fake network that ends at the third action
        looks.append(batch)
        chunk = torch.full((1, 4, 9), 0.01)
        chunk[..., 8] = -1.0
        chunk[:, (3, 1, 0)[len(looks) - 1] :, 8] = 1.0
        return chunk

    network.head = controller._policy.network.head  # type: ignore[attr-defined]
    object.__setattr__(controller._policy, "network", network)
    object.__setattr__(network, "config", made_up.policy(history=1))
    controller.reset(observation, 0)
    actions = [controller.act(observation) for _ in range(4)]
    assert [action is None for action in actions] == [False, False, False, True]
    assert actions[0] is not None
    assert np.allclose(actions[0][:7], observation[STATE][:7] + 0.01)
    assert len(looks) == 3


def test_a_policy_looks_only_where_it_plans_and_acts_as_if_it_always_did(folder: Path, checkpoint: Path) -> None:
    acted: dict[bool, list[Any]] = {}
    for always in (True, False):
        env, _ = _live(folder)
        controller, looks = PolicyController(str(checkpoint)), 0

        def network(batch: Any, noise: Any) -> torch.Tensor:  # a fake network that never ends
            seen = batch["cloud"].mean() + batch["proprio"].mean()
            return torch.cat([0.02 * torch.sin(seen * torch.arange(1, 9)), -torch.ones(1)]).expand(1, 4, 9)

        network.head, own = controller._policy.network.head, controller.config  # type: ignore[attr-defined]
        object.__setattr__(controller._policy, "network", network)
        object.__setattr__(network, "config", own)
        controller.reset(env.observe(controller.observation_spec), 3)
        acted[always] = []
        for _ in range(9):
            seen = env.observe(SPEC if always else controller.observation_spec)
            looks += seen.cloud is not None
            action = controller.act(seen)
            assert action is not None
            acted[always].append(action)
            env.step(action)
        assert looks == (9 if always else -(-9 // controller.config.execute))
    assert np.array_equal(acted[True], acted[False])
    # The scene settled while a chunk was executed: the arm waits for one step until the next observation.
    assert controller.observation_spec.is_proprioceptive
    for _ in range(5):
        env.step(action)
    seen = env.observe(controller.observation_spec)
    held = controller.act(seen)
    assert np.array_equal(held, [*seen.joint_positions[:7], seen.gripper_command])
    assert controller.observation_spec == SPEC
    env.step(action)
    assert controller.act(env.observe(controller.observation_spec)) is not None


@pytest.mark.parametrize("beside", ["nothing", "fingers", "end"])
def test_a_hand_that_stands_still_goes_back_the_way_it_came(folder: Path, checkpoint: Path, beside: str) -> None:
    env, _ = _live(folder)
    controller = PolicyController(str(checkpoint), execute=4, attempts=2)
    observation = env.observe(controller.observation_spec)
    controller.reset(observation, 0)
    here, at = observation[STATE][0], 0

    def network(batch: Any, noise: Any) -> torch.Tensor:  # a fake network that moves for 12 steps and stays
        chunk = torch.full((1, 4, 9), -1.0)
        chunk[..., :7] = 0.1 * torch.arange(at + 1, at + 5)[None, :, None].clamp(max=12)
        chunk[..., 7] = float(np.cos(len(went))) if beside == "fingers" else -1.0
        chunk[:, 2:, 8] = 1.0 if beside == "end" and at == 12 else -1.0
        return chunk

    network.head = controller._policy.network.head  # type: ignore[attr-defined]
    object.__setattr__(controller._policy, "network", network)
    object.__setattr__(network, "config", made_up.policy(history=1))
    went: list[int] = []
    for _ in range(160):
        action = controller.act(observation)
        assert action is not None
        at = round(float(action[0] - here) / 0.1)
        went.append(at)
    assert went[:12] == [*range(1, 13)]
    if beside != "nothing":  # acting fingers, or an end after the first action, are no failure
        assert went[12:] == [12] * 148
        return
    back = went.index(11, 12)
    assert 30 <= back - 12 <= 36
    assert went[back - 1 : back + 11] == list(range(12, 0, -1))
    assert set(went[back + 11 : back + 15]) == {1}
    assert went[-80:] == [12] * 80  # it starts again, only once
    assert went.count(6) == 3


def test_the_threads_are_set_in_the_process_that_acts(
    folder: Path, checkpoint: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    env, _ = _live(folder)
    counts: list[int] = []
    monkeypatch.setattr(torch, "set_num_threads", counts.append)
    controller = PolicyController(str(checkpoint), threads=3)
    assert counts == []
    controller.reset(env.observe(controller.observation_spec), 0)
    assert counts == [3]
    with pytest.raises(InputError, match="threads"):
        PolicyController(str(checkpoint), threads=0)


def test_clouds_that_are_damaged_are_not_said_to_be_missing(checkpoint: Path, tmp_path: Path) -> None:
    shutil.copytree(checkpoint, tmp_path / "policy")
    (tmp_path / "policy/clouds.npz").write_bytes(b"PK nothing")
    with pytest.raises(InputError, match=r"clouds\.npz: is damaged"):
        PolicyController(str(tmp_path / "policy"), sees="other")
    (tmp_path / "policy/clouds.npz").unlink()
    with pytest.raises(InputError, match=r"has no file clouds\.npz"):
        PolicyController(str(tmp_path / "policy"), sees="other")
    with pytest.raises(InputError, match=r"has no file clouds\.npz"):  # before the evaluation
        evaluate_policy(tmp_path / "policy", "CloseBox", episodes=1, out=tmp_path / "out", assets="builtin")
    with pytest.raises(InputError, match="no control 'deaf'"):
        evaluate_policy(tmp_path / "policy", "CloseBox", controls=("deaf",))  # type: ignore[arg-type]
    assert not (tmp_path / "out").exists()


def test_along_a_demonstration_labels_are_what_the_demonstration_did(
    folder: Path, checkpoint: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, recording = _live(folder)
    dataset = DataSet.open(folder)
    scene = dataset.record.scene.with_task(gensim2.load_task("CloseBox"), dataset.record.tasks["CloseBox"].instances)

    class Follows(PolicyController):
        """Predicts the recorded actions instead of the network's."""

        def act(self, observation: Any) -> Any:
            return recording.actions[observation.step] if observation.step < recording.steps else None

    monkeypatch.setattr(relabels, "PolicyController", Follows)
    strategies = gensim2.tasks.library.load_strategies("CloseBox")
    found = relabels.relabel_episode(scene, strategies, str(checkpoint), recording.seed)
    count, horizon, width = found[ACTION].shape
    assert count >= 1
    assert (horizon, width) == (SETTINGS["horizon"], 9)
    stood = recording.env_states["articulations"]["panda"][:, 13:20]
    for number in range(count):
        joints = found[STATE][number, -1, :7]
        step = int(np.abs(stood - joints).max(axis=1).argmin())
        assert np.abs(stood[step] - joints).max() < 1e-5
        assert step % relabels.EVERY == 0
        # Another motion to the same pose, from the arm's moving state, takes the same path.
        did, would = recording.actions[step + horizon - 1, :7] - joints, found[ACTION][number, -1, :7]
        assert np.abs(would - did).max() < 0.25
        assert float(did @ would) >= 0.5 * np.linalg.norm(did) * np.linalg.norm(would) - 1e-6
        assert np.linalg.norm(would) >= 0.3 * np.linalg.norm(did) - 1e-6  # no waiting for closed fingers


def test_rounds_of_relabels_are_counted_and_resumed(
    folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    words = [word for name, value in SETTINGS.items() for word in _flags(name, value)]
    words = ["train", "--data", str(folder), "--out", str(tmp_path / "out"), *words, "--workers", "1"]
    words += ["--dagger", "1", "--dagger-episodes", "1", "--json"]
    assert run(words) == 0
    told = json.loads(capfd.readouterr().out)
    made = relabels.Relabels.load(tmp_path / "out" / "rounds" / "0" / "relabels" / "0-CloseBox-1.npz")
    assert (told["demonstrations"], told["noisy_episodes"], told["relabels"]) == (2, 0, len(made))
    steps = told["training"]["steps"]
    assert told["steps"] == 2 * steps  # both rounds
    assert run([*words, "--resume"]) == 0
    assert json.loads(capfd.readouterr().out)["data"] == told["data"]
    words[words.index("--dagger") + 1] = "2"
    assert run([*words, "--resume"]) == 2
    assert "dagger: was begun with 1, not 2" in capfd.readouterr().err
    assert not (tmp_path / "out" / "rounds" / "1").exists()


def test_batches_have_their_share_of_relabels(folder: Path) -> None:
    source = Demonstrations.open([folder], made_up.policy(history=1, horizon=4, keyframes=1))
    whole = source.draw(np.random.default_rng(0), 3)
    arrays = {name: np.full_like(whole[name].numpy(), 7.0) for name in (*SEEN, ACTION)}
    language = source.sentences[0]
    mixed = relabels.RelabelledSource(source, [relabels.Relabels(language, arrays), relabels.Relabels(language, {})])
    batch = mixed.draw(np.random.default_rng(1), 10)
    assert (batch[ACTION][:, 0, 0] == 7.0).sum() == 3
    assert {len(values) for values in batch.values()} == {10}
    assert batch[KEY_POSITIONS].isnan().all(-1).all(-1).sum() == 3
    assert mixed.record.relabels == 3
    assert mixed.record.digest != source.record.digest
    assert (relabels.RelabelledSource(source, []).draw(np.random.default_rng(1), 10)[ACTION] != 7.0).all()


def test_other_robots_and_sentences_are_refused(folder: Path, checkpoint: Path) -> None:
    env, _ = _live(folder)
    controller = PolicyController(str(checkpoint))
    observation = env.observe(controller.observation_spec)
    told = vars(observation)
    with pytest.raises(CheckpointError, match="was not trained on the sentence 'dance'"):
        controller.reset(type(observation)(**{**told, "language": "dance"}), 0)
    PolicyController(str(checkpoint), unknown_sentences="embed").reset(
        type(observation)(**{**told, "language": "dance"}), 0
    )
    policy = PolicyCheckpoint.load(checkpoint)
    policy.network.config = PolicyConfig.of({**policy.config.to_dict(), "text": "none"})
    assert torch.equal(sentence_row(policy, "dance", checkpoint, embed=False), policy.table[:1])
    moved = {**observation.arrays, "tool_pose": observation.arrays["tool_pose"] + 0.1}
    with pytest.raises(CheckpointError, match=r"the tool of this one stands 0\.17 m off"):
        controller.reset(type(observation)(**{**told, "arrays": moved}), 0)
    longer = {**observation.arrays, "state": np.zeros(12, np.float32)}
    with pytest.raises(CheckpointError, match="with 9 joints, this one has 12"):
        controller.reset(type(observation)(**{**told, "arrays": longer}), 0)


def test_what_is_no_number_is_refused_by_name(folder: Path, tmp_path: Path) -> None:
    copy = tmp_path / "set"
    shutil.copytree(folder, copy)
    path = copy / "CloseBox/observations/000001.h5"
    seen = read_observation(path)
    arrays = {**seen.arrays, "pointcloud/xyz": np.rint(seen.arrays["pointcloud/xyz"] * 1e4).astype(np.int16)}
    arrays["proprioception/qvel"][7, 2] = np.nan
    write_observation(path, seen.description, arrays)
    shutil.rmtree(Path(gensim2.core.files.cache_dir()) / "policy" / "frames", ignore_errors=True)
    with pytest.raises(
        InputError, match=r"000001.h5: proprioception/qvel: contains a number that is not finite at frame 7"
    ):
        decode([copy])


def test_what_was_not_rendered_is_left_out_and_said(folder: Path, tmp_path: Path) -> None:
    copy = tmp_path / "set"
    shutil.copytree(folder, copy)
    before = decode([copy]).record
    files = sorted((copy / "CloseBox/observations").glob("*.h5"))
    files[1].unlink()
    said = Messages()
    found = decode([copy], progress=said)
    assert found.record.episodes == len(files) - 1 == before.episodes - 1
    assert found.record.digest != before.digest
    assert len(found.arrays[XYZ]) == found.record.frames < before.frames
    assert said.messages == [
        f"1 of {len(files)} episodes have no observations and are left out (`gensim2 render` with --resume makes them)"
    ]
    for file in files[:1] + files[2:]:
        file.unlink()
    with pytest.raises(InputError, match=r"has no observations \(run `gensim2 render`"):
        decode([copy])


def test_decoding_is_done_once_and_again_where_a_file_is_short(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from gensim2.policy import decoded

    first = decode([folder])
    with monkeypatch.context() as patch:
        patch.setattr(decoded, "_fill", lambda *_: pytest.fail("was decoded"))
        decode([folder])
    place = next((gensim2.core.files.cache_dir() / "policy" / "frames").iterdir())
    (place / "actions.npy").unlink()
    again = decode([folder])
    assert np.array_equal(first.arrays[ACTION], again.arrays[ACTION])


@pytest.mark.skipif(not can_mount(), reason="mounts a file system of its own")
def test_a_cache_on_a_full_disk_ends_decoding_in_one_line(folder: Path, tmp_path: Path) -> None:
    cache, settings = tmp_path / "cache", tmp_path / "settings.yaml"
    cache.mkdir()
    settings.write_text(json.dumps(SETTINGS))
    words = ["train", "--data", str(folder), "--config", str(settings), "--out", str(tmp_path / "out")]
    command = [*on_disk("size=64k", cache), sys.executable, "-m", "gensim2", *words]
    environment = {**os.environ, "GENSIM2_CACHE": str(cache)}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    said = done.stderr.splitlines()[-1]
    assert (done.returncode, "Traceback" in done.stderr) == (2, False), done.stderr
    assert said.startswith(f"gensim2: {cache}/policy/frames/")
    assert "cannot write: No space left on device (free disk space, or set GENSIM2_CACHE" in said


def test_another_training_may_decode_the_same_meanwhile(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from gensim2.policy import decoded

    fill = decoded._fill

    def twice(*given: Any) -> None:
        fill(*given)
        place = given[0]
        raise InputError("is not an empty folder", file=place)

    whole = decode([folder])
    for each in (gensim2.core.files.cache_dir() / "policy" / "frames").iterdir():
        shutil.rmtree(each)
    with monkeypatch.context() as patch:
        patch.setattr(decoded, "_fill", twice)
        assert np.array_equal(decode([folder]).arrays[ACTION], whole.arrays[ACTION])
    for each in (gensim2.core.files.cache_dir() / "policy" / "frames").iterdir():
        shutil.rmtree(each)
    with monkeypatch.context() as patch:
        patch.setattr(decoded, "_fill", lambda place, *_: (_ for _ in ()).throw(InputError("no room", file=place)))
        with pytest.raises(InputError, match="no room"):
            decode([folder])


def test_the_command_line(folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    out, words = tmp_path / "policy", [word for name, value in SETTINGS.items() for word in _flags(name, value)]
    assert run(["train", "--data", str(folder), "--out", str(out), *words, "--json"]) == 0
    told = json.loads(capfd.readouterr().out)
    assert (told["steps"], told["tasks"], told["episodes"]) == (2, ["CloseBox"], 2)
    tuned = ["train", "--data", str(folder), "--from", str(out), "--steps", "1", "--batch", "2"]
    assert run([*tuned, "--out", str(tmp_path / "tuned")]) == 0
    assert run(["policy", "show", str(tmp_path / "tuned")]) == 0
    assert "CloseBox" in capfd.readouterr().out
    keypose = tmp_path / "keypose.yaml"
    keypose.write_text("head: keypose\n")
    refused = {
        ("--out", str(out)): "holds a policy already",
        ("--out", str(tmp_path / "a"), "--points", "9"): "the data have 48 points, the policy 9",
        ("--out", str(tmp_path / "a"), "--task", "OpenBox"): "no data set has a task 'OpenBox'",
        ("--out", str(tmp_path / "a"), "--config", str(keypose)): "gensim2 learn --policy keypose",
        ("--out", str(tmp_path / "a"), "--from", str(folder)): "config.json",
        ("--out", str(tmp_path / "a"), "--config", str(folder / "dataset.json")): "is not a field of the",
    }
    for extra, said in refused.items():
        assert run(["train", "--data", str(folder), *extra]) == 2
        error = capfd.readouterr().err
        assert said in error.splitlines()[-1], error


def _flags(name: str, value: Any) -> tuple[str, str]:
    return f"--{name.replace('_', '-')}", str(value)
