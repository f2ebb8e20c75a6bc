"""Files of an earlier release, before modules were moved, can be read."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

pytest.importorskip("mani_skill")

from figures import rows_of

from gensim2.core.record_files import read_record
from gensim2.data.dataset import DataSet
from gensim2.data.episode_file import read_episode
from gensim2.data.formats.export import export
from gensim2.data.formats.importing import import_
from gensim2.data.observing import observe
from gensim2.data.records import RunRecord
from gensim2.data.runfolder import RUN_JSON
from gensim2.design.report import write_report
from gensim2.rollout.episode_log import read_log
from gensim2.rollout.inputs import read_task_input
from gensim2.tasks.library import load_strategies, load_task

FORMER = Path(__file__).with_name("former")
"""A data set with observations, a run folder of ``demo`` and JSON of a benchmark; physics was called ``"ours"`` then.
"""


def test_a_data_set_opens_with_its_episodes_and_what_was_seen() -> None:
    assert json.loads((FORMER / "data" / "dataset.json").read_text())["arguments"]["physics"] == "ours"
    data = DataSet.open(FORMER / "data")
    assert data.record.scene.physics == "default"
    rows = list(data.task("CloseBox").rows())
    assert [(row.index, row.held) for row in rows] == [(0, True), (1, True)]
    for row in rows:
        stored = data.task("CloseBox").read(row)
        assert stored.recording is not None
        assert len(stored.recording.actions) == row.control_steps
    frames = data.frames(horizon=4)
    assert len(frames) == sum(row.control_steps for row in rows)
    assert data.observation_spec().cloud.points == 64
    frame = frames[40]
    assert frame["action"].shape == (4, 8)
    assert frame["point_cloud"].shape == (64, 6)
    assert {"state", "tool_pose", "gripper"} <= set(frame)


def test_what_was_seen_is_what_is_seen_of_the_same_states_today() -> None:
    data = DataSet.open(FORMER / "data")
    store = data.task("CloseBox")
    recording = store.read(next(iter(store.rows()))).recording
    assert recording is not None
    seen = observe(recording, data.record.scene.with_task(store.spec()), data.observation_spec())
    with h5py.File(store.observation_path(0)) as file:
        for name in ("pointcloud/xyz", "proprioception/qpos"):
            assert np.array_equal(seen[name], file[name][:]), name
        # At an edge between two colours, the rounding of the processor decides which one a ray hits.
        assert (seen["pointcloud/rgb"] != file["pointcloud/rgb"][:]).any(-1).mean() < 0.005


def test_a_data_set_is_exported_and_comes_back(tmp_path: Path) -> None:
    assert export(FORMER / "data", tmp_path / "out", "zarr") == 2
    assert import_(tmp_path / "out", tmp_path / "back", "zarr") == 2
    for index in range(2):
        part = Path("CloseBox") / "episodes" / f"{index:06d}.h5"
        assert (tmp_path / "back" / part).read_bytes() == (FORMER / "data" / part).read_bytes()


def test_a_run_folder_is_read_and_reported(tmp_path: Path) -> None:
    run = shutil.copytree(FORMER / "demo", tmp_path / "demo")
    record = read_record(run / RUN_JSON, RunRecord, "restore the file")
    assert record.assets.keys() == {"box_rotate/7"}
    page = write_report(run).read_text()
    assert "CloseBox" in page
    (entry,) = read_log(run / "tasks" / "CloseBox" / "attempts.jsonl")
    assert entry.held
    episode = read_episode(run / "tasks" / "CloseBox" / "episodes" / "000000.h5")
    assert episode.recording is not None
    assert episode.recording.reference == {} or all(np.isnan(a).all() for a in episode.recording.reference.values())


def test_the_task_of_a_run_folder_is_the_librarys_and_can_be_run_again() -> None:
    given = read_task_input(str(FORMER / "demo" / "tasks" / "CloseBox"), seed=0, assets="builtin", physics="ours")
    assert given.spec.objects == load_task("CloseBox").objects
    assert given.strategies.keys() == load_strategies("CloseBox").keys()
    assert given.scene.physics == "default"


def test_what_a_benchmark_wrote_is_a_figure_of_the_present_ones() -> None:
    (row,) = rows_of(FORMER / "benchmark.json")
    assert (row.task, row.episodes, row.held, row.condition.physics) == ("CloseBox", 1, 1, "default")
    assert row.condition.is_plain
