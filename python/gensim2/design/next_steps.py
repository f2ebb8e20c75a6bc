"""Advise the user after a run that kept no task, according to the reasons for which the tasks were rejected."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from gensim2.core.record_files import read_record
from gensim2.data.records import RunSummary
from gensim2.data.runfolder import RUN_JSON, TaskFolder
from gensim2.design.designs import read_design
from gensim2.rollout.record import Cause

_REACH = (
    "place the object where the arm reaches its keypoints from several sides (place and randomization in task.yaml), "
    "or move the keypoints: gensim2 assets import --keypoint"
)

_GRIP = (
    "give the hand something to grip, hook or push: look at the keypoint `head` (gensim2 assets render), move the "
    "keypoint (gensim2 assets import --keypoint), or add a handle to the model"
)

#: Advice for the most frequent cause of failure.
_OF_CAUSE = {
    Cause.NO_CONTACT: _GRIP,
    Cause.CONTACT_SLIPPED: _GRIP,
    Cause.NO_ACTUATION_POSE: _REACH,
    Cause.KEYFRAME_OUT_OF_REACH: _REACH,
    Cause.COLLISION_ON_THE_WAY: _REACH,
    Cause.WRONG_WAY: (
        "check the sign of the joint axis in the URDF: the openness must grow when the object opens "
        "(gensim2 assets render shows the object closed and open)"
    ),
    Cause.STOPPED_SHORT: "change the threshold in done, or check how far the joint moves: gensim2 assets validate",
    Cause.HAPPENS_BY_ITSELF: (
        "change the start of the object (randomization in task.yaml), because the goal becomes true without the robot"
    ),
}

#: Advice for all other causes of failure.
_OF_OTHER_CAUSES = (
    "check that the keypoints lie where a hand should act, and that the arm can reach them: gensim2 assets render",
    "relax the task: the thresholds in done, the ranges of randomization, the place of the object",
)


@dataclass(frozen=True)
class NextStep:
    """Advice after a run that kept no task.

    Attributes:
        words: the advice.
        files: files that the user should open: films, or the folders of the tasks that the report shows.
        report: the report, if the user should read it there; otherwise None.
    """

    words: str
    files: tuple[Path, ...] = ()
    report: Path | None = None

    def __str__(self) -> str:
        if self.report is not None:
            return f"{self.words} in {self.report}"
        return f"{self.words}: {', '.join(map(str, self.files))}" if self.files else self.words


def next_steps(run_dir: Path) -> list[NextStep]:
    """Return advice after a run that kept no task, most important first, from the files of the run folder.

    Raises:
        InputError: a file of the folder cannot be read.
    """
    summary = read_record(run_dir / RUN_JSON, RunSummary, "restore the file")
    folders = sorted(path for path in (run_dir / "rejected").glob("*/") if path.is_dir())
    searched = [folder for folder in folders if read_design(folder) is not None]
    if folders and not searched and summary.arguments.command == "design":
        return [
            NextStep("correct task.yaml as the reason of the rejection says"),
            NextStep(f"then delete {run_dir} or choose another --out, and run the command again"),
        ]
    found = []
    if films := [film for folder in searched for film in sorted(folder.glob("failed_*.mp4"))[:1]]:
        found.append(NextStep("watch the videos of failed episodes", tuple(films[:3])))
    found.append(NextStep("read the causes and the residuals of the plans", tuple(searched), run_dir / "report.html"))
    causes: Counter[str] = Counter()
    for folder in searched:
        causes.update(_causes(TaskFolder(folder)))
    found += map(NextStep, _of_causes(causes))
    found.append(NextStep("write a strategy by hand and plan it: gensim2 solve"))
    return found


def _of_causes(causes: Counter[str]) -> Iterable[str]:
    """Return advice for the cause of more than half of the failures. Without such a cause, return general advice."""
    for cause, count in causes.most_common(1):
        if 2 * count > causes.total() and cause in _OF_CAUSE:
            return [f"most failures have the cause {str(cause)!r}: {_OF_CAUSE[Cause(cause)]}"]
    return _OF_OTHER_CAUSES


def _causes(files: TaskFolder) -> Counter[str]:
    """Count a task's failures by cause: of the verification, else of the search's episodes, else of its plans."""
    from gensim2.rollout.diagnose import PLAN_CAUSES  # import late, because this module loads SciPy

    if (verification := files.verification()) is not None:
        return Counter(str(episode.cause) for episode in verification.episodes if episode.cause is not None)
    design = read_design(files.path)
    stages = [stage for candidate in design.candidates for stage in candidate.stages] if design is not None else []
    simulated = [stage for stage in stages if stage.name == "physics"]
    found: Counter[str] = Counter()
    for stage in simulated or stages:
        for word, count in stage.causes.items():
            found[PLAN_CAUSES.get(word, word)] += count
    return found
