"""A model server, and a design brief with some classes of the generated library."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

pytest.importorskip("openai")

from llm_answers import GoodModel
from llm_server import KEY, ModelServer

from gensim2.design.affordance import Affordance
from gensim2.design.base import Brief, Known, RobotSummary
from gensim2.objects import Library
from gensim2.robots import robot
from gensim2.tasks.library import load_strategies, load_task

TASKS = ("OpenDrawer", "CloseBox", "OpenSafe", "PlaceGolfBallIntoDrawer")
CLASSES = ("drawer", "box_rotate", "safe_rotate", "bucket_lift", "golf_ball", "apple")


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Set an API key and a back-off of milliseconds."""
    monkeypatch.setenv("OPENAI_API_KEY", KEY)
    monkeypatch.setattr("openai._base_client.INITIAL_RETRY_DELAY", 0.01)


@pytest.fixture
def server() -> Iterator[ModelServer]:
    with ModelServer(GoodModel()) as found:
        yield found


@pytest.fixture(scope="session")
def brief(library: Library) -> Brief:
    """Brief with six classes and four known tasks."""
    profile = robot("panda")
    settings = RobotSummary(
        robot="panda",
        base=(-0.615, 0.0),
        reach=0.7,
        stroke=0.08,
        tool_keypoints=dict(profile.tool_keypoint_descriptions),
    )
    classes = {
        name: Affordance.of([library.load(name, library.instances(name)[0])], library.describe(name))
        for name in CLASSES
    }
    known = [Known(load_task(name), load_strategies(name)) for name in TASKS]
    return Brief(settings, classes, known)
