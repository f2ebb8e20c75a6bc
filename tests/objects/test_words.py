"""Words for people: a phrase for each end of each joint, and a noun for each object."""

from __future__ import annotations

import re
from typing import get_args

import pytest

from gensim2.objects import Library
from gensim2.objects.words import UNKNOWN, End, noun, words
from gensim2.tasks.library import load_task, task_names

ENDS: tuple[End, ...] = get_args(End)


def test_every_object_of_the_library_has_words(library: Library) -> None:
    articulated = [words(name, end) for name in library.classes("articulated") for end in ENDS]
    assert len(articulated) == 68
    for phrase in articulated:
        assert phrase.usefulness != UNKNOWN, f"{phrase} is from the table, not by the rule"
        assert 0 < phrase.usefulness <= 1
        assert re.fullmatch(r"[A-Z][A-Za-z]*", phrase.name)
        assert re.fullmatch(r"[a-z ]+", phrase.sentence)
        assert f"the {phrase.noun}" in phrase.sentence, "a sentence says what it is about"
        assert "joint" not in phrase.sentence
    nouns = [noun(name) for name in library.classes("rigid")]
    assert len(set(nouns)) == 45
    assert noun("rubiks_cube") == "Rubik's cube"
    assert noun("cracker_box") == "box of crackers"


def test_no_two_tasks_have_one_name_or_one_sentence(library: Library) -> None:
    phrases = [words(name, end) for name in library.classes("articulated") for end in ENDS]
    assert len({phrase.name for phrase in phrases}) == len(phrases)
    assert len({phrase.sentence for phrase in phrases}) == len(phrases)


@pytest.mark.parametrize(
    ("asset_class", "end", "name", "sentence"),
    [
        ("stapler_press", "articulated_closed", "PressStapler", "press the stapler"),
        ("toaster_press", "articulated_open", "PushDownToasterLever", "push down the lever of the toaster"),
        ("bag_lift", "articulated_open", "LiftBag", "lift the bag by its handle"),
        ("faucet", "articulated_closed", "TurnOffFaucet", "turn the faucet off"),
    ],
)
def test_what_people_say(asset_class: str, end: End, name: str, sentence: str) -> None:
    phrase = words(asset_class, end)
    assert (phrase.name, phrase.sentence, phrase.usefulness) == (name, sentence, 1.0)


def test_what_nobody_asks_for_is_hardly_useful() -> None:
    for asset_class, end in (("stapler_press", ENDS[0]), ("coffee_machine", ENDS[1])):
        assert words(asset_class, end).usefulness <= 0.1


@pytest.mark.parametrize(
    ("asset_class", "joint_type", "opened", "closed"),
    [
        ("tool_chest", "revolute", "OpenToolChest: open the tool chest", "CloseToolChest: close the tool chest"),
        ("hatch", "prismatic", "SlideHatchOpen: slide the hatch open", "SlideHatchShut: slide the hatch shut"),
        ("cart_move", "prismatic", "PushCart: push the cart away", "PullCart: pull the cart closer"),
        ("My Lamp-2", "revolute", "OpenMyLamp2: open the my lamp 2", "CloseMyLamp2: close the my lamp 2"),
        ("__", "revolute", "OpenObject: open the object", "CloseObject: close the object"),
    ],
)
def test_a_class_that_no_table_knows_gets_a_plain_phrase(
    asset_class: str, joint_type: str, opened: str, closed: str
) -> None:
    phrases = [words(asset_class, end, joint_type) for end in ENDS]
    assert [f"{p.name}: {p.sentence}" for p in phrases] == [opened, closed]
    assert [p.usefulness for p in phrases] == [UNKNOWN, UNKNOWN]


@pytest.mark.parametrize("name", task_names("paper"))
def test_stored_tasks_call_their_objects_as_people_do(name: str) -> None:
    task = load_task(name)
    for thing in task.objects.values():
        noun = words(thing.asset_class, "articulated_open").noun.split()[-1] if "_" in thing.asset_class else None
        if noun is not None and task.is_single_step:
            assert noun in task.description
