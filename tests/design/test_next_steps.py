"""The advice after a run that kept no task."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
import run_folders

from gensim2.design.base import Candidate, CandidateResult, StageResult
from gensim2.design.designs import Design, write_design
from gensim2.design.next_steps import next_steps


@pytest.fixture
def run_dir(tmp_path: Path) -> Path:
    """A run that rejected one task after its verification; most of its episodes failed by a slipped contact."""
    run = run_folders.run_folder(tmp_path / "run")
    shutil.rmtree(run / "tasks")
    return run


def test_causes_of_the_verification_decide(run_dir: Path) -> None:
    (run_dir / "rejected" / "LiftDemo" / "failed_000003.mp4").write_bytes(b"")
    found = next_steps(run_dir)
    assert str(found[0]).endswith(str(run_dir / "rejected" / "LiftDemo" / "failed_000003.mp4"))
    assert str(found[1]).endswith(str(run_dir / "report.html"))
    assert found[2].words.startswith("most failures have the cause 'contact slipped': give the hand something to grip")


def searched(run_dir: Path, *stages: StageResult) -> list[str]:
    """Return the advice after a search whose only candidate has the given results."""
    folder = run_dir / "rejected" / "LiftDemo"
    (folder / "verification.json").unlink(missing_ok=True)
    result = CandidateResult(Candidate("hook", {"open": {"designed": run_folders.CONFIG}}, {}), stages)
    write_design(folder, Design((result,), None, ("no candidate held in physics",)))
    return [step.words for step in next_steps(run_dir)[1:-1]]


def test_causes_of_plans_count_only_if_no_episode_was_simulated(run_dir: Path) -> None:
    planned = StageResult("plan", 9, 0.0, {"unreachable": 9})
    (found,) = searched(run_dir, planned)
    assert found.startswith("most failures have the cause 'keyframe out of reach': place the object where the arm")
    (found,) = searched(run_dir, planned, StageResult("physics", 2, 0.0, {"stopped short": 2}))
    assert found.startswith("most failures have the cause 'stopped short': change the threshold in done")


@pytest.mark.parametrize(
    "causes", [{"time over": 5}, {"stopped short": 2, "object did not move": 2}, {"unheard of": 1}]
)
def test_failures_without_a_common_cause_get_the_general_advice(run_dir: Path, causes: dict[str, int]) -> None:
    found = searched(run_dir, StageResult("physics", 5, 0.0, causes))
    assert len(found) == 2
    assert found[1].startswith("relax the task: ")
