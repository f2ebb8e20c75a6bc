"""Write ``report.html``, a page with all results of a run, from the files of the run folder."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from gensim2.core.errors import InputError
from gensim2.core.files import write_atomic
from gensim2.core.foreign.limits import MAX_RECORD
from gensim2.core.foreign.tree import ForeignTree, read_input
from gensim2.core.pages import template
from gensim2.core.record_files import read_record
from gensim2.data.records import RecordingSummary, ResultSummary, RunRecord, RunSummary, Verification
from gensim2.data.runfolder import RUN_JSON, TaskFolder
from gensim2.data.store import TaskStore
from gensim2.data.trajectory import JSON_NAME
from gensim2.design.designs import DesignRecord, StageRecord, read_design
from gensim2.design.model_report import ModelReport
from gensim2.design.next_steps import NextStep, next_steps
from gensim2.rollout.episode_log import ATTEMPTS, read_log
from gensim2.rollout.record import Episode, StrictMiss
from gensim2.rollout.tally import Tally, interval
from gensim2.tasks.library import load_task_file
from gensim2.tasks.spec import Step, TaskSpec
from gensim2.tasks.wording import criteria_in_words, name_in_words

#: Maximum number of candidates shown for a task.
SHOWN_CANDIDATES = 12

#: Name of the picture of a task's plan, in the task's folder.
PLAN_PICTURE = "plan.png"


def write_report(run_dir: Path) -> Path:
    """Write ``report.html`` from the files of a run folder, finished or not, and return its path.

    Raises:
        InputError: ``run_dir`` holds no run, a link leads out of the folder, or a file cannot be read.
    """
    ForeignTree(run_dir).refuse_links_out()
    run = read_record(run_dir / RUN_JSON, RunRecord, "restore the file")
    summary = read_record(run_dir / RUN_JSON, RunSummary, "restore the file")
    model = ModelReport(run_dir)
    tasks = [_task(folder, model) for folder in _folders(run_dir / "tasks")]
    rejected = [_task(folder, model) for folder in _folders(run_dir / "rejected")]
    result = summary.result or ResultSummary()
    reasons = {entry.name: entry.reason for entry in result.rejected}
    for task in rejected:
        task["reason"] = reasons.pop(task["name"], None) or _why_rejected(task)
    page = template("gensim2.design", "report.html.j2").render(
        run=run.model_dump(),
        asked=summary.arguments,
        command=" ".join(["gensim2", *run.command_line]) if run.command_line else None,
        tasks=tasks,
        rejected=rejected,
        only_reasons=reasons,
        notes=result.notes,
        licenses=_licenses(run.licenses),
        demos=sum(task["demos"] for task in tasks),
        shown=SHOWN_CANDIDATES,
        model=model.of_run(),
        unfilmed=_why_unfilmed(run, run_dir),
        advice=[(step.words, _links(step, run_dir)) for step in next_steps(run_dir)],
    )
    path = run_dir / "report.html"
    write_atomic(path, page)
    return path


def _links(step: NextStep, run_dir: Path) -> list[tuple[str, str]]:
    """Return the target and the text of each link that the report shows for an advice."""
    if step.report is not None:
        return [(f"#{folder.name}", folder.name) for folder in step.files]
    return [(path.relative_to(run_dir).as_posix(), f"{path.parent.name}, {path.name}") for path in step.files]


@contextlib.contextmanager
def reported(run_dir: Path) -> Iterator[None]:
    """Write the report when the block ends, even after an exception; skip it if a file of the folder is unreadable."""
    try:
        yield
    except InputError:
        raise
    except BaseException:
        write_report(run_dir)
        raise
    write_report(run_dir)


def _folders(parent: Path) -> list[Path]:
    return sorted(path for path in parent.iterdir() if path.is_dir()) if parent.is_dir() else []


def _task(folder: Path, model: ModelReport) -> dict[str, Any]:
    source = folder / "task.yaml"
    spec = load_task_file(source) if source.exists() else None
    files = TaskFolder(folder)
    recorded = folder / JSON_NAME
    recording = read_record(recorded, RecordingSummary, "delete the file and resume") if recorded.exists() else None
    verification = files.verification()
    design = read_design(files.path)
    best = design.candidates[0].label if design is not None and design.candidates else None
    logged = TaskStore(folder).logged() or read_log(folder / ATTEMPTS)
    return {
        "name": spec.name if spec is not None else folder.name,
        "spec": spec,
        "classes": list(dict.fromkeys(thing.asset_class for thing in spec.objects.values())) if spec else [],
        "goal": criteria_in_words(spec.success) if spec else "",
        "steps": [_step(step) for step in spec.steps] if spec and not spec.is_single_step else [],
        "texts": [(path.name, _text(path)) for path in (source, *sorted(folder.glob("strategies/*.yaml")))],
        "checker": files.checker(),
        "verification": _verification(verification, spec),
        "collection": _figures(logged, spec) if logged else None,
        "design": _design(design),
        "best": best,
        "model": model.of_task(spec.name if spec is not None else folder.name),
        "video": _beside(folder, "video.mp4"),
        "still": _beside(folder, "still.png"),
        "films": _films(folder, logged if verification is None else verification.episodes, best),
        "plan": _beside(folder, PLAN_PICTURE),
        "demos": len(recording.episodes) if recording is not None else 0,
        "env_id": recording.env_info.env_id if recording is not None else None,
        "files": [f"{folder.parent.name}/{folder.name}/{path.name}" for path in _files(folder)],
    }


def _films(folder: Path, episodes: Sequence[Episode], best: str | None) -> list[tuple[str, str]]:
    """Return path and caption of a task's videos, without that of the first demonstration, shown separately."""
    found = []
    for path in sorted(folder.glob("*_*.mp4")):
        word, _, number = path.stem.partition("_")
        if word not in ("video", "held", "failed") or not number.isdecimal():
            continue
        caption = {"video": f"demonstration {number}", "held": "held", "failed": "failed"}[word]
        if word == "failed" and not episodes:
            caption = f"the best candidate: {best}" if best else "the best candidate"
        elif word != "video" and int(number) < len(episodes):
            episode = episodes[int(number)]
            caption = f"seed {episode.seed}: {'held' if episode.held else episode.cause}"
        found.append((f"{folder.parent.name}/{folder.name}/{path.name}", caption))
    return found


