"""Texts from files, servers and solvers are shown as text in a viewer's page, and no markup in them takes effect."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from hostile_names import HOSTILE_WORDS as HOSTILE
from playwright.sync_api import Browser

pytest.importorskip("viser")

import viser

import gensim2_kpam as kpam
from gensim2.robots import robot
from gensim2_kpam.show import add_text, plain_markdown, show

PYTHON = Path(__file__).parents[2] / "python"


@pytest.fixture
def server() -> Iterator[Any]:
    made = viser.ViserServer(host="localhost", port=18300, verbose=False)
    yield made
    made.stop()


def opened(browser: Browser, server: Any) -> Any:
    page = browser.new_page()
    page.goto(f"http://{server.get_host()}:{server.get_port()}")
    page.get_by_text("THE END").first.wait_for(timeout=60_000)
    page.wait_for_timeout(500)
    return page


@pytest.mark.parametrize("text", HOSTILE)
def test_a_line_is_shown_as_it_is_and_runs_nothing(text: str, server: Any, browser: Browser) -> None:
    add_text(server, f"before: {text}", text)
    add_text(server, "THE END")
    page = opened(browser, server)
    shown = page.evaluate("document.body.innerText")
    assert page.evaluate("window.ran") is None
    assert page.locator("iframe, h1, strong, em, code, img[onerror], a[href^=javascript]").count() == 0
    page.close()
    plain = " ".join(text.split())
    assert f"before: {plain}" in shown
    assert shown.count(plain) >= 2


def test_names_in_the_scene_run_nothing(server: Any, browser: Browser) -> None:
    for number, text in enumerate(HOSTILE):
        server.scene.add_label(f"/{number} {text}".replace("//", "/"), text)
        server.gui.add_checkbox(text, initial_value=True)
    add_text(server, "THE END")
    page = opened(browser, server)
    assert page.evaluate("window.ran") is None
    assert page.locator("iframe, img[onerror]").count() == 0
    page.close()


def test_the_reason_of_a_solver_is_text(browser: Browser) -> None:
    plan: Any = SimpleNamespace(trajectory=None, status=HOSTILE[0], reason=f"{HOSTILE[2]} THE END")
    server = show(kpam.Scene(robot("panda").model), plan, port=18310)
    try:
        page = opened(browser, server)
        assert page.evaluate("window.ran") is None
        assert HOSTILE[0] in page.evaluate("document.body.innerText")
        page.close()
    finally:
        server.stop()


def test_all_text_enters_a_page_at_one_place() -> None:
    found = {
        str(file.relative_to(PYTHON))
        for file in PYTHON.rglob("*.py")
        if any(word in file.read_text() for word in ("add_markdown(", "add_html(", "add_3d_gui_container("))
    }
    assert found == {"gensim2_kpam/show.py"}
    changed = [
        line.strip()
        for file in PYTHON.rglob("*.py")
        for line in file.read_text().splitlines()
        if ".content = " in line and "plain_markdown(" not in line
    ]
    assert not changed


def test_words_of_people_are_left_as_they_are() -> None:
    assert plain_markdown("watch running: begun", "cloud 31 ms, 2.0 N") == "watch running: begun\n\ncloud 31 ms, 2.0 N"


def test_a_page_of_hostile_words_is_text(tmp_path: Path, browser: Browser) -> None:
    from gensim2.policy.experiments.page import WORDS, write_page

    measures = {f"{kind}_{end}": None for kind in (*WORDS, "lost") for end in ("mean", "interval")}
    measures |= {"unseen_mean": 0.5, "unseen_interval": [0.4, 0.6], "episodes": 1}
    about = {"count": None, "demonstrations": 1, "cpu_s": 1.0}
    arms = [{"name": text, "tasks": [text], "checkpoints": [text], **about, **measures} for text in HOSTILE]
    told = {"out": str(tmp_path), "title": HOSTILE[0], "about": HOSTILE[1], "seed": 0, "seeds": 1, "remaining": 1}
    told |= {"arms": arms, "tasks": [{"arm": text, "name": text, **measures} for text in HOSTILE], "episodes": 9}
    page = browser.new_page()
    page.goto(write_page({**told, "skipped": dict.fromkeys(HOSTILE, HOSTILE[0])}).as_uri())
    assert page.evaluate("window.ran") is None
    assert page.locator("iframe, img, script, style + style").count() == 0
    assert page.locator("h1").inner_text() == HOSTILE[0]
    page.close()


def test_a_learned_page_of_hostile_words_is_text(hostile_learned_page: Path, browser: Browser) -> None:
    page = browser.new_page()
    page.goto(hostile_learned_page.as_uri())
    page.wait_for_timeout(200)
    assert page.evaluate("window.ran") is None
    assert page.locator("iframe, script, style + style, img[onerror], a[href^=javascript]").count() == 0
    shown = " ".join(page.locator("body").inner_text().split())
    assert all(" ".join(text.split()) in shown for text in HOSTILE)
    page.close()


def test_templates_escape_all_but_drawings_of_our_own() -> None:
    safe = {
        (file.name, line.strip()[line.strip().find("{{") :][:60])
        for file in PYTHON.rglob("*.j2")
        for line in file.read_text().splitlines()
        if "| safe" in line or "|safe" in line or "autoescape" in line
    }
    assert {name for name, _ in safe} == {"quality.html.j2", "report.html.j2"}, safe
