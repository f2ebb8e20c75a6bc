"""Answers of a strong language model, recorded in benchmarks/model_designer.tar.xz, make the same tasks and configs."""

from __future__ import annotations

import json
import re
import tarfile
from collections.abc import Iterable, Mapping
from pathlib import Path

import pytest
from llm_server import Asked, ModelServer

from gensim2.design.affordance import Affordance
from gensim2.design.base import Brief
from gensim2.design.briefing import robot_summary
from gensim2.design.designs import read_design
from gensim2.design.llm import Asking, LanguageModel, LLMDesigner, ModelOptions, Prompts
from gensim2.design.llm.conversations import read_log
from gensim2.design.llm.store import AnswerStore
from gensim2.objects import Library
from gensim2.tasks.library import load_task_file
from gensim2.tasks.spec import Randomization, TaskSpec
from gensim2.tasks.strategies import Strategies

RECORDS = Path(__file__).parents[3] / "benchmarks" / "model_designer.tar.xz"
PER_RUN = 2
"""Number of tasks of each run that are replayed."""


def _kept() -> list[str]:
    """Return the paths of some kept tasks of each run."""
    with tarfile.open(RECORDS) as archive:
        paths = [name.split("/") for name in archive.getnames()]
    found: dict[str, list[str]] = {}
    for run, *rest in sorted(paths):
        if rest[0:1] == ["tasks"] and rest[2:] == ["verification.json"]:
            found.setdefault(run, []).append(f"{run}/tasks/{rest[1]}")
    return [path for each in found.values() for path in each[:PER_RUN]]


class Recorded:
    """Answers each question of one task with the last recorded answer of this conversation."""

    def __init__(self, folder: Path, task: str) -> None:
        self._answers: dict[tuple[str, str], str] = {}
        store = AnswerStore(folder)
        for each in read_log(folder).conversations:
            if each.subject == task and each.outcome != "dropped":
                step = "" if each.stage in ("proposal", "free", "reflection", "decomposition") else each.about
                record = store.record(each.turns[-1].answer)
                assert record is not None
                self._answers[each.stage, step] = record.text

    def __call__(self, asked: Asked) -> str:
        step = re.search(r", step `(\w+)`\)", asked.prompt)
        return self._answers[asked.stage, step[1] if step else ""]


@pytest.fixture(scope="module")
def records(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("records")
    with tarfile.open(RECORDS) as archive:
        archive.extractall(folder, filter="data")
    return folder


@pytest.mark.parametrize("path", _kept())
def test_recorded_answers_make_the_same_task_and_the_same_configs(path: str, records: Path, library: Library) -> None:
    run, name = path.split("/")[0], path.split("/")[2]
    stored = load_task_file(records / path)
    classes = {
        each: Affordance.of([library.load(each, library.instances(each)[0])], library.describe(each))
        for each in dict.fromkeys(thing.asset_class for thing in stored.objects.values())
    }
    brief = Brief(robot_summary("panda"), classes)
    asking = Asking.read(AnswerStore(records / run / "model").model().asking, records)
    with ModelServer(Recorded(records / run / "model", name)) as server:
        model = LanguageModel(ModelOptions(model="recorded", base_url=server.url, timeout=5.0, retries=0))
        designer = LLMDesigner(model, Prompts(), asking)
        task = next(iter(designer.propose(brief, seed=0)))
        assert _as_written(task) == _as_written(stored)
        candidates = designer.candidates(task, brief, seed=0)
    design = read_design(records / path)
    assert design is not None
    first = [each.steps for each in design.candidates if each.provenance["round"] == 0]
    assert _configs(each.steps for each in candidates) == _configs(first)


def _configs(candidates: Iterable[Mapping[str, Strategies]]) -> set[tuple[str, str]]:
    """Return the configs of all candidates, each with the name of its step."""
    return {(step, json.dumps(way)) for each in candidates for step, ways in each.items() for way in ways.values()}


def _as_written(task: TaskSpec) -> TaskSpec:
    """Return the task without strategies and random ranges, which do not come from the model."""
    steps = tuple(step.model_copy(update={"strategies": ("designed",)}) for step in task.steps)
    objects = {
        name: thing.model_copy(update={"randomization": Randomization(openness_mean=thing.randomization.openness_mean)})
        for name, thing in task.objects.items()
    }
    return task.model_copy(update={"steps": steps, "objects": objects, "provenance": None})
