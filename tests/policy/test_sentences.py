"""Instructions that say a training instruction in other words."""

from __future__ import annotations

import pytest

pytest.importorskip("torch")

from gensim2.policy.checkpoint import CheckpointError, PolicyCheckpoint, checkpoint_folder
from gensim2.policy.sentences import sentence_row, taught_sentence

FOLDER = checkpoint_folder("builtin")


@pytest.fixture(scope="module")
def policy() -> PolicyCheckpoint:
    return PolicyCheckpoint.load(FOLDER)


@pytest.mark.parametrize(
    ("sentence", "taught"),
    [
        ("close the box", "close the box"),
        ("Please shut the box.", "close the box"),
        ("lift the lid of the box", "open the box"),
        ("slide the drawer out", "pull the drawer open"),
        ("shut the fridge", "close the door of the refrigerator"),
        ("open the fridge", "open the door of the refrigerator"),
    ],
)
def test_other_words_give_the_training_instruction(policy: PolicyCheckpoint, sentence: str, taught: str) -> None:
    assert taught_sentence(policy, sentence, FOLDER) == taught
    row = sentence_row(policy, sentence, FOLDER, embed=False)
    assert row.equal(policy.row_of(taught, FOLDER))
    assert row.equal(sentence_row(policy, sentence, FOLDER, embed=True)) == (sentence == taught)


@pytest.mark.parametrize(
    ("sentence", "reason"),
    [
        ("do not close the box", "negations and exceptions are not understood"),
        ("paint the box", "unknown verb"),
        ("close the shoe", "unknown object"),
        ("open the box, put the apple into it and close it", "open the box and put the apple into the box and close"),
        ("is the box closed?", "sentence"),
    ],
)
def test_other_steps_are_refused_with_the_reason(policy: PolicyCheckpoint, sentence: str, reason: str) -> None:
    with pytest.raises(CheckpointError, match=f"was not trained on the sentence .*{reason}"):
        taught_sentence(policy, sentence, FOLDER)
