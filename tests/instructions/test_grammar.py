"""The parser of instructions: what it understands, and what it refuses."""

from __future__ import annotations

import contextlib
import itertools
import re
import time
import tomllib
from importlib import resources
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from step_notation import in_words

from gensim2.instructions import vocabulary
from gensim2.instructions.grammar import by_grammar as parse
from gensim2.instructions.meanings import solved
from gensim2.instructions.steps import SUPPORTS, HandOver, MoveJoint, Put, Refusal, SentenceError, Step
from gensim2.objects.words import articulated_classes, belongs, noun, parts, rigid_classes
from gensim2.tasks.library import load_task, task_names

DEVELOPMENT = tomllib.loads((Path(__file__).parent / "development.toml").read_text())["sentences"]
PARAPHRASES = yaml.safe_load((Path(__file__).parent / "paraphrases.yaml").read_text())

JOINTS = sorted(solved(), key=str)
#: Rigid objects that are put somewhere.
THINGS = sorted(set(rigid_classes()) - set(SUPPORTS))
PLACES = sorted(each for each in (*articulated_classes(), *SUPPORTS) if belongs(each))


def refused(sentence: str) -> SentenceError:
    """Return the error with which a sentence is refused."""
    with pytest.raises(SentenceError) as caught:
        parse(sentence)
    return caught.value


@pytest.mark.parametrize("each", DEVELOPMENT, ids=lambda each: each["say"])
def test_the_sentences_of_the_development_are_understood(each: dict[str, Any]) -> None:
    if each["meant"]:
        assert [in_words(step) for step in parse(each["say"])] == each["meant"]
    else:
        assert str(refused(each["say"])).startswith("sentence: ")


@pytest.mark.parametrize("meant", PARAPHRASES["paraphrases"])
def test_other_words_for_a_task_are_understood(meant: str) -> None:
    steps = parse(meant)
    for sentence in PARAPHRASES["paraphrases"][meant]:
        if sentence in PARAPHRASES["refused"]:
            refused(sentence)
        else:
            assert parse(sentence) == steps, sentence


@pytest.mark.parametrize("sentence", PARAPHRASES["unrelated"])
def test_an_unrelated_sentence_is_refused(sentence: str) -> None:
    refused(sentence)


@pytest.mark.parametrize(
    ("sentence", "opposite"),
    [
        ("get the {} open", "get the {} shut"),
        ("make sure the {} is open", "make sure the {} is closed"),
        ("the {} must be opened, please", "the {} must be shut, please"),
        ("lift the lid of the {}", "put the lid of the {} down"),
        ("flip the lid of the {} up", "flip the lid of the {} down"),
        ("pull up the cover of the {}", "push down the cover of the {}"),
    ],
)
def test_other_words_for_opposites_stay_opposite(sentence: str, opposite: str) -> None:
    for name in ("box", "suitcase", "laptop"):
        assert parse(sentence.format(name)) == parse(f"open the {name}")
        assert parse(opposite.format(name)) == parse(f"close the {name}")


def test_a_state_that_is_said_twice_is_one_step() -> None:
    assert parse("the box must be closed, please shut it") == parse("close the box")
    assert len(parse("open the box, close it, open it")) == 3


def test_a_grip_is_not_a_step() -> None:
    assert parse("grab the handle of the bucket and lift it") == parse("lift the bucket by its handle")
    assert refused("grab the handle of the bucket").reason == Refusal.INCOMPLETE
    assert refused("open the box and grab the handle of the bucket").reason == Refusal.INCOMPLETE
    assert refused("grab the handle of the bucket and open the box").reason == Refusal.INCOMPLETE


def test_nearly_every_description_of_the_library_is_understood() -> None:
    unread = []
    for name in task_names():
        try:
            parse(load_task(name).description)
        except SentenceError:
            unread.append(name)
    assert unread == ["FillMugWithWater"], "a place under a faucet is not understood"


