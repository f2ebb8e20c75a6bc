"""Tables of experiments, made from the JSON output of the command."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from gensim2.policy.experiments import config_of
from gensim2.policy.experiments.figures import Rate, TaskFigures
from gensim2.policy.experiments.running import ArmResult, ExperimentRecord, ExperimentResult

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture
def module(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import experiment_table

    yield experiment_table
    del sys.modules["experiment_table"]


def test_an_arm_and_its_tasks_have_a_row_each(module: ModuleType) -> None:
    config = config_of("breadth", small=True)
    seen = {"seen": Rate(10, 10), "unseen": Rate(9, 10), "opposite": Rate(0, 5)}
    tasks = (TaskFigures("TurnOnFaucet", seen), TaskFigures("TurnOffFaucet", {"unseen": Rate(8, 10)}))
    arm = ArmResult(config.arms[0], tasks, ("/home/somebody/policy",), 70, 90.0)
    record = ExperimentRecord(config=config, seed=3, assets="builtin")
    told = ExperimentResult("/home/somebody", record, (arm,), {}, 0).to_dict()
    arms = module.arms_of(told, "0123abcd")
    assert "somebody" not in str(arms)
    table = module.table(arms)
    assert "| generated-2 | 1.000 (0.722 to 1.000) of 10 | 0.850 (0.640 to 0.948) of 20 |" in table
    assert "| 3 | 0123abcd | 2 | 1 | 70 | 2 | +10.0" in table  # the task that was measured on both
