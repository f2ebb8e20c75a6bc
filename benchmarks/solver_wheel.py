"""The wheel of gensim2-kpam in an environment of its own: built, installed beside NumPy alone, and planned with.

    python benchmarks/solver_wheel.py [--wheel FILE.whl] [--pythons 3.11 3.14]

Builds source distribution and wheel (or takes FILE), makes a fresh environment a Python with uv, installs the wheel
there, looks that no gensim2 is in it, and runs the lines of crates/python/README.md on the UR5e of examples/robots. A
Python that is not on this machine and cannot be fetched is named and left out. Ends with 1 where one of them fails.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
CHECK = """
import importlib.metadata, importlib.util
assert importlib.util.find_spec("gensim2") is None, "gensim2 is there"
print(sorted(d.name for d in importlib.metadata.distributions()))
assert motion.status == "solved" and motion.status is kpam.MotionStatus.SOLVED, motion.reason
"""


def readme_lines() -> str:
    """The program that the README shows."""
    found = re.search(r"```python\n(.*?)```", (ROOT / "crates/python/README.md").read_text(), flags=re.DOTALL)
    if found is None:
        raise SystemExit("crates/python/README.md shows no program")
    return found.group(1)


def uv() -> str:
    found = shutil.which("uv", path=f"{os.environ['PATH']}:{ROOT / '.tools/bin'}")
    if found is None:
        raise SystemExit("needs uv: make setup fetches it into .tools/bin")
    return found


def built(folder: Path) -> Path:
    """The wheel, made from the source distribution."""
    maturin = Path(sys.executable).with_name("maturin")
    command: list[str | Path] = [maturin, "build", "--release", "--sdist", "--out", folder]
    subprocess.run(command, cwd=ROOT / "crates/python", check=True, env={**os.environ, "VIRTUAL_ENV": sys.prefix})
    (wheel,) = folder.glob("*.whl")
    return wheel


def runs_on(python: str, wheel: Path, folder: Path) -> bool | None:
    """Whether the README's program runs in a fresh environment of a Python; None where there is no such Python."""
    environment = folder / f"venv-{python}"
    made = subprocess.run([uv(), "venv", "--quiet", "--python", python, environment], check=False, capture_output=True)
    if made.returncode:
        return None
    interpreter = environment / "bin/python"
    subprocess.run([uv(), "pip", "install", "--quiet", "--python", interpreter, wheel], check=True)
    shutil.copy(ROOT / "examples/robots/ur5e.urdf", folder / "ur5e.urdf")
    kept = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    return not subprocess.run([interpreter, "-c", readme_lines() + CHECK], cwd=folder, check=False, env=kept).returncode


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--wheel", type=Path)
    parser.add_argument("--pythons", nargs="+", default=["3.11", "3.14"])
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        wheel = built(folder) if arguments.wheel is None else arguments.wheel.resolve()
        outcomes = {python: runs_on(python, wheel, folder) for python in arguments.pythons}
    for python, holds in outcomes.items():
        print(f"Python {python}: {'not to be had' if holds is None else 'runs' if holds else 'FAILS'}")
    return 0 if outcomes.get("3.11", True) and False not in outcomes.values() else 1


if __name__ == "__main__":
    sys.exit(main())