@pytest.mark.parametrize(
    ("sentence", "reason", "part"),
    [
        ("", Refusal.EMPTY, ""),
        ("...", Refusal.EMPTY, "..."),
        ("do not open the box", Refusal.NEGATION, "not"),
        ("open the box but don't close it", Refusal.NEGATION, "not"),
        ("open everything except the drawer", Refusal.NEGATION, "except"),
        ("paint the box", Refusal.UNKNOWN_VERB, "paint the box"),
        ("open the spaceship", Refusal.UNKNOWN_OBJECT, "the spaceship"),
        ("put the apple into the spaceship", Refusal.UNKNOWN_OBJECT, "into the spaceship"),
        ("open the left drawer", Refusal.UNKNOWN_OBJECT, "the left drawer"),
        ("open the drawer loudly", Refusal.NOT_UNDERSTOOD, "loudly"),
        ("open the drawer if it is closed", Refusal.NOT_UNDERSTOOD, "if it is closed"),
        ("turn on the drawer", Refusal.IMPOSSIBLE, "turn on the drawer"),
        ("open the apple", Refusal.IMPOSSIBLE, "open the apple"),
        ("pull the lever of the toaster", Refusal.IMPOSSIBLE, "pull the lever of the toaster"),
        ("unscrew the cap of the bottle", Refusal.IMPOSSIBLE, "unscrew the cap of the bottle"),
        ("put the mug into the dishwasher", Refusal.IMPOSSIBLE, "put the mug into the dishwasher"),
        ("put the apple onto the drawer", Refusal.IMPOSSIBLE, "put the apple onto the drawer"),
        ("put the drawer into the mug", Refusal.IMPOSSIBLE, "put the drawer into the mug"),
        ("hand the banana to the person on the left", Refusal.IMPOSSIBLE, "hand the banana to the person on the left"),
        ("open it", Refusal.AMBIGUOUS, "it"),
        ("close the lid", Refusal.AMBIGUOUS, "the lid"),
        ("put it into the drawer", Refusal.AMBIGUOUS, "it"),
        ("put the apple", Refusal.INCOMPLETE, "put the apple"),
        ("open", Refusal.INCOMPLETE, "open"),
        ("take the apple out of the box", Refusal.INCOMPLETE, "take the apple out of the box"),
        ("hand me the can of tuna", Refusal.UNKNOWN_OBJECT, "me the can of tuna"),
        ("burn the house: open the box", Refusal.UNKNOWN_VERB, "burn the house"),
        ("put the apple on the plate into the drawer", Refusal.AMBIGUOUS, "put the apple on the plate into the drawer"),
        ("move the apple from the drawer into the box and close both", Refusal.AMBIGUOUS, "both"),
        ("open the box and the drawer, then close it", Refusal.AMBIGUOUS, "it"),
        ("put the apple into the box, then put it into the box", Refusal.ORDER, "put it into the box"),
        ("open the open drawer", Refusal.ORDER, "open the open drawer"),
        ("open the second drawer", Refusal.UNKNOWN_OBJECT, "the second drawer"),
        ("put the apple into the closed drawer", Refusal.ORDER, "put the apple into the closed drawer"),
        ("pick up the apple and close the drawer", Refusal.ORDER, "pick up the apple"),
        ("öffne die Schublade", Refusal.UNKNOWN_VERB, "öffne die schublade"),
        ("open the box " * 100, Refusal.NOT_UNDERSTOOD, "open the box open the box open the box o"),
    ],
)
def test_a_refusal_names_its_part(sentence: str, reason: Refusal, part: str) -> None:
    error = refused(sentence)
    assert (error.reason, error.part) == (reason, part)
    assert error.remedy


@pytest.mark.parametrize(
    ("sentence", "meant"),
    [
        ("put the lemon in the refrigerator and shut the door", ["put lemon refrigerator", "closed refrigerator"]),
        ("shut the door", ["closed door"]),
        ("press the button", ["open coffee_machine"]),
        (
            "open the box and the drawer, then close them",
            [f"{goal} {each}" for goal in ("open", "closed") for each in ("box_rotate", "drawer")],
        ),
        ("turn the faucet down", ["half_closed faucet"]),
        ("push down the lever", ["open toaster_press"]),
        ("open the box and the drawer", ["open box_rotate", "open drawer"]),
        ("grab the apple and the lemon and put them into the bowl", ["put apple bowl", "put lemon bowl"]),
        (
            "open the box, take the cup out and put it on the plate",
            ["open box_rotate", "put cup plate from box_rotate"],
        ),
        ("take the lid off the pot and put it back on the pot", None),
        ("open the sugar box", None),
        ("put the sugar box into the box", ["put sugar_box box_rotate"]),
        ("LIFT THE BUCKET\u2019S HANDLE", ["half_closed bucket_swing"]),
    ],
)
def test_pronouns_parts_and_lists(sentence: str, meant: list[str] | None) -> None:
    if meant is None:
        refused(sentence)
    else:
        assert [in_words(step) for step in parse(sentence)] == meant


