"""Collections: the folder depends on the arguments only, even after interruptions."""

from __future__ import annotations

import json
import os
import random
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
from disks import can_mount, on_disk
from kill_runs import SCRIPT_ENVIRONMENT, contents, differences

from gensim2.cli.collect import CollectionView
from gensim2.core.errors import InputError, NotRunError, WriteError
from gensim2.core.progress import Progress
from gensim2.core.seeding import scene_seeds
from gensim2.data import DataSet
from gensim2.data.queue import Queue
from gensim2.data.status import Status, TaskStatus
from gensim2.objects import open_library
from gensim2.rollout import worker
from gensim2.rollout.tally import interval

Gather = Callable[..., Any]
KILL_RUNS = Path(__file__).parents[1] / "kill" / "kill_runs.py"


def assert_same(folder: Path, undisturbed: dict[str, Any]) -> None:
    assert list(differences(contents(folder), undisturbed)) == []


def test_every_episode_has_its_row_and_those_that_hold_their_states(tmp_path: Path, gather: Gather) -> None:
    result = gather()
    dataset = DataSet.open(tmp_path / "set")
    assert dataset.record.complete
    assert dataset.tasks == ("OpenDrawer", "CloseBox")
    for told in result.status.tasks:
        store = dataset.task(told.name)
        rows = list(store.rows())
        assert [row.index for row in rows] == list(range(8))
        assert [row.seed for row in rows] == scene_seeds(3, told.name, "collect", 8)
        assert 0 < told.held == sum(row.held for row in rows) < told.tried == 8
        assert sum(told.causes.values()) == 8 - told.held
        for row in rows:
            stored = store.read(row)
            assert stored.episode.at(-1) == row.at(-1)
            assert (stored.recording is not None) == row.held
        assert store.spec().name == told.name
    used = {f"{thing.asset_class}/{thing.id}" for row in rows for thing in row.objects.values()}
    assert used <= set(dataset.record.objects)
    page = (tmp_path / "set/report.html").read_text()
    assert "16 episodes of 2 tasks" in page
    for told in result.status.tasks:
        low, high = interval(told.held, told.tried)
        assert f'{told.held}</span></span>\n</td><td class="num">{low:.2f} to {high:.2f}</td>' in page
    assert "<b>held</b>: the goal is true at the end" in page
    assert "<b>strict</b>: held, and" in page
    assert "open_loop" not in page
    assert "one_plan" not in page
    assert f"gensim2 data report {tmp_path / 'set'}" in page


def test_states_of_failures_are_kept_where_that_is_asked_for(tmp_path: Path, gather: Gather) -> None:
    gather(keep_failures=True)
    store = DataSet.open(tmp_path / "set").task("OpenDrawer")
    failures = [row for row in store.rows() if not row.held]
    assert failures
    assert all(store.read(row).recording is not None for row in failures)


def test_a_collection_of_one_strategy_is_read_again_and_gone_on_with(tmp_path: Path, gather: Gather) -> None:
    gather("CloseBox", episodes=2, strategy=["close_box"])
    spec = DataSet.open(tmp_path / "set").task("CloseBox").spec()
    assert spec.steps[0].strategies == ("close_box",)
    assert gather("CloseBox", episodes=3, strategy=["close_box"], resume=True).status.ran == 1


def test_objects_can_be_counted_that_no_list_has(tmp_path: Path, gather: Gather) -> None:
    gather("CloseBox", objects=2)
    rows = DataSet.open(tmp_path / "set").task("CloseBox").rows()
    used = {thing.id for row in rows for thing in row.objects.values()}
    library = open_library("builtin")
    assert len(used) == 2
    assert not used & {*library.choose("box_rotate", "all"), *library.choose("box_rotate", "new")}
    assert gather("CloseBox", episodes=9, objects=2, resume=True).status.ran == 1
    with pytest.raises(InputError, match=r"tasks\.CloseBox\.objects: was begun with 2, not 3"):
        gather("CloseBox", episodes=9, objects=3, resume=True)


