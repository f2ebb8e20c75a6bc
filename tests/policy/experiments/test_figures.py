"""Figures of experiments compared with published ones, their configurations, and the page made from the JSON."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from gensim2.core.errors import InputError
from gensim2.policy.experiments import NAMES, config_of, read_experiment
from gensim2.policy.experiments.config import Arm, ExperimentConfig
from gensim2.policy.experiments.figures import Rate, TaskFigures, difference, summary
from gensim2.policy.experiments.page import figure, write_page
from gensim2.policy.experiments.running import ArmResult, ExperimentRecord, ExperimentResult, opposites, rephrased
from gensim2.tasks.library import load_task, task_names


def test_the_interval_of_a_difference_is_newcombes() -> None:
    gap, (low, high) = difference(Rate(56, 70), Rate(48, 80))  # Newcombe 1998, table II, example (a), method 10
    assert gap == pytest.approx(0.2)
    assert (low, high) == pytest.approx((0.0524, 0.3339), abs=1e-4)
    with pytest.raises(ValueError, match="has no episodes"):
        difference(Rate(1, 2), Rate(0, 0))


def test_what_is_lost_is_seen_less_unseen_over_all_episodes() -> None:
    tasks = [
        TaskFigures("OpenBox", {"seen": Rate(10, 10), "unseen": Rate(8, 10), "blind": Rate(0, 5)}),
        TaskFigures("CloseBox", {"seen": Rate(9, 10), "unseen": Rate(9, 10), "blind": Rate(1, 5)}),
    ]
    told = summary(tasks)
    assert (told["seen_mean"], told["unseen_mean"], told["blind_mean"]) == (0.95, 0.85, 0.1)
    assert told["lost_mean"] == pytest.approx(0.1)
    assert told["episodes"] == 40
    for name in ("seen", "unseen"):
        low, high = told[f"{name}_interval"]
        assert low < told[f"{name}_mean"] < high
    unseen_only = summary([TaskFigures("OpenBox", {"unseen": Rate(8, 10)})])
    assert (unseen_only["said_mean"], unseen_only["transfer_lost_mean"]) == (None, None)
    assert (unseen_only["seen_mean"], unseen_only["seen_interval"], unseen_only["lost_mean"]) == (None, None, None)


def test_what_was_said_counts_tasks_that_have_an_opposite_alone() -> None:
    paired = TaskFigures("OpenBox", {"unseen": Rate(8, 10), "real": Rate(6, 10), "opposite": Rate(1, 5)})
    alone = TaskFigures("MoveBagForward", {"unseen": Rate(2, 10), "real": Rate(2, 10)})
    told = summary([paired, alone])
    assert (told["said_mean"], told["opposite_mean"]) == (0.8, 0.2)
    assert told["transfer_lost_mean"] == pytest.approx(0.1)


def test_a_task_without_other_objects_has_no_figure_of_unseen_ones() -> None:
    bowl = TaskFigures("PutAppleInBowl", {"unseen": Rate(3, 5), "blind": Rate(1, 5)}).as_seen()
    assert bowl.rates == {"seen": Rate(3, 5), "blind": Rate(1, 5)}
    told = summary([bowl, TaskFigures("CloseBox", {"unseen": Rate(10, 10)})])
    assert (told["seen_mean"], told["unseen_mean"], told["lost_mean"], told["episodes"]) == (0.6, 1.0, None, 15)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("small", [False, True])
def test_every_configuration_is_of_tasks_that_there_are(name: Any, small: bool) -> None:
    config = config_of(name, small=small)
    for arm in config.arms:
        specs = [load_task(task) for task in arm.tasks]
        assert all(task.is_single_step for task in specs) == (arm.name not in ("generated-39", "apart", "designed-115"))
        if config.sentences:
            assert opposites(specs)
            assert len(rephrased(specs)) == 2
        taught = [{thing.asset_class for thing in task.objects.values()} for task in specs]
        others = [{thing.asset_class for thing in load_task(task).objects.values()} for task in config.untaught]
        if name == "combinations":  # each object and container is trained, but not this pair
            assert all(other <= set().union(*taught) and other not in taught for other in others)
        else:
            assert not set().union(*taught) & set().union(*others)


def test_the_experiment_of_designed_tasks_has_all_that_come_with_the_package() -> None:
    single, whole = config_of("designed", small=False).arms
    shelf = [load_task(name) for name in task_names("offline")]
    assert set(whole.tasks) == {task.name for task in shelf}
    assert set(single.tasks) == {task.name for task in shelf if task.is_single_step}


def test_an_opposite_wants_the_other_end_of_the_same_joint() -> None:
    names = ("OpenBox", "CloseBox", "CloseLaptop", "SwingDoorOpen", "ToggleDoorClose", "PressToasterLever")
    told = opposites([load_task(name) for name in (*names, "PlaceGolfBallIntoBox")])
    assert told == {
        "open the box": "close the box",
        "close the box": "open the box",
        "swing the door open": "close the door",
        "close the door": "swing the door open",
    }


def test_other_words_are_of_the_whole_suite_and_none_is_a_sentence_of_it() -> None:
    specs = [load_task(name) for name in task_names("paper")]
    said = {task.description for task in specs}
    others = [words for says in rephrased(specs) for words in says.values()]
    assert len(set(others)) == 2 * len(specs)
    assert not said & set(others)
    with pytest.raises(InputError, match="no other words for 'dance'"):
        rephrased([specs[0].model_copy(update={"description": "dance"})])


def test_the_paper_s_arms_have_five_and_fifteen_tasks() -> None:
    arms = {arm.name: len(arm.tasks) for arm in config_of("generalization").arms}
    own = {"generated-5": 5, "generated-15": 15, "real-5": 5, "real-15": 15}
    assert arms == {**own, "mixed-5": 5, "mixed-15": 15}
    counts = [arm.count for arm in config_of("scaling").arms]
    assert (counts[0], counts[-1], len(counts)) == (10, 1000, 6)


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ("minutes: 3", "minutes"),
        ("episodes: 0", "episodes"),
        ("arms: [{name: a, objects: real, count: 0, tasks: [OpenBox]}]", "arms.0.count"),
        ("untaught: [OpenBox]", None),
        ("arms: [{name: A b, objects: real, tasks: [OpenBox]}]", "arms.0.name"),
        ("arms: [{name: a, start: b, objects: real, tasks: [OpenBox]}]", None),
        (
            "arms: [{name: a, objects: real, tasks: [OpenBox]}, {name: b, start: a, objects: real, tasks: [OpenBox]}]",
            None,
        ),
    ],
)
def test_a_field_that_cannot_be_so_is_named(tmp_path: Path, text: str, field: str | None) -> None:
    base = {"title": "a", "about": "a", "minutes_a_task": "1", "scenes": "1", "episodes": "1", "control_episodes": "1"}
    base["arms"] = "[{name: a, objects: generated, tasks: [OpenBox]}]"
    lines = [f"{name}: {value}" for name, value in base.items() if not text.startswith(f"{name}:")]
    path = tmp_path / "arms.yaml"
    path.write_text("\n".join([*lines, text]))
    with pytest.raises(InputError) as caught:
        read_experiment(path)
    assert caught.value.field == field


def _arm(name: str, count: int | None, mean: float) -> ArmResult:
    rates: dict[Any, Rate] = {"unseen": Rate(round(10 * mean), 10), "blind": Rate(0, 5)}
    task = TaskFigures("OpenBox", rates if count else {"seen": Rate(9, 10), **rates})
    arm = Arm(name=name, objects="generated", count=count, tasks=("OpenBox",))
    return ArmResult(arm, (task,), ("policy",), demonstrations=7, cpu_s=3.0)


def test_what_is_lost_is_counted_over_tasks_that_have_both() -> None:
    both = TaskFigures("OpenBox", {"seen": Rate(90, 100), "unseen": Rate(80, 100)})
    unseen_alone = TaskFigures("CloseBox", {"unseen": Rate(100, 100)})
    assert summary([both, unseen_alone])["lost_mean"] == pytest.approx(0.1)
    assert summary([unseen_alone])["lost_mean"] is None


def test_the_page_shows_every_arm_with_its_error_bar(tmp_path: Path) -> None:
    arms = [_arm("few", 10, 0.5), _arm("many", 1000, 0.9), _arm("middle", 100, 0.8)]
    drawn = figure([arm.to_dict() for arm in arms])
    x = {name["words"]: name["x"] for name in drawn["names"]}
    assert x["100 objects"] - x["10 objects"] == pytest.approx(x["1000 objects"] - x["100 objects"], abs=0.2)
    assert len(drawn["marks"]) == 6  # unseen and blind; none on seen objects
    for mark in drawn["marks"]:
        assert mark["high"] < mark["y"] <= mark["low"]  # y points down
    config = ExperimentConfig(
        title="Few & many",
        about="",
        minutes_a_task=1.0,
        scenes=1,
        episodes=10,
        control_episodes=5,
        arms=tuple(each.arm for each in arms),
    )
    record = ExperimentRecord(config=config, seed=0, assets="builtin")
    result = ExperimentResult(str(tmp_path), record, tuple(arms), {"real": "needs a folder"}, remaining=0)
    page = write_page(result.to_dict()).read_text()
    assert "Few &amp; many" in page
    assert len(re.findall("<circle", page)) == 6
    assert "needs a folder" in page
    both = figure([_arm("a", None, 0.5).to_dict(), _arm("b", None, 0.9).to_dict()])
    assert [mark["words"] for mark in both["marks"]] == [
        "a, seen: 0.90",
        "a, unseen: 0.50",
        "a, blind: 0.00",
        "b, seen: 0.90",
        "b, unseen: 0.90",
        "b, blind: 0.00",
    ]
