"""Rendered observations of a small data set of real states: always the same bytes, also after an interruption."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from kept_messages import Messages

from gensim2.cli.main import BAD_INPUT, run
from gensim2.core.errors import InputError, WriteError
from gensim2.core.progress import Progress
from gensim2.core.sealed_file import HEADER_SIZE
from gensim2.data import TaskStore, observation_file, rendering
from gensim2.data.dataset import DATASET_JSON, DataSet
from gensim2.data.formats.export import export
from gensim2.data.observation_file import DamagedObservationError, read_observation
from gensim2.data.rendering import Rendered, render
from gensim2.data.report import report
from gensim2.data.selection import Selection
from gensim2.objects import open_library
from gensim2.objects.library.export import export as library_export
from gensim2.perception import CloudSettings, ObservationSpec
from gensim2.rollout.record import ObjectRecord
from gensim2.rollout.recording import Recorder
from gensim2.sim.headless import HeadlessEnv
from gensim2.viewing import of_data_set

SMALL = ObservationSpec(
    ("pointcloud", "depth", "segmentation"), ("left", "front"), CloudSettings(points=64, candidates=256)
)


def used(thing: ObjectRecord, instance: str) -> ObjectRecord:
    content = open_library("builtin").load(thing.asset_class, instance).content_hash
    return replace(thing, id=instance, content_hash=content)


@pytest.fixture
def store(gather: Callable[..., Any], tmp_path: Path) -> TaskStore:
    """Two episodes of two steps, of which one succeeded, in collection folders of the fake world."""
    gather("OpenDrawer", episodes=2)
    store = TaskStore(tmp_path / "set" / "OpenDrawer")
    lane = HeadlessEnv("OpenDrawer", assets="builtin")
    for index, row in enumerate(list(store.rows())):
        lane.reset(seed=index)
        recorder = Recorder(lane)
        for _ in range(2):
            lane.step(lane.profile.rest_action)
            recorder.add(lane.profile.rest_action, lane.measure())
        episode, recording = store.read(row).episode, recorder.finish()
        seen = {name: used(thing, recording.instances[name]) for name, thing in episode.objects.items()}
        store.path(row.index, row.held).unlink()
        store.add(index, replace(episode, seed=index, objects=seen, control_steps=2), recording)
    list(store.write_rows(2))
    assert any(row.held for row in store.rows())
    return store


def rendered(store: TaskStore, spec: ObservationSpec = SMALL, **options: Any) -> dict[str, bytes]:
    render(store.folder.parent, spec=spec, **{"workers": 0, **options})
    return {path.name: path.read_bytes() for path in sorted((store.folder / "observations").iterdir())}


def test_every_episode_that_held_is_observed(store: TaskStore) -> None:
    rendered(store)
    for row in store.rows():
        path = store.observation_path(row.index)
        assert path.exists() == row.held
        if not row.held:
            continue
        found = read_observation(path, row.episode_digest)
        assert found.description["language"] == store.spec().description
        assert found.description["steps"] == 2
        ids = found.description["segmentation_ids"]
        assert {owner for owner, _ in ids.values()} == {"panda", "table", "drawer"}
        assert {str(id) for id in np.unique(found.arrays["pointcloud/segmentation"])} <= set(ids)
        arrays = found.arrays
        assert arrays["pointcloud/xyz"].shape == (3, 64, 3)
        assert arrays["pointcloud/xyz"].dtype == np.float32
        assert arrays["pointcloud/rgb"].shape == (3, 64, 3)
        assert arrays["cameras/front/depth"].shape == (3, 128, 128)
        assert 300 < np.median(arrays["cameras/front/depth"]) < 2000, "millimetres"
        assert set(np.unique(arrays["pointcloud/segmentation"])) <= set(
            np.unique(arrays["cameras/left/segmentation"])
        ) | set(np.unique(arrays["cameras/front/segmentation"]))
        assert "cameras/right/depth" not in arrays
        recording = store.read(row).recording
        assert recording is not None
        assert np.array_equal(arrays["proprioception/qpos"], recording.obs[:, :9])
        assert arrays["proprioception/tool_pose"].shape == (3, 7)


def test_keypoints_are_rendered_by_the_command_and_their_ids_are_named(store: TaskStore) -> None:
    words = ["render", str(store.folder.parent), "--source", "keypoints", "--points", "40", "--workers", "1"]
    assert run(words) == 0
    row = next(row for row in store.rows() if row.held)
    found = read_observation(store.observation_path(row.index), row.episode_digest)
    assert found.is_of_keypoints
    assert found.arrays["pointcloud/xyz"].shape == (3, 40, 3)
    ids = found.description["segmentation_ids"]
    assert {ids[str(id)][0] for id in np.unique(found.arrays["pointcloud/segmentation"])} == {"drawer"}
    frames = DataSet.open(store.folder.parent).frames()
    assert frames[0]["point_cloud"].shape == (40, 6)
    assert run([*words[:-4], "--points", "41", "--noise", "d435"]) == 2


def test_the_bytes_do_not_depend_on_what_happened_on_the_way(store: TaskStore) -> None:
    first = rendered(store)
    name, content = next(iter(first.items()))
    path = store.folder / "observations" / name
    path.write_bytes(content[:-7] + b"changed")
    with pytest.raises(DamagedObservationError, match="not a complete observation file"):
        read_observation(path)
    (path.with_name(".0.h5.0123456789abcdef.tmp.h5")).write_bytes(b"left by a kill")
    assert rendered(store, resume=True) == first
    shutil.rmtree(path.parent)
    assert rendered(store, workers=1) == first


def test_other_observations_are_neither_mixed_nor_lost(store: TaskStore) -> None:
    first = rendered(store)
    with pytest.raises(InputError, match="--resume"):
        rendered(store)
    with pytest.raises(InputError, match="modalities"):
        rendered(store, ObservationSpec(), resume=True)
    with pytest.raises(InputError, match="must include an observation that cameras provide"):
        rendered(store, ObservationSpec(modalities=()), resume=True)
    assert rendered(store, resume=True) == first
    path = store.folder / "observations" / next(iter(first))
    with pytest.raises(InputError, match="another episode"):
        read_observation(path, "0" * 64)


def moved(store: TaskStore, assets: str) -> None:
    """Change the location of the objects that the data set records."""
    file = store.folder.parent / DATASET_JSON
    record = json.loads(file.read_bytes())
    record["arguments"]["assets"] = assets
    file.write_text(json.dumps(record))


def test_objects_that_moved_are_looked_for_where_they_are_now(store: TaskStore, tmp_path: Path) -> None:
    before = rendered(store)
    shutil.rmtree(store.folder / "observations")
    moved(store, str(tmp_path / "gone"))
    folder = store.folder.parent
    near = Selection(clearance=-0.2)
    for look in (
        lambda: render(folder, spec=SMALL, workers=0),
        lambda: report(folder, videos=0),
        lambda: export(folder, tmp_path / "out", "zarr", near),
        lambda: of_data_set(folder, None, None),
    ):
        with pytest.raises(
            InputError, match=r"gone does not exist .give the current location of the folder with --assets"
        ):
            look()
    assert export(folder, tmp_path / "all", "zarr", observations=False) > 0
    assert rendered(store, assets="builtin") == before
    assert report(folder, videos=0, assets="builtin")["tasks"][0]["held"] > 0
    assert export(folder, tmp_path / "near", "zarr", near, assets="builtin") > 0
    assert of_data_set(folder, None, None, "builtin").scene.assets == "builtin"


def test_other_objects_than_those_of_the_episodes_are_refused(store: TaskStore, tmp_path: Path) -> None:
    for row in list(store.rows()):
        stored = store.read(row)
        [(name, thing)] = row.objects.items()
        store.path(row.index, row.held).unlink()
        store.add(
            row.index, replace(stored.episode, objects={name: replace(thing, content_hash="0")}), stored.recording
        )
    list(store.write_rows(2))
    [thing] = next(row for row in store.rows() if row.held).objects.values()
    folder = store.folder.parent
    near = Selection(clearance=-0.2)
    looks = (
        lambda: render(folder, spec=SMALL, workers=0),
        lambda: report(folder, videos=0),
        lambda: export(folder, tmp_path / "near", "zarr", near),
        lambda: of_data_set(folder, None, None),
    )
    for look in looks:
        with pytest.raises(
            InputError,
            match=rf"different version of drawer/{thing.id} from the one in builtin.*--assets",
        ):
            look()
    # Other versions of gensim2 may render the same files differently.
    file = folder / DATASET_JSON
    record = json.loads(file.read_bytes())
    record["versions"]["gensim2"] = "0.1.9"
    file.write_text(json.dumps(record))
    told = Messages()
    render(folder, spec=SMALL, workers=0, progress=told)
    assert [line for line in told.messages if "differs from what gensim2 0.1.9 prepared" in line]


def test_a_folder_with_other_objects_is_refused(store: TaskStore, tmp_path: Path) -> None:
    made = library_export(open_library("builtin").load_articulated("drawer", "0"), tmp_path / "made")
    shutil.copytree(made, tmp_path / "folder" / "drawer" / "mine")
    moved(store, str(tmp_path / "gone"))
    said = r"\.h5: the object drawer/\d+ of this run cannot be loaded: no instance .*--assets"
    with pytest.raises(InputError, match=said):
        report(store.folder.parent, videos=0, assets=tmp_path / "folder")
    assert run(["data", "report", str(store.folder.parent), "--videos", "0", "--assets", "builtin"]) == 0
    assert (
        run(["render", str(store.folder.parent), "--workers", "1", "--assets", str(tmp_path / "folder")]) == BAD_INPUT
    )


def test_what_cannot_be_read_or_written_is_one_error_and_loses_nothing(
    store: TaskStore, small_disk: Callable[..., AbstractContextManager[None]]
) -> None:
    with pytest.raises(WriteError, match=r"\.h5: cannot write: File too large"), small_disk():
        rendered(store)
    first = rendered(store, resume=True)
    name, content = next(iter(first.items()))
    path = store.folder / "observations" / name
    seal = replace(observation_file._SEAL, version=2)
    digest = seal.write(path, content[HEADER_SIZE:])
    with pytest.raises(
        InputError,
        match=rf"{name}: schema_version: is 2, but this version of gensim2 reads files with schema version 1",
    ):
        rendered(store, resume=True)
    assert path.read_bytes().startswith(f"gensim2-observation 2 {digest}".encode()), "is left to whoever can read it"
    path.unlink()
    episode = store.path(int(path.stem))
    episode.write_bytes(episode.read_bytes()[:-100])
    with pytest.raises(InputError, match=rf"episodes/{name}: is not a finished episode"):
        rendered(store, resume=True)


@pytest.mark.parametrize(
    ("modalities", "cameras", "words"),
    [(("smell",), ("left",), "modalities"), (("depth",), ("left", "left"), "cameras"), (("depth",), (), "cameras")],
)
def test_specs_that_cannot_be_are_refused(modalities: Any, cameras: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        ObservationSpec(modalities, cameras)


def test_the_first_episodes_alone_are_observed_where_so_many_are_asked_for(
    store: TaskStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    heard: list[tuple[str, int | None]] = []
    monkeypatch.setattr(Progress, "start", lambda _, description, total=None: heard.append((description, total)))
    lane = store.folder.parent
    held = [row for row in store.rows() if row.held]
    assert render(lane, spec=SMALL, episodes=1, workers=0).rendered == 1
    assert [row.index for row in store.rows() if store.observation_path(row.index).exists()] == [held[0].index]
    assert render(lane, spec=SMALL, episodes=1, workers=0, resume=True).rendered == 0
    assert heard == [("observations of 1 task", 1), ("observations of 1 task", 1)]


@pytest.mark.parametrize(
    ("modalities", "begin"),
    [(("rgb",), "rgb without a GPU"), (("pointcloud",), "pointcloud"), (("depth", "rgb"), "rgb, depth without a GPU")],
)
def test_how_long_pictures_take_is_said_before(
    store: TaskStore, monkeypatch: pytest.MonkeyPatch, modalities: Any, begin: str
) -> None:
    listener = Messages()

    def render_episode(*_: Any) -> Rendered:
        assert listener.messages, "before the work"
        return Rendered(1, 1, 0.0)

    monkeypatch.setattr(rendering, "render_episode", render_episode)
    render(store.folder.parent, spec=ObservationSpec(modalities), workers=0, progress=listener)
    (said,) = listener.messages
    assert re.fullmatch(rf"{begin}: about \d+\.\d s per episode, \d:\d\d:\d\d for (1 episode|\d+ episodes)", said)
