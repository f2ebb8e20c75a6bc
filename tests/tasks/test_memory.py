"""The user's task library: which tasks are accepted, and that it stays complete under concurrency and kills."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import pytest

from gensim2.core.errors import InputError
from gensim2.tasks import Provenance, TaskSpec, Verified
from gensim2.tasks import library as shelves
from gensim2.tasks.exporting import export
from gensim2.tasks.library import load_strategies, load_task, packaged_names, task_names
from gensim2.tasks.memory import ADDED_FILE, KnownTaskError, Memory, UnverifiedTaskError
from gensim2.tasks.parse import parse_task

LONG = "PlaceGolfBallIntoDrawer"


def verified(held: int = 18, episodes: int = 20) -> Verified:
    """Return a verification, of which only the counts matter."""
    share = held / episodes
    interval = (max(0.0, share - 0.2), min(1.0, share + 0.2))
    return Verified(episodes=episodes, held=held, interval=interval, seed=7, instances="new", objects={"drawer": 20})


def novel(name: str = "PutScissorsIntoDrawer", thing: str = "scissors", **changes: Any) -> TaskSpec:
    """Return a task that is not in the package, with strategies of one that is."""
    fields = load_task(LONG).model_dump(mode="json") | {"name": name}
    fields["description"] = f"open the drawer, put the {thing.replace('_', ' ')} into it and push it closed"
    fields["objects"]["ball"]["class"] = thing
    fields["provenance"] = {"origin": "offline"}
    return parse_task(fields | changes)


@pytest.fixture
def memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Memory:
    monkeypatch.setenv("GENSIM2_LIBRARY", str(tmp_path / "tasks"))
    return Memory()


def test_a_verified_task_is_found_by_its_name_with_where_it_comes_from(memory: Memory) -> None:
    strategies = load_strategies(LONG)
    folder = memory.add(novel(), strategies, verified(), run="runs/one")
    assert folder == memory.folder / "PutScissorsIntoDrawer"
    assert "PutScissorsIntoDrawer" in task_names()
    assert memory.names() == ("PutScissorsIntoDrawer",)
    assert set(task_names("offline")) - set(packaged_names()) == {"PutScissorsIntoDrawer"}
    assert "PutScissorsIntoDrawer" not in task_names("paper")
    found = load_task("PutScissorsIntoDrawer")
    assert found.provenance == Provenance(origin="offline", verification=verified())
    assert load_strategies("PutScissorsIntoDrawer") == strategies  # also shared ones of the package
    note = json.loads((folder / ADDED_FILE).read_text())
    assert note["run"] == memory.run_of("PutScissorsIntoDrawer") == "runs/one"
    assert memory.run_of("OpenDrawer") is None
    assert "added" not in (folder / "task.yaml").read_text()
    assert {path.name for path in memory.folder.iterdir()} == {".lock", "PutScissorsIntoDrawer"}
    with pytest.raises(InputError, match=r"no task of the library has the origin 'bob'.*offline, paper"):
        task_names("bob")


def test_the_same_again_changes_nothing(memory: Memory) -> None:
    folder = memory.add(novel(), load_strategies(LONG), verified())
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
    assert memory.add(novel(), load_strategies(LONG), verified(19)) == folder
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*")} == before
    other = {**load_strategies(LONG), "grasp": {"grasp": "antipodal", "from": "the_side"}}
    with pytest.raises(KnownTaskError, match="is taken"):
        memory.add(novel(), other, verified())


@pytest.mark.parametrize(("held", "episodes"), [(19, 19), (11, 20), (0, 50)])
def test_what_was_not_verified_is_not_added(memory: Memory, held: int, episodes: int) -> None:
    with pytest.raises(UnverifiedTaskError, match=f"{held} of {episodes} fresh episodes succeeded"):
        memory.add(novel(), load_strategies(LONG), verified(held, episodes))
    assert memory.names() == ()


def test_who_proposed_it_must_be_said_and_it_was_not_the_paper(memory: Memory) -> None:
    for provenance in (None, {"origin": "paper"}):
        with pytest.raises(InputError, match="must have an origin other than 'paper'"):
            memory.add(novel(provenance=provenance), load_strategies(LONG), verified())
    with pytest.raises(InputError, match="the strategy 'open_drawer_from_inside', which was not given"):
        memory.add(novel(), {}, verified())


def _other_thresholds() -> TaskSpec:
    fields = novel("StoreScissors").model_dump(mode="json") | {"description": "tidy up"}
    for criterion in fields["goal"]:
        criterion["threshold"] *= 0.9
    return parse_task(fields)


def _other_roles() -> TaskSpec:
    text = json.dumps(novel("StoreScissors").model_dump(mode="json") | {"description": "tidy up"})
    return parse_task(
        json.loads(
            text.replace('"ball"', '"shears"')
            .replace('"drawer":', '"chest":')
            .replace('"object": "drawer"', '"object": "chest"')
            .replace('"articulated": "drawer"', '"articulated": "chest"')
        )
    )


def _other_steps() -> TaskSpec:
    fields = novel("StoreScissors").model_dump(mode="json")
    fields["description"] = "Shut the drawer after you have opened the drawer and put the scissors inside"
    return parse_task(fields | {"steps": fields["steps"][1:]})


def _only_words() -> TaskSpec:
    return novel("StoreScissors", "banana", description="Open the drawer, place the scissors in it, and push it shut.")


@pytest.mark.parametrize(
    ("made", "why"),
    [
        (_other_thresholds, "the same steps"),
        (_other_roles, "the same steps"),
        (_other_steps, "nearly the same words"),
        (_only_words, "says the same"),
    ],
)
def test_a_task_in_other_words_roles_or_numbers_is_known(memory: Memory, made: Any, why: str) -> None:
    memory.add(novel(), load_strategies(LONG), verified())
    with pytest.raises(KnownTaskError, match=f"StoreScissors is not new: PutScissorsIntoDrawer .*{why}") as caught:
        memory.add(made(), load_strategies(LONG), verified())
    assert caught.value.known == "PutScissorsIntoDrawer"


def test_a_task_of_the_package_is_known_and_another_thing_or_goal_is_new(memory: Memory) -> None:
    with pytest.raises(KnownTaskError, match="PlaceGolfBallIntoDrawer"):
        memory.add(novel("Tidy", "golf_ball"), load_strategies(LONG), verified())
    memory.add(novel(), load_strategies(LONG), verified())
    memory.add(novel("PutBananaIntoDrawer", "banana"), load_strategies(LONG), verified())
    fields = novel("OpenDrawerForScissors").model_dump(mode="json")
    fields |= {"steps": fields["steps"][:3], "goal": fields["goal"][:1]}
    fields["description"] = "open the drawer and put the scissors into it"
    memory.add(parse_task(fields), load_strategies(LONG), verified())
    assert len(memory.names()) == 3


def test_only_ones_own_tasks_can_be_removed(memory: Memory) -> None:
    memory.add(novel(), load_strategies(LONG), verified())
    with pytest.raises(InputError, match="OpenDrawer is part of the package"):
        memory.remove("PutScissorsIntoDrawer", "OpenDrawer")
    assert memory.names() == ("PutScissorsIntoDrawer",)
    memory.remove("PutScissorsIntoDrawer")
    assert [path.name for path in memory.folder.iterdir()] == [".lock"]
    with pytest.raises(InputError, match="there is no task 'PutScissorsIntoDrawer'"):
        memory.remove("PutScissorsIntoDrawer")


def test_what_was_exported_is_a_library(memory: Memory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    memory.add(novel(), load_strategies(LONG), verified())
    names = ["PutScissorsIntoDrawer", "OpenDrawer"]
    before = {name: (load_task(name), load_strategies(name)) for name in names}
    for out in (tmp_path / "folder", tmp_path / "one.zip", tmp_path / "two.zip"):
        export(names, out)
        monkeypatch.setenv("GENSIM2_LIBRARY", str(out))
        monkeypatch.setattr(shelves, "packaged_names", tuple)
        monkeypatch.setattr(shelves, "_names_on_shelf", lambda shelf: ())
        assert {name: (load_task(name), load_strategies(name)) for name in task_names()} == before
        monkeypatch.undo()
        monkeypatch.setenv("GENSIM2_LIBRARY", str(memory.folder))
    assert (tmp_path / "one.zip").read_bytes() == (tmp_path / "two.zip").read_bytes()
    with pytest.raises(InputError, match="already exists"):
        export(names, tmp_path / "folder")


def test_an_archive_that_is_none_is_one_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    archive = tmp_path / "tasks.zip"
    archive.write_bytes(b"PK\x03\x04 no")
    monkeypatch.setenv("GENSIM2_LIBRARY", str(archive))
    with pytest.raises(InputError, match=r"tasks\.zip: cannot be read as an archive of tasks"):
        task_names()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as made:
        made.writestr("Bomb/task.yaml", b"a: " + b"x" * 10**7)
    with pytest.raises(InputError, match=r"Bomb/task.yaml: is larger than 100 kB"):
        load_task("Bomb")


_ADDS = """
import os, signal, sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
from test_memory import LONG, load_strategies, novel, verified, Memory, KnownTaskError
if sys.argv[2] == "kill":
    Path.rename = lambda *_: os.kill(os.getpid(), signal.SIGKILL)
for name in sys.argv[3:]:
    try:
        Memory().add(novel("Put" + name.capitalize() + "IntoDrawer", name), load_strategies(LONG), verified())
        print("added", name)
    except KnownTaskError as error:
        print("known", error.known)
"""


def _adding(mode: str, *things: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", _ADDS, str(Path(__file__).parent), mode, *things]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def test_several_at_once_and_one_that_is_killed(memory: Memory) -> None:
    killed = _adding("kill", "scissors")
    assert killed.wait() == -signal.SIGKILL
    assert memory.names() == ()
    assert any(path.name.endswith(".tmp") for path in memory.folder.iterdir())  # complete, before the renaming
    both = [_adding("all", "scissors", "banana", "apple"), _adding("all", "banana", "apple", "scissors")]
    for process in both:
        assert process.wait() == 0
    assert memory.names() == ("PutAppleIntoDrawer", "PutBananaIntoDrawer", "PutScissorsIntoDrawer")
    assert sorted(path.name for path in memory.folder.iterdir()) == [".lock", *memory.names()]
    for name in memory.names():
        assert load_task(name).provenance is not None
        assert load_strategies(name) == load_strategies(LONG)
