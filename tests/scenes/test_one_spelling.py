"""The configuration of scenes is defined once, and signatures, options and files use this definition."""

from __future__ import annotations

import ast
import inspect
import pickle
from dataclasses import fields
from pathlib import Path
from typing import Any, get_type_hints

import pytest

import gensim2
from gensim2.core.errors import InputError
from gensim2.data.record import DatasetRecord
from gensim2.data.records import FIXED_ARGUMENTS
from gensim2.rollout.config import EpisodeConfig, RolloutArguments, RolloutOptions
from gensim2.scenes.config import SCENE_FIELDS, SceneArguments, SceneConfig, SceneOptions
from gensim2.scenes.physics import physics_name
from gensim2.tasks.figures import Condition
from gensim2.tasks.library import load_task

PYTHON = Path(__file__).parents[2] / "python" / "gensim2"

#: Together these words make a configuration; each alone is a common name.
SPELLING = {"physics", "randomization", "open_loop", "instances", "robot", "assets"}
#: Modules that define and use it; options and rows of figures are compared below.
DEFINED = {"scenes/config.py", "scenes/initial_state.py", "rollout/config.py", "tasks/figures.py", "cli/options.py"}
#: A few of these words count as a second definition.
MAX_SPELLED = 2


def words_of(node: ast.AST) -> set[str]:
    """Return the parameters of a function, or the fields of a class, in source order."""
    if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
        return {each.arg for each in (*node.args.args, *node.args.kwonlyargs)}
    if isinstance(node, ast.ClassDef):
        return {
            each.target.id
            for each in node.body
            if isinstance(each, ast.AnnAssign) and isinstance(each.target, ast.Name)
        }
    return set()


def test_no_signature_and_no_class_spells_it_again() -> None:
    found = {
        f"{path.relative_to(PYTHON)}: {node.name}": sorted(words_of(node) & SPELLING)  # type: ignore[attr-defined]
        for path in PYTHON.rglob("*.py")
        if str(path.relative_to(PYTHON)) not in DEFINED
        for node in ast.walk(ast.parse(path.read_text()))
        if len(words_of(node) & SPELLING) > MAX_SPELLED
    }
    assert found == {}


def test_no_other_function_takes_physics_or_randomization_by_name_from_a_user() -> None:
    from gensim2.data import collect
    from gensim2.design import tasks_gallery
    from gensim2.evaluation import benchmark

    for function in (gensim2.demo, gensim2.solve, gensim2.run_pipeline, collect, benchmark, tasks_gallery):
        parameters = inspect.signature(function).parameters
        assert not SPELLING & parameters.keys(), function.__name__
        kinds = [each for each in parameters.values() if each.kind is each.VAR_KEYWORD]
        assert len(kinds) == 1
        assert "Arguments" in str(kinds[0].annotation)


def test_keywords_options_and_fields_are_the_same_words() -> None:
    from gensim2.cli import options

    # `redraw` is a switch of the physics, whose name it has in files.
    assert {each.name for each in fields(SceneOptions)} | {"instances", "redraw"} == set(SCENE_FIELDS)
    assert {each.name for each in fields(SceneConfig)} == {*SCENE_FIELDS, "task"} - {"redraw"}
    assert set(get_type_hints(RolloutArguments)) == {*SCENE_FIELDS, "open_loop", *options.PLANNER}
    assert {*options.EPISODES, *options.PLANNER} == {*get_type_hints(RolloutArguments), "seed"}
    assert set(options.EPISODES) <= set(get_type_hints(options.Shared))
    run = {each.name for each in fields(RolloutOptions)}
    assert set(FIXED_ARGUMENTS) >= {*SCENE_FIELDS, *run}
    # Noise and a second engine are for collections only, and figures are of planners that know the true scene.
    others = {"noise", "engines", *options.PLANNER}
    assert set(Condition.model_fields) == {"objects"} | set(SCENE_FIELDS) - {"assets", "redraw"} | run - others


def test_it_pickles_and_finds_its_like() -> None:
    config = SceneOptions("builtin", "original").with_task(load_task("OpenBox"), frozenset({("box", "3")}))
    again = pickle.loads(pickle.dumps(EpisodeConfig(config, RolloutOptions(open_loop=True))))
    assert again.scene == config
    assert hash(again.scene) == hash(config)
    assert again.task.name == "OpenBox"
    assert config.drawn == {"box": "3"}
    assert config.options == SceneOptions("builtin", "original")


@pytest.mark.parametrize(
    ("word", "field"), [("theirs", "physics"), ("narrow", "randomization"), ("nobody", "robot"), ("bullet", "engine")]
)
def test_what_there_is_not_is_refused(word: str, field: str) -> None:
    given: dict[str, Any] = {"assets": "builtin", field: word}
    with pytest.raises(InputError, match=field):
        SceneOptions.of(**given)


def test_the_word_of_earlier_releases_is_understood() -> None:
    given: SceneArguments = {"assets": "builtin", "physics": "ours"}
    assert SceneOptions.of(**given).physics == physics_name("ours") == "default"
    assert SceneOptions.of(**given, redraw="none").physics == "default+redraw=none"
    with pytest.raises(InputError, match="redraw"):
        SceneOptions.of(**given, redraw="twice")
    record = DatasetRecord.model_validate(
        {
            "arguments": {"assets": "builtin", "physics": "ours", "robot": "panda", "open_loop": True, "attempts": 3},
            "seed": 0,
            "episodes": 1,
            "keep_failures": False,
            "tasks": {},
            "listings": {},
            "versions": {},
        }
    )
    assert record.arguments["physics"] == "default"
    assert record.arguments["engine"] == "sapien"  # earlier releases had no other
    assert record.scene == SceneOptions("builtin")
    assert record.rollout == RolloutOptions(open_loop=True, attempts=3)


@pytest.mark.parametrize(
    ("function", "given"),
    [
        (gensim2.demo, {"task": "OpenBox"}),
        (gensim2.solve, {"task": "OpenBox"}),
        (gensim2.benchmark, {"tasks": ["OpenBox"]}),
        (gensim2.run_pipeline, {}),
    ],
    ids=lambda each: getattr(each, "__name__", None),
)
def test_a_keyword_that_there_is_not_is_refused(function: Any, given: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"instnces: is an unknown argument \(did you mean instances"):
        function(**given, assets="builtin", instnces="all", out=tmp_path / "out")
    assert not (tmp_path / "out").exists()
