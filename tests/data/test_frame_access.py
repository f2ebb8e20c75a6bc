"""Access to frames by number: in any order and from any process, with each file checked once."""

from __future__ import annotations

import pickle
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gensim2.core.errors import InputError
from gensim2.core.sealed_file import Seal
from gensim2.data import DataSet, TaskStore
from gensim2.data.formats.frames import frames_of
from gensim2.data.rendering import render
from gensim2.perception import CloudSettings, DepthNoise, ObservationSpec
from gensim2.perception.raycast.observer import Observer
from gensim2.rollout.recording import Recorder, Recording
from gensim2.sim.headless import HeadlessEnv

SPEC = ObservationSpec(("pointcloud", "depth"), ("left",), CloudSettings(points=32, candidates=128, noise=DepthNoise()))
STEPS = 3


@pytest.fixture
def dataset(gather: Callable[..., Any], tmp_path: Path) -> DataSet:
    """Eight episodes in collection folders of the fake world; the successful ones have real states."""
    gather("OpenDrawer")
    store = TaskStore(tmp_path / "set" / "OpenDrawer")
    lane = HeadlessEnv("OpenDrawer", assets="builtin")
    for row in list(store.rows()):
        episode = store.read(row).episode
        lane.reset(row.seed, {"instance": {name: thing.id for name, thing in episode.objects.items()}})
        recorder = Recorder(lane)
        for step in range(STEPS):
            action = lane.profile.rest_action - np.float32(0.1 * step)
            lane.step(action)
            recorder.add(action, lane.measure())
        store.path(row.index, row.held).unlink()
        vars(episode)["control_steps"] = STEPS
        store.add(row.index, episode, recorder.finish())
    list(store.write_rows(8))
    return DataSet.open(tmp_path / "set")


def recordings(dataset: DataSet) -> list[Recording]:
    store = dataset.task("OpenDrawer")
    found = [store.read(row).recording for row in store.rows() if row.held]
    assert all(found)
    return [each for each in found if each is not None]


def test_frames_are_those_of_the_episodes_whatever_the_order(dataset: DataSet) -> None:
    render(dataset.path, spec=SPEC, workers=0)
    frames = dataset.frames()
    kept = recordings(dataset)
    assert len(frames) == STEPS * len(kept)
    assert frames.episodes == len(kept) > 1
    assert frames.spec == SPEC == dataset.observation_spec()
    lane = HeadlessEnv("OpenDrawer", assets="builtin")
    for index in np.random.default_rng(0).permutation(len(frames)).tolist():
        number, step = divmod(index, STEPS)
        recording, frame = kept[number], frames[index]
        lane.reset(recording.seed, recording.reset_options)
        models = {name: placed.model for name, placed in lane.initial_state.objects.items()}
        observer = Observer(lane.profile, models, SPEC, recording.seed, lane.task.description)
        seen = list(observer.recorded(recording.env_states, recording.actions))[step]
        assert set(seen) < set(frame)
        for name, array in seen.items():
            assert array.dtype == frame[name].dtype
            assert array.tobytes() == frame[name].tobytes(), name
        assert np.array_equal(frame["action"], recording.actions[step])
        assert (frame["episode_index"], frame["frame_index"]) == (number, step)
        assert frame["language"] == seen.language
        assert frame["done"] == (step == STEPS - 1)
        exported = frames_of(recording, lane.profile, "").columns
        assert np.array_equal(exported["state"][step], frame["state"])
    assert np.array_equal(frames[-1]["action"], kept[-1].actions[-1])
    with pytest.raises(IndexError):
        frames[len(frames)]


def test_each_file_is_looked_through_once(dataset: DataSet, monkeypatch: pytest.MonkeyPatch) -> None:
    render(dataset.path, spec=SPEC, workers=0)
    frames, looked = dataset.frames(), Counter[str]()
    read = Seal.read

    def counted(self: Seal, path: Path) -> tuple[str, bytes]:
        looked[f"{path.parent.name}/{path.name}"] += 1
        return read(self, path)

    monkeypatch.setattr(Seal, "read", counted)
    for _ in range(3):
        for index in range(len(frames)):
            frames[index]
    assert set(looked.values()) == {1}
    assert len(looked) == 2 * frames.episodes


def test_a_loader_of_pytorch_reads_them_with_workers(dataset: DataSet) -> None:
    torch = pytest.importorskip("torch")
    render(dataset.path, spec=SPEC, workers=0)
    frames = dataset.frames(horizon=4)
    expected = [frames[index] for index in range(len(frames))]  # opens the files before the loader forks
    assert isinstance(frames.torch(), torch.utils.data.Dataset)
    assert pickle.loads(pickle.dumps(frames))[1]["action"].shape == (4, 8)
    loader = torch.utils.data.DataLoader(frames.torch(), batch_size=5, num_workers=2)
    batches = list(loader)
    clouds = torch.cat([batch["point_cloud"] for batch in batches]).numpy()
    assert np.array_equal(clouds, np.stack([frame["point_cloud"] for frame in expected]))
    pads = torch.cat([batch["action_is_pad"] for batch in batches]).numpy()
    assert pads[:STEPS].sum(axis=1).tolist() == [4 - STEPS, 5 - STEPS, 6 - STEPS]
    assert batches[0]["language"] == [expected[0]["language"]] * 5


def test_what_is_missing_or_damaged_is_named(dataset: DataSet) -> None:
    bare = dataset.frames()
    assert "point_cloud" not in bare[0]
    with pytest.raises(InputError, match="has no observations"):
        bare.spec  # noqa: B018
    with pytest.raises(InputError, match="has no observations"):
        dataset.observation_spec()
    render(dataset.path, spec=SPEC, workers=0)
    paths = sorted(dataset.path.glob("OpenDrawer/observations/*.h5"))
    content = paths[0].read_bytes()
    paths[0].write_bytes(content[:-5] + b"wrong")
    with pytest.raises(InputError, match=f"{paths[0].name}: is not a complete observation file"):
        dataset.frames()[0]
    paths[0].unlink()
    with pytest.raises(InputError, match=f"{paths[0].name}: does not exist"):
        dataset.frames()
    with pytest.raises(InputError, match="at least 1"):
        dataset.frames(horizon=0)
