"""Every page of the project in a real browser: no errors, nothing missing, and legible text."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from browser import WIDTHS, faults
from hostile_names import HOSTILE
from playwright.sync_api import Browser

PAGES = (
    "report_page",
    "objects_page",
    "tasks_page",
    "collection_page",
    "quality_page",
    "learned_page",
    "experiment_page",
    "hostile_page",
)

GOOD = """<!doctype html><html lang="en"><head><title>Page</title></head><body><h1 id="top">Page</h1>
<p>Something to read, <a href="#top">up</a>, <a href="there.txt">there</a>.</p>{}</body></html>"""


@pytest.mark.parametrize("kind", PAGES)
def test_a_page_has_no_faults_in_a_narrow_and_a_wide_window(kind: str, request: pytest.FixtureRequest) -> None:
    page = request.getfixturevalue(kind)  # first, so that errors show without a browser
    browser = request.getfixturevalue("browser")
    shots = os.environ.get("GENSIM2_SCREENSHOTS")
    pictures = {width: Path(shots) / f"{kind}_{width}.png" if shots else None for width in WIDTHS}
    wrong = {width: faults(browser, page, width, picture=picture) for width, picture in pictures.items()}
    assert not any(wrong.values()), wrong


def test_the_text_in_the_picture_of_a_plan_is_not_reduced(report_page: Path, browser: Browser) -> None:
    page = browser.new_page(viewport={"width": WIDTHS[0], "height": 800})
    page.goto(report_page.as_uri())
    sizes = page.locator(".plan img").evaluate_all("all => all.map(each => [each.clientWidth, each.naturalWidth])")
    page.close()
    assert sizes
    assert all(shown >= natural > 0 for shown, natural in sizes)


@pytest.mark.parametrize(("width", "shown"), [(WIDTHS[0], True), (WIDTHS[1], False)])
def test_a_picture_wider_than_the_window_has_a_hint_to_scroll(
    width: int, shown: bool, report_page: Path, browser: Browser
) -> None:
    page = browser.new_page(viewport={"width": width, "height": 800})
    page.goto(report_page.as_uri())
    scrolls = page.locator(".plan").first.evaluate("each => each.scrollWidth > each.clientWidth")
    assert scrolls == page.locator(".sideways").first.is_visible() == shown
    page.close()


@pytest.mark.fast
def test_a_page_without_faults_has_none(browser: Browser, tmp_path: Path) -> None:
    (tmp_path / "there.txt").write_text("no film")
    page = tmp_path / "page.html"
    page.write_text(GOOD.format(""))
    assert faults(browser, page, 400) == []


def test_hostile_names_are_text_and_have_pictures_of_their_own(hostile_page: Path, browser: Browser) -> None:
    page = browser.new_page()
    dialogs: list[str] = []
    page.on("dialog", lambda dialog: (dialogs.append(dialog.message), dialog.dismiss()))
    page.goto(hostile_page.as_uri())
    shown = page.locator("article h3").all_text_contents()
    assert len(shown) == len(HOSTILE) ** 2
    normal = {" ".join(f"{one}/{two}".split()) for one in HOSTILE for two in HOSTILE}
    assert {" ".join(text.split()) for text in shown} == normal
    assert dialogs == []
    assert page.locator("script").count() == 1
    assert page.locator("[onmouseover]").count() == 0
    page.close()
    assert len(list((hostile_page.parent / "pictures").rglob("*.webp"))) == len(HOSTILE) ** 2


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        ("<script>console.log('left from debugging')</script>", "console: left from debugging"),
        ("<script>missing()</script>", "error: missing is not defined"),
        ("<img src='none.png'>", "picture does not load: none.png"),
        ("<i style='background-image: url(none.webp)'></i>", "picture does not load"),
        ("<video src='there.txt'></video>", "video does not play: there.txt"),
        ("<video src='there.txt' poster='none.png'></video>", "poster does not load"),
        ("<img src='http://localhost:9/a.png'>", "asks for http://localhost:9/a.png"),
        ("<a href='none.html'>gone</a>", "link to a file that is not there: none.html"),
        ("<a href='#none'>gone</a>", "link to a place that is not there: #none"),
        ("<a href='https://example.org'>away</a>", "link out of the folder"),
        ("<p style='font-size: 9px'>small print</p>", "text of 9.0 px: small print"),
        ("<svg viewBox='0 0 4000 100' width='300'><text y='50' font-size='40'>tiny</text></svg>", "px: tiny"),
        ("<p style='width: 1500px'>wide</p>", "px wide where there are 400"),
        ("<div style='overflow: hidden'><p style='margin-left: 390px'>cutoff</p></div>", "over the right edge: cutoff"),
        ("<div style='overflow: hidden; width: 80px'><b style='margin-left: 60px'>cut</b></div>", "right edge: cut"),
        ("<details><p style='font-size: 9px'>hidden</p></details>", "unfolded: text of 9.0 px: hidden"),
    ],
)
def test_each_fault_is_found(content: str, fault: str, browser: Browser, tmp_path: Path) -> None:
    (tmp_path / "there.txt").write_text("no film")
    page = tmp_path / "page.html"
    page.write_text(GOOD.format(content))
    assert any(fault in found for found in faults(browser, page, 400))
