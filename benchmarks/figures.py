"""Store benchmark results in the package; tables, pages and `tasks show` use them.

.venv/bin/python benchmarks/figures.py results/*.json
.venv/bin/python benchmarks/figures.py --remake DIR --assets OBJECTS [--shown]     # runs missing benchmarks, stores all
.venv/bin/python benchmarks/figures.py --page by_instance.html                     # writes a page of results by object

Each file is the output of `gensim2 benchmark --json FILE`. A row replaces an earlier row of the same task and
condition. With `--only`, rows that no given file contains are removed. The archive stores the episodes of each row, one
episode on each line. `--remake` repeats the episodes of all rows, with one command for all rows that have the same
condition and seed. A command that was interrupted continues when the script is run again.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import io
import lzma
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from statistics import mean, pstdev
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, Field

from gensim2.core.errors import InputError
from gensim2.core.files import write_atomic
from gensim2.core.foreign.limits import MAX_RECORD
from gensim2.core.foreign.tree import read_input
from gensim2.core.pages import template
from gensim2.core.record_files import read_record
from gensim2.evaluation.benchmark_table import by_instance
from gensim2.rollout.config import RolloutOptions, nested_options
from gensim2.rollout.record import Episode, ObjectRecord
from gensim2.rollout.tally import Tally
from gensim2.scenes.config import SceneOptions
from gensim2.tasks import figures as stored
from gensim2.tasks.figures import Condition, Figure, Figures, Source, Verdicts, parse_figures

FILE = Path(stored.__file__).with_name(stored.FIGURES)
ARCHIVE = Path(__file__).resolve().with_name("episodes")
PAGE = Path(__file__).with_name("instances.html.j2")

_REMEDY = "give a file that `gensim2 benchmark --json FILE` wrote"


class _Arguments(BaseModel):
    seed: int
    runs: Annotated[int, Field(ge=1)]
    episodes: Annotated[int, Field(ge=1)]
    instances: str
    scene: SceneOptions
    rollout: RolloutOptions


class _Row(BaseModel):
    name: str
    records: list[Episode]


class _Document(BaseModel):
    arguments: Annotated[_Arguments, BeforeValidator(nested_options)]
    tasks: list[_Row]
    provenance: Source | None = None


def read_figures(path: Path) -> Figures:
    """Read the measured results in a file.

    Raises:
        InputError: the file cannot be read or is invalid; the message names the field.
    """
    return parse_figures(read_input(path, MAX_RECORD), path)


def rows_of(path: Path) -> list[Figure]:
    """Return a row for each task of a benchmark, computed from its episodes; rates in the file are ignored.

    Raises:
        InputError: as :func:`rows_with_episodes`.
    """
    return [row for row, _ in rows_with_episodes(path)]


def rows_with_episodes(path: Path) -> list[tuple[Figure, list[Episode]]]:
    """Return a row for each task of a benchmark, and the episodes that it counts.

    Raises:
        InputError: the file is not a benchmark result, or a task does not have the number of episodes in the arguments.
    """
    document = read_record(path, _Document, _REMEDY)
    given = document.arguments
    condition: dict[str, Any] = {
        **given.scene.to_record(),
        **given.rollout.to_record(),
        "instances": given.instances,
        "objects": "generated" if given.scene.assets == "builtin" else "real",
    }
    del condition["assets"]
    rows = []
    for task in document.tasks:
        if len(task.records) != given.runs * given.episodes:
            message = f"{task.name} has {len(task.records)} episodes, not {given.runs} x {given.episodes}"
            raise InputError(message, file=path, field="tasks", remedy=_REMEDY)
        rows.append((_row(task, Condition(**condition), given, document.provenance), task.records))
    if document.provenance is None or not rows:
        return rows
    # The stored command must not contain paths of the user's machine.
    command = " ".join(("gensim2", *command_of([row for row, _ in rows], "OBJECTS")))
    source = document.provenance.model_copy(update={"command": command})
    return [(row.model_copy(update={"source": source}), episodes) for row, episodes in rows]


def _row(task: _Row, condition: Condition, given: _Arguments, source: Source | None) -> Figure:
    tally = Tally.of(task.records)
    runs = [task.records[run * given.episodes : (run + 1) * given.episodes] for run in range(given.runs)]
    return Figure(
        task=task.name,
        condition=condition,
        seed=given.seed,
        runs=given.runs,
        episodes=tally.episodes,
        **tally.verdicts(),
        deviation=pstdev(mean(episode.paper for episode in run) for run in runs),
        partial=tally.partial,
        causes=tally.causes,
        strict_misses=tally.strict_misses,
        objects=tally.objects,
        instances={name: Verdicts(**counts) for name, counts in by_instance(task.records).items()},
        source=source,
    )


def command_of(rows: Sequence[Figure], assets: str | None) -> list[str]:
    """Return the arguments of the ``gensim2 benchmark`` command that repeats rows of one condition and seed.

    Args:
        rows: rows, one for each task.
        assets: folder of the real objects; None for generated objects.

    Raises:
        InputError: the rows have real objects, and no folder is given.
    """
    first, condition = rows[0], rows[0].condition
    if condition.objects == "real" and assets is None:
        raise InputError("these figures are of real objects", field="assets", remedy="give the folder of the objects")
    given = {
        "--runs": first.runs,
        "--episodes": first.episodes // first.runs,
        "--seed": first.seed,
        "--assets": "builtin" if condition.objects == "generated" else assets,
        "--engine": condition.engine,
        "--physics": condition.physics,
        "--robot": condition.robot,
        "--instances": condition.instances,
        "--randomization": condition.randomization,
        "--attempts": condition.attempts,
        "--disturb": condition.disturbance,
        "--method": "one-plan" if condition.one_plan else "chain",
    }
    words = [word for name, value in given.items() if value is not None for word in (name, str(value))]
    return ["benchmark", *(row.task for row in rows), *words, *(["--open-loop"] if condition.open_loop else [])]


def made_together(rows: Sequence[Figure]) -> list[list[Figure]]:
    """Group rows that one command can repeat, in the order of the first row of each group."""
    found: dict[tuple[Condition, int, int, int], list[Figure]] = {}
    for row in rows:
        found.setdefault((row.condition, row.seed, row.runs, row.episodes), []).append(row)
    return list(found.values())


LOW = 0.5
"""Success rate below which the page prints an object in bold."""


def page_by_instance(rows: Sequence[Figure]) -> str:
    """Return an HTML page with the results of each row by object; rows without known objects are only counted."""
    known = [row for row in rows if row.instances]
    values = {"rows": known, "without": len(rows) - len(known), "low": LOW}
    pages = template("gensim2.core.pages", "base.html.j2").environment
    return pages.from_string(PAGE.read_text()).render(values)


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
    """Return the file name of a condition, built from the settings by which conditions differ."""
    words = [condition.physics, condition.objects, *condition.deviations]
    plain = "-".join(words).lower()
    return "".join(each if each.isalnum() or each in "-+=" else "_" for each in plain) + SUFFIX


def archived(row: Figure, episodes: Sequence[Episode]) -> list[dict[str, str]]:
    """Return the columns of the archive lines of a row's episodes."""
    return [_line(row, index, episode) for index, episode in enumerate(episodes)]


