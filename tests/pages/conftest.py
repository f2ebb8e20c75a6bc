"""Pages of every kind, made without simulator and renderer, and the browser that opens them."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import browser as opened
import numpy as np
import pytest
import run_folders
from hostile_names import HOSTILE
from PIL import Image
from playwright.sync_api import Browser
from run_folders import fake_world

from gensim2.data import DataSet, collect, video
from gensim2.data import report as quality_report
from gensim2.data.attempt_log import AttemptLog, LoggedEpisode
from gensim2.data.observation_file import write_observation
from gensim2.data.runfolder import TaskFolder
from gensim2.data.video import Film
from gensim2.design import shelf, tasks_gallery
from gensim2.design.report import write_report
from gensim2.inspection import gallery, pictures
from gensim2.inspection.gallery import build_gallery
from gensim2.objects import Library
from gensim2.observations.cameras import observation_cameras
from gensim2.observations.cloud import to_steps
from gensim2.policy.experiments.page import WORDS
from gensim2.policy.experiments.page import write_page as write_experiment
from gensim2.policy.page import write_page as write_learned
from gensim2.robots import robot
from gensim2.rollout import worker
from gensim2.sim import rendering
from gensim2.tasks.library import load_strategies, load_task

LONG = "PlaceGolfBallIntoDrawer"


def draw_film(path: Path, still: Path, frames: int = 12) -> None:
    """A square on its way, in the project's own video format."""
    drawn = np.full((frames, 480, 640, 3), 200, np.uint8)
    for number, frame in enumerate(drawn):
        frame[200:280, 20 + 40 * number : 100 + 40 * number] = (30, 120, 90)
    path.parent.mkdir(parents=True, exist_ok=True)
    video.write_video(path, drawn, 10)
    Image.fromarray(drawn[frames // 2]).save(still)


@pytest.fixture
def report_page(tmp_path: Path) -> Path:
    """The report of a run with a short task in a film, a long one, and some that were rejected."""
    folder = run_folders.run_folder(tmp_path / "run")
    short = folder / "tasks" / "OpenDemo"
    draw_film(short / "video.mp4", short / "still.png")
    files, task = TaskFolder(folder / "tasks" / LONG), load_task(LONG)
    files.write_task(task)
    files.write_strategies(load_strategies(LONG))
    log = AttemptLog(files.path / "attempts.jsonl", range(12))
    for seed in range(12):
        log.add(LoggedEpisode.of(fake_world.episode_of(task, seed, held=seed % 4 > 0), seed))
    return write_report(folder)


@pytest.fixture
def objects_page(library: Library, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The gallery of a few objects of both kinds, one of them with a finding."""

    def stripes(rows: int, views: int) -> Image.Image:
        return Image.fromarray(np.tile(np.uint8([[[90, 120, 160]], [[200, 210, 220]]]), (88 * rows, 176 * views, 1)))

    monkeypatch.setattr(pictures, "Studio", lambda size: None)
    monkeypatch.setattr(pictures, "turntable", lambda studio, model, views: stripes(3, views))
    monkeypatch.setattr(pictures, "rigid_turntable", lambda studio, model, views: stripes(1, views))
    finding = {"check": "overlap of the meshes while the joint moves, mm", "value": 2.5, "limit": 1.0}
    found = tmp_path / "findings.json"
    found.write_text(json.dumps({"objects": [{"class": "switch", "id": "0", "findings": [finding]}]}))
    classes = ["switch", "suitcase_rotate", "mug", "cracker_box"]
    return build_gallery([library], tmp_path / "objects", classes=classes, findings=[found]).index


class HostileLibrary:
    """A stand-in for a folder of a stranger: one generated object under names, warnings and a licence of his own."""

    name = "<b>lib</b>".replace("/", "\u2044")

    def __init__(self, library: Library) -> None:
        self._model = library.load("switch", "0")

    def __getattr__(self, name: str) -> Any:
        return {
            "kind": lambda asset_class: "articulated",
            "instances": lambda asset_class, *_: HOSTILE,
            "license_of": lambda asset_class: HOSTILE[0],
            "describe": lambda asset_class: HOSTILE[1],
            "load": lambda asset_class, id: dataclasses.replace(
                self._model, asset_class=asset_class, id=id, warnings=HOSTILE
            ),
        }[name]


@pytest.fixture
def hostile_page(library: Library, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The gallery of a stranger's objects."""
    drawn = Image.new("RGB", (176 * 8, 88 * 3), (90, 120, 160))
    monkeypatch.setattr(pictures, "Studio", lambda size: None)
    monkeypatch.setattr(pictures, "turntable", lambda studio, model, views: drawn)
    stranger: Any = HostileLibrary(library)
    monkeypatch.setattr(gallery, "wanted_classes", lambda libraries, classes: [(stranger, HOSTILE)])
    return build_gallery([stranger], tmp_path / "hostile").index


@pytest.fixture
def tasks_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The gallery of two tasks, of one and of four steps."""

    def filmed(replay: Any, path: Path, *, still: Path, **_: Any) -> Film:
        draw_film(path, still)
        return Film(12, True)

    for name in fake_world.REPLACED:
        monkeypatch.setattr(worker, name, getattr(worker, name))
    fake_world.install()
    monkeypatch.setattr(fake_world, "EPISODE_SECONDS", 0.0)
    monkeypatch.setattr(shelf, "film", filmed)
    monkeypatch.setattr(rendering, "can_render", lambda: True)
    return tasks_gallery(["OpenDrawer", LONG], out=tmp_path / "tasks", assets="builtin", workers=0).index


@pytest.fixture
def experiment_page(tmp_path: Path) -> Path:
    """The page of an experiment of two arms, everything measured of one of them."""

    def rates(*kinds: str) -> dict[str, Any]:
        found = {f"{kind}_mean": 0.8 if kind in kinds else None for kind in WORDS}
        found |= {f"{kind}_interval": [0.7, 0.9] if kind in kinds else None for kind in WORDS}
        return {**found, "lost_mean": None, "lost_interval": None, "episodes": 100}

    tasks = [{"arm": "generated-24", "name": name, **rates(*WORDS)} for name in ("OpenDrawer", LONG)]
    about = {"tasks": ["OpenDrawer", LONG], "count": None, "demonstrations": 900, "cpu_s": 60.0}
    arms = [{"name": "generated-24", **about, **rates(*WORDS)}, {"name": "real-5", **about, **rates("unseen")}]
    told = {"out": str(tmp_path), "title": "One policy for two tasks", "about": "Two arms.", "seed": 3, "seeds": 1}
    write_experiment({**told, "arms": arms, "tasks": tasks, "skipped": {}, "episodes": 400})
    return tmp_path / "report.html"


@pytest.fixture
def learned_page(tmp_path: Path) -> Path:
    """The page of a policy for many tasks, with a film; the result is made up, as far as the page asks."""
    names = ("OpenDrawer", "CloseBox", "OpenBox", LONG)
    controls = {f"{name}_mean": 0.1 if name == "blind" else None for name in ("blind", "shuffled", "no_op", "expert")}
    measures = {"held_mean": 0.9, "interval": [0.8, 0.95], "demonstrations": 400, "steps": 900, "cpu_s": 80.0}
    told = [
        {"name": n, **measures, **controls, "causes": {"stopped short": 1}, "episodes": 12, "control_episodes": 30}
        for n in names
    ]
    draw_film(tmp_path / "video_2.mp4", tmp_path / "still.png")
    rows = []
    for name in names:
        task = load_task(name)
        episodes = [fake_world.episode_of(task, seed, held=seed % 4 > 0) for seed in range(12)]
        rows.append(SimpleNamespace(task=task, episodes=episodes))
    curves = "".join(json.dumps({"step": step, "loss": 9.0 / step}) + "\n" for step in range(25, 900, 25))
    (tmp_path / "training").mkdir()
    (tmp_path / "training" / "curves.jsonl").write_text(curves)
    measured = SimpleNamespace(
        policy=SimpleNamespace(rows=rows, videos={"CloseBox": (str(tmp_path / "video_2.mp4"),)}),
        rows=lambda control: {name: {"episodes": 30} for name in names},
    )
    one = SimpleNamespace(folder=tmp_path, demonstrations=dict.fromkeys(names, 400), measured=measured)
    record = {"policy": "keypose", "seed": 7, "multi_task": True}
    result: Any = SimpleNamespace(
        out=str(tmp_path),
        learned=(one,),
        record=SimpleNamespace(model_dump=lambda: record),
        to_dict=lambda: {"tasks": told, "seen_objects": []},
    )
    return write_learned(result)


@pytest.fixture
def collected(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A data set of two tasks in a made-up world."""
    for name in fake_world.REPLACED:
        monkeypatch.setattr(worker, name, getattr(worker, name))
    fake_world.install()
    monkeypatch.setattr(fake_world, "EPISODE_SECONDS", 0.0)
    out = tmp_path / "set"
    return collect(("OpenDrawer", "CloseBox"), episodes=12, out=out, workers=0, assets="builtin").folder


@pytest.fixture
def collection_page(collected: Path) -> Path:
    """How a collection went."""
    return collected / "report.html"


@pytest.fixture
def quality_page(collected: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """What a data set covers: of one task there are pictures, of the other point clouds; both have films."""

    def filmed(replay: Any, path: Path, *, still: Path) -> Film:
        draw_film(path, still)
        return Film(12, True)

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
    """A real one, headless."""
    executable = opened.installed()
    if executable is None:
        pytest.skip(f"no browser is installed: none of {', '.join(opened.NAMES)} (GENSIM2_BROWSER names another)")
    with opened.started(executable) as found:
        yield found
