"""The page of an episode in a real browser: no error on the console, and the cloud is drawn."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hostile_names import OUT_OF_ALL
from PIL import Image
from playwright.sync_api import Browser, Page

pytest.importorskip("viser")
pytest.importorskip("mani_skill")

from gensim2.core.errors import InputError
from gensim2.perception import CloudSettings, ObservationSpec
from gensim2.rollout.recording import Recorder
from gensim2.scenes.config import SceneOptions
from gensim2.sim.headless import HeadlessEnv
from gensim2.tasks import load_task
from gensim2.viewing import Shown, serve, view


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """A page of a scene without motion for three control steps."""
    env = HeadlessEnv("OpenDrawer", assets="builtin")
    env.reset(seed=0)
    recorder = Recorder(env)
    for _ in range(3):
        env.step(env.profile.rest_action)
        recorder.add(env.profile.rest_action, env.measure())
    scene = SceneOptions("builtin").with_task(load_task("OpenDrawer"))
    spec = ObservationSpec(cloud=CloudSettings(points=512, candidates=2048))
    server = serve(Shown(OUT_OF_ALL, scene, recorder.finish()), spec, port=18200)
    yield f"http://{server.get_host()}:{server.get_port()}"
    server.stop()


def _picture(page: Page) -> np.ndarray:
    """Return the image of the page beside its switches when it no longer changes; a software renderer takes a while."""
    before = None
    for _ in range(20):
        shot = Image.open(io.BytesIO(page.screenshot(timeout=120_000)))
        now = np.asarray(shot.convert("RGB"), dtype=np.int32)[:, :550]
        if before is not None and np.array_equal(before, now):
            return now
        before = now
        page.wait_for_timeout(500)
    raise AssertionError("the page does not come to rest")


def test_the_cloud_is_there_and_the_console_has_no_error(address: str, browser: Browser) -> None:
    page = browser.new_page(viewport={"width": 900, "height": 440})
    said: list[str] = []
    # viser's client logs its connection and a deprecation of three.js; the driver warns of slow screenshots.
    page.on("console", lambda message: said.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: said.append(f"error: {error}"))
    page.goto(address)
    page.get_by_text("time [s]").first.wait_for(timeout=60_000)
    assert page.evaluate("window.ran") is None
    assert OUT_OF_ALL in page.evaluate("document.body.innerText")
    boxes = page.get_by_role("checkbox")
    everything = _picture(page)
    boxes.nth(0).evaluate("box => box.click()")  # hides the scene's meshes
    cloud = _picture(page)
    boxes.nth(1).evaluate("box => box.click()")  # hides the cloud
    nothing = _picture(page)
    page.close()
    assert said == []
    drawn = (np.abs(cloud - nothing).max(axis=-1) > 20).sum()
    assert drawn > 200, "the points of the cloud"
    assert (np.abs(everything - cloud).max(axis=-1) > 20).sum() > 5 * drawn, "robot, table and drawer"


@pytest.mark.parametrize("selection", [{"task": "OpenBox"}, {"episode": 0}])
def test_a_selection_beside_an_episode_file_is_refused(selection: dict[str, str | int], tmp_path: Path) -> None:
    [field] = selection
    with pytest.raises(InputError, match="selects from the folder of a data set only") as error:
        view(tmp_path / "OpenBox" / "episodes" / "000000.h5", **selection)  # type: ignore[arg-type]
    assert error.value.field == field
