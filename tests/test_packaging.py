"""The wheels work outside the repository with all their data, and the pinned versions are complete."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Callable, Iterator
from importlib.metadata import distribution
from pathlib import Path

import click
import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version
from solver_wheel import readme_lines

from gensim2.cli.main import cli

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
SOLVER = tomllib.loads((ROOT / "crates/python/pyproject.toml").read_text())["project"]
ROBOT = tomllib.loads((ROOT / "python/pyproject.toml").read_text())["project"]
LOCK, DOCS_LOCK = ((ROOT / name).read_text() for name in ("requirements.lock", "requirements-docs.lock"))


def _pins() -> dict[str, Version]:
    """Return the pins for the running Python version."""
    lines = re.findall(r"^([A-Za-z0-9_.-]+==.+?)(?: \\)?$", LOCK, flags=re.MULTILINE)
    pins = [pin for pin in map(Requirement, lines) if pin.marker is None or pin.marker.evaluate()]
    return {pin.name.lower().replace("_", "-"): Version(next(iter(pin.specifier)).version) for pin in pins}


@pytest.mark.parametrize(
    "wanted",
    [
        PROJECT["dependencies"],
        *(PROJECT["optional-dependencies"][extra] for extra in ("sim", "mujoco", "remote", "dev")),
        [line for line in ROBOT["dependencies"] if Requirement(line).name != "gensim2"],
    ],
    ids=["gensim2", "sim", "mujoco", "remote", "dev", "gensim2-robot"],
)
def test_every_requirement_is_pinned(wanted: list[str]) -> None:
    pins = _pins()
    for line in wanted:
        requirement = Requirement(line)
        if requirement.marker is not None and not requirement.marker.evaluate():
            continue
        pin = pins[requirement.name.lower().replace("_", "-")]
        assert requirement.specifier.contains(pin), line


@pytest.mark.parametrize("lock", [LOCK, DOCS_LOCK], ids=["all", "docs"])
def test_pins_name_no_host_and_have_hashes(lock: str) -> None:
    assert "://" not in lock
    assert "--index-url" not in lock
    assert len(re.findall(r"^\S+==", lock, flags=re.MULTILINE)) > 40
    assert re.findall(r"^\S+==.*\n(?!    --hash=sha256:[0-9a-f]{64})", lock, flags=re.MULTILINE) == []


@pytest.mark.parametrize("file", ["Makefile", "scripts/setup.sh"])
def test_locks_are_installed_with_their_hashes(file: str) -> None:
    lines = re.findall(r"^.*pip install .*\.lock$", (ROOT / file).read_text(), flags=re.MULTILINE)
    assert lines
    assert all("--require-hashes" in line for line in lines)


def test_one_version_everywhere() -> None:
    workspace = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]
    assert workspace["package"]["version"] == PROJECT["version"] == SOLVER["version"] == ROBOT["version"]
    assert f"gensim2[remote]=={PROJECT['version']}" in ROBOT["dependencies"]


def test_the_solver_alone_needs_numpy_and_nothing_else() -> None:
    assert [Requirement(line).name for line in SOLVER["dependencies"]] == ["numpy"]
    script = (
        "import sys, gensim2_kpam\n"
        "print(sorted(n for n in sys.modules if n.split('.')[0] in ('gensim2', 'scipy', 'trimesh', 'pydantic')))"
    )
    answer = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert answer.stdout.strip() == "[]"


def test_the_readme_of_the_solver_plans(tmp_path: Path) -> None:
    (tmp_path / "ur5e.urdf").write_bytes((ROOT / "examples/robots/ur5e.urdf").read_bytes())
    script = readme_lines() + "assert motion.status == 'solved', motion.reason\n"
    answer = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert answer.returncode == 0, answer.stderr


def test_api_pages_are_built_without_a_warning(tmp_path: Path) -> None:
    pytest.importorskip("pdoc")
    # Keys of this type are Python keywords, so it has no class body for pdoc.
    ignored = "ignore:Cannot determine where gensim2_kpam.ContactWindow"
    command = [sys.executable, "-W", "error", "-W", ignored, "-m", "pdoc", "--docformat", "google", "gensim2_kpam"]
    made = subprocess.run([*command, "--output-directory", tmp_path], capture_output=True, text=True, check=False)
    assert made.returncode == 0, made.stderr
    assert "warn" not in made.stderr.lower(), made.stderr
    text = (tmp_path / "gensim2_kpam.html").read_text()
    for name in ("Scene.plan_to", "Trajectory.sample_into", "KeypointProblem", "Status.SOLVED"):
        assert f'id="{name}"' in text, name
    # The signature shows the types, and their meaning is described beside it.
    assert "axis constraints hold along the whole motion" in text


@pytest.fixture(scope="module")
def wheels(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The wheel of each distribution, by name."""
    folder = tmp_path_factory.mktemp("wheels")
    # As `make wheels` builds them: without a source distribution, the Python files of gensim2-kpam, which are outside
    # its folder, would be missing.
    environment = {"CARGO_TARGET_DIR": str(ROOT / "target"), **os.environ, "VIRTUAL_ENV": sys.prefix}
    maturin = [Path(sys.executable).with_name("maturin"), "build", "--quiet", "--release", "--sdist", "--out", folder]
    for project in (ROOT, ROOT / "crates/python"):
        subprocess.run(maturin, cwd=project, check=True, env=environment)
    # setuptools leaves files beside the sources.
    copy = shutil.copytree(ROOT / "python", folder / "source", ignore=shutil.ignore_patterns("gensim2", "gensim2_kpam"))
    script = f"from setuptools.build_meta import build_wheel; build_wheel({str(folder)!r})"
    subprocess.run([sys.executable, "-c", script], cwd=copy, check=True, capture_output=True)
    return {path.name.partition("-")[0].replace("_", "-"): path for path in folder.glob("*.whl")}