def test_workers_and_the_order_of_tasks_change_no_episode(
    tmp_path: Path, gather: Gather, undisturbed: dict[str, Any]
) -> None:
    gather(workers=2)
    assert_same(tmp_path / "set", undisturbed)
    gather("CloseBox", out=tmp_path / "other")
    for name, content in contents(tmp_path / "other").items():
        if name.startswith("CloseBox/"):
            assert content == undisturbed[name]


@pytest.mark.parametrize("seed", range(4))
def test_any_part_can_be_gone_or_damaged(
    tmp_path: Path, gather: Gather, undisturbed: dict[str, Any], seed: int
) -> None:
    folder, dice = tmp_path / "set", random.Random(seed)
    gather()
    for path in [*folder.glob("*/episodes/*.h5"), *folder.glob("*/failures/*.h5"), *folder.glob("*/episodes.jsonl")]:
        what = dice.random()
        if what < 0.15:
            path.unlink()
        elif what < 0.3:
            path.write_bytes(path.read_bytes()[: dice.randrange(path.stat().st_size)])
        elif what < 0.4:
            content = bytearray(path.read_bytes())
            content[dice.randrange(len(content))] ^= 0x10
            path.write_bytes(content)
    (folder / "OpenDrawer/episodes/.000001.h5.0123456789abcdef.tmp.h5").write_bytes(b"half an episode")
    (folder / "report.html").unlink()
    gather(resume=True)
    assert_same(folder, undisturbed)


def test_resuming_starts_what_is_not_there_and_runs_nothing_twice(
    tmp_path: Path, gather: Gather, undisturbed: dict[str, Any]
) -> None:
    assert gather(resume=True).status.ran == 16
    with pytest.raises(InputError, match=r"holds a data set already \(add --resume"):
        gather()
    assert gather(resume=True).status.ran == 0
    assert_same(tmp_path / "set", undisturbed)


def test_what_is_known_of_finished_episodes_stays_where_going_on_is_stopped(
    tmp_path: Path, gather: Gather, monkeypatch: pytest.MonkeyPatch
) -> None:
    gather("OpenDrawer", episodes=3)
    before = DataSet.open(tmp_path / "set").record
    assert before.objects
    monkeypatch.setattr(Queue, "_run", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
    for episodes in (3, 4):
        with pytest.raises(KeyboardInterrupt):
            gather("OpenDrawer", episodes=episodes, resume=True)
        after = DataSet.open(tmp_path / "set").record
        assert after.objects == before.objects
        assert after.complete is (episodes == 3)
        assert after.tasks["OpenDrawer"].tried == (3 if episodes == 3 else None)
    monkeypatch.undo()


def test_a_data_set_with_a_hole_is_not_complete(
    tmp_path: Path, gather: Gather, monkeypatch: pytest.MonkeyPatch
) -> None:
    gather("OpenDrawer", episodes=3)
    next((tmp_path / "set" / "OpenDrawer" / "episodes").glob("*.h5")).unlink()
    with monkeypatch.context() as patch:
        patch.setattr(Queue, "_run", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            gather("OpenDrawer", episodes=3, resume=True)
    after = DataSet.open(tmp_path / "set").record
    assert not after.complete
    assert after.tasks["OpenDrawer"].tried is None
    assert after.objects


def test_a_data_set_can_grow(tmp_path: Path, gather: Gather, undisturbed: dict[str, Any]) -> None:
    gather("OpenDrawer", episodes=5)
    assert gather(resume=True).status.ran == 11
    assert_same(tmp_path / "set", undisturbed)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"seed": 4}, "seed: was begun with 3, not 4"),
        ({"episodes": 7}, "episodes: was begun with 8"),
        ({"physics": "original"}, "arguments.physics: was begun with 'default', not 'original'"),
        ({"engine": "mujoco"}, "arguments.engine: was begun with 'sapien', not 'mujoco'"),
        ({"instances": "train"}, r"tasks\.OpenDrawer\.instances: was begun with .all., not .train."),
        ({"keep_failures": True}, "keep_failures: was begun with False"),
    ],
)
def test_another_collection_is_not_gone_on_with(gather: Gather, options: dict[str, Any], said: str) -> None:
    gather()
    with pytest.raises(InputError, match=said):
        gather(resume=True, **options)


