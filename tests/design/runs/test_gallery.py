"""The gallery of tasks: its content, its cache, and its messages about missing parts."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import fake_world
import pytest

from gensim2.data.runfolder import TaskFolder
from gensim2.data.video import Film
from gensim2.design import gallery, tasks_gallery
from gensim2.design.gallery import TasksGallery
from gensim2.core.errors import GenSim2Error, InputError
from gensim2.objects import Library
from gensim2.objects.library.export import export
from gensim2.rollout import inputs, worker
from gensim2.tasks.library import load_strategies, load_task, using_library
from gensim2.tasks.spec import Provenance, Verified

TASKS = ("OpenDrawer", "CloseBox", "PlaceGolfBallIntoDrawer")


class Camera:
    """A fake camera, which works without a renderer."""

    def __init__(self) -> None:
        self.seeds: list[int] = []
        self.success = True

    def film(self, replay: Any, video: Path, *, still: Path, stride: int, speed: int) -> Film:
        """Write a file that is not a video."""
        self.seeds.append(replay.reset_kwargs["seed"])
        video.write_bytes(b"film")
        still.write_bytes(b"picture")
        return Film(3, self.success, "a fake camera draws")


@pytest.fixture
def camera(monkeypatch: pytest.MonkeyPatch) -> Camera:
    """The fake camera."""
    found = Camera()
    monkeypatch.setattr(gallery, "film", found.film)
    return found


def made(out: Path, *, tasks: tuple[str, ...] = TASKS, resume: bool = False) -> TasksGallery:
    return tasks_gallery(tasks, out=out, seed=5, assets="builtin", workers=0, resume=resume)


def test_the_first_episode_that_holds_is_shown(tmp_path: Path, camera: Camera) -> None:
    result = made(tmp_path / "out")
    assert list(result.shown) == list(TASKS)
    assert camera.seeds == list(result.shown.values())
    assert result.without == result.skipped == {}
    page = result.index.read_text()
    for task in TASKS:
        tried = [json.loads(line) for line in (tmp_path / "out" / "tasks" / task / "attempts.jsonl").open()]
        assert [each["held"] for each in tried] == [False] * (len(tried) - 1) + [True]
        assert tried[-1]["seed"] == result.shown[task]
        assert f"seed {result.shown[task]}, try {len(tried)}" in page
        assert f'src="tasks/{task}/video.mp4" poster="tasks/{task}/still.webp"' in page
    assert "open the drawer, put the golf ball into it and push it closed" in page
    assert "with ball" in page  # what the third step acts with
    assert "gensim2 demo TASK --episodes 1 --seed 5 --assets builtin</pre>" in page


def test_the_command_of_an_own_task_names_the_library_and_figures_are_those_of_its_verification(
    tmp_path: Path, camera: Camera
) -> None:
    former = Verified(episodes=20, held=19, interval=(0.76, 0.99), seed=0, instances="all", objects={"drawer": 1})
    verification = former.model_copy(update={"paper": 20, "strict": 18})
    for name, told in (("MyDrawer", verification), ("FormerDrawer", former), ("OtherDrawer", None)):
        provenance = Provenance(origin="hand", verification=told)
        files = TaskFolder(tmp_path / "shelf" / name)
        files.write_task(load_task("OpenDrawer").model_copy(update={"name": name, "provenance": provenance}))
        files.write_strategies(load_strategies("OpenDrawer"))
    with using_library(str(tmp_path / "shelf")):
        page = made(tmp_path / "out", tasks=("MyDrawer", "FormerDrawer", "OtherDrawer")).index.read_text()
    assert f"gensim2 demo TASK --episodes 1 --seed 5 --assets builtin --library {tmp_path / 'shelf'}" in page
    mine, other = page[page.index('id="MyDrawer"') :].split('id="OtherDrawer"')
    mine, before = mine.split('id="FormerDrawer"')
    assert all(share in mine for share in (">1.00<", ">0.95 ", ">0.90<"))
    assert "not stored" not in mine
    assert before.count("not stored") == 2
    assert "Not measured yet" not in mine + before
    assert "Not measured yet: gensim2 benchmark OtherDrawer measures it." in other


def test_own_objects_are_named_by_their_folder(tmp_path: Path, camera: Camera, library: Library) -> None:
    export(library.load("drawer", "1"), tmp_path / "mine")
    found = tasks_gallery(["OpenDrawer"], out=tmp_path / "out", seed=5, assets=tmp_path / "mine", workers=0)
    page = found.index.read_text()
    assert f"objects from {tmp_path / 'mine'} ·" in page
    assert "objects real" not in page


def test_the_same_episode_is_what_demo_would_record(tmp_path: Path, camera: Camera, record: Any) -> None:
    result = made(tmp_path / "out", tasks=("OpenDrawer",))
    record(episodes=1, seed=5)
    attempts = (tmp_path / "run" / "tasks" / "OpenDrawer" / "episodes.jsonl").read_text().splitlines()
    assert json.loads(attempts[-1])["seed"] == result.shown["OpenDrawer"]


def test_what_is_finished_is_kept_and_what_is_gone_is_made_again(tmp_path: Path, camera: Camera) -> None:
    before = made(tmp_path / "out")
    with pytest.raises(InputError, match="holds a run already"):
        made(tmp_path / "out")
    (tmp_path / "out" / "tasks" / "CloseBox" / "video.mp4").unlink()
    camera.seeds.clear()
    again = made(tmp_path / "out", resume=True)
    assert again == before
    assert camera.seeds == [before.shown["CloseBox"]]
    with pytest.raises(InputError, match="stored_tasks"):
        made(tmp_path / "out", tasks=("OpenDrawer",), resume=True)


def test_a_page_stands_after_each_task(tmp_path: Path, camera: Camera, monkeypatch: pytest.MonkeyPatch) -> None:
    real = worker.demonstrate

    def stops(config: Any, strategies: Any, seed: int) -> Any:
        if config.task.name == "CloseBox":
            raise KeyboardInterrupt
        return real(config, strategies, seed)

    monkeypatch.setattr(worker, "demonstrate", stops)
    with pytest.raises(KeyboardInterrupt):
        made(tmp_path / "out")
    page = (tmp_path / "out" / "index.html").read_text()
    assert page.count("<video") == 1
    assert page.count("not filmed yet") == 2
    monkeypatch.setattr(worker, "demonstrate", real)
    assert list(made(tmp_path / "out", resume=True).shown) == list(TASKS)
    assert len(camera.seeds) == 3


def test_a_task_without_a_success_says_why(tmp_path: Path, camera: Camera, monkeypatch: pytest.MonkeyPatch) -> None:
    def never(config: Any, strategies: Any, seed: int) -> Any:
        return fake_world.episode_of(config.task, seed, held=False, content_hash=_hash(config)), None

    monkeypatch.setattr(worker, "demonstrate", never)
    result = made(tmp_path / "out", tasks=("OpenDrawer",))
    assert result.shown == {}
    assert result.without == {"OpenDrawer": "object did not move"}
    assert "None of 5 episodes held; the last: object did not move." in result.index.read_text()
    assert camera.seeds == []
    again = made(tmp_path / "out", tasks=("OpenDrawer",), resume=True)
    assert again == result


def _hash(config: Any) -> str:
    from gensim2.objects import open_library

    thing = next(iter(config.task.objects.values()))
    return open_library("builtin").load(thing.asset_class, "0").content_hash


def test_a_film_that_does_not_end_in_the_goal_is_none(tmp_path: Path, camera: Camera) -> None:
    camera.success = False
    with pytest.raises(GenSim2Error, match=r"OpenDrawer: the replay of seed \d+ does not reach the goal"):
        made(tmp_path / "out", tasks=("OpenDrawer",))


def test_tasks_that_a_folder_has_no_objects_for_are_named(
    tmp_path: Path, camera: Camera, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = (("OpenDrawer",), {"OpenSafe": "no safe"})
    monkeypatch.setattr(inputs, "of_these_objects", lambda *_: found)
    result = made(tmp_path / "out", tasks=())
    assert result.skipped == {"OpenSafe": "no safe"}
    assert re.search(r"OpenSafe\s+<span class=\"dim\">no safe", result.index.read_text())