def test_a_reason_does_not_add_a_step() -> None:
    assert parse("open the window so that you can shout and sing") == parse("open the window")
    assert parse("close the laptop to tidy the desk") == parse("close the laptop")
    assert parse("push the door shut so nobody can come in") == parse("close the door")
    assert parse("I want you to get the box open") == parse("open the box")
    two = parse("open the window because it is hot, and close the door")
    assert two == (*parse("open the window"), *parse("close the door"))


@pytest.mark.parametrize("step", JOINTS, ids=str)
def test_every_joint_goal_of_the_library_can_be_said(step: MoveJoint) -> None:
    assert parse(step.text) == (step,)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("open the {}", "close the {}"),
        ("turn on the {}", "turn off the {}"),
        ("push the {} away", "pull the {} closer"),
        ("slide the {} open", "slide the {} shut"),
    ],
)
def test_opposite_sentences_end_in_the_opposite(one: str, other: str) -> None:
    ends = {"articulated_open": "articulated_closed"}
    compared = 0
    for name in dict.fromkeys(noun(each) for each in articulated_classes()):
        try:
            (first,), (second,) = parse(one.format(name)), parse(other.format(name))
        except SentenceError:
            continue
        assert isinstance(first, MoveJoint)
        assert isinstance(second, MoveJoint)
        assert first.asset_class == second.asset_class
        assert ends[first.goal] == second.goal
        compared += 1
    assert compared >= 1


@given(
    st.lists(st.one_of(st.sampled_from(JOINTS), st.builds(Put, st.sampled_from(THINGS), st.sampled_from(PLACES))),
             min_size=1, max_size=4),
    st.sampled_from([" and ", ", ", ", and then ", ". Then ", "; "]),
    st.sampled_from(["", "please ", "Could you ", "Robot, "]),
)  # fmt: skip
def test_sentences_of_the_grammar_give_their_steps(steps: list[Step], join: str, before: str) -> None:
    sentence = before + join.join(each.text.partition(" so that ")[0] for each in steps)
    if any("but leave it ajar" in each.text or " to " in each.text or " for " in each.text for each in steps[:-1]):
        return  # a reason ends the sentence
    doors = [n for n, each in enumerate(steps) if each.classes == ("door",)]
    if any("door" in parts(name) for n in doors for earlier in steps[:n] for name in earlier.classes):
        return  # "the door" is then the door of the earlier object
    puts = [each for each in steps if isinstance(each, Put)]
    places = {thing: [each.destination for each in puts if each.thing == thing] for thing in THINGS}
    if any(one == other for own in places.values() for one, other in itertools.pairwise(own)):
        assert refused(sentence).reason == Refusal.ORDER
        return
    assert parse(sentence) == tuple(steps), sentence


KNOWN = {
    *itertools.chain.from_iterable(vocabulary.nouns()),
    *vocabulary.parts(),
    *vocabulary.statement_verbs().finite,
    *re.findall(r"[a-z]+|'s", (resources.files("gensim2.instructions") / "vocabulary.toml").read_text()),
}


@given(st.lists(st.text("abcdefghijklmnopqrstuvwxyz", min_size=2, max_size=9), min_size=1, max_size=6), st.data())
def test_an_unknown_word_is_never_acted_on(strange: list[str], data: st.DataObject) -> None:
    strange = [word for word in strange if word not in KNOWN]
    if not strange:
        return
    refused(" ".join(strange))
    # A sentence that is understood is refused as soon as one strange word comes in.
    sentence = vocabulary.spelled(data.draw(st.sampled_from(DEVELOPMENT[:24]))["say"])
    at = data.draw(st.integers(0, len(sentence)))
    refused(" ".join([*sentence[:at], strange[0], *sentence[at:]]).replace(" 's", "'s"))


@given(st.text(max_size=200))
def test_any_text_gives_steps_or_a_refusal(text: str) -> None:
    with contextlib.suppress(SentenceError):
        assert parse(text)


@given(st.lists(st.sampled_from(sorted(KNOWN)), min_size=1, max_size=12))
def test_any_order_of_known_words_gives_possible_steps_or_a_refusal(words: list[str]) -> None:
    try:
        steps = parse(" ".join(words).replace(" 's", "'s"))
    except SentenceError:
        return
    for step in steps:
        assert step in solved() if isinstance(step, MoveJoint) else set(step.classes) <= {*THINGS, *PLACES, *SUPPORTS}
        assert not isinstance(step, HandOver) or step.direction in ("left", "right", "away")