def put_into_archive(folder: Path, found: Iterable[tuple[Figure, Sequence[Episode]]]) -> list[Path]:
    """Write the episodes of rows to the files of their conditions, replacing older episodes of the same task.

    Returns:
        Written files.

    Raises:
        InputError: an existing file is damaged.
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
    """Return the columns of an archive file.

    Raises:
        InputError: the file cannot be read, or is not an archive.
    """
    try:
        text = lzma.decompress(path.read_bytes()).decode()
    except (OSError, lzma.LZMAError, UnicodeDecodeError) as error:
        raise InputError(f"cannot be read: {error}", file=path, remedy="write it with benchmarks/figures.py") from error
    reader = csv.DictReader(io.StringIO(text))
    if tuple(reader.fieldnames or ()) != COLUMNS:
        raise InputError("has other columns", file=path, field="header", remedy="write it with benchmarks/figures.py")
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


def main() -> None:
    """Read the arguments and store the results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path, nargs="*", help="JSON output files of gensim2 benchmark")
    parser.add_argument("--only", action="store_true", help="remove rows that no given file contains")
    parser.add_argument(
        "--remake",
        type=Path,
        metavar="DIR",
        help="repeat all benchmarks whose output is not in DIR, and write the outputs to DIR",
    )
    parser.add_argument("--assets", metavar="DIR", help="folder of the real objects, for --remake")
    parser.add_argument("--shown", action="store_true", help="only print the commands of --remake")
    parser.add_argument(
        "--page", type=Path, metavar="FILE", help="write an HTML page with the results of each row by object"
    )
    parser.add_argument("--out", type=Path, default=FILE, help="file of results  [default: the file in the package]")
    parser.add_argument(
        "--archive",
        type=Path,
        default=ARCHIVE,
        metavar="DIR",
        help="folder of the archive of episodes  [default: the archive of the project]",
    )
    options = parser.parse_args()
    if not (options.results or options.remake or options.page):
        parser.error("give JSON files, --remake or --page")
    try:
        results = list(options.results)
        if options.remake is not None:
            results += remade(read_figures(options.out).rows, options.remake, options.assets, options.shown)
        if results:
            put_in(results, options.out, options.archive, options.only)
        if options.page is not None:
            write_atomic(options.page, page_by_instance(read_figures(options.out).rows))
    except InputError as error:
        sys.exit(f"figures: {error}")


