"""Scenes for the simulator's tests."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from gensim2.core.errors import InputError
from gensim2.objects import RigidObject
from gensim2.objects.types import ArticulatedObject, Hulls
from gensim2.scenes.arguments import as_library
from gensim2.tasks.parse import parse_task
from gensim2.tasks.spec import TaskSpec

_SPEC = importlib.util.spec_from_file_location("tiny_object", Path(__file__).with_name("tiny_object.py"))
assert _SPEC is not None
assert _SPEC.loader is not None
tiny_object = importlib.util.module_from_spec(_SPEC)
sys.modules["tiny_object"] = tiny_object
_SPEC.loader.exec_module(tiny_object)


class CrateLibrary:
    """A library of crates; other classes are generated."""

    def __init__(self, *crates: ArticulatedObject) -> None:
        self._crates = {crate.id: crate for crate in crates}
        self._others = as_library("builtin")

    def source(self, asset_class: str, /) -> str:
        return "real" if asset_class == "crate" else self._others.source(asset_class)

    def instances(self, asset_class: str, /) -> tuple[str, ...]:
        return tuple(self._crates) if asset_class == "crate" else self._others.instances(asset_class)

    def choose(self, asset_class: str, which: str, /) -> tuple[str, ...]:
        if asset_class != "crate":
            return self._others.choose(asset_class, which)
        ids = self.instances(asset_class)
        splits = {"all": ids, "train": ids[:1], "test": ids[1:]}
        if which not in splits and which not in ids:
            raise InputError(f"{asset_class} has no instance {which}", field="instance")
        return splits.get(which, (which,))

    def load(self, asset_class: str, instance_id: str, hulls: Hulls = "default", /) -> ArticulatedObject | RigidObject:
        if asset_class == "crate":
            return self._crates[instance_id]
        return self._others.load(asset_class, instance_id, hulls)


@pytest.fixture
def crates(tmp_path: Path) -> Callable[..., CrateLibrary]:
    """Return a function that makes a library of ``count`` equal crates."""

    def make(count: int = 1, **kwargs: Any) -> CrateLibrary:
        return CrateLibrary(
            *(tiny_object.make_crate(tmp_path / f"{kwargs}-{n}", number=n, **kwargs) for n in range(count))
        )

    return make


@pytest.fixture
def crate_task() -> TaskSpec:
    return parse_task(
        {
            "name": "CloseCrate",
            "description": "close the crate",
            "objects": {"crate": {"class": "crate"}},
            "steps": [
                {
                    "name": "close",
                    "object": "crate",
                    "strategies": ["push"],
                    "done": [{"type": "articulated_closed", "object": "crate"}],
                }
            ],
        }
    )
