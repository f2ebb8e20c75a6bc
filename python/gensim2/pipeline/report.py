"""``report.html``: everything a run found out, on one page that needs nothing but the run folder."""

from __future__ import annotations

import contextlib
import math
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gensim2.episodes.trajectory import JSON_NAME
from gensim2.errors import InputError
from gensim2.files import write_atomic
from gensim2.pipeline.reading import read_record
from gensim2.pipeline.records import (
    DesignRecord,
    RecordingSummary,
    ResultSummary,
    RunRecord,
    RunSummary,
    StageRecord,
    Verification,
)
from gensim2.pipeline.runfolder import RUN_JSON, TaskFolder
from gensim2.tasks.library import load_task_file

if TYPE_CHECKING:
    from jinja2 import Template

#: Candidates shown of a design; the rest are counted.
SHOWN_CANDIDATES = 12


@cache
def _template() -> Template:
    import jinja2  # here: refusing arguments needs no page

    templates = jinja2.Environment(
        loader=jinja2.PackageLoader("gensim2.pipeline", "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.filters["openness"] = lambda value: "no number" if value is None else f"{value:.2f}"
    return templates.get_template("report.html.j2")


def write_report(run_dir: Path) -> Path:
    """Write ``report.html`` from the files of a run folder, finished or not, and return its path.

    Raises:
        InputError: ``run_dir`` holds no run, or one of its files cannot be read.
    """
    run = read_record(run_dir / RUN_JSON, RunRecord, "restore the file")
    summary = read_record(run_dir / RUN_JSON, RunSummary, "restore the file")
    tasks = [_task(folder) for folder in _folders(run_dir / "tasks")]
    rejected = [_task(folder) for folder in _folders(run_dir / "rejected")]
    result = summary.result or ResultSummary()
    reasons = {entry.name: entry.reason for entry in result.rejected}
    for task in rejected:
        task["reason"] = reasons.pop(task["name"], None) or _why_rejected(task)
    page = _template().render(
        run=run.model_dump(),
        asked=summary.arguments,
        command=" ".join(["gensim2", *run.command_line]),
        tasks=tasks,
        rejected=rejected,
        only_reasons=reasons,
        notes=result.notes,
        licenses=_licenses(run.licenses),
        demos=sum(task["demos"] for task in tasks),
        shown=SHOWN_CANDIDATES,
    )
    path = run_dir / "report.html"
    write_atomic(path, page)
    return path


@contextlib.contextmanager
def reported(run_dir: Path) -> Iterator[None]:
    """Leave a report behind, however the block ends; except where a file of the folder cannot be read."""
    try:
        yield
    except InputError:
        raise
    except BaseException:
        write_report(run_dir)
        raise
    write_report(run_dir)


def wilson(successes: int, trials: int) -> tuple[float, float]:
    """95 % confidence interval of a rate (Wilson 1927); (0, 1) without trials."""
    if trials == 0:
        return 0.0, 1.0
    z = 1.959964
    rate, spread = successes / trials, z * z / trials
    center = (rate + spread / 2) / (1 + spread)
    half = z * math.sqrt(rate * (1 - rate) / trials + spread / (4 * trials)) / (1 + spread)
    return max(0.0, center - half), min(1.0, center + half)


def _folders(parent: Path) -> list[Path]:
    return sorted(path for path in parent.iterdir() if path.is_dir()) if parent.is_dir() else []


def _task(folder: Path) -> dict[str, Any]:
    spec = load_task_file(folder / "task.yaml").model_dump(mode="json") if (folder / "task.yaml").exists() else {}
    files = TaskFolder(folder)
    recorded = folder / JSON_NAME
    recording = read_record(recorded, RecordingSummary, "delete the file and resume") if recorded.exists() else None
    return {
        "name": spec.get("name", folder.name),
        "spec": spec,
        "goal": " and ".join(_criterion(entry) for entry in spec.get("success", [])),
        "spec_text": _text(folder / "task.yaml"),
        "config_text": _text(folder / "solver.yaml"),
        "verification": _verification(files.verification()),
        "design": _design(files.design()),
        "video": _beside(folder, "*.mp4"),
        "still": _beside(folder, "*.png"),
        "demos": len(recording.episodes) if recording is not None else 0,
        "env_id": recording.env_info.env_id if recording is not None else None,
        "files": [f"{folder.parent.name}/{folder.name}/{path.name}" for path in _files(folder)],
    }


def _criterion(entry: dict[str, Any]) -> str:
    word = {"articulated_open": "openness >", "articulated_closed": "openness <"}.get(entry["type"], entry["type"])
    return f"{word} {entry.get('threshold', '')}".strip()


def _verification(verification: Verification | None) -> dict[str, Any] | None:
    if verification is None:
        return None
    attempts = verification.attempts
    trials: Counter[str] = Counter(attempt.instance for attempt in attempts)
    held: Counter[str] = Counter(attempt.instance for attempt in attempts if attempt.success)
    low, high = wilson(verification.successes, len(attempts))
    return {
        "kept": verification.kept,
        "threshold": verification.threshold,
        "trials": len(attempts),
        "successes": verification.successes,
        "rate": verification.rate,
        "low": low,
        "high": high,
        "causes": list(verification.causes().items()),
        "instances": [(name, held[name], trials[name]) for name in sorted(trials, key=lambda id: (len(id), id))],
        "episodes": [attempt.to_dict() for attempt in attempts],
        "still": sum(bool(attempt.still_success) for attempt in attempts),
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
    if (verification := task["verification"]) is not None:
        held, trials, needed = verification["successes"], verification["trials"], verification["threshold"]
        return f"{held} of {trials} fresh episodes held; {needed:.0%} are needed"
    if (design := task["design"]) is not None and design["notes"]:
        return str(design["notes"][-1])
    return "the run ended before it was verified"


def _licenses(licenses: dict[str, str]) -> list[tuple[str, list[str]]]:
    """Each licence with the objects under it."""
    objects: dict[str, list[str]] = {}
    for name, license in sorted(licenses.items()):
        objects.setdefault(license, []).append(name)
    return list(objects.items())


def _files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.iterdir() if path.is_file() and not path.name.startswith("."))


def _beside(folder: Path, pattern: str) -> str | None:
    """Path of the first match, relative to the run folder."""
    found = sorted(folder.glob(pattern))
    return f"{folder.parent.name}/{folder.name}/{found[0].name}" if found else None


def _text(path: Path) -> str | None:
    return path.read_text(encoding="utf-8", errors="replace") if path.exists() else None
