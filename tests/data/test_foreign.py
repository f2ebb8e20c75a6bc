"""Exports and data sets from untrusted sources are imported correctly, or refused in one line without leftovers."""

from __future__ import annotations

import asyncio
import errno
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import zarr
from kept_messages import Messages

from gensim2.core.errors import InputError, WriteError
from gensim2.core.files import new_folder
from gensim2.data.card import card
from gensim2.data.dataset import DataSet
from gensim2.data.episode_file import write_episode
from gensim2.data.formats import export as exporting
from gensim2.data.formats.columns import camera_array
from gensim2.data.formats.export import NATIVE, export
from gensim2.data.formats.frames import EPISODE_COLUMNS
from gensim2.data.formats.importing import import_
from gensim2.data.formats.manifest import FORMATS, MANIFEST, Format
from gensim2.data.formats.replay_zarr import ZarrWriter
from gensim2.data.formats.zarr_reading import zarr_frames
from gensim2.data.observation_file import read_observation, write_observation
from gensim2.data.rendering import render
from gensim2.perception.observation import CLOUD, DEPTH, IMAGE, PROPRIOCEPTION

SmallDisk = Callable[..., AbstractContextManager[None]]

PIXELS = 8


@pytest.fixture
def dataset(observed: Path, tmp_path: Path) -> DataSet:
    """Four episodes of each of two tasks, with clouds, images and depth of the successful ones."""
    return DataSet.open(shutil.copytree(observed, tmp_path / "set"))


