"""The top-level package imports the most used names when they are accessed."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import subprocess
import sys
import textwrap
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path

import pytest

import gensim2

ROOMS = (
    "data",
    "design",
    "envs",
    "evaluation",
    "inspection",
    "objects",
    "perception",
    "planning",
    "robots",
    "rollout",
    "sim",
    "tasks",
)
HEAVY = ("h5py", "mani_skill", "numpy", "pydantic", "sapien", "scipy", "torch", "trimesh", "yaml")


def test_importing_the_package_imports_nothing_heavy() -> None:
    code = f"import gensim2, sys; dir(gensim2); print(sorted(set({HEAVY}) & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_opening_a_library_brings_neither_simulator_nor_meshes() -> None:
    code = (
        "import gensim2, sys; gensim2.open_library('builtin').classes(); gensim2.load_task('OpenDrawer')\n"
        "print(sorted({'mani_skill', 'sapien', 'torch', 'trimesh'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("name", [name for name in gensim2.__all__ if name not in ("__version__", "HeadlessEnv")])
def test_every_name_is_that_of_its_room(name: str) -> None:
    found = getattr(gensim2, name)
    assert found.__module__.startswith("gensim2.")
    assert name in dir(gensim2)
    assert gensim2.__dict__.get(name) is None, "what a room gives is asked of the room each time"


@pytest.mark.parametrize("room", ROOMS)
def test_rooms_say_what_they_are_and_give_what_they_say(room: str) -> None:
    module = importlib.import_module(f"gensim2.{room}")
    assert module.__doc__
    assert len(module.__doc__.splitlines()[0]) > 20
    if room in ("sim", "inspection", "episodes"):
        pytest.importorskip("mani_skill")
    for name in module.__all__:
        assert not inspect.ismodule(getattr(module, name)), f"{name} is a module of that name"
    assert sorted(module.__all__) == sorted(set(module.__all__))


def _example(text: str) -> str | None:
    """Return the program below ``Example:`` in a docstring."""
    found = re.search(r"^Example:\n(.*?)(?=\n\S|\Z)", inspect.cleandoc(text), re.S | re.M)
    if found is None:
        return None
    block = textwrap.dedent(found[1])
    fenced = re.search(r"```python\n(.*?)```", block, re.S)
    return fenced[1] if fenced else textwrap.dedent(block.partition("::\n")[2])


@pytest.mark.parametrize("room", ["", *ROOMS, "bench", "policy"])
def test_every_function_has_an_example(room: str) -> None:
    module = importlib.import_module(f"gensim2.{room}".rstrip("."))
    functions = [(name, getattr(module, name)) for name in module.__all__]
    examples = {name: _example(made.__doc__ or "") for name, made in functions if inspect.isroutine(made)}
    assert [name for name, text in examples.items() if not text] == []
    for text in examples.values():
        compile(text or "", room, "exec", flags=ast.PyCF_ALLOW_TOP_LEVEL_AWAIT)


def test_every_function_of_the_solver_has_an_example() -> None:
    tree = ast.parse(files("gensim2_kpam").joinpath("__init__.pyi").read_text(encoding="utf-8"))
    (robot,) = (node for node in tree.body if isinstance(node, ast.ClassDef) and node.name == "Robot")
    functions = [node for node in [*tree.body, *robot.body] if isinstance(node, ast.FunctionDef)]
    wanted = [node for node in functions if node in tree.body or node.name == "from_urdf"]
    assert len(wanted) > 9
    assert [node.name for node in wanted if not _example(ast.get_docstring(node) or "")] == []


def test_the_package_is_the_command_line() -> None:
    done = subprocess.run([sys.executable, "-m", "gensim2", "--help"], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("Usage: gensim2 ")


def test_other_names_are_refused() -> None:
    with pytest.raises(AttributeError, match="module 'gensim2' has no attribute 'open_librery'"):
        getattr(gensim2, "open_librery")  # noqa: B009


def test_version_is_the_installed_one() -> None:
    assert gensim2.__version__ == version("gensim2")


def test_types_travel_with_the_package() -> None:
    assert Path(str(files("gensim2") / "py.typed")).is_file()


def test_make_env_takes_a_name_a_spec_or_its_fields() -> None:
    pytest.importorskip("mani_skill")
    task = gensim2.load_task("OpenDrawer")
    fields = {**task.model_dump(mode="json", by_alias=True), "name": "MyDrawer"}
    for asked, name in (("OpenDrawer", "OpenDrawer"), (task, "OpenDrawer"), (fields, "MyDrawer")):
        env = gensim2.make_env(asked, assets="builtin", obs_mode="state")
        assert env.unwrapped.task.name == name
        env.close()


def test_importing_the_environments_registers_their_ids_and_no_simulator() -> None:
    code = (
        "import gensim2.envs, gymnasium, sys; assert 'GenSim2-OpenDrawer-v1' in gymnasium.registry\n"
        "print(sorted({'mani_skill', 'sapien', 'torch'} & set(sys.modules)))"
    )
    pytest.importorskip("gymnasium")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
