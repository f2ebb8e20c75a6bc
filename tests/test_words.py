"""The list of offenders finds what it should, and lets pass what it should."""

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

class Lane:
    """Physics alone."""

    def whether(self, most: int = 3) -> bool:
        """Whether it holds with a still arm; somebody asks."""
        # nobody listens
        return "What else"
'''
RUST = """//! How things go.

/// What it is.
pub struct Plan;

/// The plan.
pub fn former(plan: &Plan, hasty: bool) -> bool {} // nobody

pub struct Options {
    pub harvest: usize,
    bad: f64,
}
"""


def test_offenders_of_both_languages_are_found() -> None:
    found = [(each.kind, each.line) for each in words.of_python(PYTHON, Path("python/gensim2/sim/a.py"))]
    assert sorted(found) == [
        ("house", 10),
        ("name", 6),
        ("name", 9),
        ("opening", 1),
        ("opening", 4),
        ("speaker", 10),
        ("speaker", 11),
    ]
    found = [(each.kind, each.line) for each in words.of_rust(RUST, Path("crates/kpam/src/a.rs"))]
    assert sorted(found) == [("name", 7), ("name", 7), ("name", 10), ("opening", 1), ("opening", 3)]
    assert [each.text for each in words.of_python('"""Of it."""', Path("benchmarks/still_arm.py"))] == [
        "still_arm: no-op baseline"
    ]
    assert [each.text for each in words.of_python('option("--most")', Path("a.py"))] == ["most: max"]


def test_two_classes_of_one_name_are_found(tmp_path: Path) -> None:
    for name in ("one.py", "other.py"):
        (tmp_path / "python").mkdir(exist_ok=True)
        (tmp_path / "python" / name).write_text("class Picture: ...\n")
    assert [each.text for each in words.twice(tmp_path)] == ["Picture is also in python/one.py"]


def test_docstrings_are_counted() -> None:
    assert (words.docstrings(PYTHON, "py"), words.docstrings(RUST, "rs")) == (4, 3)


def test_the_house_keeps_the_bar() -> None:
    found, count = words.offences(words.ROOT)
    for suffix in words.SUFFIXES:
        assert sum(each.kind == "opening" and each.path.suffix == f".{suffix}" for each in found) < 0.02 * count[suffix]
    assert [each for each in found if each.kind != "opening"] == []