@pytest.fixture(scope="module")
def observed(gathered: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of that data set."""
    dataset = DataSet.open(gathered(tmp_path_factory.mktemp("observed") / "set", 4))
    draw = np.random.default_rng(0)
    for name in dataset.tasks:
        store = dataset.task(name)
        for row in store.rows():
            if row.held:
                frames = row.control_steps + 1
                arrays: dict[str, Any] = {
                    "pointcloud/xyz": draw.integers(-1000, 1000, (frames, 16, 3)).astype(np.int16),
                    camera_array("left", "intrinsic"): np.eye(3),
                    camera_array("left", "rgb"): draw.integers(0, 256, (frames, PIXELS, PIXELS, 3)).astype(np.uint8),
                    camera_array("left", "depth"): draw.integers(0, 9000, (frames, PIXELS, PIXELS)).astype(np.uint16),
                }
                write_observation(store.observation_path(row.index), {"episode_digest": row.episode_digest}, arrays)
    return dataset.path


def exported(dataset: DataSet, to: Format, *, manifest: bool = False) -> Path:
    """Return an export; without its manifest it is like a foreign or an older one."""
    out = dataset.path.parent / to
    export(dataset.path, out, to)
    if not manifest:
        (out / MANIFEST).unlink()
    return out


def refused(folder: Path, of: Format) -> str:
    """Return the error message of an import, which must leave no files."""
    before = sorted(folder.parent.iterdir())
    with pytest.raises(InputError) as caught:
        import_(folder, folder.parent / "back", of)
    assert sorted(folder.parent.iterdir()) == before
    assert len(str(caught.value).splitlines()) == 1
    return str(caught.value)


def edited(file: Path, change: Callable[[Any], object]) -> None:
    """Change a JSON document."""
    document = json.loads(file.read_text())
    change(document)
    file.write_text(json.dumps(document))


# --- names


@pytest.mark.parametrize("name", ["../../../x", "/tmp/x", "a/b", ".hidden", "a\nb", ""])
def test_a_strategy_is_written_nowhere_but_into_its_task(dataset: DataSet, name: str) -> None:
    out = exported(dataset, "maniskill")
    for file in out.glob("*/trajectory.json"):

        def rename(document: Any) -> None:
            strategies = document["gensim2"]["strategies"]
            strategies[name] = next(iter(strategies.values()))

        edited(file, rename)
    assert "gensim2.strategies: the strategies do not match the task" in refused(out, "maniskill")


@pytest.mark.parametrize("name", ["../../x", "OpenBox/x", "open", "."])
def test_a_task_has_a_name_that_is_one(dataset: DataSet, name: str) -> None:
    out = exported(dataset, "zarr")

    def rename(document: Any) -> None:
        document["tasks"][name] = document["tasks"]["CloseBox"]

    edited(out / NATIVE / "dataset.json", rename)
    assert "dataset.json: tasks" in refused(out, "zarr")


def test_no_column_has_a_slash_and_pictures_and_depth_come_back(dataset: DataSet) -> None:
    out = exported(dataset, "zarr")
    names = set(zarr.open_group(out / "data", mode="r").array_keys())
    assert {*PROPRIOCEPTION, *EPISODE_COLUMNS, CLOUD, IMAGE + "left", DEPTH + "left"} == names
    store = dataset.task(dataset.tasks[0])
    row = next(row for row in store.rows() if row.held)
    seen = read_observation(store.observation_path(row.index)).arrays
    first = next(zarr_frames(out))
    assert np.array_equal(first.columns[IMAGE + "left"], seen["cameras/left/rgb"][:-1])
    assert np.array_equal(first.columns[DEPTH + "left"], seen["cameras/left/depth"][:-1])
    features = json.loads((exported(dataset, "lerobot") / "meta" / "info.json").read_text())["features"]
    assert "observation.images.left" in features
    assert not [name for name in features if "/" in name]


def copied_from_path(folder: Path) -> dict[str, np.ndarray]:
    """Read a folder as ``ReplayBuffer.copy_from_path`` of Diffusion Policy does.

    It reads all arrays of ``meta`` and all keys of ``data``; a folder in ``data`` fails at ``[:]``. The package is not
    on PyPI.
    """
    root = zarr.open(folder, mode="r")
    meta = {key: value[:] if len(value.shape) else np.array(value) for key, value in root["meta"].members()}
    data = {key: root["data"][key][:] for key, _ in root["data"].members()}
    assert "episode_ends" in meta
    assert all(len(value) == meta["episode_ends"][-1] for value in data.values())
    return data


def test_a_replay_buffer_takes_all_of_it(dataset: DataSet) -> None:
    data = copied_from_path(exported(dataset, "zarr"))
    assert data[IMAGE + "left"].shape[1:] == (PIXELS, PIXELS, 3)
    assert len(data["action"]) == len(data[DEPTH + "left"])


def test_exports_with_the_former_names_still_load(dataset: DataSet) -> None:
    out = exported(dataset, "zarr")
    new = next(zarr_frames(out)).columns
    for prefix in (IMAGE, DEPTH):
        nested = out / "data" / f"{prefix}cameras"
        nested.mkdir()
        (nested / ".zgroup").write_text('{"zarr_format": 2}')
        (out / "data" / f"{prefix}left").rename(nested / "left")
    old = next(zarr_frames(out)).columns
    assert old.keys() == new.keys()
    assert all(np.array_equal(old[name], new[name]) for name in new)
    told = Messages()
    assert import_(out, out.parent / "back", "zarr", progress=told) > 0
    assert any("read as image_left" in text for text in told.messages)
    assert any("older gensim2" in text for text in told.messages)


# --- links, special files, sizes


@pytest.mark.parametrize("to", FORMATS)
@pytest.mark.parametrize("what", ["a link", "a pipe", "a device"])
def test_links_and_special_files_are_refused_at_once(dataset: DataSet, to: Format, what: str, tmp_path: Path) -> None:
    out = exported(dataset, to)
    files = sorted(path for path in out.rglob("*") if path.is_file())
    file = files[len(files) // 2]
    file.unlink()
    if what == "a pipe":
        os.mkfifo(file)
    else:
        (tmp_path / "secret").write_text("x")
        file.symlink_to(tmp_path / "secret" if what == "a link" else "/dev/zero")
    began = time.monotonic()
    assert f"{file.name}: is a {'pipe' if what == 'a pipe' else 'link'}, not a file" in refused(out, to)
    assert time.monotonic() - began < 30


def test_a_data_set_does_not_lead_out_of_its_folder(dataset: DataSet, tmp_path: Path) -> None:
    store = dataset.task("CloseBox")
    row = next(row for row in store.rows() if row.held)
    store.path(row.index).rename(tmp_path / "episode.h5")
    store.path(row.index).symlink_to(tmp_path / "episode.h5")
    with pytest.raises(InputError, match="lies outside the folder"):
        store.read(row)
    store.folder.rename(tmp_path / "elsewhere")
    (dataset.path / "CloseBox").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InputError, match="lies outside the folder"):
        dataset.task("CloseBox")


def test_records_that_are_pipes_are_refused(dataset: DataSet) -> None:
    file = dataset.path / "dataset.json"
    file.unlink()
    os.mkfifo(file)
    with pytest.raises(InputError, match="is a pipe, not a file"):
        DataSet.open(dataset.path)


@pytest.mark.parametrize(
    ("what", "said"),
    [
        ("a circle", "actions is not an array"),
        ("a soft link", "actions is a link"),
        ("another file's numbers", "actions stores its data in another file"),
        ("1e12 rows", "more than 128 MiB"),
        ("text", "contains text or objects, but must contain numbers"),
    ],
)
def test_hdf5_points_nowhere_and_claims_no_more_than_fits(dataset: DataSet, what: str, said: str) -> None:
    out = exported(dataset, "maniskill")
    with h5py.File(next(out.glob("*/trajectory.h5")), "r+") as file:
        group = file["traj_0"]
        del group["actions"]
        if what == "a circle":
            group["actions"] = file["/"]
        elif what == "a soft link":
            group["actions"] = h5py.SoftLink("/traj_0/actions")
        elif what == "another file's numbers":
            group.create_dataset("actions", (8, 8), "f4", external=[(str(out / "README.md"), 0, 4096)])
        elif what == "1e12 rows":
            group.create_dataset("actions", (10**12, 8), "f4", chunks=True)
        else:
            group.create_dataset("actions", data=np.array([b"move"] * 9, dtype=object))
    assert said in refused(out, "maniskill")


def test_circles_of_groups_end(dataset: DataSet) -> None:
    out = exported(dataset, "maniskill")
    with h5py.File(next(out.glob("*/trajectory.h5")), "r+") as file:
        file["traj_0/env_states/actors/again"] = file["traj_0/env_states"]
    assert "is nested too deeply" in refused(out, "maniskill")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"shape": [10**12, 8]}, "not the"),
        ({"chunks": [10**12, 8]}, "more than 256 MiB"),
        ({"dtype": "|O", "filters": [{"id": "pickle"}]}, "dtype"),
        ({"filters": [{"id": "pickle"}]}, "filters"),
        ({"compressor": {"id": "pickle"}}, "compressor"),
        ({"shape": []}, "shape"),
    ],
)
def test_zarr_is_given_plain_numbers_of_bounded_size(dataset: DataSet, change: dict[str, Any], said: str) -> None:
    out = exported(dataset, "zarr")
    edited(out / "data/action/.zarray", lambda document: document.update(change))
    assert said in refused(out, "zarr")


# --- counts are those of the data that was read


def changed_trajectory(dataset: DataSet, name: str, values: Callable[[Any], Any]) -> Path:
    """Return an export whose first episode has other numbers."""
    out = exported(dataset, "maniskill")
    with h5py.File(sorted(out.glob("*/trajectory.h5"))[0], "r+") as file:
        before = file[f"traj_0/{name}"][()]
        del file[f"traj_0/{name}"]
        file[f"traj_0/{name}"] = values(before)
    return out


@pytest.mark.parametrize(
    ("name", "values", "said"),
    [
        (
            "actions",
            lambda a: np.full_like(a, np.nan),
            "episode 0.actions: contains a number that is not finite at step 0",
        ),
        ("actions", lambda a: a[:3], "episode 0.actions: has 3 steps, but the episode"),
        ("actions", lambda a: a.astype(np.float64), "episode 0.actions: must have the type float32"),
        ("actions", lambda a: a.reshape(-1), "episode 0.actions: has"),
        ("obs", lambda a: a[:-1], "episode 0.obs: must have the type float32"),
        ("rewards", lambda a: a.astype(np.int64), "episode 0.rewards: must have the type"),
        ("success", lambda a: a[:1], "episode 0.success: must have the type bool"),
    ],
)
def test_an_episode_that_is_none_is_named(dataset: DataSet, name: str, values: Callable[[Any], Any], said: str) -> None:
    assert said in refused(changed_trajectory(dataset, name, values), "maniskill")


@pytest.mark.parametrize("indices", ["negative", "all 0", "falling", "text", "huge"])
def test_indices_are_those_of_episodes(dataset: DataSet, indices: str) -> None:
    out = exported(dataset, "maniskill")
    ways: dict[str, Callable[[list[int]], list[Any]]] = {
        "negative": lambda found: [-1, *found[1:]],
        "all 0": lambda found: [0] * len(found),
        "falling": lambda found: found[::-1],
        "text": lambda found: [str(number) for number in found],
        "huge": lambda found: [*found[:-1], 10**30],
    }
    for file in out.glob("*/trajectory.json"):
        edited(file, lambda document: document["gensim2"].update(indices=ways[indices](document["gensim2"]["indices"])))
    assert "gensim2.indices" in refused(out, "maniskill")


def test_rows_that_repeat_an_episode_are_refused(dataset: DataSet) -> None:
    out = exported(dataset, "zarr")
    rows = next((out / NATIVE).glob("*/episodes.jsonl"))
    lines = rows.read_text().splitlines(keepends=True)
    rows.write_text(lines[0] * 2 + "".join(lines[1:]))
    assert "line 2: index: is" in refused(out, "zarr")


def test_a_sealed_episode_without_numbers_is_refused_wherever_it_is_read(dataset: DataSet, tmp_path: Path) -> None:
    """A seal shows that a file is complete, not that its content is valid: anybody can make one."""
    from dataclasses import replace

    store = dataset.task("CloseBox")
    row = next(row for row in store.rows() if row.held)
    recording = store.read(row).recording
    assert recording is not None
    broken = replace(recording, actions=np.full_like(recording.actions, np.nan))
    digest = write_episode(store.path(row.index), row, broken)
    with pytest.raises(InputError, match="actions: contains a number that is not finite at step 0"):
        store.read(replace(row, episode_digest=digest))


# --- what is compared


@pytest.mark.parametrize(("to", "pattern"), [("zarr", "data/point_cloud/*"), ("zarr", "data/image_left/*")])
def test_a_cloud_or_picture_that_was_zeroed_is_found_out(dataset: DataSet, to: Format, pattern: str) -> None:
    out = exported(dataset, to, manifest=True)
    name = pattern.rpartition("/")[0]
    zarr.open_array(out / name, mode="r+")[:] = 0
    said = refused(out, to)
    assert "was changed since it was exported" in said or "is not there" in said or "does not exist" in said
    assert name in said


@pytest.mark.parametrize("to", FORMATS)
def test_every_file_of_an_export_is_compared(dataset: DataSet, to: Format) -> None:
    """Except the card, which people may edit."""
    out = exported(dataset, to, manifest=True)
    listed = set(json.loads((out / MANIFEST).read_text())["files"])
    there = {str(path.relative_to(out)) for path in out.rglob("*") if path.is_file()}
    assert there == listed | {"README.md", MANIFEST}
    (out / "README.md").write_text("mine")
    assert import_(out, out.parent / "back", to) > 0
    shutil.rmtree(out.parent / "back")
    assert f"the export has the format {to}, not" in refused(out, "maniskill" if to != "maniskill" else "zarr")


# --- folders


def test_what_a_killed_export_left_is_removed_by_the_next(dataset: DataSet, tmp_path: Path) -> None:
    left = tmp_path / ".out.0123456789abcdef.tmp"
    (left / "data").mkdir(parents=True)
    other = tmp_path / ".other.0123456789abcdef.tmp"
    other.mkdir()
    with new_folder(tmp_path / "out") as filled:  # another export is running
        export(dataset.path, tmp_path / "out", "zarr")
        assert filled.is_dir()
        assert not left.exists()
        shutil.rmtree(tmp_path / "out")
    assert other.is_dir()


@pytest.mark.parametrize("to", FORMATS)
def test_an_export_at_work_is_not_removed_by_another_of_its_name(
    dataset: DataSet, to: Format, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The lock belongs to the folder: a library that recreates the folder makes one without a lock."""
    out = tmp_path / "out"
    described = exporting.write_card

    def meanwhile(*arguments: Any) -> None:
        monkeypatch.setattr(exporting, "write_card", described)
        export(dataset.path, out, to)
        described(*arguments)

    monkeypatch.setattr(exporting, "write_card", meanwhile)
    with pytest.raises(InputError, match=r"out: is not an empty folder \(choose another folder with --out\)"):
        export(dataset.path, out, to)
    assert (out / MANIFEST).is_file()
    assert not list(tmp_path.glob(".out*"))


def test_an_export_that_is_killed_leaves_what_the_next_removes(dataset: DataSet, tmp_path: Path) -> None:
    code = "import os, signal\nfrom pathlib import Path\nfrom gensim2.core.files import new_folder\n"
    code += "with new_folder(Path('out')) as folder:\n (folder / 'a').touch()\n os.kill(os.getpid(), signal.SIGKILL)\n"
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=False, timeout=120)
    assert [path.name for path in tmp_path.glob(".out.*.tmp")]
    export(dataset.path, tmp_path / "out", "zarr")
    assert not list(tmp_path.glob(".out.*.tmp"))


