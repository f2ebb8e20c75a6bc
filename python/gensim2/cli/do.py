"""Command ``gensim2 do``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from gensim2.cli.options import PLANNER, PROCESSES, SCENE, Checkpoint, Ending, command, is_given
from gensim2.cli.output import line, table
from gensim2.cli.typed import Count
from gensim2.core.plural import plural
from gensim2.core.progress import Progress


def _show(result: dict[str, Any]) -> None:
    for number, text in enumerate(result["steps"], 1):
        line(f"{number}. {text}")
    if "episodes" not in result:
        return
    source = "task of the library" if result["is_from_library"] else "new combination of known tasks"
    line(f"{result['task']}: {source}")
    rows = [
        (
            each["seed"],
            *(("no", "yes")[each[name]] for name in ("held", "strict", "stopped")),
            ", ".join(step["name"] for step in each["steps"] if step["done"]),
            each["cause"] or "",
        )
        for each in result["episodes"]
    ]
    table(("seed", "held", "strict", "stopped by itself", "steps done", "cause of failure"), rows)
    low, high = result["held_interval"]
    line(
        f"of {plural(result['episodes_run'], 'episode')} {result['held']} held ({low:.2f} to {high:.2f}), "
        f"{result['strict']} strict; {result['cpu_s']:.1f} s of CPU"
    )
    for film in result["videos"]:
        line(f"video: {film}")
    line(f"report: {Path(result['run_dir']) / 'report.html'}")


@command(
    "library", "seed", *(each for each in SCENE if each != "redraw"), *PLANNER, "out", *PROCESSES, "resume", "videos",
    show=_show,
)  # fmt: skip
def do(
    sentence: str,
    *,
    policy: Checkpoint | None = None,
    episodes: Count = 1,
    steps: bool = False,
    scene_source: str = "perceived",
    progress: Progress,
    **given: Any,
) -> dict[str, Any] | Ending:
    """Carry out an instruction in plain English.

    The command splits SENTENCE into steps, such as "open the box, put the apple into it and close it". Then a
    controller carries out the steps in random scenes, and ends each episode by itself. The command refuses sentences
    that it does not understand, and names the reason. The exit code is 1 if an episode fails the verdict held.

    Args:
        policy: Policy that acts instead of the planner. Give a checkpoint made by gensim2 learn or train, or builtin
            for the packaged policy of the single-step tasks.
        episodes: Number of random scenes.
        steps: Only show the steps, without simulation.
    """
    from gensim2.core.record_files import SCHEMA_VERSION
    from gensim2.instructions.grammar import parse

    if steps:
        return {
            "schema_version": SCHEMA_VERSION,
            "sentence": sentence,
            "steps": [each.text for each in parse(sentence)],
        }
    if policy is not None and (
        is_given(click.get_current_context(), "scene_source") or given["depth_noise"] is not None
    ):
        raise click.UsageError("--scene and --noise are options of the planner, and cannot be combined with --policy.")
    if scene_source == "true" and given["depth_noise"] is not None:
        raise click.UsageError("--noise requires a scene that is estimated from point clouds.")
    from gensim2.doing.carrying_out import do as function

    found = function(sentence, policy=policy, episodes=episodes, scene_source=scene_source, progress=progress, **given)
    return found.to_dict() if found.is_done else Ending(found.to_dict())
