"""List docstrings and comments that violate a style rule, and names that are assigned twice.

    python scripts/words.py            # counts, and what is over the bar
    python scripts/words.py --all      # every offender

An offender is a docstring (of Rust, a doc comment) that opens with What, How, Where or Who in place of an imperative or
a noun phrase; a text, in the pages too, with an indefinite person in it; a name that a module or a class assigns twice,
so that the second value silently replaces the first.
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


@dataclass(frozen=True)
class Offence:
    """A violation of a rule.

    Attributes:
        kind: ``"opening"``, ``"speaker"`` or ``"twice"``.
        path: path of the file, relative to the root.
        line: line number, counted from 1.
        text: offending text.
    """

    kind: str
    path: Path
    line: int
    text: str


def offences(root: Path) -> tuple[list[Offence], Counter[str]]:
    """Return all violations in a source tree, and the number of docstrings by language."""
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
    return found, count


def _twice(tree: ast.AST, path: Path) -> Iterator[Offence]:
    """Yield names that the body of a module or a class assigns twice."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.Module | ast.ClassDef):
            continue
        known: dict[str, int] = {}
        for entry in node.body:
            if not isinstance(entry, ast.Assign | ast.AnnAssign) or entry.value is None:
                continue
            targets = entry.targets if isinstance(entry, ast.Assign) else [entry.target]
            nested = (target.elts if isinstance(target, ast.Tuple) else [target] for target in targets)
            for name in (each.id for several in nested for each in several if isinstance(each, ast.Name)):
                if name in known:
                    yield Offence("twice", path, entry.lineno, f"{name} was assigned in line {known[name]}")
                known[name] = entry.lineno


def docstrings(text: str, suffix: str) -> int:
    """Return the number of docstrings (Python) or doc comments (Rust) in a source text."""
    return sum(1 for _ in (_python_docs(ast.parse(text)) if suffix == "py" else _rust_docs(text)))


def of_python(text: str, path: Path) -> Iterator[Offence]:
    """Yield the violations in a Python source."""
    tree = ast.parse(text)
    for line, said in _python_docs(tree):
        yield from _of_text(said, path, line)
    for line, said in _comments(text, "#"):
        yield from _speakers(said, path, line)
    yield from _twice(tree, path)


def of_rust(text: str, path: Path) -> Iterator[Offence]:
    """Yield the violations in a Rust source."""
    for line, said in _rust_docs(text):
        yield from _of_text(said, path, line)
    for line, said in _comments(text, "//"):
        if not said.startswith(("/", "!")):
            yield from _speakers(said, path, line)


def _of_text(said: str, path: Path, line: int) -> Iterator[Offence]:
    if OPENING.match(said.strip()):
        yield Offence("opening", path, line, said.strip().splitlines()[0])
    yield from _speakers(said, path, line)


def _speakers(said: str, path: Path, line: int) -> Iterator[Offence]:
    for found in SPEAKERS.finditer(said):
        yield Offence("speaker", path, line, said[max(0, found.start() - 40) : found.end() + 40].replace("\n", " "))


def _python_docs(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield the docstrings of modules, classes, functions and attributes."""
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
    """Print the violations and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--all", action="store_true", help="print every offender")
    every = parser.parse_args().all
    found, count = offences(ROOT)
    for each in found:
        if every or each.kind != "opening":
            print(f"{each.path}:{each.line}: {each.kind}: {each.text}")
    kinds = Counter(each.kind for each in found)
    print(f"{kinds['twice']} names assigned twice, {kinds['speaker']} texts with an indefinite person")
    wrong = kinds.total() > kinds["opening"]
    for suffix, language in (("py", "Python"), ("rs", "Rust")):
        opening = sum(each.kind == "opening" and each.path.suffix in SUFFIXES[suffix] for each in found)
        share = opening / max(count[suffix], 1)
        print(f"{language}: {opening} of {count[suffix]} docstrings open with a question word ({share:.1%})")
        wrong |= share > BAR
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