def test_chunks_that_are_still_written_after_one_failed_do_not_bring_the_folder_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import zarr.storage

    keep, late = zarr.storage.LocalStore.set, []

    async def full_at_first(self: zarr.storage.LocalStore, key: str, value: Any) -> None:
        if key == "data/state/0.0":
            raise OSError(errno.ENOSPC, "No space left on device")
        if key.startswith("data/state/") and key[-1].isdigit():
            await asyncio.sleep(0.3)
            late.append(key)
        await keep(self, key, value)

    monkeypatch.setattr(zarr.storage.LocalStore, "set", full_at_first)
    monkeypatch.setattr("gensim2.data.formats.replay_zarr.CHUNK_BYTES", 64)
    with (
        pytest.raises(WriteError, match="No space left"),
        new_folder(tmp_path / "out") as filled,
        ZarrWriter(filled / "replay.zarr") as writer,
    ):
        writer.add("Open it.", {"state": np.ones((40, 9), np.float32)})
    time.sleep(0.6)
    assert late
    assert list(tmp_path.iterdir()) == []


def test_an_import_outlives_the_server_that_forks_its_reader(dataset: DataSet, tmp_path: Path) -> None:
    from multiprocessing import forkserver

    out = exported(dataset, "zarr", manifest=True)
    import_(out, tmp_path / "one", "zarr")
    server = forkserver._forkserver._forkserver_pid  # type: ignore[attr-defined]
    os.kill(server, signal.SIGSTOP)
    threading.Timer(0.5, os.kill, (server, signal.SIGKILL)).start()  # after the request to fork
    assert import_(out, tmp_path / "two", "zarr") == import_(out, tmp_path / "three", "zarr")


