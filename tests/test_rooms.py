"""Dependencies between the packages, read from the import statements of the sources."""

from __future__ import annotations

import ast
import importlib
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

import gensim2.objects

PYTHON = Path(__file__).parents[1] / "python"

#: Packages that must not depend on the simulator, and those that may.
BELOW_SIM = ("gensim2.instructions", "gensim2.objects", "gensim2.planning", "gensim2.scenes", "gensim2.tasks")
ABOVE_SIM = (
    "gensim2.rollout",
    "gensim2.data",
    "gensim2.evaluation",
    "gensim2.policy",
    "gensim2_robot",
    "gensim2.design",
    "gensim2.inspection",
    "gensim2.doing",
)
FROM_SIM_UP = ("gensim2.sim", *ABOVE_SIM)
#: Packages in order of dependency: each imports nothing of those after it.
UPWARDS = (
    "gensim2.rollout",
    "gensim2.data",
    "gensim2.evaluation",
    "gensim2.policy",
    "gensim2.perception.estimation",
    "gensim2.design",
    "gensim2.doing",
    "gensim2.cli",
)
#: Packages within ``gensim2.objects`` with those that each may import; ``core`` is the modules beside them.
WITHIN_OBJECTS = {
    "core": {"core"},
    "meshwork": {"core", "meshwork"},
    "generators": {"core", "generators"},
    "library": {"core", "meshwork", "generators", "library"},
}