def put_in(results: Sequence[Path], out: Path, archive: Path, only: bool) -> None:
    """Store the rows of benchmarks in the file of results, and their episodes in the archive."""
    counted = [pair for path in results for pair in rows_with_episodes(path)]
    rows = [row for row, _ in counted]
    fresh = only or not out.exists()
    before = Figures(schema_version=1, rows=()) if fresh else read_figures(out)
    keys = [(row.task, row.condition) for row in rows]
    if len(set(keys)) < len(keys):
        raise InputError("two files contain the same task with the same condition", field="results")
    replaced = {(row.task, row.condition): row for row in (*before.rows, *rows)}
    found = Figures(schema_version=1, rows=tuple(sorted(replaced.values(), key=_order)))
    put_into_archive(archive, counted)
    lines = ",\n".join(row.model_dump_json() for row in found.rows)
    text = f'{{"schema_version":1,"rows":[\n{lines}\n]}}\n'
    write_atomic(out, lzma.compress(text.encode(), preset=9) if out.suffix == ".xz" else text)
    print(f"{len(rows)} rows in, {len(found.rows)} in {out}")


def _order(row: Figure) -> tuple[str, bool, tuple[str, ...]]:
    """Return the sort key of a row. Rows are sorted by task. Among the rows of a task, rows that were measured under
    the paper's protocol come first, and the rows are then sorted by their conditions.
    """
    return row.task, not row.condition.is_plain, tuple(str(value) for _, value in row.condition)


def remade(rows: Sequence[Figure], folder: Path, assets: str | None, shown: bool) -> list[Path]:
    """Run the benchmarks of rows whose JSON is not in ``folder``; return the files. With ``shown`` only print them."""
    commands = [command_of(group, assets) for group in made_together(rows)]
    found = []
    for words in commands:
        name = hashlib.sha256(shlex.join(words).encode()).hexdigest()[:12]
        run, file = folder / name, folder / f"{name}.json"
        line = ["gensim2", *words, "--out", str(run), "--json", str(file), *(["--resume"] if run.exists() else [])]
        if shown:
            print(shlex.join(line))
            continue
        if not file.exists():
            folder.mkdir(parents=True, exist_ok=True)
            code = subprocess.run([str(Path(sys.executable).with_name("gensim2")), *line[1:]], check=False).returncode
            if code or not file.exists():
                raise InputError(f"ended with {code}: {shlex.join(line)}", remedy="run it again: it goes on")
        found.append(file)
    return found


if __name__ == "__main__":
    main()
