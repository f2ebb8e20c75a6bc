"""``report.html``: everything a run found out, on one page that needs nothing but the run folder."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path
from typing import Any

import jinja2
import yaml

from gensim2.errors import InputError
from gensim2.files import write_atomic
from gensim2.pipeline.runfolder import read_json

#: Candidates shown of a design; the rest are counted.
SHOWN_CANDIDATES = 12

_TEMPLATES = jinja2.Environment(
    loader=jinja2.PackageLoader("gensim2.pipeline", "templates"),
    autoescape=True,
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)


def write_report(run_dir: Path) -> Path:
    """Write ``report.html`` from the files of a run folder, finished or not, and return its path.

    Raises:
        InputError: ``run_dir`` holds no run, or one of its files cannot be read.
    """
    run = read_json(run_dir / "run.json")
    tasks = [_task(folder) for folder in _folders(run_dir / "tasks")]
    rejected = [_task(folder) for folder in _folders(run_dir / "rejected")]
    result = run.get("result") or {}
    reasons = {entry["name"]: entry["reason"] for entry in result.get("rejected", [])}
    for task in rejected:
        task["reason"] = reasons.pop(task["name"], None) or _why_rejected(task)
    page = _TEMPLATES.get_template("report.html.j2").render(
        run=run,
        title=run["arguments"].get("command", "run"),
        command=" ".join(["gensim2", *run.get("command_line", [])]),
        tasks=tasks,
        rejected=rejected,
        only_reasons=reasons,
        notes=result.get("notes", []),
        licenses=_licenses(run),
        demos=sum(task["demos"] for task in tasks),
        shown=SHOWN_CANDIDATES,
    )
    path = run_dir / "report.html"
    write_atomic(path, page)
    return path


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
    spec = _yaml(folder / "task.yaml") or {}
    recorded = folder / "trajectory.json"
    recording = read_json(recorded) if recorded.exists() else {}
    return {
        "name": spec.get("name", folder.name),
        "spec": spec,
        "goal": " and ".join(_criterion(entry) for entry in spec.get("success", [])),
        "spec_text": _text(folder / "task.yaml"),
        "config_text": _text(folder / "solver.yaml"),
        "verification": _verification(folder / "verification.json"),
        "design": _design(folder / "design.json"),
        "video": _beside(folder, "*.mp4"),
        "still": _beside(folder, "*.png"),
        "demos": len(recording.get("episodes", [])),
        "env_id": recording.get("env_info", {}).get("env_id"),
        "files": [f"{folder.parent.name}/{folder.name}/{path.name}" for path in _files(folder)],
    }


def _criterion(entry: dict[str, Any]) -> str:
    word = {"articulated_open": "openness >", "articulated_closed": "openness <"}.get(entry["type"], entry["type"])
    return f"{word} {entry.get('threshold', '')}".strip()


def _verification(path: Path) -> dict[str, Any] | None:
    if not path.exists():
        return None
    value = read_json(path)
    episodes = value["episodes"]
    successes = sum(episode["success"] for episode in episodes)
    trials: Counter[str] = Counter(episode["instance"] for episode in episodes)
    held: Counter[str] = Counter(episode["instance"] for episode in episodes if episode["success"])
    low, high = wilson(successes, len(episodes))
    return {
        "kept": value["kept"],
        "threshold": value["threshold"],
        "trials": len(episodes),
        "successes": successes,
        "rate": successes / len(episodes) if episodes else 0.0,
        "low": low,
        "high": high,
        "causes": Counter(episode["cause"] for episode in episodes if episode["cause"]).most_common(),
        "instances": [(name, held[name], trials[name]) for name in sorted(trials, key=lambda id: (len(id), id))],
        "episodes": episodes,
        "still": sum(bool(episode.get("still_success")) for episode in episodes),
    }


def _design(path: Path) -> dict[str, Any] | None:
    if not path.exists():
        return None
    value = read_json(path)
    candidates = value["candidates"]
    rows = []
    for candidate in candidates:
        physics = [stage for stage in candidate["stages"] if stage.get("name", "physics") == "physics"]
        plan = [stage for stage in candidate["stages"] if stage.get("name") == "plan"]
        rows.append(
            {
                "label": candidate["label"],
                "cause": candidate["cause"],
                "plan": _share(plan),
                "stages": [(round(stage["successes"]), stage["episodes"]) for stage in physics],
                "physics": _share(physics),
            }
        )
    chosen = value.get("chosen")
    return {
        "count": len(rows),
        "planned": sum(row["plan"] is None or row["plan"] > 0 for row in rows),
        "tried": sum(bool(row["stages"]) for row in rows),
        "held": sum(bool(row["physics"]) for row in rows),
        "episodes": sum(trials for row in rows for _, trials in row["stages"]),
        "rows": rows[:SHOWN_CANDIDATES],
        "chosen": chosen if isinstance(chosen, int) else None,
        "notes": value.get("notes", []),
    }


def _share(stages: list[dict[str, Any]]) -> float | None:
    trials = sum(stage["episodes"] for stage in stages)
    return sum(stage["successes"] for stage in stages) / trials if trials else None


def _why_rejected(task: dict[str, Any]) -> str:
    if (verification := task["verification"]) is not None:
        held, trials, needed = verification["successes"], verification["trials"], verification["threshold"]
        return f"{held} of {trials} fresh episodes held; {needed:.0%} are needed"
    if (design := task["design"]) is not None and design["notes"]:
        return str(design["notes"][-1])
    return "the run ended before it was verified"


def _licenses(run: dict[str, Any]) -> list[tuple[str, list[str]]]:
    """Each licence with the objects under it."""
    objects: dict[str, list[str]] = {}
    for name, license in sorted(run.get("licenses", {}).items()):
        objects.setdefault(license, []).append(name)
    return list(objects.items())


def _files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.iterdir() if path.is_file() and not path.name.startswith("."))


def _beside(folder: Path, pattern: str) -> str | None:
    """Path of the first match, relative to the run folder."""
    found = sorted(folder.glob(pattern))
    return f"{folder.parent.name}/{folder.name}/{found[0].name}" if found else None


def _text(path: Path) -> str | None:
    return path.read_text() if path.exists() else None


def _yaml(path: Path) -> dict[str, Any] | None:
    if not path.exists():
        return None
    try:
        value = yaml.safe_load(path.read_text())
    except yaml.YAMLError as error:
        raise InputError(f"is not YAML: {error}", file=path, remedy="restore or delete the file") from error
    if not isinstance(value, dict):
        raise InputError("is not a mapping", file=path, remedy="restore or delete the file")
    return value
