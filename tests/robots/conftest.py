"""Robots for parametrized tests: the package's, and robots of user files."""

from __future__ import annotations

from pathlib import Path

from gensim2.robots import load_robot

EXAMPLES = Path(__file__).parents[2] / "examples" / "robots"
OWN = ("ur5e", "xarm7", "iiwa14")


def pytest_generate_tests(metafunc: object) -> None:
    """Parametrize ``any_robot`` with every robot, as the name or path that ``--robot`` accepts."""
    if "any_robot" in metafunc.fixturenames:  # type: ignore[attr-defined]
        names = [*("panda", "fr3", "fetch"), *(load_robot(EXAMPLES / f"{name}.py") for name in OWN)]
        metafunc.parametrize("any_robot", names, ids=lambda name: Path(name).stem)  # type: ignore[attr-defined]
