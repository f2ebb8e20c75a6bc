"""The tasks of the offline designer: verified, new, varied, and described as a person would."""

from __future__ import annotations

from collections import Counter

from gensim2.design.drafting import chains, verbs
from gensim2.objects import open_library
from gensim2.tasks.library import load_strategies, load_task, task_names
from gensim2.tasks.likeness import joint_goal, likeness, normal_form, why_alike
from gensim2.tasks.spec import TaskSpec

LIBRARY = open_library("builtin")
TASKS = [load_task(name) for name in task_names("offline")]
SINGLE = [task for task in TASKS if task.is_single_step]
LONG = [task for task in TASKS if not task.is_single_step]


def joints(task: TaskSpec) -> int:
    return sum(LIBRARY.kind(thing.asset_class) == "articulated" for thing in task.objects.values())


def test_there_are_a_hundred_of_many_kinds() -> None:
    assert min(len(SINGLE), len(LONG)) >= 50
    assert len({thing.asset_class for task in TASKS for thing in task.objects.values()}) >= 25
    assert len({verbs(task) for task in LONG}) >= 12
    assert sum(joints(task) >= 2 for task in LONG) >= 5


def test_each_was_verified_on_objects_that_no_search_saw() -> None:
    for task in TASKS:
        assert task.provenance is not None
        told = task.provenance.verification
        assert told is not None
        assert told.episodes == 50
        assert told.share >= (0.8 if task.is_single_step else 0.6), task.name
        assert told.instances == ("new" if joints(task) else "all")
        assert load_strategies(task.name)
        assert chains(task) == []


def test_none_is_another_one_or_of_the_suite_in_other_words() -> None:
    forms = Counter((normal_form(task).words, normal_form(task).goal) for task in TASKS)
    assert max(forms.values()) == 1
    suite = [load_task(name) for name in task_names("paper")]
    for task in TASKS:
        classes = normal_form(task).classes
        # Half open from closed and half closed from open are the same goal, but different to a person.
        others = [
            other
            for other in (*suite, *TASKS)
            if other is not task and normal_form(other).classes == classes and joint_goal(other) == joint_goal(task)
        ]
        assert not [other.name for other in others if why_alike(task, other)], task.name


def test_no_more_than_three_differ_only_in_the_rigid_object() -> None:
    def shape(task: TaskSpec) -> str:
        kinds = {
            name: thing.asset_class if LIBRARY.kind(thing.asset_class) == "articulated" else "rigid"
            for name, thing in task.objects.items()
        }
        begins = [(kinds[name], kinds.get(thing.place.on)) for name, thing in task.objects.items()]
        steps = [(verb, kinds[step.object]) for verb, step in zip(verbs(task), task.steps, strict=True)]
        goal = [(c.type, getattr(c, "direction", ""), [kinds[name] for name in c.objects]) for c in task.success]
        return f"{begins} {steps} {goal}"

    with_rigid = [task for task in TASKS if joints(task) < len(task.objects)]
    assert max(Counter(map(shape, with_rigid)).values()) <= 3


def test_each_is_asked_for_in_a_sentence_of_its_own() -> None:
    sentences = Counter(task.description for task in TASKS)
    assert max(sentences.values()) == 1
    assert all(sentence[0].islower() and not sentence.endswith(".") and "_" not in sentence for sentence in sentences)


def test_likeness_is_the_share_of_common_letters_whatever_the_order_of_words() -> None:
    assert likeness(("lid", "close", "lid"), ("close", "lid")) == 100.0
    assert likeness(("abcd",), ("bxd",)) == 400 / 7
    assert likeness(("a",), ()) == 0.0
