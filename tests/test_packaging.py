"""The wheel works away from the clone with all its data, and the pins are complete."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.version import Version
from solver_wheel import readme_lines

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
SOLVER = tomllib.loads((ROOT / "crates/python/pyproject.toml").read_text())["project"]
LOCK, DOCS_LOCK = ((ROOT / name).read_text() for name in ("requirements.lock", "requirements-docs.lock"))


def _pins() -> dict[str, Version]:
    """Those that hold for the Python that runs this."""
    lines = re.findall(r"^([A-Za-z0-9_.-]+==.+?)(?: \\)?$", LOCK, flags=re.MULTILINE)
    pins = [pin for pin in map(Requirement, lines) if pin.marker is None or pin.marker.evaluate()]
    return {pin.name.lower().replace("_", "-"): Version(next(iter(pin.specifier)).version) for pin in pins}


@pytest.mark.parametrize("extra", [None, "sim", "mujoco", "dev"])
def test_every_requirement_is_pinned(extra: str | None) -> None:
    pins = _pins()
    wanted = PROJECT["dependencies"] if extra is None else PROJECT["optional-dependencies"][extra]
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
    assert workspace["package"]["version"] == PROJECT["version"] == SOLVER["version"]


def test_the_solver_alone_needs_numpy_and_nothing_else() -> None:
    assert [Requirement(line).name for line in SOLVER["dependencies"]] == ["numpy"]
    script = (
        "import sys, gensim2_kpam\n"
        "print(sorted(n for n in sys.modules if n.split('.')[0] in ('gensim2', 'scipy', 'trimesh', 'pydantic')))"
    )
    answer = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert answer.stdout.strip() == "[]"


def test_the_readme_of_the_solver_plans(tmp_path: Path) -> None:
    (tmp_path / "ur5.urdf").write_bytes((ROOT / "examples/robots/ur5.urdf").read_bytes())
    script = readme_lines() + "assert motion.status == 'solved', motion.reason\n"
    answer = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert answer.returncode == 0, answer.stderr


def test_api_pages_are_built_without_a_warning(tmp_path: Path) -> None:
    pytest.importorskip("pdoc")
    # A key of that type is a word of Python's, so it has no class body in which pdoc could look.
    ignored = "ignore:Cannot determine where gensim2_kpam.ContactWindow"
    command = [sys.executable, "-W", "error", "-W", ignored, "-m", "pdoc", "--docformat", "google", "gensim2_kpam"]
    made = subprocess.run([*command, "--output-directory", tmp_path], capture_output=True, text=True, check=False)
    assert made.returncode == 0, made.stderr
    assert "warn" not in made.stderr.lower(), made.stderr
    text = (tmp_path / "gensim2_kpam.html").read_text()
    for name in ("Scene.plan_to", "Trajectory.sample_into", "KeypointProblem", "Status.SOLVED"):
        assert f'id="{name}"' in text, name
    # What a signature says is that of the types, and what it means stands beside it.
    assert "axis constraints hold all along" in text


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    # The same profile and interpreter as the set-up's, so that nothing is compiled twice.
    subprocess.run(
        [Path(sys.executable).with_name("maturin"), "build", "--quiet", "--release", "--out", folder],
        cwd=ROOT,
        check=True,
        env={**os.environ, "VIRTUAL_ENV": sys.prefix},
    )
    (found,) = folder.glob("*.whl")
    return found


def test_wheel_holds_code_data_stubs_and_licence(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
    sources = {
        str(path.relative_to(ROOT / "python"))
        for path in (ROOT / "python").rglob("*")
        if path.is_file() and "__pycache__" not in path.parts and path.suffix != ".so"
    }
    assert sources - names == set()
    assert "gensim2_kpam/_native.abi3.so" in names
    assert {"gensim2/py.typed", "gensim2_kpam/py.typed", "gensim2/objects/words.toml"} <= names
    assert any(name.endswith("licenses/LICENSE") for name in names)


def test_wheel_works_away_from_the_clone(wheel: Path, tmp_path: Path) -> None:
    site = tmp_path / "site"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    script = (
        "import gensim2, gensim2_kpam\n"
        f"assert gensim2.__file__.startswith({str(site)!r}), gensim2.__file__\n"
        f"assert gensim2_kpam.__file__.startswith({str(site)!r}), gensim2_kpam.__file__\n"
        "from gensim2.core.pages import template\n"
        "for name in ('report.html.j2', 'tasks.html.j2'): template('gensim2.design', name)\n"
        "template('gensim2.inspection', 'objects.html.j2')\n"
        "from gensim2.tasks.library import load_strategies, load_task, task_names\n"
        "for name in task_names(): load_strategies(name)\n"
        "from gensim2.objects import open_library\n"
        "print(len(task_names()), open_library('builtin').load('drawer', '0').urdf.exists())\n"
    )
    result = subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(site)},
    )
    assert result.returncode == 0, result.stderr
    assert result.stdout.split()[1] == "True"
    assert int(result.stdout.split()[0]) >= 8
