"""Docstrings and names beside the field's words: offenders, and 1 where there are more than the bar allows.

    python scripts/words.py            # counts, and what is over the bar
    python scripts/words.py --all      # every offender

An offender is a docstring (of Rust, a doc comment) that opens with What, How, Where or Who in place of an imperative or
a noun phrase; a text with an indefinite person or a word of the house in it, in the pages too; a public name
(of a module, class, function, parameter, field, constant or command-line option) that says in everyday words what the
field has a term for; a class whose name another one has for something else.
"""

from __future__ import annotations

import argparse
import ast
import re
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]

#: Words that no docstring opens with.
OPENING = re.compile(r"(What|How|Where|Who|Whose)\b")
#: Indefinite persons, in place of whom a text says which value is unknown, or which part of the program acts.
SPEAKERS = re.compile(r"\b([Nn]obody|[Ss]omebody)\b")
#: Words of the house that no text has.
HOUSE = re.compile(r"\b([Ss]till[- ]arm|judged against each other)\b")
#: Public names that are gone, as patterns of the whole name, and the field's terms for them.
NAMES = {
    "Lane": "HeadlessEnv",
    "Standing": "SceneAccessMixin",
    "Later": "LazyMapping",
    "Setup": "InitialState",
    "Instance": "ArticulatedObject",
    "(still_arm|Still[A-Z].*|StandStill|still_episode)": "no-op baseline",
    "Ours": "default",
    "every_so_many": "uniform_stride",
    "close_to_others": "inlier_mask",
    "former(_.*)?": "warm_start",
    "starts": "num_seeds",
    "descents": "num_refinements",
    "harvest": "extra_seeds",
    "(Judged|judged_pairs)": "checked pairs",
    "never_judged": "disabled_collisions",
    "(be_)?hasty": "early_exit",
    "Cast": "CollisionObjects",
    "Course": "Schedule",
    "(Leg|LegWorld|WorldLeg|leg)": "segment",
    "(Lead|leads)": "start transition",
    "law": "time_scaling",
    "(most|MOST)(_.*)?": "max",
    "bad": "violation",
    "price": "penalty",
}
_NAMED = re.compile("|".join(f"(?:{pattern})" for pattern in NAMES))
#: Classes of which there is one.
ONCE = {"Observation", "InitialState", "Placed", "Provenance", "Picture", "Plan", "Robot"}
#: This script's own test, which is made of offenders.
TEST = "test_words.py"
#: Page of tasks' sentences, which are a user's.
SENTENCES = "designed.md"
#: Share of docstrings that may open so, in each language.
BAR = 0.02
#: Ends of the files of a language; stubs hold the docstrings of the extension.
SUFFIXES = {"py": (".py", ".pyi"), "rs": (".rs",)}
PYTHON = ("python", "scripts", "benchmarks", "examples", "plugins", "tests")
RUST = ("crates", "fuzz")
_DOC_COMMENT = re.compile(r"^\s*//[/!] ?(.*)$")
_RUST_NAME = re.compile(
    r"^\s*pub(?:\([\w ]+\))? (?:(?:const |struct |enum |fn |trait |type |mod )+(\w+)|(\w+):)", re.MULTILINE
)
_RUST_SIGNATURE = re.compile(
    r"^\s*pub(?:\([\w ]+\))? (?:const )?fn \w+[^(]*\(([^{;]*?)\) *(?:->|\{|where)", re.MULTILINE
)
_IN_CODE = re.compile(r"`(?:--)?(\w+)`")
_RUST_PARAMETER = re.compile(r"\b(\w+): ")


@dataclass(frozen=True)
class Offence:
    """One place.

    Attributes:
        kind: ``"opening"``, ``"speaker"``, ``"house"``, ``"name"`` or ``"twice"``.
        path: of the file, from the root.
        line: counted from 1.
        text: the words.
    """

    kind: str
    path: Path
    line: int
    text: str


def offences(root: Path) -> tuple[list[Offence], Counter[str]]:
    """Return all offences below a root, and the number of docstrings by language."""
    found: list[Offence] = []
    count: Counter[str] = Counter()
    for folders, suffix, read in ((PYTHON, "py", of_python), (RUST, "rs", of_rust)):
        for path in (path for folder in folders for path in sorted((root / folder).rglob("*"))):
            if "target" in path.parts or path.suffix not in SUFFIXES[suffix] or path.name == TEST or not path.is_file():
                continue
            text = path.read_text(encoding="utf-8")
            count[suffix] += docstrings(text, suffix)
            found += read(text, path.relative_to(root))
    pages = (path for path in sorted((root / "docs").rglob("*.md")) if path.name != SENTENCES)
    for path in (root / "README.md", *pages):
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            found += _speakers(line, path.relative_to(root), number)
            for name in _IN_CODE.findall(line):
                found += _named(name, path.relative_to(root), number)
    return [*found, *twice(root)], count


def twice(root: Path) -> Iterator[Offence]:
    """Yield public classes that share a name of :data:`ONCE`."""
    known: dict[str, Path] = {}
    for path in sorted((root / "python").rglob("*.py*")):
        if path.suffix not in SUFFIXES["py"]:
            continue
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ClassDef) and node.name in ONCE and known.setdefault(node.name, path) != path:
                where = known[node.name].relative_to(root)
                yield Offence("twice", path.relative_to(root), node.lineno, f"{node.name} is also in {where}")


