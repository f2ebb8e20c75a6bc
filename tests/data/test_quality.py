"""Coverage statistics of data sets are counted correctly."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import imageio.v2 as imageio
import numpy as np
import pytest

from gensim2.core.errors import InputError
from gensim2.data.card import Described, card, write_card
from gensim2.data.collection import CollectionResult
from gensim2.data.dataset import DataSet
from gensim2.data.episode_file import write_episode
from gensim2.data.formats.frames import FIRST_JOINT
from gensim2.data.observation_file import write_observation
from gensim2.data.quality import jerk, qualities
from gensim2.data.report import report
from gensim2.data.selection import Selection
from gensim2.perception.camera import observation_cameras
from gensim2.perception.cloud import to_steps
from gensim2.robots import robot
from gensim2.rollout.episode_log import log_line

Gather = Callable[..., CollectionResult]


def test_jerk_of_a_motion_that_is_known(gather: Gather) -> None:
    store = DataSet.open(gather("CloseBox").folder).task("CloseBox")
    recording = store.read(next(row for row in store.rows() if row.held)).recording
    assert recording is not None
    profile = robot("panda")
    time = np.arange(400) / robot("panda").control_hz
    states = np.zeros((400, FIRST_JOINT + 18))
    states[:, FIRST_JOINT : FIRST_JOINT + 7] = np.sin(time)[:, None]  # the third derivative is -cos
    moved = replace(recording, env_states={"articulations": {profile.agent: states}})
    assert jerk(moved, profile) == pytest.approx(np.sqrt(np.mean(np.cos(time) ** 2)), rel=0.01)


def test_what_is_there_twice_is_counted(gather: Gather) -> None:
    dataset = DataSet.open(gather("CloseBox").folder)
    before = next(qualities(dataset))
    store = dataset.task("CloseBox")
    rows = list(store.rows())
    row = next(row for row in rows if row.held)
    stored = store.read(row)
    index = len(rows)
    write_episode(store.path(index), row, stored.recording)
    with (store.folder / "episodes.jsonl").open("ab") as stream:
        stream.write(log_line(replace(row, index=index, episode_digest=row.episode_digest)))
    after = next(qualities(dataset))
    assert (before.same_scene, before.same_actions) == (0, 0)
    assert (after.same_scene, after.same_actions) == (1, 1)
    assert (after.tried, after.held) == (before.tried + 1, before.held + 1)


def test_the_report_says_what_the_rows_say(gather: Gather) -> None:
    dataset = DataSet.open(gather().folder)
    numbers = report(dataset.path, videos=0)
    assert numbers == json.loads((dataset.path / "quality.json").read_text())
    for task in numbers["tasks"]:
        rows = list(dataset.task(task["name"]).rows())
        lengths = [row.control_steps for row in rows if row.held]
        assert (task["tried"], task["held"]) == (len(rows), len(lengths))
        assert (task["lengths"]["min"], task["lengths"]["max"]) == (min(lengths), max(lengths))
        assert sum(task["instances"].values()) == len(lengths)
        assert sum(task["causes"].values()) == len(rows) - len(lengths)
        kept = sum(
            len(each) for _, each in Selection((task["name"],), clearance=task["clearances"]["median"]).of(dataset)
        )
        assert 0 < kept < len(lengths)
    page = (dataset.path / "quality.html").read_text()
    assert all(task["sentence"] in page for task in numbers["tasks"])
    assert page.count("<svg") >= len(numbers["tasks"])
    report(dataset.path, videos=0)
    assert (dataset.path / "quality.html").read_text() == page


def test_demonstrations_are_shown_as_they_were_observed(gather: Gather) -> None:
    dataset = DataSet.open(gather("CloseBox").folder)
    store, held = dataset.task("CloseBox"), [row for row in dataset.task("CloseBox").rows() if row.held]
    (camera,) = (each for each in observation_cameras(robot("panda")) if each.name == "right")
    point = np.array([0.5, 0.1, 0.2])
    (column, line, depth), frames = camera.projection @ np.append(point, 1.0), 6
    arrays = {
        "cameras/right/intrinsic": camera.intrinsic,
        "cameras/right/T_base_camera": camera.T_base_camera,
        "pointcloud/xyz": to_steps(np.tile(point, (frames, 2, 1))),
        "pointcloud/rgb": np.tile(np.uint8([10, 20, 200]), (frames, 2, 1)),
    }
    for row in held[:-1]:
        write_observation(
            store.observation_path(row.index),
            {"steps": frames - 1, "episode_digest": row.episode_digest, "robot": "panda"},
            arrays,
        )
    report(dataset.path, videos=0)
    shot = imageio.imread(dataset.path / "quality" / f"CloseBox-{held[0].index:06d}.png")
    assert shot.shape == (2 * camera.height, camera.width, 3)  # first and last image, stacked
    place = int(line / depth), int(column / depth)
    assert shot[place].tolist() == shot[place[0] + camera.height, place[1]].tolist() == [10, 20, 200]
    assert (shot[: camera.height] == [10, 20, 200]).all(axis=-1).sum() == 25
    assert len(list((dataset.path / "quality").glob("CloseBox-*.png"))) == len(held) - 1


def test_a_card_names_tasks_counts_and_terms(gather: Gather) -> None:
    dataset = DataSet.open(gather().folder)
    text = card(dataset.path).read_text()
    for name in dataset.tasks:
        record = dataset.record.tasks[name]
        assert f"| {name} | {dataset.task(name).spec().description} | {record.held} | {record.tried} |" in text
    assert all(used.license in text for used in dataset.record.objects.values())
    assert f"| seed | {dataset.record.seed} |" in text


@pytest.mark.parametrize(("kind", "state"), [("lerobot", "observation.state"), ("zarr", "state")])
def test_a_card_of_frames_tells_units_frames_and_what_an_action_is(
    gather: Gather, tmp_path: Path, kind: str, state: str
) -> None:
    dataset = DataSet.open(gather().folder)
    store = dataset.task(dataset.tasks[0])
    described = Described.of(store, (row for row in store.rows() if row.held))
    text = write_card(dataset, [described], tmp_path, kind).read_text()
    assert re.search(rf"\| {state} \| joint positions, rad .*panda", text)
    assert re.search(r"\| action \| absolute target positions of the arm.*, rad .*-1 \(closed\) to 1 \(open\)", text)
    assert "1/20 s apart" in text
    assert "x ahead, y to its left, z up" in text


def test_episodes_of_other_objects_than_the_task_are_refused(gather: Gather) -> None:
    folder = gather("CloseBox").folder
    rows = folder / "CloseBox" / "episodes.jsonl"
    rows.write_text(rows.read_text().replace('"objects": {"box":', '"objects": {"other":'))
    with pytest.raises(InputError, match="line 1: objects: episode 0 has other objects than the task"):
        report(folder)