def imports(source: str) -> set[str]:
    """Return the full names of everything that a source imports anywhere: the module and its names."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports name the whole package"
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def lies_in(name: str, package: str) -> bool:
    """Return whether a full name is the package or inside it."""
    return f"{name}.".startswith(f"{package}.")


def sources(package: str) -> Iterator[Path]:
    """Return all modules of a package."""
    found = sorted((PYTHON / package.replace(".", "/")).rglob("*.py"))
    assert found, package
    yield from found


def room_within_objects(name: str) -> str:
    """Return the subpackage of ``gensim2.objects`` of a full name or of a path."""
    first = name.removeprefix("gensim2.objects").strip(".").split(".")[0]
    return first if first in WITHIN_OBJECTS else "core"


def test_imports_are_found_wherever_they_stand() -> None:
    source = "import a.b\ndef f():\n    from c import d\nif TYPE_CHECKING:\n    from gensim2 import sim as s\n"
    assert imports(source) == {"a.b", "c.d", "gensim2.sim"}
    assert lies_in("gensim2.sim", "gensim2.sim")
    assert lies_in("gensim2.sim.env.X", "gensim2.sim")
    assert not lies_in("gensim2.simple", "gensim2.sim")


@pytest.mark.parametrize("room", BELOW_SIM)
def test_nothing_below_the_simulator_knows_it(room: str) -> None:
    for path in sources(room):
        for name in imports(path.read_text()):
            assert not any(lies_in(name, above) for above in FROM_SIM_UP), f"{path}: {name}"


def test_the_simulator_knows_neither_episodes_nor_what_looks_at_objects() -> None:
    for path in sources("gensim2.sim"):
        for name in imports(path.read_text()):
            assert not any(lies_in(name, above) for above in ABOVE_SIM), f"{path}: {name}"


def test_robots_know_of_nothing_but_files_and_the_solver() -> None:
    for path in sources("gensim2.robots"):
        for name in imports(path.read_text()):
            known = ("gensim2.robots", "gensim2.core")
            assert not lies_in(name, "gensim2") or any(lies_in(name, room) for room in known), f"{path}: {name}"


@pytest.mark.parametrize("number", range(len(UPWARDS) - 1))
def test_rooms_from_the_loop_up_depend_in_one_direction(number: int) -> None:
    for path in sources(UPWARDS[number]):
        for name in imports(path.read_text()):
            assert not any(lies_in(name, above) for above in UPWARDS[number + 1 :]), f"{path}: {name}"


def test_perception_knows_no_simulator() -> None:
    """It is also used for a real robot's cameras, without a simulator; ray casting depends on objects, too.

    The estimator of scenes plans and acts on its estimates: it stands above the policies.
    """
    for path in sources("gensim2.perception"):
        if path.parent.name == "estimation":
            assert not any(lies_in(name, "gensim2.sim") for name in imports(path.read_text())), path
            continue
        known = ["gensim2.perception", "gensim2.robots", "gensim2.core"]
        known += ["gensim2.objects", "gensim2.scenes"] if path.parent.name == "raycast" else []
        for name in imports(path.read_text()):
            assert not lies_in(name, "gensim2") or any(lies_in(name, room) for room in known), f"{path}: {name}"


def test_the_core_knows_no_room() -> None:
    for path in sources("gensim2.core"):
        for name in imports(path.read_text()):
            assert not lies_in(name, "gensim2") or lies_in(name, "gensim2.core"), f"{path}: {name}"


def test_nothing_in_gensim2_knows_the_distribution_for_robots() -> None:
    for path in sources("gensim2"):
        for name in imports(path.read_text()):
            assert not lies_in(name, "gensim2_robot"), f"{path}: {name}"
        assert re.search(r"\bgensim2_robot\b", path.read_text()) is None, path


def test_the_interpreter_of_task_code_knows_tasks_and_executes_nothing() -> None:
    known = ("gensim2.design.sandbox", "gensim2.tasks", "gensim2.core")
    for path in sources("gensim2.design.sandbox"):
        for name in imports(path.read_text()):
            assert not lies_in(name, "gensim2") or any(lies_in(name, room) for room in known), f"{path}: {name}"
        used = {node.id for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Name)}
        assert not used & {"exec", "eval", "compile", "setattr", "__import__"}, path


def test_rooms_of_objects_depend_in_one_direction() -> None:
    top = PYTHON / "gensim2" / "objects"
    for path in sources("gensim2.objects"):
        if path == top / "__init__.py":
            continue  # the top-level package, which imports lazily
        room = room_within_objects(".".join(path.relative_to(top).with_suffix("").parts))
        for name in imports(path.read_text()):
            if lies_in(name, "gensim2.objects"):
                assert room_within_objects(name) in WITHIN_OBJECTS[room], f"{path}: {name}"
                assert name.removeprefix("gensim2.objects.") not in gensim2.objects.__all__, f"{path}: {name}"


def test_holding_an_object_loads_no_library() -> None:
    """Lazy imports keep the core independent of libraries."""
    tree = ast.parse((PYTHON / "gensim2" / "objects" / "__init__.py").read_text())
    at_once = {name for node in tree.body if not isinstance(node, ast.If) for name in imports(ast.unparse(node))}
    assert at_once
    assert not any(lies_in(name, "gensim2.objects.library") for name in at_once)


def modules_of_the_package() -> dict[str, Path]:
    """Return the files by full name."""
    found = {}
    for path in sources("gensim2"):
        name = ".".join(path.relative_to(PYTHON).with_suffix("").parts)
        found[name.removesuffix(".__init__")] = path
    return found


def at_run_time(tree: ast.AST) -> ast.AST:
    """Return the source without imports for type checkers only."""

    class Drop(ast.NodeTransformer):
        def visit_If(self, node: ast.If) -> ast.AST | None:
            return None if isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING" else node

    return Drop().visit(tree)


def test_no_circle_of_files_goes_through_several_rooms() -> None:
    """Imports within functions count, except in the top-level packages with lazy names."""
    files = {name: path for name, path in modules_of_the_package().items() if name != "gensim2"}
    names = sorted(files)
    links = np.zeros((len(names), len(names)), dtype=bool)
    for row, name in enumerate(names):
        for full in imports(ast.unparse(at_run_time(ast.parse(files[name].read_text())))):
            target = full if full in files else full.rpartition(".")[0]
            if target in files and target != name:
                links[row, names.index(target)] = True
    count, groups = connected_components(csr_array(links), connection="strong")
    circles = [[n for n, group in zip(names, groups, strict=True) if group == number] for number in range(count)]
    for circle in circles:
        assert len({name.split(".")[1] for name in circle}) == 1, circle
    assert [circle for circle in circles if len(circle) > 1] == []


def test_an_error_of_pydantic_is_put_into_words_in_one_place() -> None:
    converting = {
        path.relative_to(PYTHON / "gensim2").as_posix()
        for path in sources("gensim2")
        if ".errors()" in path.read_text()
    }
    assert converting == {"core/validation.py", "tasks/parse.py"}, "tasks/parse.py looks up a location in the error"


#: Packages whose class names are unique in both distributions; others still share names.
ONE_MEANING = (
    "gensim2.design",
    "gensim2.evaluation",
    "gensim2.bench",
    "gensim2.objects",
    "gensim2.perception",
    "gensim2_robot",
)


def test_a_name_of_a_class_has_one_meaning() -> None:
    owners: dict[str, set[str]] = {}
    for path in (*sources("gensim2"), *sources("gensim2_robot")):
        module = ".".join(path.relative_to(PYTHON).with_suffix("").parts)
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                owners.setdefault(node.name, set()).add(module)
    shared = {name: found for name, found in owners.items() if len(found) > 1}
    ours = {
        name for name, found in shared.items() if any(lies_in(each, room) for each in found for room in ONE_MEANING)
    }
    assert ours == set()


def test_limits_of_untrusted_files_stand_in_one_table() -> None:
    """Modules import their limits: none assigns a name of the table, and all of the table is used."""
    limits = PYTHON / "gensim2/core/foreign/limits.py"
    table = assigned(limits) - {"MIB"}
    used: set[str] = set()
    for room in ("gensim2.core", "gensim2.objects", "gensim2.perception", "gensim2.data.formats", "gensim2_robot"):
        for path in sources(room):
            assert path == limits or assigned(path) & table == set(), path
            used |= {name.rpartition(".")[2] for name in imports(path.read_text()) if "foreign.limits." in name}
    assert used | {"MAX_MESSAGE"} == table


def assigned(path: Path) -> set[str]:
    """Return the names that a module assigns at its top level."""
    targets = [t for node in ast.parse(path.read_text()).body if isinstance(node, ast.Assign) for t in node.targets]
    return {name.id for target in targets for name in ast.walk(target) if isinstance(name, ast.Name)}


@pytest.mark.parametrize(
    ("walk", "most"),
    [
        ("A seed from the command to the trajectory", 12),
        ("A cloud from the ray caster to the policy", 8),
        ("A designed task from the model's answer to the library", 12),
    ],
)
def test_a_walk_of_the_architecture_is_short_and_leads_through_functions_that_exist(walk: str, most: int) -> None:
    """Each row of the table names a function, whose module names the one of the row before or after it."""
    page = (PYTHON.parent / "docs/architecture.md").read_text()
    section = page.split(f"### {walk}\n")[1].split("\n#")[0]
    hops = re.findall(r"^\| \d+ \| `([\w.]+):([\w.]+)` \|", section, flags=re.M)
    assert 2 <= len(hops) <= most
    for module, name in hops:
        found: object = importlib.import_module(module)
        for part in name.split("."):
            found = getattr(found, part)
        assert callable(found), name


def test_how_jobs_run_is_one_value() -> None:
    """Only ``Execution`` has parameters for time limits and Ray; other functions take its keywords."""
    allowed = ("core/processes/", "cli/options.py")
    for path in sources("gensim2"):
        if path.relative_to(PYTHON / "gensim2").as_posix().startswith(allowed):
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                names = {argument.arg for argument in (*node.args.args, *node.args.kwonlyargs)}
                assert not names & {"ray", "time_limit", "jobs_per_worker"}, f"{path}: {node.name}"


def test_episodes_are_run_and_logged_in_one_place() -> None:
    """One runner gives jobs to workers, and one log reads and writes lines of episodes."""
    for path in sources("gensim2"):
        where, text = path.relative_to(PYTHON / "gensim2").as_posix(), path.read_text()
        if where not in ("rollout/runner.py", "data/task_queue.py"):
            assert "evaluator.run(" not in text, path
            assert "runner.run(" not in text, path
        if where != "rollout/episode_log.py":
            assert '"episode_digest":' not in text or where == "data/rendering.py", path


def test_options_come_from_typed_functions() -> None:
    """The signature and the docstring declare options; click's own decorators would repeat both."""
    for path in (path for package in ("gensim2", "gensim2_robot") for path in sources(package)):
        used = {
            f"{node.value.id}.{node.attr}"
            for node in ast.walk(ast.parse(path.read_text()))
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)
        }
        assert not used & {"click.option", "click.argument", "click.command"}, path
        made = used & {"click.Argument", "click.Option"}
        assert not made or path.parent.name == "cli", path


