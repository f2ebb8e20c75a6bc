"""Object folders of users: proposals with missing classes, other ids, links, and tasks that name a split."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest

from gensim2.core.errors import InputError
from gensim2.core.progress import NULL_PROGRESS
from gensim2.design import Brief, OfflineDesigner
from gensim2.design.base import Known
from gensim2.design.briefing import Classes, robot_summary
from gensim2.design.drafting import pieces
from gensim2.objects import open_library
from gensim2.objects.library.catalogue import release_split
from gensim2.objects.library.export import export
from gensim2.rollout.inputs import read_task_input
from gensim2.scenes.arguments import chosen_instances
from gensim2.tasks.library import load_strategies, load_task, packaged_names

RELEASED = ("19179", "20279", "20411", "20555", "22692", "26525", "29921", "31249")


class _NoRun:
    def add_object(self, model: Any) -> None:
        """Do nothing, because there is no run folder."""


@pytest.fixture
def drawers(tmp_path: Path) -> Path:
    """Two drawers with the user's own ids; the folder of their class is a link."""
    model = open_library("builtin").load_articulated("drawer", "0")
    made = export(model, tmp_path / "made")
    for name in ("mine", "yours"):
        shutil.copytree(made, tmp_path / "elsewhere" / "drawer" / name)
    folder = tmp_path / "folder" / "articulated_objs"
    folder.mkdir(parents=True)
    (folder / "drawer").symlink_to(tmp_path / "elsewhere" / "drawer")
    return folder.parent


def test_what_is_known_of_classes_that_are_not_there_ends_no_run(drawers: Path) -> None:
    library = open_library(drawers)
    run: Any = _NoRun()
    classes = Classes(library, "all", 0, run, NULL_PROGRESS)
    known = [Known(load_task(name), load_strategies(name)) for name in packaged_names()]
    brief = Brief(robot_summary("panda"), classes, known)
    assert {piece.asset_class for piece in pieces(brief)} == {"drawer"}
    found = list(OfflineDesigner().propose(brief, 0))
    assert len(found) > 10
    for task in found:
        assert {thing.asset_class for thing in task.objects.values()} <= set(library.classes())


def test_classes_without_the_objects_that_were_asked_for_are_named(drawers: Path) -> None:
    library, run = open_library(drawers), _NoRun()
    assert Classes(library, "all", 0, run, NULL_PROGRESS).notes == []  # type: ignore[arg-type]
    classes = Classes(library, "test", 0, run, NULL_PROGRESS)  # type: ignore[arg-type]
    assert "drawer" not in classes
    assert classes.notes == ["classes without test objects are left out: drawer"]
    [note] = Classes(library, "mine", 0, run, NULL_PROGRESS).notes  # type: ignore[arg-type]
    rigid = len(library.classes("rigid"))
    assert note.startswith("classes without an object 'mine' are left out: ")
    assert note.endswith(f" and {rigid - 6} more")


def test_drawer_tasks_take_a_folder_with_other_drawers(drawers: Path) -> None:
    names = [name for name in packaged_names() if name.endswith(("IntoDrawer", "OpenDrawer"))]
    assert len(names) >= 7
    for name in names:
        given = read_task_input(name, assets=str(drawers), instances="all")
        chosen = chosen_instances(given.library, given.spec, given.instances)
        assert ("mine", "yours") in chosen.values(), name
    assert read_task_input("PlaceGolfBallIntoDrawer", assets=str(drawers), instances="mine").instances == "mine"
    with pytest.raises(InputError, match="no instance 'theirs'"):
        read_task_input("PlaceGolfBallIntoDrawer", assets=str(drawers), instances="theirs")


def test_no_task_of_the_package_names_an_id() -> None:
    for name in packaged_names():
        for thing in load_task(name).objects.values():
            words = thing.instances.values() if isinstance(thing.instances, dict) else [thing.instances or ()]
            assert not any(word[:1].isdigit() for each in words for word in each), name


def test_a_split_is_of_the_release_and_of_nothing_else() -> None:
    listed = tuple(sorted({*RELEASED, "20453", "24644"}))
    assert release_split("drawer", "long_horizon", listed) == tuple(i for i in listed if i in RELEASED)
    assert release_split("drawer", "long_horizon", listed[1:]) == listed[1:]
    assert release_split("drawer", "19179", listed) is None
    assert release_split("box_rotate", "long_horizon", listed) is None