def names_in(wheel: Path) -> set[str]:
    with zipfile.ZipFile(wheel) as archive:
        return set(archive.namelist())


def sources(package: str) -> set[str]:
    return {
        str(path.relative_to(ROOT / "python"))
        for path in (ROOT / "python" / package).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts and path.suffix != ".so"
    }


def test_wheels_hold_code_data_stubs_and_licence(wheels: dict[str, Path]) -> None:
    held = {name: names_in(wheel) for name, wheel in wheels.items()}
    for name, packages in {
        "gensim2": {"gensim2", "gensim2_kpam"},
        "gensim2-kpam": {"gensim2_kpam"},
        "gensim2-robot": {"gensim2_robot"},
    }.items():
        assert set.union(*map(sources, packages)) - held[name] == set(), name
        assert {each.split("/")[0] for each in held[name] if ".dist-info" not in each} == packages, name
    for name in ("gensim2", "gensim2-kpam"):
        assert {"gensim2_kpam/_native.abi3.so", "gensim2_kpam/py.typed"} <= held[name]
    estimator = "gensim2/perception/estimation/builtin/estimator.json"
    assert {"gensim2/py.typed", "gensim2/objects/words.toml", estimator} <= held["gensim2"]
    assert {"gensim2_robot/py.typed", "gensim2_robot/protocols/CloseBox.yaml"} <= held["gensim2-robot"]
    assert any(each.endswith("licenses/LICENSE") for each in held["gensim2"])


def away(wheels: list[Path], folder: Path, script: str) -> subprocess.CompletedProcess[str]:
    """Run a script with the wheels unpacked in a folder, outside the repository."""
    for wheel in wheels:
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(folder / "site")
    return subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        check=False,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder / "site")},
    )


def test_wheel_works_away_from_the_clone(wheels: dict[str, Path], tmp_path: Path) -> None:
    site = str(tmp_path / "site")
    script = (
        "import gensim2, gensim2_kpam\n"
        f"assert gensim2.__file__.startswith({site!r}), gensim2.__file__\n"
        f"assert gensim2_kpam.__file__.startswith({site!r}), gensim2_kpam.__file__\n"
        "from gensim2.core.pages import template\n"
        "for name in ('report.html.j2', 'tasks.html.j2'): template('gensim2.design', name)\n"
        "template('gensim2.inspection', 'objects.html.j2')\n"
        "from gensim2.tasks.library import load_strategies, load_task, task_names\n"
        "for name in task_names(): load_strategies(name)\n"
        "from gensim2.objects import open_library\n"
        "print(len(task_names()), open_library('builtin').load('drawer', '0').urdf.exists())\n"
    )
    result = away([wheels["gensim2"]], tmp_path, script)
    assert result.returncode == 0, result.stderr
    assert result.stdout.split()[1] == "True"
    assert int(result.stdout.split()[0]) >= 8