def _why_unfilmed(run: RunRecord, run_dir: Path) -> str:
    """Return the reason why a task has no video, as a sentence for the report."""
    if run.arguments.get("videos") == 0:
        return "no pictures: videos were disabled (--videos 0)"
    why = "; if this failed, errors.log says why" if (run_dir / "errors.log").exists() else ""
    return f"no video of this task was made{why}"


def _step(step: Step) -> dict[str, Any]:
    return {
        "name": name_in_words(step.name),
        "object": step.object,
        "tool": step.tool,
        "strategies": list(step.strategies),
        "done": criteria_in_words(step.done),
    }


def _verification(verification: Verification | None, spec: TaskSpec | None) -> dict[str, Any] | None:
    if verification is None:
        return None
    return {
        **_figures(verification.episodes, spec),
        "kept": verification.kept,
        "threshold": verification.threshold,
        "rate": verification.rate,
        "seen": verification.instances == "all",
        "second": _second(verification),
        "instances": sum(Tally.of(verification.episodes).objects.values()),
    }


def _second(verification: Verification) -> dict[str, Any] | None:
    """Return the success rates in the second engine, and the scenes with different outcomes in the two engines."""
    if (second := verification.second) is None:
        return None
    pairs = list(zip(verification.episodes, second.episodes, strict=True))
    return {
        "engine": second.engine,
        "held": second.tally.held,
        "trials": second.tally.episodes,
        "interval": interval(second.tally.held, second.tally.episodes),
        "lost": [again.seed for one, again in pairs if one.held and not again.held],
        "won": [again.seed for one, again in pairs if again.held and not one.held],
        "causes": sorted(second.tally.causes.items()),
    }


def _figures(episodes: Sequence[Episode], spec: TaskSpec | None) -> dict[str, Any]:
    """Return the page's statistics: success rates with intervals, causes, results by object and by step."""
    tally = Tally.of(episodes)
    names = [step.name for step in spec.steps] if spec is not None else []
    return {
        "trials": tally.episodes,
        "verdicts": [(name, count, *interval(count, tally.episodes)) for name, count in tally.verdicts().items()],
        "held": tally.held,
        "engines": list(tally.engines.items()),
        "disagreed": tally.disagreed,
        "partial": tally.partial,
        "replanned": tally.replanned,
        "still": tally.still,
        "causes": list(tally.causes.items()),
        "misses": [item for item in tally.strict_misses.items() if item[0] != StrictMiss.NOT_HELD],
        "objects": list(tally.objects.items()),
        "openness": [_travel(episode) for episode in episodes] if _has_one_joint(episodes) else [],
        "steps": [_turns(name, episodes) for name in names] if len(names) > 1 else [],
    }


