"""Check the claims of ``common/suite.py`` about the suite."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from suite import FAST, LONGEST, PARTLY_FAST, SKIPPED_IN_CI, SLOW_ROOMS, TESTS


def test_files_that_are_named_are_there_and_named_once() -> None:
    for names in ((*FAST, *PARTLY_FAST), LONGEST):
        assert len(set(names)) == len(names)
        assert [name for name in names if not (TESTS / name).is_file()] == []


def test_every_room_has_quick_tests() -> None:
    rooms = {file.relative_to(TESTS).parts[0] for file in TESTS.rglob("*/test_*.py")}
    assert rooms - {name.split("/")[0] for name in (*FAST, *PARTLY_FAST)} == set(SLOW_ROOMS)


def test_what_is_said_to_be_partly_quick_has_a_mark() -> None:
    for name in PARTLY_FAST:
        assert "pytest.mark.fast" in (TESTS / name).read_text(), name


SKIPPING = """
import pytest

class TestSkips:
    @pytest.mark.skip(reason="by mark")
    def test_mark(self): pass

    def test_body(self): pytest.skip("by body")

    @pytest.fixture
    def absent(self): pytest.skip("by fixture")

    def test_fixture(self, absent): pass

    @pytest.mark.xfail(reason="known")
    def test_expected(self): assert False

    def test_passes(self): pass
"""
LISTED = """
import suite
suite.SKIPPED_IN_CI["{}"] = "needs a machine without one"
"""


@pytest.mark.parametrize("workers", [(), ("-n", "1")], ids=["alone", "xdist"])
def test_ci_fails_a_skip_that_is_not_listed(tmp_path: Path, workers: tuple[str, ...]) -> None:
    file = tmp_path / "test_one.py"
    file.write_text(SKIPPING)
    assert _run(file, *workers).stdout.splitlines()[-1].startswith("1 passed, 3 skipped, 1 xfailed")
    found = _run(file, *workers, ci="true")
    assert found.returncode == 1
    for name in ("mark", "body", "fixture"):
        assert f"::test_{name} - skipped in CI: by {name};" in found.stdout
    assert "1 passed, 1 xfailed" in found.stdout


def test_ci_fails_a_module_that_skips_itself(tmp_path: Path) -> None:
    file = tmp_path / "test_one.py"
    file.write_text("import pytest\npytest.importorskip('no_such_package')\n")
    assert _run(file).returncode == 5  # no test ran
    found = _run(file, ci="true")
    assert found.returncode == 2
    assert "ERROR test_one.py - skipped in CI: could not import 'no_such_package'" in found.stdout


def test_ci_accepts_a_listed_skip(tmp_path: Path) -> None:
    file = tmp_path / "test_one.py"
    file.write_text(SKIPPING + LISTED.format("test_one.py::TestSkips"))
    found = _run(file, ci="true")
    assert (found.returncode, "3 skipped" in found.stdout) == (0, True)


def test_listed_skips_are_of_tests_that_exist() -> None:
    for name, reason in SKIPPED_IN_CI.items():
        file, *parts = name.split("::")
        assert (TESTS / file).is_file(), name
        assert all(part.partition("[")[0] in (TESTS / file).read_text() for part in parts), name
        assert reason


@pytest.mark.parametrize(("group", "package"), [("vulkan", "mesa-vulkan-drivers"), ("tests", "chromium")])
def test_system_packages_that_cannot_be_installed_are_one_line_and_a_failure(group: str, package: str) -> None:
    environment = {**os.environ, "GENSIM2_NO_SYSTEM_PACKAGES": "1"}
    script = TESTS.parent / "scripts/system_packages.sh"
    found = subprocess.run([script, group], env=environment, capture_output=True, text=True, check=False)
    assert (found.returncode, found.stdout, found.stderr.count("\n")) == (1, "", 1)
    assert package in found.stderr


def _run(file: Path, *options: str, ci: str = "") -> subprocess.CompletedProcess[str]:
    """Run a test file with the hooks of this suite."""
    words = [sys.executable, "-m", "pytest", "-q", "-p", "conftest", "-c", os.devnull, f"--rootdir={file.parent}"]
    path = os.pathsep.join([str(TESTS), str(TESTS / "common"), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "CI": ci, "PYTHONPATH": path}
    return subprocess.run(
        [*words, *options, file.name], cwd=file.parent, env=environment, capture_output=True, text=True, check=False
    )