#: Modules that are slow to import or belong to an extra, with the modules of gensim2 that may import them.
HEAVY = (
    "json_repair",
    "PIL",
    "gensim2.inspection",
    "gensim2.sim",
    "gensim2.objects.meshwork.interior",
    "gensim2.scenes.goal",
    "gensim2.scenes.initial_state",
    "gensim2.scenes.randomize",
    "gensim2.rollout.diagnose",
)


def test_imports_of_designers_stand_at_the_top() -> None:
    """Only slow and optional modules are imported inside functions; commands import what they run."""
    for path in sources("gensim2.design"):
        functions = [each for each in ast.walk(ast.parse(path.read_text())) if isinstance(each, ast.FunctionDef)]
        for name in {name for each in functions for name in imports(ast.unparse(each))}:
            assert any(lies_in(name, module) for module in HEAVY), f"{path}: {name}"


def test_whether_a_run_is_the_same_is_decided_in_one_place() -> None:
    """Every resumable folder is a ``ResumableFolder`` or compares its record as ``RunSettings`` do."""
    every = [*sources("gensim2"), *sources("gensim2_robot")]
    names = {path.relative_to(PYTHON).as_posix(): path.read_text() for path in every}
    assert {name for name, text in names.items() if "import FileLock" in text} == {
        "gensim2/core/resumable.py",
        "gensim2/objects/library/cache.py",  # waits for its turn
        "gensim2/tasks/memory.py",
    }
    assert {name for name, text in names.items() if '"was begun with' in text} <= {
        "gensim2/core/resumable.py",
        "gensim2/data/record.py",  # a collection may grow, so it compares differently
        "gensim2/design/llm/store.py",
    }
    for name in (
        "gensim2/data/queue.py",
        "gensim2/data/runfolder.py",
        "gensim2/policy/dagger.py",
        "gensim2/policy/experiments/running.py",
        "gensim2/policy/keypose/data.py",
        "gensim2/policy/learn_record.py",
        "gensim2/policy/train_state.py",
        "gensim2_robot/trial/record.py",
    ):
        assert any(each.startswith("gensim2.core.resumable.") for each in imports(names[name])), name


