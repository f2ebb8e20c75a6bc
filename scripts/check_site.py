"""Check the site that ``make docs`` has built: all links work, and pages render correctly in a browser.

    python scripts/check_site.py dist/site [--pictures DIR]

The script follows links and anchors of all pages in the files. If a Chromium browser is installed, it opens some pages
of every kind at widths of 400 and 1,400 pixels, and checks that the console has no errors, that no element is wider
than the page, and that the search has results. The exit code is 1 if a check fails.
"""

from __future__ import annotations

import argparse
import functools
import http.server
import re
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlparse

sys.path.append(str(Path(__file__).parents[1] / "tests/common"))

import browser as opened

PAGES = (
    "index.html",
    "reference/tasks.html",
    "reference/solver.html",
    "results/tasks.html",
    "guides/viewing.html",
    "cli/collect.html",
    "api/gensim2.sim.html",
)


_BAR = re.compile(r"<td[^<]*(?:<(?!/td)[^<]*)*?\\\|")


class _Page(HTMLParser):
    """Links and anchors of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        self.anchors |= {value for name in ("id", "name") if (value := values.get(name))}
        link = values.get("href" if tag in ("a", "link") else "src")
        if link:
            self.links.append(link)


def dead_links(site: Path) -> list[str]:
    """Return broken links and anchors of all pages, and table bars that are displayed with an escape character."""
    texts = {path: path.read_text(encoding="utf-8") for path in sorted(site.rglob("*.html"))}
    pages = {path: _Page(text) for path, text in texts.items()}
    wrong = [
        f"{path.relative_to(site)}: an escaped bar in a table" for path, text in texts.items() if _BAR.search(text)
    ]
    for path, page in pages.items():
        for link in page.links:
            target = urlparse(link)
            if target.scheme or target.netloc or path.name == "404.html":
                continue
            file = (path.parent / unquote(target.path)).resolve() if target.path else path
            if file.is_dir():
                file /= "index.html"
            if not file.exists():
                wrong.append(f"{path.relative_to(site)}: no file: {link}")
            elif target.fragment and file in pages and unquote(target.fragment) not in pages[file].anchors:
                wrong.append(f"{path.relative_to(site)}: no such place: {link}")
    return wrong


class _Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: object) -> None:
        """Do not log requests."""


@contextmanager
def served(site: Path) -> Iterator[str]:
    """Serve a folder on a free port of this machine."""
    handler = functools.partial(_Quiet, directory=str(site))
    with http.server.ThreadingHTTPServer(("localhost", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://localhost:{server.server_port}"
        server.shutdown()


def faults_in_browser(site: Path, pictures: Path | None) -> list[str]:
    """Return the faults of some pages in a browser; without a browser, print this and return no faults."""
    executable = opened.installed()
    if executable is None:
        print("no browser is installed: pages were not opened")
        return []
    wrong: list[str] = []
    with opened.started(executable) as browser, served(site) as address:
        for width in opened.WIDTHS:
            page = browser.new_page(viewport={"width": width, "height": 900})
            page.on(
                "console", lambda message: wrong.append(f"console: {message.text}") if message.type == "error" else None
            )
            page.on("pageerror", lambda error: wrong.append(f"error: {error}"))
            for name in PAGES:
                page.goto(f"{address}/{name}")
                wide = page.evaluate("document.documentElement.scrollWidth")
                if wide > width:
                    wrong.append(f"{name} is {wide} px wide where there are {width}")
                if not page.evaluate(
                    "[...document.images].every(each => each.loading === 'lazy' || each.naturalWidth)"
                ):
                    wrong.append(f"{name}: a picture does not load")
                if pictures is not None:
                    pictures.mkdir(parents=True, exist_ok=True)
                    page.screenshot(path=pictures / f"{name.replace('/', '_').removesuffix('.html')}_{width}.png")
            if width == max(opened.WIDTHS):
                page.goto(f"{address}/index.html")
                page.locator("input.md-search__input").click()
                page.locator("input.md-search__input").press_sequentially("gripper")
                page.locator(".md-search-result__item").first.wait_for(timeout=60_000)
            page.close()
    return wrong


def main() -> int:
    """Print the faults of a site."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("site", type=Path)
    parser.add_argument("--pictures", type=Path, help="folder for screenshots")
    given = parser.parse_args()
    site = given.site.resolve()
    wrong = dead_links(site) + faults_in_browser(site, given.pictures)
    print("\n".join(wrong) or f"{sum(1 for _ in site.rglob('*.html'))} pages: nothing wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
