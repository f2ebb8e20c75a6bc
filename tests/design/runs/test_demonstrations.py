"""Collections: the kept episodes depend on the seed only; missing, damaged and foreign files are detected."""

from __future__ import annotations

import dataclasses
import json
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fake_world
import pytest
from kill_runs import contents, differences

from gensim2.data import demonstrations
from gensim2.data.demonstrations import TRIES_PER_DEMO
from gensim2.core.errors import InputError, NotRunError
from gensim2.rollout import worker
from gensim2.rollout.record import Cause
from gensim2.rollout.config import EpisodeConfig
from gensim2.tasks.library import load_strategies
from gensim2.tasks.strategies import Strategies

Record = Callable[..., Any]
EPISODES = Path("tasks/OpenDrawer/episodes")
FAILURES = Path("tasks/OpenDrawer/failures")
ROWS = Path("tasks/OpenDrawer/episodes.jsonl")


def assert_same(run: Path, undisturbed: dict[str, Any]) -> None:
    """Compare byte for byte, except for the number of workers."""
    found = contents(run)
    found["run.json"]["arguments"]["workers"] = undisturbed["run.json"]["arguments"]["workers"]
    assert list(differences(found, undisturbed)) == []


def lines(run: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (run / ROWS).read_text().splitlines()]


def finished(run: Path) -> set[int]:
    return {int(path.stem) for folder in (EPISODES, FAILURES) for path in (run / folder).glob("*.h5")}


def test_the_shortest_run_of_indices_with_enough_successes_is_kept(tmp_path: Path, record: Record) -> None:
    result = record()
    assert result.demos == 6
    attempts = lines(tmp_path / "run")
    assert [entry["index"] for entry in attempts] == list(range(len(attempts)))
    assert len(attempts) > 6
    assert attempts[-1]["held"]
    assert sum(entry["held"] for entry in attempts) == 6
    kept = sorted(int(path.stem) for path in (tmp_path / "run" / EPISODES).iterdir())
    assert kept == [entry["index"] for entry in attempts if entry["held"]]
    document = json.loads((tmp_path / "run/tasks/OpenDrawer/trajectory.json").read_text())
    assert [e["episode_seed"] for e in document["episodes"]] == [e["seed"] for e in attempts if e["held"]]


@pytest.mark.parametrize("workers", [1, 3])
def test_the_number_of_workers_changes_nothing(
    tmp_path: Path, record: Record, undisturbed: dict[str, Any], workers: int
) -> None:
    record(workers=workers)
    assert_same(tmp_path / "run", undisturbed)


def test_it_gives_up_after_enough_tries(tmp_path: Path, record: Record, monkeypatch: pytest.MonkeyPatch) -> None:
    def hopeless(config: EpisodeConfig, strategies: Strategies, seed: int) -> tuple[Any, None]:
        episode, _ = fake_world.demonstrate(config, strategies, seed)
        return dataclasses.replace(episode, held=False, strict=False, cause=Cause.NO_CONTACT), None

    def filmed(config: EpisodeConfig, strategies: Strategies, seed: int, video: Path) -> None:
        video.write_text(str(seed))

    monkeypatch.setattr(worker, "demonstrate", hopeless)
    monkeypatch.setattr(demonstrations, "film_attempt", filmed)
    result = record(videos=2)
    assert result.demos == 0
    assert len(lines(tmp_path / "run")) == 6 * TRIES_PER_DEMO
    told = result.to_dict()
    assert (told["episodes_run"], told["held"], told["strict"]) == (30, 0, 0)
    assert told["causes"] == {"object did not move": 30}
    films = sorted((tmp_path / "run/tasks/OpenDrawer").glob("*.mp4"))
    assert [film.name for film in films] == ["failed_000000.mp4", "failed_000001.mp4"]
    assert [int(film.read_text()) for film in films] == [line["seed"] for line in lines(tmp_path / "run")[:2]]
    page = (tmp_path / "run/report.html").read_text()
    assert all(film.name in page for film in films)


@pytest.mark.parametrize("workers", [0, 2])
def test_the_counts_are_those_of_the_episodes_and_cpu_is_told(tmp_path: Path, record: Record, workers: int) -> None:
    told = record(workers=workers).to_dict()
    entries = lines(tmp_path / "run")
    assert told["episodes_run"] == len(entries)
    for verdict in ("paper", "held", "strict"):
        assert told[verdict] == sum(entry[verdict] for entry in entries)
    assert 0 < told["strict"] < told["held"] == told["demos"] == 6
    assert told["cpu_s"] > 0
    assert json.loads((tmp_path / "run/run.json").read_text())["result"] == told


