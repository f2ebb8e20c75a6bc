"""Pages of every kind, made without simulator and renderer, and the browser that opens them."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import browser as opened
import numpy as np
import pytest
import run_folders
from hostile_names import CONTROLS, HOSTILE, HOSTILE_WORDS, OUT_OF_ALL
from PIL import Image
from playwright.sync_api import Browser
from run_folders import fake_world

from gensim2.data import DataSet, collect, video
from gensim2.data import report as quality_report
from gensim2.data.observation_file import write_observation
from gensim2.data.runfolder import TaskFolder
from gensim2.data.video import Film
from gensim2.design import gallery, tasks_gallery
from gensim2.design.report import PLAN_PICTURE, write_report
from gensim2.evaluation.benchmark_table import TaskRow
from gensim2.evaluation.evaluating import EvaluationResult
from gensim2.inspection import pictures
from gensim2.inspection.checks import Finding
from gensim2.inspection.gallery import build_gallery
from gensim2.inspection.validate import ObjectReport
from gensim2.objects import Library
from gensim2.objects.library.shelf import Shelf
from gensim2.objects.types import ArticulatedObject, Hulls, Kind, RigidObject, Source
from gensim2.perception.camera import observation_cameras
from gensim2.perception.cloud import to_steps
from gensim2.planning.picture import SIZE
from gensim2.policy.checkpoint import PolicyCheckpoint, checkpoint_folder
from gensim2.policy.curves import Curves
from gensim2.policy.evaluating import PolicyResult
from gensim2.policy.experiments.config import Arm, ExperimentConfig
from gensim2.policy.experiments.figures import KINDS, Rate, TaskFigures
from gensim2.policy.experiments.page import write_page as write_experiment
from gensim2.policy.experiments.running import ArmResult, ExperimentRecord, ExperimentResult
from gensim2.policy.learn_record import LearnRecord
from gensim2.policy.learning import Learned, LearnResult
from gensim2.policy.page import write_page as write_learned
from gensim2.policy.train import TRAINING, TrainResult
from gensim2.robots import robot
from gensim2.rollout import worker
from gensim2.rollout.episode_log import EpisodeLog
from gensim2.scenes.config import SceneOptions
from gensim2.sim import rendering
from gensim2.tasks.library import load_strategies, load_task

LONG = "PlaceGolfBallIntoDrawer"


def draw_film(path: Path, still: Path, frames: int = 12) -> None:
    """Write a video of a moving square in the project's video format."""
    drawn = np.full((frames, 480, 640, 3), 200, np.uint8)
    for number, frame in enumerate(drawn):
        frame[200:280, 20 + 40 * number : 100 + 40 * number] = (30, 120, 90)
    path.parent.mkdir(parents=True, exist_ok=True)
    video.write_video(path, drawn, 10)
    Image.fromarray(drawn[frames // 2]).save(still)


@pytest.fixture
def report_page(tmp_path: Path) -> Path:
    """The report of a run with a short task with a video, a long one, and some rejected ones."""
    folder = run_folders.run_folder(tmp_path / "run")
    short = folder / "tasks" / "OpenDemo"
    draw_film(short / "video.mp4", short / "still.png")
    Image.new("RGB", (2 * SIZE + 4, 560), "#ffffff").save(short / PLAN_PICTURE)
    files, task = TaskFolder(folder / "tasks" / LONG), load_task(LONG)
    files.write_task(task)
    files.write_strategies(load_strategies(LONG))
    log = EpisodeLog(files.path / "attempts.jsonl", range(12))
    for seed in range(12):
        log.add(seed, fake_world.episode_of(task, seed, held=seed % 4 > 0))
    return write_report(folder)


@pytest.fixture
def objects_page(library: Library, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The gallery of a few objects of both kinds, one of them with a finding."""

    def stripes(rows: int, views: int) -> Image.Image:
        return Image.fromarray(np.tile(np.uint8([[[90, 120, 160]], [[200, 210, 220]]]), (88 * rows, 176 * views, 1)))

    def turntable(model: ArticulatedObject | RigidObject, views: int, size: int) -> Image.Image:
        return stripes(3 if isinstance(model, ArticulatedObject) else 1, views)

    monkeypatch.setattr(pictures, "turntable", turntable)
    finding = Finding("overlap of the meshes while the joint moves, mm", 2.5, 1.0)
    found = tmp_path / "findings.json"
    found.write_text(json.dumps({"objects": [ObjectReport("switch", "0", (finding,), 1.0).to_dict()]}))
    classes = ["switch", "suitcase_rotate", "mug", "cracker_box"]
    return build_gallery([library], tmp_path / "objects", classes=classes, findings=[found]).index


class HostileShelf(Shelf):
    """A library of one generated object with hostile names, licence, description and warnings."""

    kind: Kind = "articulated"
    source: Source = "real"
    license = OUT_OF_ALL + CONTROLS

    def __init__(self, model: ArticulatedObject) -> None:
        self._model = model

    def classes(self) -> tuple[str, ...]:
        return HOSTILE

    def instances(self, asset_class: str) -> tuple[str, ...]:
        return HOSTILE

    def load(self, asset_class: str, instance_id: str, hulls: Hulls = "default") -> ArticulatedObject:
        warnings = (*HOSTILE, *HOSTILE_WORDS, OUT_OF_ALL + CONTROLS)
        return dataclasses.replace(self._model, asset_class=asset_class, id=instance_id, warnings=warnings)

    def describe(self, asset_class: str) -> str:
        return HOSTILE[1]

    def joint_type(self, asset_class: str) -> str:
        return HOSTILE[2]


@pytest.fixture
def hostile_page(library: Library, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The gallery of an untrusted object folder."""
    drawn = Image.new("RGB", (176 * 8, 88 * 3), (90, 120, 160))
    monkeypatch.setattr(pictures, "turntable", lambda model, views, size: drawn)
    shelf = HostileShelf(library.load_articulated("switch", "0"))
    hostile = Library("<b>lib</b>".replace("/", "\u2044"), str(tmp_path), [shelf])
    return build_gallery([hostile], tmp_path / "hostile").index


@pytest.fixture
def tasks_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The gallery of two tasks, of one and of four steps."""
    return gallery_of(["OpenDrawer", LONG], tmp_path / "tasks", monkeypatch)


@pytest.fixture
def hostile_tasks_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The gallery of an untrusted task."""
    files = TaskFolder(tmp_path / "OpenDrawer")
    files.write_task(load_task("OpenDrawer").model_copy(update={"description": OUT_OF_ALL}))
    files.write_strategies(load_strategies("OpenDrawer"))
    return gallery_of([str(files.path)], tmp_path / "tasks", monkeypatch)


def gallery_of(tasks: list[str], out: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the gallery of tasks in a fake world."""

    def filmed(replay: Any, path: Path, *, still: Path, **_: Any) -> Film:
        draw_film(path, still)
        return Film(12, True, "a fake camera draws")

    for name in fake_world.REPLACED:
        monkeypatch.setattr(worker, name, getattr(worker, name))
    fake_world.install()
    monkeypatch.setattr(fake_world, "EPISODE_SECONDS", 0.0)
    monkeypatch.setattr(gallery, "film", filmed)
    monkeypatch.setattr(rendering, "can_render", lambda: True)
    return tasks_gallery(tasks, out=out, assets="builtin", workers=0).index


@pytest.fixture
def experiment_page(tmp_path: Path) -> Path:
    """The page of an experiment of two arms; the first one has figures of every kind."""
    names = ("OpenDrawer", LONG)
    arms = (
        Arm(name="generated-24", objects="generated", count=24, tasks=names),
        Arm(name="real-5", objects="real", tasks=names),
    )
    config = ExperimentConfig(
        title="One policy for two tasks",
        about="Two arms.",
        seeds=2,
        minutes_a_task=1.0,
        scenes=900,
        episodes=100,
        control_episodes=30,
        arms=arms,
    )
    results = []
    for arm, kinds in zip(arms, (KINDS, ("unseen",)), strict=True):
        figures = TaskFigures(names[0], dict.fromkeys(kinds, Rate(80, 100)))
        tasks = (figures, dataclasses.replace(figures, name=LONG))
        results.append(ArmResult(arm, tasks, (str(tmp_path / arm.name),), demonstrations=900, cpu_s=60.0))
    record = ExperimentRecord(config=config, seed=3, assets="real")
    skipped = {"more": "needs a folder of real objects: --assets"}
    result = ExperimentResult(str(tmp_path), record, tuple(results), skipped, remaining=2)
    return write_experiment(result.to_dict())


def learned_result(folder: Path, words: Sequence[str] = ()) -> LearnResult:
    """Return the result of a policy for several tasks, with a video, curves and failed episodes.

    Args:
        folder: folder for its files.
        words: names and instructions of its tasks, and other texts, instead of good ones.
    """
    names = ("OpenDrawer", "CloseBox", "OpenBox", LONG)
    tasks = [load_task(name) for name in names]
    if words:
        tasks = [tasks[0].model_copy(update={"name": word, "description": word}) for word in words]
        names = tuple(words)
    draw_film(folder / "video_2.mp4", folder / "still.png")

    def table(episodes: int) -> EvaluationResult:
        rows = []
        for task in tasks:
            found = (fake_world.episode_of(task, seed, held=seed % 4 > 0) for seed in range(episodes))
            rows.append(TaskRow(task, runs=1, episodes=tuple(found)))
        return EvaluationResult(
            run_dir=str(folder),
            controller={},
            arguments={},
            versions={},
            rows=tuple(rows),
            skipped=dict(zip(words, words, strict=True)),
            speeds={},
            videos={names[1]: [str(folder / "video_2.mp4")]},
            cpu_s=9.0,
        )

    (folder / TRAINING).mkdir()
    curves = Curves(folder / TRAINING, 0)
    for step in range(25, 900, 25):
        curves.add(step=step, loss=9.0 / step)
    record = LearnRecord(
        tasks=names,
        policy="keypose",
        minutes=15.0,
        multi_task=True,
        seed=7,
        scenes=2000,
        scene=SceneOptions("builtin").to_record(),
        settings={"encoder": "state", **dict(zip(words, words, strict=True))},
        demonstrations_of=words[0] if words else None,
    )
    checkpoint = PolicyCheckpoint.load(checkpoint_folder("builtin"))
    trained = TrainResult(folder, checkpoint, loss=0.01, steps=900, cpu_s=80.0, parameters=1)
    measured = PolicyResult(table(12), {"blind": (table(8),)})
    learned = Learned(folder, dict.fromkeys(names, 400), data_cpu_s=40.0, trained=trained, measured=measured)
    return LearnResult(str(folder), record, words[0] if words else "new", tuple(words), (learned,))


@pytest.fixture
def learned_page(tmp_path: Path) -> Path:
    """The page of a policy for several tasks."""
    return write_learned(learned_result(tmp_path))


@pytest.fixture
def hostile_learned_page(tmp_path: Path) -> Path:
    """The same page with hostile names, instructions and settings."""
    return write_learned(learned_result(tmp_path, HOSTILE_WORDS))


@pytest.fixture
def collected(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A data set of two tasks in a fake world."""
    for name in fake_world.REPLACED:
        monkeypatch.setattr(worker, name, getattr(worker, name))
    fake_world.install()
    monkeypatch.setattr(fake_world, "EPISODE_SECONDS", 0.0)
    out = tmp_path / "set"
    return collect(("OpenDrawer", "CloseBox"), episodes=12, out=out, workers=0, assets="builtin").folder


@pytest.fixture
def collection_page(collected: Path) -> Path:
    """The page about a collection."""
    return collected / "report.html"


@pytest.fixture
def quality_page(collected: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The page about a data set's coverage: one task has images, the other point clouds; both have videos."""

    def filmed(replay: Any, path: Path, *, still: Path) -> Film:
        draw_film(path, still)
        return Film(12, True, "a fake camera draws")

    dataset = DataSet.open(collected)
    cloud = {
        "pointcloud/xyz": to_steps(np.full((6, 40, 3), 0.5) + np.linspace(0.0, 0.1, 40)[:, None]),
        "pointcloud/rgb": np.full((6, 40, 3), 90, np.uint8),
    }
    (camera, *_) = observation_cameras(robot())
    seen = {"cameras/left/rgb": np.tile(np.uint8([[[90, 120, 160]], [[200, 210, 220]]]), (6, 64, 128, 1))}
    for name, arrays in (("OpenDrawer", cloud), ("CloseBox", seen)):
        store = dataset.task(name)
        numbers = {"intrinsic": camera.intrinsic, "T_base_camera": camera.T_base_camera}
        arrays = arrays | {f"cameras/left/{what}": each for what, each in numbers.items()}
        for row in (row for row in store.rows() if row.held):
            about = {"steps": 5, "episode_digest": row.episode_digest}
            write_observation(store.observation_path(row.index), about, arrays)
    monkeypatch.setattr(quality_report, "film", filmed)
    monkeypatch.setattr(rendering, "can_render", lambda: True)
    quality_report.report(collected)
    return collected / quality_report.HTML


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """A real headless browser."""
    executable = opened.installed()
    if executable is None:
        pytest.skip(f"no browser is installed: none of {', '.join(opened.NAMES)} (GENSIM2_BROWSER names another)")
    with opened.started(executable) as found:
        yield found
