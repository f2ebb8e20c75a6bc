"""Links of the documentation are valid, every page is in the navigation, and pages are short except references."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted([*DOCS.rglob("*.md"), *(ROOT / name for name in ("README.md", "CONTRIBUTING.md"))])
#: Largest number of words of a page, except references and internal pages.
MAX_WORDS = 2500
LONG = ("reference/", "architecture.md", "reliability.md")
#: Folders whose texts refer to pages as ``docs/...``.
CODE = ("python", "crates", "benchmarks", "scripts", "tests", "examples", "plugins")


def _without_code(text: str) -> str:
    return re.sub(r"^(```.*?^```|    [^\n]*)$", "", text, flags=re.S | re.M)


def anchors(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as GitHub and MkDocs make them."""
    titles = re.findall(r"^#+ (.*)$", _without_code(page.read_text(encoding="utf-8")), re.M)
    return {re.sub(r"[^\w\- ]", "", title.lower()).strip().replace(" ", "-") for title in titles}


def dead_links(page: Path) -> Iterator[str]:
    """Yield the relative links of a page to missing files or headings."""
    for link in re.findall(r"\]\(([^)\s]+)\)", _without_code(page.read_text(encoding="utf-8"))):
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        if re.match(r"\w+:", link):
            continue
        if not target.exists() or (anchor and anchor not in anchors(target)):
            yield link


def test_a_dead_link_is_found(tmp_path: Path) -> None:
    page = tmp_path / "a.md"
    page.write_text("# One two\n[a](#one-two) [b](#three) [c](b.md) [d](a.md#one-two) [e](https://x.org)\n")
    assert list(dead_links(page)) == ["#three", "b.md"]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    assert list(dead_links(page)) == []


def test_pages_that_the_code_names_exist() -> None:
    texts = (
        (path, path.read_text(encoding="utf-8"))
        for folder in CODE
        for path in (ROOT / folder).rglob("*")
        if path.suffix in (".py", ".pyi", ".rs", ".md", ".sh") and path != Path(__file__) and "target" not in path.parts
    )
    named = {(path.relative_to(ROOT), page) for path, text in texts for page in re.findall(r"\bdocs/[\w/]+\.md", text)}
    assert len(named) > 20
    assert [f"{path}: {page}" for path, page in sorted(named) if not (ROOT / page).is_file()] == []


def test_every_page_stands_in_the_navigation() -> None:
    listed = re.findall(r"^ +- .*?: ([\w/]+\.md)$", (ROOT / "mkdocs.yml").read_text(encoding="utf-8"), re.M)
    assert len(listed) == len(set(listed))
    made = {"index.md", "contributing.md", "changelog.md", "cli/index.md", "api/index.md"}  # scripts/site_pages.py
    assert set(listed) - made == {str(page.relative_to(DOCS)) for page in DOCS.rglob("*.md")}


def test_no_page_but_references_is_long() -> None:
    words = {str(page.relative_to(DOCS)): len(page.read_text(encoding="utf-8").split()) for page in DOCS.rglob("*.md")}
    assert {name: count for name, count in words.items() if count > MAX_WORDS and not name.startswith(LONG)} == {}


def test_drawings_of_constraints_are_those_of_the_script(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    from constraint_drawings import FOLDER, drawings

    page = (DOCS / "reference/solver.md").read_text(encoding="utf-8")
    for name, text in drawings().items():
        assert (FOLDER / f"{name}.svg").read_text(encoding="utf-8") == text, "run scripts/constraint_drawings.py"
        assert f"| `{name}` |" in page
    assert len(list(FOLDER.iterdir())) == len(drawings())