@pytest.mark.parametrize("seed", range(8))
def test_any_part_of_a_run_can_be_gone(tmp_path: Path, record: Record, undisturbed: dict[str, Any], seed: int) -> None:
    run, dice = tmp_path / "run", random.Random(seed)
    record()
    for path in (*(run / EPISODES).iterdir(), *(run / FAILURES).iterdir()):
        if dice.random() < 0.3:
            path.unlink()
    if dice.random() < 0.5:
        (run / ROWS).unlink()
    for name in ("trajectory.h5", "trajectory.json", f"strategies/{next(iter(load_strategies('OpenDrawer')))}.yaml"):
        if dice.random() < 0.5:
            (run / "tasks/OpenDrawer" / name).unlink()
    (run / EPISODES / ".000001.h5.0123456789abcdef.tmp.h5").write_bytes(b"half an episode")
    record(resume=True)
    assert_same(run, undisturbed)


def _truncate(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-100])


def _flip(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(content)


@pytest.mark.parametrize("damage", [Path.unlink, _truncate, _flip, lambda path: path.write_bytes(b"")])
def test_a_damaged_episode_is_made_again(
    tmp_path: Path, record: Record, undisturbed: dict[str, Any], damage: Callable[[Path], object]
) -> None:
    record()
    damage(min((tmp_path / "run" / EPISODES).iterdir()))
    assert record(resume=True).demos == 6
    assert_same(tmp_path / "run", undisturbed)


def test_an_episode_of_another_run_is_refused_and_named(
    tmp_path: Path, record: Record, undisturbed: dict[str, Any]
) -> None:
    record()
    episodes = tmp_path / "run" / EPISODES
    source = min(episodes.iterdir())
    failed = next(entry["index"] for entry in lines(tmp_path / "run") if not entry["held"])
    for index in (failed, 999):
        foreign = episodes / f"{index:06d}.h5"
        foreign.write_bytes(source.read_bytes())
        with pytest.raises(InputError, match=rf"{foreign.name}: belongs to another collection") as raised:
            record(resume=True)
        assert raised.value.remedy == "delete the file and resume"
        foreign.unlink()
    record(resume=True)
    assert_same(tmp_path / "run", undisturbed)


def test_what_cannot_be_run_ends_the_run_after_all_others_and_is_tried_again(
    tmp_path: Path, record: Record, undisturbed: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    import broken_world

    monkeypatch.setattr(worker, "record", broken_world.record)
    broken = next(e for e in json_lines(undisturbed) if e["held"])
    monkeypatch.setenv("BROKEN_SEED", str(broken["seed"]))
    with pytest.raises(NotRunError) as raised:
        record(workers=2)
    assert set(raised.value.reasons) == {broken["index"]}
    assert "errors.log" in str(raised.value)
    log = (tmp_path / "run/errors.log").read_text()
    assert log.count("Traceback") == 3
    done = finished(tmp_path / "run")
    assert done == {e["index"] for e in json_lines(undisturbed)} - {broken["index"]}
    monkeypatch.delenv("BROKEN_SEED")
    record(workers=2, resume=True)
    assert_same(tmp_path / "run", undisturbed)


def json_lines(undisturbed: dict[str, Any]) -> list[dict[str, Any]]:
    return [json.loads(line) for line in undisturbed[str(ROWS)].splitlines()]


def test_an_object_that_is_broken_is_bad_input(tmp_path: Path, record: Record, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(config: EpisodeConfig, strategies: Strategies, seed: int) -> Any:
        episode, recording = fake_world.demonstrate(config, strategies, seed)
        if episode.seed == lines_of[0]["seed"]:
            raise InputError("has no mesh", file="drawer/0/mobility.urdf")
        return episode, recording

    record(out=tmp_path / "other")
    lines_of = lines(tmp_path / "other")
    monkeypatch.setattr(worker, "demonstrate", refuse)
    with pytest.raises(InputError, match="has no mesh"):
        record()
    assert finished(tmp_path / "run")  # the other tasks are kept
