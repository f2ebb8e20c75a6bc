"""Absurd task files are valid tasks, or refused in one line that names the field; none takes long."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from gensim2.core.errors import InputError
from gensim2.core.yaml_files import read_yaml
from gensim2.tasks.library import load_task
from gensim2.tasks.parse import parse_task

Fields = dict[str, Any]

STEP = {"name": "open", "object": "drawer", "strategies": ["open_drawer_from_above"]}


def at(*path: str | int, value: object) -> Callable[[Fields], None]:
    def change(fields: Fields) -> None:
        inner: Any = fields
        for part in path[:-1]:
            inner = inner[part]
        inner[path[-1]] = value

    return change


DRAWER = ("objects", "drawer")
ABSURD: dict[str, tuple[Callable[[Fields], None], str]] = {
    "a far place": (
        at(*DRAWER, "place", value={"at": [1e308, 0.0]}),
        "objects.drawer.place.at.0: .* less than or equal to 5",
    ),
    "a place beyond the room": (at(*DRAWER, "place", value={"at": [0.0, -1e6]}), "objects.drawer.place.at.1"),
    "a wide scene": (at(*DRAWER, "randomization", value={"x": 1e308}), "randomization.x.0"),
    "a turn": (at(*DRAWER, "randomization", value={"yaw": 1e308}), "randomization.yaw"),
    "an openness": (at(*DRAWER, "randomization", value={"openness_mean": 1e308}), "openness_mean"),
    "a threshold": (at("steps", 0, "done", 0, "threshold", value=1e308), "threshold: input should be less than 1"),
    "endless": (at("max_episode_steps", value=1e308), "max_episode_steps: input should be a valid integer"),
    "too long": (
        at("max_episode_steps", value=10_001),
        "max_episode_steps: input should be less than or equal to 10000",
    ),
    "10,000 steps": (at("steps", value=[{**STEP, "name": f"s{i}"} for i in range(10_000)]), "is larger than 100 kB"),
    "10,000 times one step": (at("steps", value=[STEP] * 10_000), "more than 20000 values, repeated ones included"),
    "51 steps": (
        at("steps", value=[{**STEP, "name": f"s{i}"} for i in range(51)]),
        "steps: needs at most 50 entries",
    ),
    "1,000 ways": (at("steps", 0, "strategies", value=["a"] * 1000), "strategies: needs at most 20 entries"),
    "1,000 objects": (
        at("objects", value={f"o{i}": {"class": "drawer"} for i in range(1000)}),
        "objects: .* at most 20",
    ),
    "a terminal's colours": (at("description", value="\x1b[31mopen it"), r"text contains a control .*\\x1b"),
    "a null byte": (at("description", value="open\0it"), r"text contains a control .*\\x00"),
    "letters from the right": (at("description", value="open \u202e it"), r"text contains a control .*\\u202e"),
}


@pytest.mark.parametrize("name", ABSURD)
def test_absurd_task_files_are_one_line(name: str, tmp_path: Path) -> None:
    change, words = ABSURD[name]
    fields = copy.deepcopy(load_task("OpenDrawer").model_dump(mode="json", exclude={"provenance"}, by_alias=True))
    change(fields)
    file = tmp_path / "task.yaml"
    file.write_text(yaml.safe_dump(fields))
    begin = time.process_time()

    def read() -> None:
        parse_task(read_yaml(file), file)

    with pytest.raises(InputError, match=words) as refused:
        read()
    assert str(refused.value).isprintable()
    assert time.process_time() - begin < 5.0


def test_a_description_may_have_lines() -> None:
    fields = load_task("OpenDrawer").model_dump(mode="json", by_alias=True)
    assert parse_task({**fields, "description": "öffne\tdie\nSchublade"}).description == "öffne\tdie\nSchublade"