def _has_one_joint(episodes: Sequence[Episode]) -> bool:
    return all(len(episode.objects) == 1 for episode in episodes)


def _travel(episode: Episode) -> dict[str, Any]:
    thing = next(iter(episode.objects.values()))
    return {
        "seed": episode.seed,
        "object": thing.id,
        "start": thing.openness_start,
        "end": thing.openness_end,
        "held": episode.held,
        "cause": episode.cause,
    }


def _turns(name: str, episodes: Sequence[Episode]) -> dict[str, Any]:
    turns = [step for episode in episodes for step in episode.steps if step.name == name]
    strategies = Counter(turn.plans[-1].strategy for turn in turns if turn.plans)
    return {
        "name": name_in_words(name),
        "begun": len(turns),
        "paper": sum(turn.paper for turn in turns),
        "partial": sum(turn.partial for turn in turns),
        "replans": sum(turn.replans for turn in turns),
        "strategies": ", ".join(f"{name_in_words(strategy)} {count}" for strategy, count in strategies.most_common()),
    }


def _design(design: DesignRecord | None) -> dict[str, Any] | None:
    if design is None:
        return None
    rows: list[dict[str, Any]] = []
    for candidate in design.candidates:
        physics = [stage for stage in candidate.stages if stage.name == "physics"]
        plan = [stage for stage in candidate.stages if stage.name == "plan"]
        rows.append(
            {
                "label": candidate.label,
                "cause": candidate.cause,
                "plan": _share(plan),
                "stages": [(round(stage.successes), stage.episodes) for stage in physics],
                "physics": _share(physics),
                "interval": interval(
                    round(sum(stage.successes for stage in physics)), sum(stage.episodes for stage in physics)
                )
                if physics
                else None,
                "told": next(([each.words for each in s.diagnoses] for s in candidate.stages[::-1] if s.diagnoses), []),
            }
        )
    return {
        "count": len(rows),
        "planned": sum(row["plan"] is None or row["plan"] > 0 for row in rows),
        "tried": sum(bool(row["stages"]) for row in rows),
        "held": sum(bool(row["physics"]) for row in rows),
        "episodes": sum(trials for row in rows for _, trials in row["stages"]),
        "rows": rows[:SHOWN_CANDIDATES],
        "chosen": design.chosen,
        "notes": design.notes,
    }


def _share(stages: list[StageRecord]) -> float | None:
    trials = sum(stage.episodes for stage in stages)
    return sum(stage.successes for stage in stages) / trials if trials else None


def _why_rejected(task: dict[str, Any]) -> str:
    if (checker := task["checker"]) is not None and not checker.passes:
        return str(checker.reason)
    if (verification := task["verification"]) is not None:
        held, trials, needed = verification["held"], verification["trials"], verification["threshold"]
        where = ""
        if (second := verification["second"]) is not None:
            where = f", and {second['held']} of {second['trials']} in {second['engine']}"
        return f"{held} of {trials} fresh episodes succeeded{where}; {needed:.0%} are needed"
    if (design := task["design"]) is not None and design["notes"]:
        return str(design["notes"][-1])
    return "the run ended before it was verified"


def _licenses(licenses: dict[str, str]) -> list[tuple[str, list[str]]]:
    objects: dict[str, list[str]] = {}
    for name, license in sorted(licenses.items()):
        objects.setdefault(license, []).append(name)
    return list(objects.items())


def _files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.iterdir() if path.is_file() and not path.name.startswith("."))


def _beside(folder: Path, pattern: str) -> str | None:
    """Return the path, relative to the run folder, of the first file that matches ``pattern``; None without a match."""
    found = sorted(folder.glob(pattern))
    return f"{folder.parent.name}/{folder.name}/{found[0].name}" if found else None


def _text(path: Path) -> str | None:
    return read_input(path, MAX_RECORD).decode(errors="replace") if path.exists() else None
