"""The path of a value through the files of the package, by function calls.

A file passes a value on if a function of another file calls one of its functions with the value or gets the value from
it. The path is the shortest chain of such files; calls inside libraries are skipped.
"""

from __future__ import annotations

import itertools
import sys
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import BuiltinMethodType, FrameType
from typing import Any

import pytest

pytest.importorskip("openai")

from llm_answers import BOX, GoodModel
from llm_server import ModelServer
from test_models import run
from test_models import world as model_world

import gensim2
from gensim2.cli.main import run as command
from gensim2.core.seeding import scene_seeds
from gensim2.design import single
from gensim2.design.remembering import remember

PACKAGE = Path(gensim2.__file__).parent
#: Depth of nested containers and records that are searched.
DEPTH = 3
#: Largest number of files in a path.
LONGEST = 12
SEED = 271_828


class Walks:
    """Records which file passes a value to which.

    Args:
        carries: returns whether an object is the value or made of it.
    """

    def __init__(self, carries: Callable[[Any], bool]) -> None:
        self.carries = carries
        self.handed: dict[str, set[str]] = {}

    def holds(self, value: Any, depth: int = DEPTH) -> bool:
        if self.carries(value):
            return True
        if depth == 0:
            return False
        if isinstance(value, dict):
            return any(self.holds(each, depth - 1) for each in list(value.values())[:50])
        if isinstance(value, list | tuple):
            return any(self.holds(each, depth - 1) for each in value[:50])
        if isinstance(value, BuiltinMethodType):  # such as a list's methods
            return self.holds(value.__self__, depth - 1)
        names = getattr(type(value), "__dataclass_fields__", None) or getattr(type(value), "model_fields", ())
        if names:
            return any(self.holds(getattr(value, name, None), depth - 1) for name in names)
        return False

    def note(self, frame: FrameType, event: str, value: Any) -> None:
        here = _file(frame)
        if here is None or event not in ("call", "return"):
            return
        caller = frame.f_back
        while caller is not None and _file(caller) is None:
            caller = caller.f_back
        there = None if caller is None else _file(caller)
        if there is None or there == here:
            return
        if event == "return":
            if self.holds(value):
                self.handed.setdefault(here, set()).add(there)
            return
        code = frame.f_code
        names = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount + bool(code.co_flags & 0x0C)]
        if any(self.holds(frame.f_locals.get(name)) for name in names):
            self.handed.setdefault(there, set()).add(here)

    def through(self, *files: str) -> list[str]:
        """Return the files of the shortest path that passes all of ``files`` in this order."""
        found = [files[0]]
        for first, last in itertools.pairwise(files):
            part = self.shortest(first, last)
            assert part, f"{first} hands nothing on that comes to {last}"
            found += part[1:]
        return list(dict.fromkeys(found))

    def shortest(self, first: str, last: str) -> list[str]:
        """Return the files of the shortest path, empty if there is none."""
        paths, waiting = {first: [first]}, deque([first])
        while waiting:
            here = waiting.popleft()
            if here == last:
                return paths[here]
            for there in sorted(self.handed.get(here, ())):
                if there not in paths:
                    paths[there] = [*paths[here], there]
                    waiting.append(there)
        return []


def _file(frame: FrameType) -> str | None:
    path = frame.f_code.co_filename
    own = path.startswith(str(PACKAGE)) and path.endswith(".py")
    return str(Path(path).relative_to(PACKAGE)) if own else None


@contextmanager
def watched(carries: Callable[[Any], bool]) -> Iterator[Walks]:
    walks = Walks(carries)
    before = sys.getprofile()
    sys.setprofile(walks.note)
    try:
        yield walks
    finally:
        sys.setprofile(before)


def test_a_seed_walks_from_the_command_to_the_trajectory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Followed are the seed, the scene seeds drawn from it, and records of episodes that contain one of these."""
    drawn = {SEED, *scene_seeds(SEED, "OpenDrawer", "demos", 50)}
    monkeypatch.setattr(single.Execution, "of", lambda _: single.Execution(0))
    with watched(lambda value: type(value) is int and value in drawn) as walks:
        words = ["demo", "OpenDrawer", "--episodes", "1", "--seed", str(SEED), "--videos", "0", "--assets", "builtin"]
        assert command([*words, "--out", str(tmp_path / "run")]) == 0
    assert (tmp_path / "run/tasks/OpenDrawer/trajectory.h5").is_file()
    walk = walks.through(
        "cli/demo.py", "data/task_queue.py", "core/processes/pool.py", "data/episode_file.py", "data/trajectory.py"
    )
    assert len(walk) <= LONGEST, walk


@pytest.mark.usefixtures("model_world")
def test_a_designed_task_walks_from_the_answer_to_the_shelf(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Followed are the answer's text, the fields read from it, and the task made of them."""
    monkeypatch.setenv("GENSIM2_LIBRARY", str(tmp_path / "library"))
    told = ("fling-box-open", "FlingBoxOpen")
    with (
        ModelServer(GoodModel(BOX)) as server,
        watched(lambda value: isinstance(value, str) and any(name in value for name in told)) as walks,
    ):
        run(server, tmp_path / "run", num_tasks=1)
        remember(tmp_path / "run")
    walk = walks.through(
        "design/llm/client.py",
        "design/llm/extraction.py",
        "design/llm/stages/proposal.py",
        "design/llm/specs.py",
        "design/llm/designer.py",
        "data/runfolder.py",
    )
    kept = walks.through("tasks/library.py", "tasks/memory.py")  # through the task's file in the run folder
    assert len({*walk, *kept}) <= LONGEST, (walk, kept)