def test_arrays_of_observation_files_are_named_in_one_place() -> None:
    naming = {
        path.relative_to(PYTHON).as_posix()
        for path in (*sources("gensim2"), *sources("gensim2_robot"))
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Constant)
        and isinstance(node.value, str)
        and node.value.startswith(("pointcloud/", "proprioception/"))
    }
    assert naming == {"gensim2/data/formats/columns.py"}


def test_options_of_scenes_are_made_once() -> None:
    """The command line changes no environment variables, and a configuration goes to the simulator unchanged."""
    for path in sources("gensim2.cli"):
        assert "os.environ[" not in path.read_text(), path
    for package in ("gensim2", "gensim2_robot"):
        for path in sources(package):
            assert "scene.arguments" not in path.read_text(), path


def test_what_builds_in_a_simulator_lies_with_it() -> None:
    for path in sources("gensim2.scenes"):
        assert not {name for name in imports(path.read_text()) if name.split(".")[0] in ("sapien", "mani_skill")}, path


def test_an_episode_has_three_types() -> None:
    """Its record, its states, and both together, whether it was just run or read."""
    owners = {
        node.name
        for room in ("rollout", "data", "evaluation", "design")
        for path in sources(f"gensim2.{room}")
        for node in ast.parse(path.read_text()).body
        if isinstance(node, ast.ClassDef)
    }
    assert {"Episode", "Recording", "EpisodeResult"} <= owners
    assert not owners & {"EpisodeRow", "StoredEpisode", "LoggedEpisode", "Found", "Kept", "Recorded"}


def test_jobs_are_handed_out_by_one_loop() -> None:
    """Worker processes and Ray share it, and the cluster is asked for its CPUs once."""
    loops = {path.name: path.read_text() for path in sources("gensim2.core.processes")}
    assert [name for name, text in loops.items() if " Tries(" in text] == ["executor.py"]
    assert loops["ray.py"].count("cluster_resources()") == 1


def test_a_camera_becomes_plain_data_in_one_place() -> None:
    """Logs and requests to policy servers share the record, so that neither loses a field."""
    records = {
        path.relative_to(PYTHON).as_posix()
        for path in (*sources("gensim2"), *sources("gensim2_robot"))
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ClassDef) and {"intrinsic", "T_base_camera"} <= {_named(each) for each in node.body}
    }
    assert records == {"gensim2/perception/camera.py", "gensim2/perception/camera_record.py"}


def _named(node: ast.stmt) -> str | None:
    """Return the name of an annotated field of a class."""
    return node.target.id if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) else None


def test_the_type_of_arrays_is_defined_once() -> None:
    """``Array`` has one definition; only the measurement of displacements still has its own."""
    for package in ("gensim2", "gensim2_robot"):
        for path in sources(package):
            if "Array = npt.NDArray[np.float64]" in path.read_text():
                where = path.relative_to(PYTHON / package).as_posix()
                assert where == "core/arrays.py", path