def light_site(folder: Path, wheel: Path | None = None) -> Path:
    """Make a folder of packages: gensim2, and links to what ``gensim2[mujoco]`` depends on, and nothing else.

    Args:
        folder: folder that will contain it.
        wheel: wheel of gensim2; None links the sources.
    """
    site = folder / "site"
    if wheel is None:
        site.mkdir()
        for package in ("gensim2", "gensim2_kpam"):
            (site / package).symlink_to(ROOT / "python" / package)
    else:
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(site)
    waiting = [*PROJECT["dependencies"], *PROJECT["optional-dependencies"]["mujoco"]]
    seen = set()
    while waiting:
        requirement = Requirement(waiting.pop())
        extras = requirement.extras or {""}
        if requirement.marker is not None and not requirement.marker.evaluate({"extra": ""}):
            continue
        name = canonicalize_name(requirement.name)
        if name in seen:
            continue
        seen.add(name)
        found = distribution(name)
        for place in {file.parts[0] for file in found.files or () if file.parts[0] not in ("..", "__pycache__")}:
            link, target = site / place, Path(str(found.locate_file(place)))
            if not link.exists():
                link.symlink_to(target)
        for line in found.requires or ():
            inner = Requirement(line)
            if inner.marker is None or any(inner.marker.evaluate({"extra": extra}) for extra in extras):
                inner.marker = None
                waiting.append(str(inner))
    return site


