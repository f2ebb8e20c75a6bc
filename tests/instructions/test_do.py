"""Instructions that are carried out in simulation."""

from __future__ import annotations

import json
import pickle
from pathlib import Path

import pytest

import gensim2
from gensim2.cli import main as cli
from gensim2.core.errors import InputError
from gensim2.instructions import SentenceError
from gensim2.policy.checkpoint import CheckpointError
from gensim2.tasks.library import load_task_file


def test_a_sentence_of_one_step_is_done_on_an_estimated_scene(tmp_path: Path) -> None:
    result = gensim2.do("shut the microwave", out=tmp_path / "run", videos=0, workers=1, assets="builtin", seed=1)
    (episode,) = result.episodes
    assert result.evaluation.controller["target"].endswith(":PerceivingChain")
    assert not result.evaluation.controller["privileged"]
    assert result.is_done
    assert not episode.truncated, "the controller ends the episode"
    assert result.composed.is_from_library


def test_a_sentence_about_two_articulated_objects_is_done_on_an_estimated_scene(tmp_path: Path) -> None:
    sentence, out = "open the drawer and close the box", tmp_path / "run"
    result = gensim2.do(sentence, out=out, videos=0, workers=1, assets="builtin", engine="mujoco")
    (episode,) = result.episodes
    assert result.evaluation.controller["target"].endswith(":PerceivingChain")
    assert [step.text for step in result.steps] == ["open the drawer", "close the box"]
    assert result.is_done
    assert not episode.truncated, "the controller ends the episode"


def test_a_sentence_of_several_steps_is_done_on_the_true_scene(tmp_path: Path) -> None:
    sentence = "open the safe, put the golf ball into it and close it"
    out = tmp_path / "run"
    words = ["do", sentence, "--scene", "true", "--out", str(out), "--videos", "0", "--workers", "1"]
    assert cli.run([*words, "--assets", "builtin", "--json", str(tmp_path / "result.json")]) == 0
    told = json.loads((tmp_path / "result.json").read_text())
    assert told["steps"] == ["open the safe", "put the golf ball into the safe", "close the safe"]
    assert [step["done"] for step in told["episodes"][0]["steps"]] == [True] * 4
    assert told["held"] == told["stopped"] == 1
    assert not told["is_from_library"]
    task = load_task_file(out / "tasks" / told["task"])
    assert len(task.steps) == 4, "the composed task is stored"
    assert sentence in (out / "report.html").read_text()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["do", "paint the box"], "'paint the box': unknown verb"),
        (["do", "open the box", "--scene", "true", "--noise", "d435"], "--noise requires"),
        (["do", "open the box", "--policy", "builtin", "--scene", "true"], "cannot be combined with --policy"),
        (["do", "open the box", "--episodes", "0"], "--episodes"),
        (["do"], "Missing argument 'SENTENCE'"),
    ],
)
def test_bad_input_ends_with_code_2(words: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(words) == cli.BAD_INPUT
    assert message in capsys.readouterr().err


def test_the_steps_are_shown_without_simulation(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["do", "open the box, put the apple into it and close it", "--steps"]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "1. open the box",
        "2. put the apple into the box",
        "3. close the box",
    ]


def test_a_policy_refuses_a_task_that_it_does_not_know(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match="open the suitcase"):
        gensim2.do("open the suitcase and close it", policy="builtin", out=tmp_path / "run", assets="builtin")


def test_a_refusal_survives_pickling() -> None:
    with pytest.raises(SentenceError) as caught:
        gensim2.do("open the spaceship")
    copy = pickle.loads(pickle.dumps(caught.value))
    assert isinstance(copy, InputError)
    assert (str(copy), copy.reason, copy.part) == (str(caught.value), caught.value.reason, caught.value.part)
