"""Episodes behind the figures: one line each, in one compressed CSV file a condition."""

from __future__ import annotations

import csv
import io
import lzma
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

from gensim2.errors import InputError
from gensim2.files import write_atomic
from gensim2.rollout.record import Episode, ObjectRecord
from gensim2.tasks.figures import Condition, Figure

SUFFIX = ".csv.xz"
COLUMNS = (
    "task",
    "run_seed",
    "index",
    "seed",
    "objects",
    "placement_draws",
    "openness_start",
    "openness_end",
    "position_end",
    "control_steps",
    "paper",
    "held",
    "strict",
    "cause",
    "misses",
)
"""``run_seed`` is the command's, ``seed`` the reset's. Values of several objects are joined by ``" + "``: openness of
those with a joint, (x, y, z) of the others at the end, m."""


def archive_name(condition: Condition) -> str:
    """Return the name of a condition's file: its words that differ from one condition to another."""
    words = [condition.physics, condition.objects, *condition.deviations]
    plain = "-".join(words).lower()
    return "".join(each if each.isalnum() or each in "-+=" else "_" for each in plain) + SUFFIX


def archived(row: Figure, episodes: Sequence[Episode]) -> list[dict[str, str]]:
    """Return the lines of a row's episodes, by column."""
    return [_line(row, index, episode) for index, episode in enumerate(episodes)]


def put_into_archive(folder: Path, found: Iterable[tuple[Figure, Sequence[Episode]]]) -> list[Path]:
    """Write the episodes of rows into their conditions' files, in place of older ones of the same task.

    Returns:
        The files that were written.

    Raises:
        InputError: a file that is there is damaged.
    """
    files: dict[Path, dict[str, list[dict[str, str]]]] = {}
    for row, episodes in found:
        path = folder / archive_name(row.condition)
        if path not in files:
            files[path] = _by_task(read_archive(path)) if path.exists() else {}
        files[path][row.task] = archived(row, episodes)
    folder.mkdir(parents=True, exist_ok=True)
    for path, tasks in files.items():
        text = io.StringIO()
        writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(line for name in sorted(tasks) for line in tasks[name])
        write_atomic(path, lzma.compress(text.getvalue().encode(), preset=9))
    return list(files)


def read_archive(path: Path) -> list[dict[str, str]]:
    """Return the lines of a file, by column.

    Raises:
        InputError: it cannot be read, or is no such file.
    """
    try:
        text = lzma.decompress(path.read_bytes()).decode()
    except (OSError, lzma.LZMAError, UnicodeDecodeError) as error:
        raise InputError(f"cannot be read: {error}", file=path, remedy="write it with scripts/figures.py") from error
    reader = csv.DictReader(io.StringIO(text))
    if tuple(reader.fieldnames or ()) != COLUMNS:
        raise InputError("has other columns", file=path, field="header", remedy="write it with scripts/figures.py")
    return list(reader)


def _by_task(lines: Iterable[Mapping[str, str]]) -> dict[str, list[dict[str, str]]]:
    found: dict[str, list[dict[str, str]]] = {}
    for line in lines:
        found.setdefault(line["task"], []).append(dict(line))
    return found


def _line(row: Figure, index: int, episode: Episode) -> dict[str, str]:
    things = list(episode.objects.values())
    return {
        "task": row.task,
        "run_seed": str(row.seed),
        "index": str(index),
        "seed": str(episode.seed),
        "objects": " + ".join(f"{each.asset_class}/{each.id}" for each in things),
        "placement_draws": str(episode.placement_draws),
        "openness_start": _joined(things, lambda each: each.openness_start),
        "openness_end": _joined(things, lambda each: each.openness_end),
        "position_end": " + ".join(
            " ".join(f"{value:.3f}" for value in each.pose_end[:3]) for each in things if each.pose_end is not None
        ),
        "control_steps": str(episode.control_steps),
        **{name: str(int(getattr(episode, name))) for name in ("paper", "held", "strict")},
        "cause": "" if episode.cause is None else str(episode.cause),
        "misses": " + ".join(map(str, episode.strict_misses)),
    }


def _joined(things: Iterable[ObjectRecord], openness: Callable[[ObjectRecord], float | None]) -> str:
    return " + ".join(f"{value:.3f}" for each in things if (value := openness(each)) is not None)
