"""Former names still load, with a warning of one line that gives the present name."""

from __future__ import annotations

import json
from dataclasses import asdict

import pytest
from pydantic import TypeAdapter

from gensim2.core import renamed
from gensim2.rollout.record import AttemptRecord, Cause
from gensim2.scenes.physics import physics_name, physics_switches


@pytest.fixture(autouse=True)
def _untold() -> None:
    renamed._tell.cache_clear()
    physics_switches.cache_clear()


def test_a_former_name_is_told_once(capsys: pytest.CaptureFixture[str]) -> None:
    assert physics_name("default") == "default"
    assert capsys.readouterr().err == ""
    assert physics_name("ours") == physics_name("ours+gripper=default") == "default"
    said = "physics 'ours' is called 'default'; the next release will not accept the old name\n"
    assert capsys.readouterr().err == said


def test_a_record_with_a_former_cause_loads(capsys: pytest.CaptureFixture[str]) -> None:
    record = AttemptRecord(0, {}, paper=True, held=False, strict=False, cause=Cause.HAPPENS_BY_ITSELF)
    today = json.dumps(asdict(record))
    former = today.replace("happens in the no-op baseline", "happens with a still arm")
    assert former != today
    assert TypeAdapter(AttemptRecord).validate_json(former) == record
    assert "'happens in the no-op baseline'" in capsys.readouterr().err
    with pytest.raises(ValueError, match="cause"):
        TypeAdapter(AttemptRecord).validate_json(today.replace("no-op baseline", "end"))
