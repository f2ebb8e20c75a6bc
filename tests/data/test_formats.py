"""Exports for other tools are imported unchanged, and agree with the episodes."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path

import h5py
import imageio.v2 as imageio
import numpy as np
import pyarrow.parquet
import pytest
import zarr
from kept_messages import Messages
from kill_runs import contents

from gensim2.core.errors import InputError, WriteError
from gensim2.core.sealed_file import HEADER_SIZE
from gensim2.data import episode_file
from gensim2.data.dataset import DataSet
from gensim2.data.formats.export import NATIVE, export
from gensim2.data.formats.importing import import_
from gensim2.data.formats.lerobot import Feature, LeRobotWriter
from gensim2.data.formats.lerobot_reading import read_lerobot
from gensim2.data.formats.manifest import FORMATS, MANIFEST, Format
from gensim2.data.observation_file import write_observation
from gensim2.data.selection import Selection
from gensim2.data.store import ROWS
from gensim2.perception import ObservationSpec
from gensim2.perception.cloud import to_steps
from gensim2.perception.observation import Proprioception
from gensim2.robots import robot
from gensim2.rollout.episode_log import log_line

SmallDisk = Callable[..., AbstractContextManager[None]]


@pytest.fixture
def dataset(gathered: Callable[..., Path], tmp_path: Path) -> DataSet:
    return DataSet.open(gathered(tmp_path / "set"))


def held(dataset: DataSet) -> list[Path]:
    return sorted(path.relative_to(dataset.path) for path in dataset.path.glob("*/episodes/*.h5"))


@pytest.mark.parametrize("to", FORMATS)
def test_episodes_come_back_byte_for_byte(dataset: DataSet, to: Format, tmp_path: Path) -> None:
    count = export(dataset.path, tmp_path / "out", to)
    assert count == len(held(dataset)) > 0
    assert import_(tmp_path / "out", tmp_path / "back", to) == count
    back = DataSet.open(tmp_path / "back")
    assert held(back) == held(dataset)
    for path in held(dataset):
        assert (back.path / path).read_bytes() == (dataset.path / path).read_bytes()
    assert [row.index for row in back.task("CloseBox").rows()] == [
        row.index for row in dataset.task("CloseBox").rows() if row.held
    ]


@pytest.mark.parametrize("to", FORMATS)
def test_only_an_export_of_all_episodes_is_complete(dataset: DataSet, to: Format, tmp_path: Path) -> None:
    """An export without the failed episodes, or without one of the tasks, is incomplete."""
    record = dataset.record
    for name in record.tasks:
        rows = list(dataset.task(name).rows())
        assert 0 < sum(row.held for row in rows) < len(rows)
    export(dataset.path, tmp_path / "out", to)
    import_(tmp_path / "out", tmp_path / "back", to)
    assert record.complete
    assert not DataSet.open(tmp_path / "back").record.complete
    # Make a data set that contains only successful episodes: two of each task.
    for name in record.tasks:
        store = dataset.task(name)
        rows = [row for row in store.rows() if row.held][:2]
        (store.folder / ROWS).write_bytes(b"".join(log_line(row) for row in rows))
    DataSet(dataset.path, record.model_copy(update={"episodes": 2})).save()
    export(dataset.path, tmp_path / "whole", to)
    import_(tmp_path / "whole", tmp_path / "again", to)
    assert DataSet.open(tmp_path / "again").record.complete
    export(dataset.path, tmp_path / "part", to, Selection(tasks=("CloseBox",)))
    import_(tmp_path / "part", tmp_path / "third", to)
    assert not DataSet.open(tmp_path / "third").record.complete


def test_frames_of_each_format_are_those_of_the_episodes(dataset: DataSet, tmp_path: Path) -> None:
    export(dataset.path, tmp_path / "l", "lerobot")
    export(dataset.path, tmp_path / "z", "zarr")
    export(dataset.path, tmp_path / "m", "maniskill")
    episodes = list(read_lerobot(tmp_path / "l"))
    group = zarr.open_group(tmp_path / "z", mode="r")
    begin = number = 0
    for name in dataset.tasks:
        store = dataset.task(name)
        with h5py.File(tmp_path / "m" / name / "trajectory.h5") as file:
            for place, row in enumerate(row for row in store.rows() if row.held):
                recording = store.read(row).recording
                assert recording is not None
                sentence, columns = episodes[number]
                end = int(group["meta/episode_ends"][number])
                assert sentence == store.spec().description
                assert np.array_equal(columns["action"], recording.actions)
                assert np.array_equal(group["data/action"][begin:end], recording.actions)
                assert np.array_equal(file[f"traj_{place}"]["actions"], recording.actions)
                assert np.array_equal(columns["observation.state"], group["data/state"][begin:end])
                assert columns["next.done"].tolist() == [False] * (recording.steps - 1) + [True]
                assert (columns["index"] == np.arange(begin, end)).all()
                begin, number = end, number + 1
    assert number == len(episodes) == group["meta/episode_ends"].shape[0]


def test_observations_go_along_and_must_be_there_for_all(dataset: DataSet, tmp_path: Path) -> None:
    store = dataset.task("CloseBox")
    rows = [row for row in store.rows() if row.held]
    rng = np.random.default_rng(0)
    clouds = {}
    for row in rows:
        steps = row.control_steps
        clouds[row.index] = rng.normal(size=(steps + 1, 16, 3)).astype(np.float32)
        arrays = {
            "pointcloud/xyz": to_steps(clouds[row.index]),
            "pointcloud/rgb": np.full((steps + 1, 16, 3), 51, np.uint8),
        }
        write_observation(store.observation_path(row.index), {"episode_digest": row.episode_digest}, arrays)
    only = Selection(tasks=("CloseBox",))
    export(dataset.path, tmp_path / "z", "zarr", only)
    export(dataset.path, tmp_path / "l", "lerobot", only)
    _, columns = next(read_lerobot(tmp_path / "l"))
    stored = zarr.open_group(tmp_path / "z", mode="r")["data/point_cloud"][: len(columns["action"])]
    assert np.array_equal(stored, columns["observation.points"])
    assert stored.shape[1:] == (16, 6)
    assert np.allclose(stored[..., 3:], 0.2)
    assert np.allclose(stored[..., :3], clouds[rows[0].index][:-1], atol=1e-3)  # stored with rounding
    for to, name in (("zarr", "z"), ("lerobot", "l")):
        listener = Messages()
        import_(tmp_path / name, tmp_path / f"back_{name}", to, progress=listener)
        (text,) = listener.messages
        assert "observations" in text
        assert "point_cloud" in text
        assert "`gensim2 render`" in text
    with pytest.raises(InputError, match="some of the episodes have observations"):
        export(dataset.path, tmp_path / "both", "zarr")


def test_a_cloud_of_keypoints_is_exported_as_the_state_of_the_environment(dataset: DataSet, tmp_path: Path) -> None:
    store = dataset.task("CloseBox")
    rng, points = np.random.default_rng(0), {}
    for row in (row for row in store.rows() if row.held):
        points[row.index] = to_steps(rng.uniform(-1, 1, (row.control_steps + 1, 16, 3)).astype(np.float32))
        arrays = {
            "pointcloud/xyz": points[row.index],
            "pointcloud/rgb": np.zeros((row.control_steps + 1, 16, 3), np.uint8),
            "pointcloud/segmentation": np.zeros((row.control_steps + 1, 16), np.int16),
        }
        told = {"episode_digest": row.episode_digest, "cloud": {"source": "keypoints"}}
        write_observation(store.observation_path(row.index), told, arrays)
    export(dataset.path, tmp_path / "l", "lerobot", Selection(tasks=("CloseBox",)))
    for (_, columns), expected in zip(read_lerobot(tmp_path / "l"), points.values(), strict=True):
        assert "observation.points" not in columns
        found = columns["observation.environment_state"]
        assert np.array_equal(to_steps(found), expected[:-1].reshape(len(found), 48))


def test_episodes_that_were_rendered_in_two_ways_are_not_exported_as_one(dataset: DataSet, tmp_path: Path) -> None:
    for name in dataset.tasks:
        store = dataset.task(name)
        for row in (row for row in store.rows() if row.held):
            frames = row.control_steps + 1
            arrays = {
                "pointcloud/xyz": to_steps(np.zeros((frames, 16, 3), np.float32)),
                "pointcloud/rgb": np.zeros((frames, 16, 3), np.uint8),
            }
            told = {"episode_digest": row.episode_digest, "cloud": {"noise": name}}
            write_observation(store.observation_path(row.index), told, arrays)
    with pytest.raises(InputError, match="rendered with settings that differ"):
        export(dataset.path, tmp_path / "both", "zarr")
    export(dataset.path, tmp_path / "one", "zarr", Selection(tasks=("CloseBox", "CloseBox")))  # named twice: once


def test_exports_hold_what_the_robot_knows_of_itself_and_what_cameras_and_ids_are(
    dataset: DataSet, tmp_path: Path
) -> None:
    store, camera = dataset.task("CloseBox"), np.diag([70.0, 70.0, 1.0])
    for row in store.rows():
        if not row.held:
            continue
        shape = (row.control_steps + 1, 4, 5)
        arrays = {
            "cameras/left/segmentation": np.full(shape, row.index % 3, np.int16),
            "cameras/left/depth": np.full(shape, 700, np.uint16),
            "cameras/left/intrinsic": camera,
            "cameras/left/T_base_camera": np.eye(4),
        }
        ids = {"1": ["panda", "panda_link0"], "2": ["box", f"lid_{row.index % 2}"]}
        spec = ObservationSpec(("depth", "segmentation"), ("left",)).to_dict()
        description = {"episode_digest": row.episode_digest, "segmentation_ids": ids, **spec}
        write_observation(store.observation_path(row.index), description, arrays)
    only = Selection(tasks=("CloseBox",))
    export(dataset.path, tmp_path / "z", "zarr", only)
    export(dataset.path, tmp_path / "l", "lerobot", only)
    row = next(row for row in store.rows() if row.held)
    recording, profile = store.read(row).recording, robot("panda")
    assert recording is not None
    group, (_, columns) = zarr.open_group(tmp_path / "z", mode="r"), next(read_lerobot(tmp_path / "l"))
    for step in (0, recording.steps - 1):
        joints = recording.env_states["articulations"]["panda"][step, 13:31]
        command = recording.actions[step - 1, -1] if step else 1.0
        for name, array in Proprioception(profile, joints[:9], joints[9:], float(command)).items():
            assert np.array_equal(group[f"data/{name}"][step], array)
            assert np.array_equal(columns[f"observation.{name}"][step], array)
    assert group["data/segmentation_left"][0, 0, 0] == row.index % 3
    assert not [name for name in columns if "segmentation" in name or "depth" in name], "LeRobot has no place for them"
    for folder in ("z", "l"):
        seen = json.loads((tmp_path / folder / NATIVE / "observations.json").read_text())
        assert seen["spec"]["modalities"] == ["depth", "segmentation"]
        assert seen["cameras"] == {"left": {"intrinsic": camera.tolist(), "T_base_camera": np.eye(4).tolist()}}
        for entry in seen["episodes"]:
            assert seen["tables"][entry["table"]]["2"] == ["box", f"lid_{entry['index'] % 2}"]
    assert import_(tmp_path / "z", tmp_path / "back", "zarr") == len(seen["episodes"])


def test_pictures_of_odd_sides_are_exported_as_they_are(dataset: DataSet, tmp_path: Path) -> None:
    store = dataset.task("CloseBox")
    for row in (row for row in store.rows() if row.held):
        spec = ObservationSpec(("rgb",), ("left",)).to_dict()
        arrays = {
            "cameras/left/rgb": np.full((row.control_steps + 1, 73, 97, 3), 90, np.uint8),
            "cameras/left/intrinsic": np.diag([70.0, 70.0, 1.0]),
            "cameras/left/T_base_camera": np.eye(4),
        }
        write_observation(store.observation_path(row.index), {"episode_digest": row.episode_digest, **spec}, arrays)
    count = export(dataset.path, tmp_path / "l", "lerobot", Selection(tasks=("CloseBox",)))
    (feature,) = [
        each for each in json.loads((tmp_path / "l/meta/info.json").read_text())["features"].values() if "info" in each
    ]
    assert (feature["shape"], feature["info"]["video.pix_fmt"]) == ([73, 97, 3], "yuv444p")
    films = sorted((tmp_path / "l/videos").rglob("*.mp4"))
    assert len(films) == count > 0
    assert {np.shape(imageio.mimread(path))[1:] for path in films} == {(73, 97, 3)}
    assert import_(tmp_path / "l", tmp_path / "back", "lerobot") == count


def test_a_selection_takes_what_it_says(dataset: DataSet, tmp_path: Path) -> None:
    rows = [row for row in dataset.task("CloseBox").rows() if row.held]
    middle = sorted(row.control_steps for row in rows)[len(rows) // 2]
    short = Selection(tasks=("CloseBox",), longest=middle)
    assert export(dataset.path, tmp_path / "a", "maniskill", short) == sum(r.control_steps <= middle for r in rows)
    with pytest.raises(InputError, match="no episode matches the selection"):
        export(dataset.path, tmp_path / "b", "maniskill", Selection(longest=1, shortest=2))
    with pytest.raises(InputError, match="has no task"):
        export(dataset.path, tmp_path / "c", "maniskill", Selection(tasks=("Elsewhere",)))


def test_frames_that_were_changed_are_found_out(dataset: DataSet, tmp_path: Path) -> None:
    export(dataset.path, tmp_path / "z", "zarr")
    actions = zarr.open_group(tmp_path / "z", mode="r+")["data/action"]
    actions[0, 0] += 1
    with pytest.raises(InputError, match=r"data/action/0\.0: was changed since it was exported"):
        import_(tmp_path / "z", tmp_path / "back", "zarr")
    (tmp_path / "z" / MANIFEST).unlink()
    with pytest.raises(InputError, match=r"episode 0 differs from the original in gensim2/ .action"):
        import_(tmp_path / "z", tmp_path / "back", "zarr")
    assert not (tmp_path / "back").exists()


@pytest.mark.parametrize("to", ["lerobot", "zarr"])
def test_frames_without_states_are_no_data_set(dataset: DataSet, to: Format, tmp_path: Path) -> None:
    export(dataset.path, tmp_path / "out", to)
    (tmp_path / "out" / NATIVE).rename(tmp_path / "away")
    with pytest.raises(InputError, match=r"has no folder .* with the states"):
        import_(tmp_path / "out", tmp_path / "back", to)


def test_a_folder_with_something_in_it_is_left_alone(dataset: DataSet, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine").touch()
    for to in FORMATS:
        with pytest.raises(InputError, match="is not an empty folder"):
            export(dataset.path, tmp_path / "out", to)
    with pytest.raises(InputError, match="is not an empty folder"):
        import_(dataset.path, tmp_path / "out", "zarr")


@pytest.mark.parametrize("to", FORMATS)
def test_where_there_is_no_room_nothing_is_left_and_nothing_lost(
    dataset: DataSet, to: Format, tmp_path: Path, small_disk: SmallDisk
) -> None:
    before = contents(dataset.path)
    with pytest.raises(WriteError, match=r"out: cannot write: File too large \(free disk space"), small_disk():
        export(dataset.path, tmp_path / "out", to)
    (tmp_path / "file").touch()
    with pytest.raises(WriteError, match="cannot write: Not a directory"):
        export(dataset.path, tmp_path / "file/out", to)
    assert contents(dataset.path) == before
    export(dataset.path, tmp_path / "out", to)
    with pytest.raises(WriteError, match=r"back: cannot write: File too large"), small_disk():
        import_(tmp_path / "out", tmp_path / "back", to)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "out", "set"]


@pytest.mark.parametrize("to", FORMATS)
def test_a_damaged_episode_is_named_and_not_exported(dataset: DataSet, to: Format, tmp_path: Path) -> None:
    path = dataset.path / held(dataset)[-1]
    good = path.read_bytes()
    path.write_bytes(good[: len(good) // 2])
    with pytest.raises(InputError, match=rf"{path.name}: is not a finished episode"):
        export(dataset.path, tmp_path / "out", to)
    replace(episode_file._SEAL, version=2).write(path, good[HEADER_SIZE:])
    with pytest.raises(
        InputError,
        match=rf"{path.name}: schema_version: is 2, but this version of gensim2 reads files with schema version 1",
    ):
        export(dataset.path, tmp_path / "out", to)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("to", "pattern"), [("maniskill", "*/trajectory.h5"), ("lerobot", "data/*/*.parquet"), ("zarr", "data/action/0.0")]
)
def test_an_export_that_was_cut_is_one_clear_error(dataset: DataSet, to: Format, pattern: str, tmp_path: Path) -> None:
    export(dataset.path, tmp_path / "out", to)
    (path, *_) = sorted((tmp_path / "out").glob(pattern))
    good = path.read_bytes()
    for size in (0, 7, len(good) // 2):
        path.write_bytes(good[:size])
        with pytest.raises(InputError, match=r"cannot be read|is not a readable|(was|were) changed"):
            import_(tmp_path / "out", tmp_path / "back", to)
    assert not (tmp_path / "back").exists()


def test_lerobot_files_rotate_and_statistics_are_right(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gensim2.data.formats.lerobot.FILE_BYTES", 2600)
    rng = np.random.default_rng(1)
    episodes = [rng.normal(size=(length, 3)).astype(np.float32) for length in (20, 31, 7, 50)]
    with LeRobotWriter(tmp_path / "out", {"x": Feature("float32", (3,))}, fps=20, robot="panda") as writer:
        for number, values in enumerate(episodes):
            writer.add(f"task {number % 2}", {"x": values})
    assert len(list((tmp_path / "out" / "data").glob("*/*.parquet"))) == 3
    assert all(np.array_equal(a["x"], b) for (_, a), b in zip(read_lerobot(tmp_path / "out"), episodes, strict=True))
    whole = np.concatenate(episodes).astype(np.float64)
    stats = json.loads((tmp_path / "out" / "meta" / "stats.json").read_text())["x"]
    assert stats["count"] == [len(whole)]
    for word, truth in (("mean", whole.mean(0)), ("std", whole.std(0)), ("min", whole.min(0)), ("max", whole.max(0))):
        assert np.allclose(stats[word], truth)
    rows = pyarrow.parquet.read_table(tmp_path / "out" / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert [row["length"] for row in rows] == [20, 31, 7, 50]
    assert rows[-1]["dataset_to_index"] == len(whole)
    for row, values in zip(rows, episodes, strict=True):
        assert np.allclose(row["stats/x/mean"], values.astype(np.float64).mean(0))


def test_what_is_no_lerobot_data_set_is_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is not a LeRobot data set"):
        next(read_lerobot(tmp_path))
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta" / "info.json").write_text('{"codebase_version": "v2.1", "features": {}}')
    with pytest.raises(InputError, match=r"is v2\.1, not v3\.0"):
        next(read_lerobot(tmp_path))
