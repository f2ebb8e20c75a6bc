"""Descriptions of tasks whose objects are not available."""

from __future__ import annotations

from typing import Any

from gensim2.design.description import description_of
from gensim2.objects import open_library
from gensim2.tasks.library import load_strategies, load_task


class Bare:
    """A fake object library without any class of the task."""

    def classes(self) -> tuple[str, ...]:
        return ()


def test_a_task_of_classes_that_are_not_there_says_which_objects_have_joints() -> None:
    task, bare = load_task("DropAppleIntoBox"), Bare()
    found: dict[str, Any] = description_of(task, load_strategies(task.name), bare)  # type: ignore[arg-type]
    known = description_of(task, load_strategies(task.name), open_library("builtin"))
    told = {each["name"]: "openness" in each["randomization"] for each in found["objects"]}
    assert told == {"box": True, "apple": False}
    assert found["objects"] == known["objects"]