def test_the_light_installation_takes_at_most_400_mb(tmp_path: Path) -> None:
    site = light_site(tmp_path)
    folders = (folder for folder, *_ in os.walk(site, followlinks=True))
    # Without compiled modules, which Python writes while it runs.
    written = (".pyc", "__pycache__")
    files = [file for folder in folders for file in Path(folder).iterdir() if not file.name.endswith(written)]
    # Whole blocks of 4 KiB. Some file systems reserve more blocks for a file than its bytes need.
    assert sum(-(-file.stat().st_size // 4096) * 4096 for file in files) <= 400 * 2**20


Run = Callable[..., subprocess.CompletedProcess[str]]


def light_run(site: Path, folder: Path) -> Run:
    """Return a function that runs Python in a folder with the packages of a light installation."""
    # -S: without this environment's own packages, in the worker processes as well.
    home = {"HOME": str(folder), "XDG_CACHE_HOME": str(folder / "cache")}
    environment = {**os.environ, **home, "PYTHONPATH": str(site)}
    environment.pop("GENSIM2_ASSETS", None)

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-S", *arguments], capture_output=True, text=True, check=False, cwd=folder, env=environment
        )

    return run


def test_the_light_installation_makes_a_verified_demonstration(wheels: dict[str, Path], tmp_path: Path) -> None:
    run = light_run(light_site(tmp_path, wheels["gensim2"]), tmp_path)
    absent = run("-c", "from importlib.util import find_spec as f\nprint(*map(f, ('torch', 'sapien', 'mani_skill')))")
    assert absent.stdout.split() == ["None"] * 3, absent.stderr
    made = run("-m", "gensim2", "demo", "CloseBox", "--episodes", "1", "--out", "demo", "--workers", "1")
    assert made.returncode == 0, made.stderr
    assert "MuJoCo simulates" in made.stderr
    assert (tmp_path / "demo/report.html").is_file()
    assert (tmp_path / "demo/tasks/CloseBox/video.mp4").stat().st_size > 10_000
    record = json.loads((tmp_path / "demo/run.json").read_text())
    assert record["arguments"]["engine"] == "mujoco"
    refused = run("-m", "gensim2", "demo", "CloseBox", "--engine", "sapien", "--out", "other")
    assert refused.returncode == 2
    assert "pip install 'gensim2[sim]'" in refused.stderr


LIGHT = {
    "do": "close_the_box --steps",
    "solve": "CloseBox --assets builtin",
    "collect": "CloseBox --episodes 1 --workers 1 --assets builtin --out data",
    "data card": "data",
    "render": "data --workers 1 --modalities pointcloud",
    "tasks list": "",
    "tasks show": "CloseBox",
    "tasks export": "CloseBox --to mjcf --out tasks",
    "assets list": "",
    "assets show": "drawer/0 --assets builtin",
    "assets export": "drawer/0 --to mjcf --assets builtin --out mjcf",
    "assets import": "mjcf/drawer/0.xml --class drawer --name new --scale 1 --out library",
    "assets prepare": "drawer/0 --assets builtin",
    "assets validate": "drawer/0 --assets builtin --no-physics",
    "assets render": "drawer/0 --assets builtin --out picture.png",
    "assets gallery": "--assets builtin --classes mug --out gallery",
    "doctor": "",
}
"""Commands that work in a light installation, in an order in which each has its input."""

REFUSED = {
    "view": ("CloseBox --assets builtin", "viz"),
    "evaluate": ("CloseBox --assets builtin", "train"),
    "learn": ("CloseBox --out learned", "train"),
    "train": ("--data data --out trained", "train"),
    "experiment scaling": ("--out experiment", "train"),
    "policy show": ("builtin", "train"),
    "policy export": ("builtin --out exported", "train"),
    "policy serve": ("builtin", "train"),
    "perceive train": ("--out perceived", "train"),
    "perceive measure": ("builtin", "train"),
    "perceive show": ("data --out shown", "train"),
    "bench policy": ("", "train"),
    "data report": ("data", "data"),
    "data export": ("data --to zarr --out exported", "data"),
}
"""Commands that need an extra, with their arguments and the extra."""

UNTRIED = frozenset(
    (
        *("demo", "benchmark", "design", "run-pipeline", "tasks gallery"),  # simulate and film as demo does
        *("tasks add", "tasks remove", "data import", "bench solver", "bench motion"),  # read files of the user
        *(f"experiment {name}" for name in ("breadth", "combinations", "designed", "generalization")),
    )
)


def test_every_command_works_in_a_light_installation_or_names_the_extra(tmp_path: Path) -> None:
    run = light_run(light_site(tmp_path), tmp_path)
    assert {*LIGHT, *REFUSED, *UNTRIED} == set(_leaves(cli, click.Context(cli), ""))
    for name, arguments in LIGHT.items():
        done = run("-m", "gensim2", *name.split(), *arguments.split())
        assert (name, done.returncode) == (name, 0), done.stderr
    for name, (arguments, extra) in REFUSED.items():
        done = run("-m", "gensim2", *name.split(), *arguments.split())
        assert (name, done.returncode) == (name, 2), done.stderr
        assert f"pip install 'gensim2[{extra}]'" in done.stderr.splitlines()[-1], name
        assert "Traceback" not in done.stderr


def _leaves(command: click.Command, context: click.Context, name: str) -> Iterator[str]:
    """Return the names of all commands that have no subcommands."""
    if not isinstance(command, click.Group):
        yield name
        return
    for each in command.list_commands(context):
        inner = command.get_command(context, each)
        if inner is not None and each != "robot":  # of another distribution
            yield from _leaves(inner, context, f"{name} {each}".strip())


def test_robots_are_a_distribution_of_their_own(wheels: dict[str, Path], tmp_path: Path) -> None:
    # The test environment has both distributions installed; the first one on the path is imported.
    site = str(tmp_path / "site")
    script = (
        "from importlib.metadata import Distribution\n"
        f"(point,) = Distribution.at({site!r} + '/gensim2_robot-{ROBOT['version']}.dist-info').entry_points\n"
        "assert (point.group, point.name) == ('gensim2.commands', 'robot')\n"
        "import gensim2_robot, gensim2.cli.main as main\n"
        f"assert gensim2_robot.__file__.startswith({site!r}), gensim2_robot.__file__\n"
        "raise SystemExit(main.run(['robot', '--help']))\n"
    )
    result = away([wheels["gensim2"], wheels["gensim2-robot"]], tmp_path, script)
    assert result.returncode == 0, result.stderr
    assert "dry-run" in result.stdout