def test_nothing_is_written_into_what_is_read(dataset: DataSet, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="lies in the data set"):
        export(dataset.path, dataset.path / "export", "zarr")
    out = exported(dataset, "zarr")
    for inside in (out / "back", out / NATIVE / "back", out / NATIVE):
        with pytest.raises(InputError, match="lies in the export"):
            import_(out, inside, "zarr")
    (tmp_path / "link").symlink_to(dataset.path)
    with pytest.raises(InputError, match="lies in the data set"):
        export(dataset.path, tmp_path / "link" / "x", "zarr")


def test_rendering_on_a_full_disk_names_the_file(dataset: DataSet, small_disk: SmallDisk) -> None:
    with pytest.raises(WriteError, match=r"set/\.lock: cannot write"), small_disk(0):
        render(dataset.path, workers=0, resume=True)


# --- the card


def test_a_card_shows_descriptions_as_they_are(dataset: DataSet) -> None:
    from gensim2.core.yaml_files import dump_yaml, read_yaml

    file = dataset.path / "CloseBox" / "task.yaml"
    said = "<script>alert(1)</script> | a ![x](http://y) `z` **b** [l](x) | line"
    file.write_text(dump_yaml({**read_yaml(file), "description": said}))
    text = card(dataset.path).read_text()
    for raw in ("<script", "![x", "`z`", "[l](x)", "**b**"):
        assert raw not in text
    (row,) = [line for line in text.splitlines() if "script" in line]
    assert row.count("|") == 8  # seven cells
    assert "&#60;script&#62;" in row
    assert "&#124;" in row
