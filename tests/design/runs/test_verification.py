"""Verifications: finished episodes are kept, and ``verification.json`` is read again or refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from gensim2.core.processes import Execution
from gensim2.data.records import Verification
from gensim2.data.runfolder import RunFolder
from gensim2.design import execution
from gensim2.design.unseen import kept_apart
from gensim2.design.execution import UNDER_WAY, VERIFY_EPISODES, verify
from gensim2.core.errors import InputError
from gensim2.objects import open_library
from gensim2.design.report import _verification
from gensim2.rollout import worker
from gensim2.rollout.config import EpisodeConfig
from gensim2.rollout.record import Episode
from gensim2.rollout.runner import EpisodeRunner
from gensim2.scenes.config import SceneOptions
from gensim2.tasks.library import load_task
from gensim2.tasks.strategies import Strategies

TASK = load_task("OpenDrawer")
CIRCUMSTANCES = SceneOptions("builtin")


@pytest.fixture(autouse=True)
def low_threshold(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lower the threshold, because the fake world succeeds in three of four episodes only."""
    monkeypatch.setattr(execution, "KEEP_THRESHOLD", 0.1)


def _verify(out: Path, seed: int = 0, episodes: int = VERIFY_EPISODES) -> Verification:
    with RunFolder(out, {}, {}, resume=True) as run, EpisodeRunner(CIRCUMSTANCES, Execution(0)) as evaluator:
        files, library = run.task(TASK.name), open_library("builtin")
        apart = kept_apart(library, TASK)
        return verify(TASK, {}, files, run, evaluator, library, apart, episodes=episodes, seed=seed)


def test_an_interrupted_verification_repeats_no_episode(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = _verify(tmp_path / "whole")
    assert len(whole.episodes) == VERIFY_EPISODES
    plain, calls = worker.episode, []

    def counted(*arguments: object) -> object:
        calls.append(arguments)
        if len(calls) == 8:
            raise KeyboardInterrupt
        return plain(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(worker, "episode", counted)
    with pytest.raises(KeyboardInterrupt):
        _verify(tmp_path / "run")
    log = tmp_path / "run/tasks/OpenDrawer" / UNDER_WAY
    assert len(log.read_text().splitlines()) == 7
    assert _verify(tmp_path / "run") == whole
    assert len(calls) == 8 + VERIFY_EPISODES - 7
    assert not log.exists()
    name = "tasks/OpenDrawer/verification.json"
    assert (tmp_path / "run" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
    _verify(tmp_path / "run")
    assert len(calls) == 8 + VERIFY_EPISODES - 7  # these are read and not run


def test_a_verification_of_another_run_is_refused(tmp_path: Path) -> None:
    _verify(tmp_path)
    with pytest.raises(InputError, match=r"verification\.json: episodes: the file contains episodes of another run"):
        _verify(tmp_path, seed=1)
    path = tmp_path / "tasks/OpenDrawer/verification.json"
    value = json.loads(path.read_text())
    value["held"] += 1
    path.write_text(json.dumps(value))
    with pytest.raises(InputError, match="the counts do not match the episodes"):
        _verify(tmp_path)


def test_generated_objects_of_a_verification_are_such_as_no_search_sees(tmp_path: Path) -> None:
    library = open_library("builtin")
    listed = set(library.instances("drawer"))
    assert set(library.choose("drawer", kept_apart(library, TASK).search)) <= listed
    found = _verify(tmp_path)
    drawn = [episode.objects["drawer"].id for episode in found.episodes]
    assert len(set(drawn)) == len(drawn) == VERIFY_EPISODES
    assert not set(drawn) & listed
    assert found.tally.objects == {"drawer": VERIFY_EPISODES}
    written = json.loads((tmp_path / "tasks/OpenDrawer/verification.json").read_text())
    assert (written["instances"], written["objects"]) == ("new", {"drawer": VERIFY_EPISODES})


class _Folder:
    """A folder with the given number of drawers."""

    def __init__(self, count: int) -> None:
        self._ids = tuple(str(number) for number in range(count))

    def instances(self, asset_class: str) -> tuple[str, ...]:
        return self._ids

    def kind(self, asset_class: str) -> str:
        return "articulated"

    def source(self, asset_class: str) -> str:
        return "real"


@pytest.mark.parametrize(("count", "search", "kind"), [(9, "all", "all"), (10, "train", "test")])
def test_a_folder_is_divided_where_it_has_enough(count: int, search: str, kind: str) -> None:
    apart = kept_apart(_Folder(count), TASK)  # type: ignore[arg-type]
    assert (apart.search, apart.kind) == (search, kind)
    assert apart.verification(3, seed=0) == [kind] * 3


def test_what_cannot_be_kept_any_more_is_not_run_to_the_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(execution, "KEEP_THRESHOLD", 1.0)
    found = _verify(tmp_path, episodes=60)
    assert not found.kept
    assert len(found.episodes) in range(execution.STRIDE, 60, execution.STRIDE)
    assert _verify(tmp_path, episodes=60) == found


def test_each_articulated_object_of_a_task_is_a_new_one() -> None:
    drawer = TASK.objects["drawer"]
    other = drawer.model_copy(update={"asset_class": "faucet"})
    ball = drawer.model_copy(update={"asset_class": "golf_ball"})
    task = TASK.model_copy(update={"objects": {"drawer": drawer, "faucet": other, "ball": ball}})
    library = open_library("builtin")
    drawn = [dict(each) for each in kept_apart(library, task).verification(5, seed=0)]  # type: ignore[arg-type]
    for name, asset_class in (("drawer", "drawer"), ("faucet", "faucet")):
        ids = {each[name] for each in drawn}
        assert len(ids) == 5
        assert not ids & set(library.instances(asset_class))
    assert all("ball" not in each for each in drawn)


@pytest.mark.parametrize(("odd", "kept"), [(0, True), (1, False)])
def test_a_task_is_kept_only_if_both_engines_hold_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, odd: int, kept: bool
) -> None:
    """The made-up world stands for both engines; three in four episodes of MuJoCo then fail, or none does."""
    monkeypatch.setattr(execution, "KEEP_THRESHOLD", 0.6)
    plain = worker.episode

    def judged(config: EpisodeConfig, strategies: Strategies, seed: int) -> Episode:
        found = plain(config, strategies, seed)
        return replace(found, held=config.scene.engine == "sapien" or not odd or seed % 4 == 0)

    monkeypatch.setattr(worker, "episode", judged)
    with RunFolder(tmp_path, {}, {}, resume=True) as run, EpisodeRunner(CIRCUMSTANCES, Execution(0)) as evaluator:
        files, library = run.task(TASK.name), open_library("builtin")
        given = (TASK, {}, files, run, evaluator, library, kept_apart(library, TASK))
        found = verify(*given, episodes=20, seed=0, second="mujoco")
        assert found.second is not None
        assert (found.tally.held, found.second.engine, found.kept) == (20, "mujoco", kept)
        assert [each.seed for each in found.second.episodes] == [each.seed for each in found.episodes]
        assert verify(*given, episodes=20, seed=0, second="mujoco") == found  # read from the file
    shown = _verification(found, TASK)
    assert shown is not None
    odd_seeds = [each.seed for each in found.episodes if odd and each.seed % 4]
    assert (shown["second"]["lost"], shown["second"]["won"]) == (odd_seeds, [])