def test_what_is_said_of_a_collection_s_tasks_comes_before_its_objects(tmp_path: Path, gather: Gather) -> None:
    gather()
    begun = r"tasks: was begun with these tasks in this order; more tasks may be appended: \w+, \w+"
    for left in ("CloseBox", "OpenDrawer"):
        with pytest.raises(InputError, match=begun):
            gather(left, resume=True)
    file = tmp_path / "set" / "dataset.json"
    record = json.loads(file.read_bytes())
    file.write_text(json.dumps({**record, "listings": {**record["listings"], "drawer": "0"}}))
    with pytest.raises(InputError, match=r"listings\.drawer: the objects of class drawer have changed since"):
        gather(resume=True)


def test_what_is_not_ours_is_refused(tmp_path: Path, gather: Gather) -> None:
    folder = tmp_path / "set"
    gather()
    store = DataSet.open(folder).task("OpenDrawer")
    other = DataSet.open(folder).task("CloseBox")
    held = next(row.index for row in other.rows() if row.held)
    good = store.path(held).read_bytes() if store.path(held).exists() else None
    shutil.copy(other.path(held), store.path(held))
    with pytest.raises(InputError, match=rf"{held:06d}\.h5: (belongs to another collection|exists twice)"):
        gather(resume=True)
    store.path(held).unlink() if good is None else store.path(held).write_bytes(good)
    described = json.loads((folder / "dataset.json").read_text())
    for change in ({"schema_version": 9}, {"episodes": "many"}):
        (folder / "dataset.json").write_text(json.dumps({**described, **change}))
        with pytest.raises(InputError, match=rf"dataset\.json: {next(iter(change))}: "):
            gather(resume=True)
    (folder / "dataset.json").write_text(json.dumps(described))
    gather(resume=True)
    (tmp_path / "full").mkdir()
    (tmp_path / "full/file").write_text("")
    with pytest.raises(InputError, match="is not empty, but contains no data set"):
        gather(out=tmp_path / "full", resume=True)


