"""Command ``gensim2 demo``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from gensim2.cli.options import EPISODES, PLANNER, PROCESSES, Ending, command
from gensim2.cli.output import line, show_engines
from gensim2.cli.typed import Count
from gensim2.core.plural import plural
from gensim2.core.progress import Progress


def _show(result: dict[str, Any]) -> None:
    line(f"{result['name']}: {plural(result['demos'], 'demonstration')}")
    verdicts = ", ".join(f"{result[name]} {name}" for name in ("paper", "held", "strict"))
    line(f"of {plural(result['episodes_run'], 'episode')} {verdicts}; {result['cpu_s']:.1f} s of CPU")
    show_engines(result["name"], result["episodes_run"], result)
    for cause, count in result["causes"].items():
        line(f"{count} failed: {cause}")
    for note in result["notes"]:
        line(f"note: {note}")
    line(f"report: {Path(result['run_dir']) / 'report.html'}")


@command("library", *EPISODES, *PLANNER, "engines", "out", *PROCESSES, "resume", "videos", show=_show)
def demo(task: str, *, episodes: Count = 5, progress: Progress, **given: Any) -> dict[str, Any] | Ending:
    """Record demonstrations of a task.

    TASK is a task of the library, or a folder with task.yaml and strategies/. An episode becomes a demonstration if it
    passes the verdict held: the goal is true at the end, the scene is then at rest, and the goal stays false in the
    same scene if the robot does not move. The JSON output contains the number of episodes that pass each verdict. It
    also contains the CPU seconds of all processes, not including the time to start them. The exit code is 1 if fewer
    demonstrations succeeded than requested.

    Args:
        episodes: Number of demonstrations to record.
    """
    from gensim2.design import demo as function

    result = function(task, episodes=episodes, progress=progress, **given).to_dict()
    return result if result["demos"] >= episodes else Ending(result)
