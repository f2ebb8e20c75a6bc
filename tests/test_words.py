"""The list of forbidden words finds what it should, and nothing else."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

SCRIPT = Path(__file__).parents[1] / "scripts/words.py"
_SPEC = importlib.util.spec_from_file_location("words", SCRIPT)
assert _SPEC is not None
assert _SPEC.loader is not None
words = importlib.util.module_from_spec(_SPEC)
sys.modules["words"] = words
_SPEC.loader.exec_module(words)

PYTHON = '''"""What a module is."""

x = 1
"""Where it stands."""

class Mover:
    """Physics alone."""

    def whether(self, limit: int = 3) -> bool:
        """Whether it holds; somebody asks."""
        # nobody listens
        return "What else"
'''
TWICE = """
LIMIT = 40
LIMIT = 60
a, b = 1, 2
b: int = 3
for i in (1, 2):
    a += i
for i in (3, 4):
    a += i
if a:
    c = 1
else:
    c = 2

class Options:
    LIMIT = 80
    a = 1
    b: int
    b = 2
    a = 2

def function():
    x = 1
    x = 2
"""
RUST = """//! How things go.

/// What it is.
pub struct Plan;

/// The plan.
pub fn plan(plan: &Plan) -> bool {} // nobody
"""


def test_offenders_of_both_languages_are_found() -> None:
    found = [(each.kind, each.line) for each in words.of_python(PYTHON, Path("a.py"))]
    assert sorted(found) == [("opening", 1), ("opening", 4), ("speaker", 10), ("speaker", 11)]
    found = [(each.kind, each.line) for each in words.of_rust(RUST, Path("a.rs"))]
    assert sorted(found) == [("opening", 1), ("opening", 3)]


def test_a_name_that_a_module_or_a_class_assigns_twice_is_found() -> None:
    found = [(each.kind, each.line, each.text) for each in words.of_python(TWICE, Path("a.py"))]
    assert found == [
        ("twice", 3, "LIMIT was assigned in line 2"),
        ("twice", 5, "b was assigned in line 4"),
        ("twice", 20, "a was assigned in line 17"),
    ]


def test_docstrings_are_counted() -> None:
    assert (words.docstrings(PYTHON, "py"), words.docstrings(RUST, "rs")) == (4, 3)


def test_the_house_keeps_the_bar() -> None:
    found, count = words.offences(words.ROOT)
    for suffix in words.SUFFIXES:
        assert sum(each.kind == "opening" and each.path.suffix == f".{suffix}" for each in found) < 0.02 * count[suffix]
    assert [each for each in found if each.kind != "opening"] == []
