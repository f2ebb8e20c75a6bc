"""Robots that tests go through: the package's, and those that a user's files describe."""

from __future__ import annotations

from pathlib import Path

from gensim2.robots import load_robot

EXAMPLES = Path(__file__).parents[2] / "examples" / "robots"
OWN = ("ur5", "xarm7")


def pytest_generate_tests(metafunc: object) -> None:
    """Give every robot, by the name or the path that ``--robot`` takes, to tests that ask for ``any_robot``."""
    if "any_robot" in metafunc.fixturenames:  # type: ignore[attr-defined]
        names = [*("panda", "fr3", "fetch"), *(load_robot(EXAMPLES / f"{name}.py") for name in OWN)]
        metafunc.parametrize("any_robot", names, ids=lambda name: Path(name).stem)  # type: ignore[attr-defined]