def docstrings(text: str, suffix: str) -> int:
    """Return the number of docstrings of a source, or of its doc comments."""
    return sum(1 for _ in (_python_docs(ast.parse(text)) if suffix == "py" else _rust_docs(text)))


def of_python(text: str, path: Path) -> Iterator[Offence]:
    """Yield the offences of a Python source."""
    tree = ast.parse(text)
    for line, said in _python_docs(tree):
        yield from _of_text(said, path, line)
    for line, said in _comments(text, "#"):
        yield from _speakers(said, path, line)
    yield from _named(path.stem, path, 1)
    for line, name in _python_names(tree):
        yield from _named(name, path, line)


def of_rust(text: str, path: Path) -> Iterator[Offence]:
    """Yield the offences of a Rust source."""
    for line, said in _rust_docs(text):
        yield from _of_text(said, path, line)
    for line, said in _comments(text, "//"):
        if not said.startswith(("/", "!")):
            yield from _speakers(said, path, line)
    yield from _named(path.stem, path, 1)
    for found in _RUST_NAME.finditer(text):
        yield from _named(found[1] or found[2], path, text.count("\n", 0, found.end()) + 1)
    for found in _RUST_SIGNATURE.finditer(text):
        for parameter in _RUST_PARAMETER.finditer(found[1]):
            yield from _named(parameter[1], path, text.count("\n", 0, found.start(1) + parameter.start()) + 1)


def _named(name: str, path: Path, line: int) -> Iterator[Offence]:
    if _NAMED.fullmatch(name):
        term = next(term for pattern, term in NAMES.items() if re.fullmatch(pattern, name))
        yield Offence("name", path, line, f"{name}: {term}")


def _python_names(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield public names: of definitions, their parameters, fields, constants and options of the command line."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef):
            yield node.lineno, node.name
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node.lineno, node.name
            if node.name == "__init__" or not node.name.startswith("_"):
                each = node.args
                for one in (*each.posonlyargs, *each.args, *each.kwonlyargs, each.vararg, each.kwarg):
                    if one is not None:
                        yield one.lineno, one.arg
        elif isinstance(node, ast.Call):
            for given in node.args:
                if isinstance(given, ast.Constant) and isinstance(given.value, str) and given.value.startswith("--"):
                    yield given.lineno, given.value[2:].replace("-", "_")
        if isinstance(node, ast.ClassDef | ast.Module):
            for entry in node.body:
                targets = entry.targets if isinstance(entry, ast.Assign) else [getattr(entry, "target", None)]
                yield from ((entry.lineno, target.id) for target in targets if isinstance(target, ast.Name))


def _of_text(said: str, path: Path, line: int) -> Iterator[Offence]:
    if OPENING.match(said.strip()):
        yield Offence("opening", path, line, said.strip().splitlines()[0])
    yield from _speakers(said, path, line)


def _speakers(said: str, path: Path, line: int) -> Iterator[Offence]:
    for kind, pattern in (("speaker", SPEAKERS), ("house", HOUSE)):
        for found in pattern.finditer(said):
            yield Offence(kind, path, line, said[max(0, found.start() - 40) : found.end() + 40].replace("\n", " "))


def _python_docs(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Texts that stand alone: of modules, classes, functions and, below them, of values."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            for entry in node.body:
                if (
                    isinstance(entry, ast.Expr)
                    and isinstance(entry.value, ast.Constant)
                    and isinstance(entry.value.value, str)
                ):
                    yield entry.lineno, entry.value.value


def _rust_docs(text: str) -> Iterator[tuple[int, str]]:
    lines: list[str] = []
    for number, line in enumerate([*text.splitlines(), ""], 1):
        found = _DOC_COMMENT.match(line)
        if found:
            lines.append(found[1])
        elif lines:
            yield number - len(lines), "\n".join(lines)
            lines = []


def _comments(text: str, mark: str) -> Iterator[tuple[int, str]]:
    for number, line in enumerate(text.splitlines(), 1):
        before, found, said = line.partition(mark)
        if found and not before.strip():
            yield number, said


def main() -> int:
    """Print what is wrong and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--all", action="store_true", help="print every offender")
    every = parser.parse_args().all
    found, count = offences(ROOT)
    for each in found:
        if every or each.kind != "opening":
            print(f"{each.path}:{each.line}: {each.kind}: {each.text}")
    kinds = Counter(each.kind for each in found)
    names = kinds["name"] + kinds["twice"]
    texts = kinds["speaker"] + kinds["house"]
    print(f"{names} public names that the field has a term for, {texts} texts in the house's words")
    wrong = kinds.total() > kinds["opening"]
    for suffix, language in (("py", "Python"), ("rs", "Rust")):
        opening = sum(each.kind == "opening" and each.path.suffix in SUFFIXES[suffix] for each in found)
        share = opening / max(count[suffix], 1)
        print(f"{language}: {opening} of {count[suffix]} docstrings open with a question word ({share:.1%})")
        wrong |= share > BAR
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