def test_no_two_nouns_share_a_spelling() -> None:
    nouns = vocabulary.nouns()
    assert len({each.name for each in nouns.values()}) == len(
        {noun(each) for each in itertools.chain(articulated_classes(), rigid_classes())}
    )


@pytest.mark.parametrize(("half", "understood"), [("development", 127), ("held_out", 121)])
def test_sentences_of_ten_people_are_understood_as_meant_or_refused(half: str, understood: int) -> None:
    written = yaml.safe_load(Path(__file__).with_name(f"ten_people_{half}.yaml").read_text())
    count = 0
    for meant, others in written["paraphrases"].items():
        for other in others:
            with contextlib.suppress(SentenceError):
                assert parse(other) == parse(meant), other
                count += 1
    assert count == understood  # of 129, as docs/results/instructions.md says
    for sentence in written["refused"]:
        refused(sentence)


@pytest.mark.parametrize(
    "sentence",
    [
        "shut the box, there's a draught",
        "the cat keeps getting into the box, so close it",
        "Why is the box still open? Close it!",
        "I've taken out what I needed; close the box back up",
        "no one is using the box, close it",
        "if you get a chance, could you close the box?",
        "close the box, but don't slam it",
        "don't leave the box open",
        "I'd like the lid of the box down",
        "could you see to it that the box is closed?",
        "make sure the box isn't left open",
        "the lid of the box is up, put it down",
        "the box, please, shut it",
        "keep the moths out by closing the box",
        "give the lid of the box a push until it is shut",
    ],
)
def test_an_instruction_beside_other_clauses_is_understood(sentence: str) -> None:
    assert parse(sentence) == parse("close the box")


@pytest.mark.parametrize(
    ("sentence", "reason"),
    [
        ("the drawer should be painted, and close the box", Refusal.UNKNOWN_VERB),
        ("I want the drawer painted and the box closed", Refusal.UNKNOWN_VERB),
        ("it's hot and turn on the fan, close the box", Refusal.UNKNOWN_OBJECT),
        ("because it is late, call a taxi and close the box", Refusal.UNKNOWN_VERB),
        ("close the box, dry the dishes", Refusal.UNKNOWN_VERB),
        ("before closing the box, open the drawer", Refusal.UNKNOWN_VERB),
        ("open the box so that I can reach in and close it", Refusal.AMBIGUOUS),
        ("close the box, I don't want you to close the drawer", Refusal.NEGATION),
        ("the laptop is next to the box, close it", Refusal.AMBIGUOUS),
        ("the box is closed, so close it", Refusal.ORDER),
        ("the box, open the drawer", Refusal.INCOMPLETE),
        ("the drawer, the box, close it", Refusal.INCOMPLETE),
        ("the drawer, the box is heavy, close it", Refusal.INCOMPLETE),
        ("is the box open?", Refusal.EMPTY),
        ("fridge open?", Refusal.UNKNOWN_VERB),
        ("shut the computer down", Refusal.NOT_UNDERSTOOD),
        ("the box was closed yesterday", Refusal.EMPTY),
        ("close the box when I say so", Refusal.NOT_UNDERSTOOD),
    ],
)
def test_a_further_demand_or_a_statement_alone_is_refused(sentence: str, reason: Refusal) -> None:
    assert refused(sentence).reason == reason


def test_many_reasons_in_a_row_take_little_time() -> None:
    start = time.process_time()
    refused("because it can rain" + " and close the box because it can rain" * 17)
    assert time.process_time() - start < 2.0  # s; a few milliseconds, but time that doubles with each reason takes 10 s


def test_sentences_of_other_people_are_understood_as_meant_or_refused() -> None:
    told = yaml.safe_load(Path(__file__).with_name("other_people.yaml").read_text())
    known = {parse(sentence): sentence for sentence in told["paraphrases"]}
    understood = 0
    for sentence, others in told["paraphrases"].items():
        for other in others:
            with contextlib.suppress(SentenceError):
                assert known[parse(other)] == sentence
                understood += 1
    assert understood == 42  # of 48, as docs/results/instructions.md says
    acted = 0
    for sentence in told["unrelated"]:
        with contextlib.suppress(SentenceError):
            assert parse(sentence) not in known, sentence
            acted += 1
    assert acted == 1  # of 40
