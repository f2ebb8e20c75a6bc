"""Texts from files, servers and solvers are shown as text in a viewer's page, and no markup in them takes effect."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import run_folders
import yaml
from hostile_files import made_hostile
from hostile_names import CONTROLS, OUT_OF_ALL
from hostile_names import HOSTILE_WORDS as HOSTILE
from playwright.sync_api import Browser

pytest.importorskip("viser")

import viser

import gensim2_kpam as kpam
from gensim2.data import report as quality_report
from gensim2.data.dataset import DataSet
from gensim2.data.queue import write_page
from gensim2.data.status import Status, TaskStatus
from gensim2.design.report import write_report
from gensim2.robots import robot
from gensim2_kpam.show import add_text, plain_markdown, show

PYTHON = Path(__file__).parents[2] / "python"
TEXTS = (OUT_OF_ALL + CONTROLS, OUT_OF_ALL)  # some readers refuse control characters


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


def shown_as_text(browser: Browser, file: Path) -> str:
    """Return the text of a page, which runs nothing, asks for nothing elsewhere and is in its own order."""
    page = browser.new_page()
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto(file.as_uri())
    page.wait_for_timeout(200)
    assert page.evaluate("window.ran") is None
    assert page.locator("iframe, style + style, img[onerror], a[href^=javascript]").count() == 0
    page.evaluate("document.querySelectorAll('details').forEach(each => each.open = true)")
    shown = str(page.evaluate("document.body.textContent")) + page.title()
    page.close()
    assert all(url.startswith(("file:", "data:")) for url in asked), asked
    assert not set(CONTROLS) & set(shown), "a control character hides or reorders the text around it"
    assert "onerror=top.ran = true" in shown
    return shown


def test_every_text_of_a_run_folder_is_text_in_its_report(tmp_path: Path, browser: Browser) -> None:
    folder = run_folders.run_folder(tmp_path / "run")
    found = made_hostile(folder, TEXTS, lambda: write_report(folder))
    assert {"run.json: command_line.0", "tasks/OpenDemo/task.yaml: description"} <= set(found), found
    (folder / "rejected" / OUT_OF_ALL.replace("/", "\u2044")).mkdir()
    shown_as_text(browser, write_report(folder))


def test_every_text_of_a_data_set_is_text_on_its_page(collected: Path, browser: Browser) -> None:
    run = collected / "run.json"

    def written() -> Path:
        dataset = DataSet.open(collected)
        tasks = (
            TaskStatus(name, task.tried, task.tried, task.held, task.strict, {**task.causes, TEXTS[0]: 1})
            for name, task in dataset.record.tasks.items()
        )
        return write_page(dataset, Status(tuple(tasks), 1, 1.0, 1, 1, 0), json.loads(run.read_text()))

    found = made_hostile(collected, TEXTS, written)
    assert {"run.json: host", "dataset.json: versions.python"} <= set(found), found
    shown_as_text(browser, written())


def test_the_sentence_of_a_task_is_text_on_the_page_of_its_quality(collected: Path, browser: Browser) -> None:
    for path in collected.glob("*/task.yaml"):
        task = yaml.safe_load(path.read_text())
        path.write_text(yaml.safe_dump({**task, "description": OUT_OF_ALL}))
    quality_report.report(collected, videos=0)
    shown_as_text(browser, collected / quality_report.HTML)


@pytest.mark.parametrize("kind", ["hostile_page", "hostile_tasks_page"])
def test_a_gallery_of_untrusted_objects_or_tasks_is_text(
    kind: str, request: pytest.FixtureRequest, browser: Browser
) -> None:
    shown_as_text(browser, request.getfixturevalue(kind))


def test_the_page_of_an_arm_shows_titles_reasons_and_cameras_as_text(browser: Browser) -> None:
    from gensim2_robot.live import LivePage

    with LivePage("panda", HOSTILE[0], port=18320) as shown:
        shown.change(0.0, HOSTILE[1], f"{OUT_OF_ALL} THE END")
        shown.clocks(0.0, 0.0, {HOSTILE[2]: 0.1})
        shown.draw()
        page = opened(browser, shown.server)
        assert page.evaluate("window.ran") is None
        assert page.locator("iframe, img[onerror]").count() == 0
        words = page.evaluate("document.body.innerText")
        page.close()
    assert all(each in words for each in (HOSTILE[0], HOSTILE[1], OUT_OF_ALL, HOSTILE[2]))


def test_a_policy_server_answers_a_browser_in_plain_text(browser: Browser) -> None:
    from gensim2.policy.remote.server import PolicyServer
    from gensim2.rollout.controller_spec import ControllerSpec

    server = PolicyServer(ControllerSpec("gensim2.policy.no_op:NoOpPolicy", {"arm": 7}), "panda", 16 * "x", port=0)
    thread = threading.Thread(target=server.serve)
    thread.start()
    try:
        page = browser.new_page(extra_http_headers={"Sec-WebSocket-Protocol": HOSTILE[1]})
        for path in (OUT_OF_ALL, "favicon.ico"):
            answer = page.goto(f"http://{server.host}:{server.port}/{path}")
            assert answer is not None
            assert answer.headers["content-type"].startswith("text/plain")
            assert page.evaluate("window.ran") is None
        page.close()
    finally:
        server.close()
        thread.join()


def test_templates_escape_all_but_drawings_of_our_own() -> None:
    safe = {
        (file.name, line.strip()[line.strip().find("{{") :][:60])
        for file in PYTHON.rglob("*.j2")
        for line in file.read_text().splitlines()
        if "| safe" in line or "|safe" in line or "autoescape" in line
    }
    assert {name for name, _ in safe} == {"quality.html.j2"}, safe
