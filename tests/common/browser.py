"""Open pages in a real browser and report errors in them."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import unquote, urlparse

from playwright.sync_api import Browser, Page, sync_playwright

#: Names of browsers to try; ``GENSIM2_BROWSER`` names another.
NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "microsoft-edge")

WIDTHS = (400, 1400)

SMALLEST_TEXT = 12
"""Text smaller than this many CSS pixels counts as illegible."""

_TEXTS = """smallest => {
  const wrong = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node = walker.nextNode(); node; node = walker.nextNode()) {
    const element = node.parentElement;
    if (!node.textContent.trim() || element.closest("script, style, title")) continue;
    const range = document.createRange();
    range.selectNodeContents(node);
    const box = range.getBoundingClientRect();
    if (!box.width || !box.height) continue;
    const text = node.textContent.trim().slice(0, 40);
    const drawn = element.ownerSVGElement ? element.getScreenCTM() : null;
    const scale = drawn ? Math.hypot(drawn.a, drawn.b) : 1;  // turned text, too
    const size = parseFloat(getComputedStyle(element).fontSize) * scale;
    if (size < smallest - 0.01) wrong.push(`text of ${size.toFixed(1)} px: ${text}`);
    let around = element;
    while (around && getComputedStyle(around).overflowX === "visible") around = around.parentElement;
    const cut = around && !/auto|scroll/.test(getComputedStyle(around).overflowX);
    const edge = cut ? Math.min(around.getBoundingClientRect().right, innerWidth) : innerWidth;
    if ((cut || !around) && box.right > edge + 1) wrong.push(`runs over the right edge: ${text}`);
  }
  if (document.documentElement.scrollWidth > innerWidth)
    wrong.push(`is ${document.documentElement.scrollWidth} px wide where there are ${innerWidth}`);
  return wrong;
}"""

_MEDIA = """async () => {
  const wrong = [], wait = (target, good) => new Promise(done => {
    target.addEventListener(good, () => done(true), { once: true });
    target.addEventListener("error", () => done(false), { once: true });
    setTimeout(() => done(false), 20000);
  });
  for (const image of document.images) {
    image.loading = "eager";
    if (!image.complete) await wait(image, "load");
    if (!image.naturalWidth) wrong.push(`picture does not load: ${image.getAttribute("src")}`);
  }
  for (const element of document.querySelectorAll("*")) {
    const drawn = /url\\("(.*?)"\\)/.exec(getComputedStyle(element).backgroundImage);
    for (const [what, source] of [["picture", drawn?.[1]], ["poster", element.poster]]) {
      if (!source) continue;
      const image = new Image();
      const loaded = wait(image, "load");
      image.src = source;
      if (!await loaded) wrong.push(`${what} does not load: ${source}`);
    }
  }
  for (const video of document.querySelectorAll("video")) {
    const loaded = wait(video, "canplay");
    video.preload = "auto";
    video.load();
    if (!await loaded || !video.videoWidth || !(video.duration > 0))
      wrong.push(`video does not play: ${video.getAttribute("src")}`);
  }
  return wrong;
}"""


def installed() -> str | None:
    """Return the path of an installed browser of the Chromium family, or None."""
    named = os.environ.get("GENSIM2_BROWSER")
    return named or next((path for name in NAMES if (path := shutil.which(name))), None)


@contextmanager
def started(executable: str) -> Iterator[Browser]:
    """Yield a headless browser."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable)
        try:
            yield browser
        finally:
            browser.close()


def faults(browser: Browser, page: Path, width: int, *, picture: Path | None = None) -> list[str]:
    """Return the errors of a page in a window of the given width (pixels), and take a screenshot if asked for."""
    opened = browser.new_page(viewport={"width": width, "height": 900})
    said: list[str] = []
    opened.on("console", lambda message: said.append(f"console: {message.text}"))
    opened.on("pageerror", lambda error: said.append(f"error: {error}"))
    opened.on("request", lambda request: said.extend(_elsewhere(request.url)))
    try:
        opened.goto(page.resolve().as_uri())
        _scroll_through(opened)
        found = [*opened.evaluate(_MEDIA), *opened.evaluate(_TEXTS, SMALLEST_TEXT), *_dead_links(opened, page)]
        opened.evaluate("document.querySelectorAll('details').forEach(each => each.open = true)")
        found += [f"unfolded: {fault}" for fault in opened.evaluate(_TEXTS, SMALLEST_TEXT)]
        if picture is not None:
            opened.screenshot(path=picture, full_page=True)
    finally:
        opened.close()
    return [*said, *found]


def _elsewhere(url: str) -> list[str]:
    return [] if url.startswith(("file:", "data:", "blob:")) else [f"asks for {url}"]


def _scroll_through(page: Page) -> None:
    """Scroll through the page, so that lazily loaded parts are loaded."""
    page.evaluate("""async () => {
      for (let y = 0; y < document.body.scrollHeight; y += innerHeight) {
        scrollTo(0, y);
        await new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)));
      }
      scrollTo(0, 0);
    }""")


def _dead_links(page: Page, file: Path) -> list[str]:
    """Return links to missing files or missing anchors."""
    wrong = []
    for link in page.evaluate("[...document.querySelectorAll('a')].map(each => each.getAttribute('href'))"):
        target = urlparse(link or "")
        if target.scheme or target.netloc or not link:
            wrong.append(f"link out of the folder, or to nowhere: {link}")
        elif target.path and not (file.parent / unquote(target.path)).exists():
            wrong.append(f"link to a file that is not there: {link}")
        elif target.fragment and not target.path and page.query_selector(f"[id='{unquote(target.fragment)}']") is None:
            wrong.append(f"link to a place that is not there: {link}")
    return wrong
