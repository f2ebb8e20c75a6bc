"""``experiment --resume`` with damaged records: an error of one line, or the experiment as configured."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

sys.path.append(str(Path(__file__).parents[2] / "fuzz"))

from mutate import damaged

from gensim2.core.errors import InputError
from gensim2.objects.library.catalogue import BUILTIN
from gensim2.policy.experiments import running
from gensim2.policy.experiments.config import ExperimentConfig

from .test_experiment import CONFIG

COUNT = 40


class Reached(Exception):
    """Raised where the first training would start."""


@pytest.mark.parametrize("name", ["experiment.json", "result.json"])
def test_damaged_records(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def reached(*_: object) -> None:
        raise Reached

    monkeypatch.setattr(running, "_train", reached)
    config = ExperimentConfig.model_validate({**yaml.safe_load(CONFIG), "seeds": 2})
    found = running.runnable(running.ExperimentRecord(config=config, seed=0, assets=BUILTIN))
    monkeypatch.setattr(running, "runnable", lambda _: found)
    with pytest.raises(Reached):
        running.run_experiment(config, out=tmp_path, assets=BUILTIN)
    (tmp_path / "result.json").write_text('{"schema_version": 1, "remaining": 3}')
    path = tmp_path / name
    good, said = path.read_bytes(), list[str]()
    for number in range(COUNT):
        path.unlink(missing_ok=True)
        if number == 0:
            os.mkfifo(path)
        else:
            path.write_bytes(damaged(good, "json", np.random.default_rng([3, number])))
        try:
            running.run_experiment(config, out=tmp_path, assets=BUILTIN, resume=True)
        except InputError as error:
            said.append(str(error))
        except Reached:
            said.append("")
    assert len(said) == COUNT
    assert "is a pipe" in said[0]
    assert all(len(line.splitlines()) <= 1 for line in said)