def test_what_cannot_be_run_is_named_after_all_others_and_tried_again(
    tmp_path: Path, gather: Gather, undisturbed: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    import broken_world

    broken = scene_seeds(3, "CloseBox", "collect", 8)[5]
    monkeypatch.setattr(worker, "record", broken_world.record)
    monkeypatch.setenv("BROKEN_SEED", str(broken))
    with pytest.raises(NotRunError, match=r"episodes of CloseBox: could not be run: 5 \(.*errors\.log"):
        gather(workers=2)
    assert (tmp_path / "set/OpenDrawer/episodes.jsonl").exists()
    assert not (tmp_path / "set/CloseBox/episodes.jsonl").exists()
    assert not DataSet.open(tmp_path / "set").record.complete
    assert "Not complete: 1 episode remains." in (tmp_path / "set/report.html").read_text()
    monkeypatch.delenv("BROKEN_SEED")
    assert gather(workers=2, resume=True).status.ran == 1
    assert_same(tmp_path / "set", undisturbed)


def test_whoever_watches_is_told(gather: Gather) -> None:
    class Watcher(Progress):
        last: Status | None = None

        def update(self, status: Status) -> None:
            self.last = status

    watcher = Watcher()
    gather(listener=watcher)
    assert watcher.last is not None
    assert (watcher.last.tried, watcher.last.total, watcher.last.ran) == (16, 16, 16)
    assert watcher.last.stored > 0
    assert watcher.last.free > 0


def test_the_estimate_leaves_out_the_start_of_the_workers(gather: Gather, monkeypatch: pytest.MonkeyPatch) -> None:
    now, lengths = [100.0], iter([35.0, *[2.0] * 15])  # the first episode waits for its worker
    real = Queue._counted

    def counted(queue: Queue, *arguments: Any) -> None:
        now[0] += next(lengths)
        real(queue, *arguments)

    monkeypatch.setattr(Queue, "_counted", counted)
    monkeypatch.setattr("gensim2.data.queue.time.monotonic", lambda: now[0])
    heard: list[Status] = []

    class Watcher(Progress):
        def update(self, status: Status) -> None:
            heard.append(status)

    gather(listener=Watcher(), workers=0)
    assert [(status.tried, status.left) for status in heard[:4]] == [(0, None), (1, None), (2, 28.0), (3, 26.0)]


def test_a_collection_prints_when_it_begins_and_as_soon_as_it_can_estimate() -> None:
    stream = StringIO()

    def status(tried: int, pace: float | None) -> Status:
        return Status((TaskStatus("CloseBox", 50, tried, tried, tried, {}),), tried, 38.0, 1, 1, 0, pace)

    with CollectionView(stream) as view:
        for tried, pace in ((0, None), (1, None), (4, 2.5), (5, 2.5), (50, 2.5), (50, 2.4)):
            view.update(status(tried, pace))
    said = stream.getvalue().splitlines()
    assert [line.split(" ")[0] for line in said] == ["0/50", "4/50", "50/50"]
    assert "an estimate of the time follows" in said[0]
    assert "0.40 a second without the start of the workers, about 0:01:55 left" in said[1]
    assert "left" not in said[2]
    assert "a second" not in said[2]


def test_a_full_disk_ends_it_at_once_and_keeps_what_is_finished(
    tmp_path: Path, gather: Gather, undisturbed: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    real, written = os.fsync, []

    def full_after_a_while(handle: int) -> None:
        written.append(handle)
        if len(written) > 40:
            raise OSError(28, "No space left on device")
        real(handle)

    monkeypatch.setattr(os, "fsync", full_after_a_while)
    with pytest.raises(WriteError, match=r"No space left on device \(free disk space, and resume with --resume\)"):
        gather()
    monkeypatch.setattr(os, "fsync", real)
    there = {path.name: path.read_bytes() for path in (tmp_path / "set/OpenDrawer").glob("*/0*.h5")}
    assert there
    assert gather(resume=True).status.ran == 16 - len(there)
    assert_same(tmp_path / "set", undisturbed)


def collecting(out: Path, before: Callable[[], None] | None = None, *prefix: str) -> subprocess.CompletedProcess[str]:
    """Return the collection command in the fake world, without byte code, which small disks would damage."""
    words = ["collect", "OpenDrawer", "CloseBox", "--episodes", "8", "--seed", "3", "--assets", "builtin"]
    command = [*prefix, sys.executable, str(KILL_RUNS), "--child", "fake", *words, "--workers", "2", "--resume"]
    environment = {**SCRIPT_ENVIRONMENT, "PYTHONDONTWRITEBYTECODE": "1"}
    return subprocess.run(
        [*command, "--out", str(out)], capture_output=True, text=True, preexec_fn=before, env=environment
    )


def small_files() -> None:
    """Limit files of this process and its children to 4 kB, less than an episode with states."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))


def test_the_command_says_one_line_where_a_worker_cannot_write(tmp_path: Path, undisturbed: dict[str, Any]) -> None:
    done = collecting(tmp_path / "set", small_files)
    assert done.returncode == 2
    *_, said = done.stderr.splitlines()
    assert said.startswith("gensim2: ")
    assert "cannot write: File too large" in said
    assert "Traceback" not in done.stderr
    assert not list((tmp_path / "set").glob("**/*.tmp*"))
    assert collecting(tmp_path / "set").returncode == 0
    assert_same(tmp_path / "set", undisturbed)


@pytest.mark.skipif(not can_mount(), reason="mounts a file system of its own")
@pytest.mark.parametrize(
    ("mounted", "said"), [("size=32k", "No space left on device"), ("ro", "Read-only file system")]
)
def test_the_command_says_one_line_on_a_full_or_read_only_disk(tmp_path: Path, mounted: str, said: str) -> None:
    done = collecting(tmp_path / "set", None, *on_disk(mounted, tmp_path))
    assert done.returncode == 2
    last = done.stderr.splitlines()[-1]
    assert last.startswith("gensim2: ")
    assert said in last
    assert "Traceback" not in done.stderr
