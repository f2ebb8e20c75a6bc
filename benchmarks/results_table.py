"""Success rates as Markdown: every table of the documents, made of the package's figures.

    python benchmarks/figures.py results/*.json                             # what benchmarks found, into the figures
    python benchmarks/results_table.py --into README.md docs/results/physics.md docs/results/tasks*.md
    python benchmarks/results_table.py results/*.json > tables.md        # of these files of `gensim2 benchmark` alone
    python benchmarks/results_table.py --switches results/*.json --into docs/results/physics.md   # physics switches

Rows of switches are on scenes of their own and stand in `switches.json` beside this file, where new ones take the place
of those of the same scenes and physics.
`--into` rewrites the text between `<!-- figures: NAME -->` and `<!-- /figures -->` in a file. NAME is `all`, `claims`,
`short`, `means`, `switches`, `overview`, `objects`, `engines`, `designed`, `policy`, or `section` with the title of a
section. A cell holds the success rates paper / held (with its 95 % interval) / strict. The tables `short` and `means`
hold one rate: held, or paper under the original's physics.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from statistics import mean, stdev

import engines_table
from figures import rows_of
from markdown_tables import line, markdown_table
from results_claims import TYPES, claims

from gensim2.core.errors import InputError
from gensim2.core.files import write_atomic, write_json
from gensim2.rollout.tally import interval
from gensim2.scenes.physics import DEFAULT_PHYSICS, PHYSICS_NAMES
from gensim2.tasks.figures import Condition, Figure, figures
from gensim2.tasks.library import load_task
from gensim2.tasks.published import MEASURED, MEASURED_IN_ALL, PAPER

WHERE = [("default", "generated"), ("default", "real"), ("original", "generated"), ("original", "real")]
"""Columns: whose physics, and which objects."""
MEASURED_TASKS = {"single-step": 24, "long-horizon": 15}
"""Tasks of a table below which the release's share over all of them does not stand in it."""
MIN_EPISODES = 5
"""Of an object for its share to be named."""
SWITCHES = Path(__file__).with_name("switches.json")
MARKED = re.compile(r"(<!-- figures: ([\w ']+) -->\n).*?(<!-- /figures -->)", re.DOTALL)

Cell = Callable[[Figure], str]


def everything(rows: Sequence[Figure]) -> str:
    """Means of all conditions, then a section each, the paper's protocol first, in it a table a type of tasks."""
    return "\n".join([overview(rows), *(section(title, rows) for title in sections(rows)), objects(rows)])


def sections(rows: Sequence[Figure]) -> dict[str, list[Figure]]:
    """Return the rows of each condition by its title, the paper's protocol first."""
    found: dict[str, list[Figure]] = {}
    rows = [row for row in rows if row.condition.physics in PHYSICS_NAMES]  # mixtures have a table of their own
    for row in sorted(rows, key=lambda row: not row.condition.is_plain):
        title = what_differs(row.condition)
        found.setdefault(title[0].upper() + title[1:], []).append(row)
    return found


def short(rows: Sequence[Figure]) -> str:
    """The paper's protocol alone, one verdict a cell: held in the default physics, paper in the original's."""
    return _tables([row for row in rows if row.condition.is_plain], _one_verdict, averages=_average_of_one)


def means(rows: Sequence[Figure]) -> str:
    """Return the mean success rates under the paper's protocol, one row per type of task."""
    plain = [row for row in rows if row.condition.is_plain]
    tables = {kind: [row for row in plain if _type(row.task) == kind] for kind in TYPES}
    found = [
        (kind, _table(kind, members, _one_verdict, _average_of_one, columns=_columns(plain)).splitlines())
        for kind, members in tables.items()
        if members
    ]
    head = [each.replace(f"{kind} task", "tasks") for kind, lines in found[:1] for each in lines[:2]]
    return "\n".join([*head, *(lines[-1].replace("mean", kind, 1) for kind, lines in found)]) + "\n"


def switches(rows: Sequence[Figure]) -> str:
    """Table of what each switch of the physics costs or gives, turned to the original's alone, on the same scenes.

    A row of the table is of the tasks that were measured under the default and with that switch, of as many episodes of
    the same seed on the same objects. Points are those of the mean over tasks; the interval is that of the mean of the
    tasks' differences (normal, by its standard error over tasks).

    Raises:
        InputError: nothing can be compared.
    """
    plain = {_scenes(row): row for row in rows if row.condition.physics == DEFAULT_PHYSICS}
    found: dict[tuple[str, str], list[tuple[Figure, Figure]]] = {}
    for row in rows:
        before = plain.get(_scenes(row))
        if before is not None and row.condition.physics != DEFAULT_PHYSICS:
            found.setdefault((row.condition.physics, _type(row.task)), []).append((before, row))
    head = ["physics", "tasks", "episodes each", "paper", "held", "strict"]
    lines = []
    for (physics, kind), pairs in found.items():
        sizes = sorted({row.episodes for _, row in pairs})
        cells = (_points(pairs, verdict) for verdict in ("paper", "held", "strict"))
        lines.append([f"`{physics}`", f"{len(pairs)} {kind}", " or ".join(map(str, sizes)), *cells])
    if not found:
        raise InputError("hold no switch and its default on the same scenes", field="results")
    return markdown_table(head, lines)


def take_in(rows: Sequence[Figure]) -> None:
    """Keep rows for :func:`switches`, without what each object did; they replace those of the same scenes."""
    before = measured_switches() if SWITCHES.exists() else []
    found = {(_scenes(row), row.condition.physics): row for row in (*before, *rows)}
    kept = [row.model_copy(update={"instances": {}}).model_dump(mode="json") for row in found.values()]
    write_json(SWITCHES, {"schema_version": 1, "rows": kept})


def measured_switches() -> list[Figure]:
    """Rows that were kept for :func:`switches`."""
    return [Figure.model_validate(row) for row in json.loads(SWITCHES.read_text(encoding="utf-8"))["rows"]]


def _scenes(row: Figure) -> tuple[str, str, int, int]:
    """Return what a row's scenes follow from, physics apart."""
    return row.task, row.condition.model_copy(update={"physics": ""}).model_dump_json(), row.seed, row.episodes


def _points(pairs: Sequence[tuple[Figure, Figure]], verdict: str) -> str:
    """Mean difference in points, with its 95 % interval where there are several tasks."""
    gains = [
        100 * (getattr(row, verdict) / row.episodes - getattr(before, verdict) / before.episodes)
        for before, row in pairs
    ]
    half = 1.96 * stdev(gains) / len(gains) ** 0.5 if len(gains) > 1 else None
    return f"{mean(gains):+.1f}" + (
        "" if half is None else f" ({mean(gains) - half:+.1f} to {mean(gains) + half:+.1f})"
    )


def what_differs(condition: Condition) -> str:
    """In what a condition is not the paper's protocol, physics and objects apart."""
    named = (
        (condition.engine != "sapien", f"engine {condition.engine}"),
        (condition.robot != "panda", f"robot {condition.robot}"),
        (condition.instances != "all", f"instances {condition.instances}"),
        (condition.randomization != "paper", f"randomization {condition.randomization}"),
        (condition.attempts > 1, f"up to {condition.attempts} attempts"),
        (condition.open_loop, "open loop"),
        (condition.one_plan, "one plan a step"),
        (condition.disturbance is not None, f"disturbance {condition.disturbance}"),
    )
    return ", ".join(words for holds, words in named if holds) or "The paper's protocol"


def overview(rows: Sequence[Figure]) -> str:
    """Return the means over tasks of every condition."""
    head = ["", "tasks", *(f"{physics}, {objects}" for physics, objects in WHERE)]
    lines = [line(head), line(["---"] * len(head))]
    for title, members in sections(rows).items():
        for kind in TYPES:
            places = [[row for row in members if _type(row.task) == kind and _where(row) == where] for where in WHERE]
            if any(places):
                cells = (_average_of_three(place) if place else "" for place in places)
                lines.append(line([title, kind, *cells]))
    return "\n".join(["## Means over tasks\n", *lines]) + "\n"


def section(title: str, rows: Sequence[Figure]) -> str:
    """Return the tables of one condition below its heading."""
    rows = sections(rows)[title]
    sizes = sorted({(row.runs, row.episodes // row.runs) for row in rows})
    shown = " or ".join(f"{runs} run{'s' * (runs > 1)} of {episodes} episodes" for runs, episodes in sizes)
    seeds = sorted({row.seed for row in rows})
    used = f"The seed is {seeds[0]}" if len(seeds) == 1 else f"The seeds are {', '.join(map(str, seeds))}"
    head = f"## {title}\n\nEach success rate in the following tables was measured in {shown}. {used}. {_made(rows)}\n"
    return f"{head}\n{_tables(rows, _three_verdicts, averages=_average_of_three)}"


def _made(rows: Sequence[Figure]) -> str:
    """Return sentences with the commits and dates of a section's rows; older rows have none."""
    found: dict[str, list[str]] = {}
    for date, commit in sorted({(row.source.date, row.source.commit[:12]) for row in rows if row.source is not None}):
        found.setdefault(commit, []).append(date)
    commits = ", ".join(f"{commit} ({' and '.join(dates)})" for commit, dates in found.items())
    made = [f"The rates were measured at these commits of gensim2: {commits}."] if found else []
    older = sum(row.source is None for row in rows)
    if older:
        which = f"all {older}" if older == len(rows) else f"{older} of {len(rows)}"
        made.append(f"The commit of {which} rates is unknown, because earlier measurements did not record it.")
    return " ".join(made)


def objects(rows: Sequence[Figure]) -> str:
    """Return a section with each row's object of the lowest success rate; older rows do not know their objects."""
    rows = [row for members in sections(rows).values() for row in members]
    known = [row for row in rows if row.instances and row.condition.objects == "real"]
    conditions = sorted({row.condition.in_words for row in known})
    if not known:
        return ""
    lines = [line(["task", *conditions]), line(["---"] * (len(conditions) + 1))]
    by_place = {(row.task, row.condition.in_words): row for row in known}
    for task in sorted({row.task for row in known}, key=_rank):
        cells = (by_place.get((task, condition)) for condition in conditions)
        lines.append(line([task, *("" if row is None else _worst(row) for row in cells)]))
    head = (
        "## The worst object of each row\n\nEach cell names the real object with the lowest success rate. The "
        "fraction before the name is the number of successful episodes (verdict `held`) over the number of all "
        f"episodes with this object. Objects with fewer than {MIN_EPISODES} episodes are ignored.\n"
    )
    return "\n".join([head, *lines]) + "\n"


def _worst(row: Figure) -> str:
    enough = [
        (each.held / each.episodes, name) for name, each in row.instances.items() if each.episodes >= MIN_EPISODES
    ]
    if not enough:
        return ""
    _, name = min(enough)
    each = row.instances[name]
    return f"{each.held}/{each.episodes} {name}"


def _tables(rows: Sequence[Figure], cell: Cell, averages: Callable[[Sequence[Figure]], str]) -> str:
    found = []
    for kind in TYPES:
        members = [row for row in rows if _type(row.task) == kind]
        if members:
            found.append(_table(kind, members, cell, averages, columns=_columns(members)))
    return "\n".join(found)


def _columns(rows: Sequence[Figure]) -> list[tuple[str, str]]:
    return [where for where in WHERE if any(_where(row) == where for row in rows)]


def _table(
    kind: str,
    rows: Sequence[Figure],
    cell: Cell,
    averages: Callable[[Sequence[Figure]], str],
    *,
    columns: Sequence[tuple[str, str]],
) -> str:
    by_place = {(row.task, *_where(row)): row for row in rows}
    tasks = sorted({row.task for row in rows}, key=_rank)
    lines = [
        line([f"{kind} task", *(f"{physics}, {objects}" for physics, objects in columns), "paper", "its release"]),
        line(["---"] * (len(columns) + 3)),
    ]
    for task in tasks:
        cells = [by_place.get((task, *where)) for where in columns]
        lines.append(line([task, *("" if row is None else cell(row) for row in cells), *_published(task)]))
    members = [[by_place[task, *where] for task in tasks if (task, *where) in by_place] for where in columns]
    published = [_mean(PAPER[task][0] for task in tasks if task in PAPER)]
    in_all = MEASURED_IN_ALL[kind] if len(tasks) >= MEASURED_TASKS[kind] else None
    published.append("" if in_all is None else f"{_with_interval(*in_all)} of {in_all[1]}")
    return "\n".join([*lines, line(["mean", *map(averages, members), *published])]) + "\n"


def _where(row: Figure) -> tuple[str, str]:
    return row.condition.physics, row.condition.objects


def _type(task: str) -> str:
    return TYPES[0] if load_task(task).is_single_step else TYPES[1]


def _rank(task: str) -> tuple[int, str]:
    """In the paper's order, others after them."""
    return (list(PAPER).index(task) if task in PAPER else len(PAPER)), task


def _published(task: str) -> tuple[str, str]:
    measured = MEASURED.get(task)
    return (
        f"{PAPER[task][0]:.2f}" if task in PAPER else "",
        "" if measured is None else _with_interval(*measured),
    )


def _three_verdicts(row: Figure) -> str:
    held = _with_interval(row.held, row.episodes)
    return f"{row.paper / row.episodes:.2f} / {held} / {row.strict / row.episodes:.2f}"


def _one_verdict(row: Figure) -> str:
    return _with_interval(_counting(row), row.episodes)


def _counting(row: Figure) -> int:
    return row.paper if row.condition.physics == "original" else row.held


def _with_interval(count: int, of: int) -> str:
    low, high = interval(count, of)
    return f"{count / of:.2f} ({low:.2f}–{high:.2f})"


def _average_of_three(rows: Sequence[Figure]) -> str:
    counts: tuple[Callable[[Figure], int], ...] = (lambda r: r.paper, lambda r: r.held, lambda r: r.strict)
    return " / ".join(_mean(count(row) / row.episodes for row in rows) for count in counts) + f" (of {len(rows)})"


def _average_of_one(rows: Sequence[Figure]) -> str:
    return f"{_mean(_counting(row) / row.episodes for row in rows)} (of {len(rows)})" if rows else ""


def _mean(rates: Iterable[float]) -> str:
    found = list(rates)
    return f"{mean(found):.2f}" if found else ""


def renewed(text: str, rows: Sequence[Figure]) -> str:
    """A document with the tables between its marks written anew.

    Raises:
        InputError: it has no marks.
    """
    makers: dict[str, Callable[[Sequence[Figure]], str]] = {
        "all": everything,
        "claims": claims,
        "short": short,
        "means": means,
        "switches": lambda _: switches(measured_switches()),
        "overview": overview,
        "objects": objects,
        "engines": engines_table.suite,
        "designed": engines_table.designed,
        "policy": engines_table.policy,
    }
    makers |= {f"section {title}": partial(section, title) for title in sections(rows)}
    for _, name, _ in MARKED.findall(text):
        if name not in makers:
            raise InputError(f"has no figures {name!r}", remedy=f"name one of {', '.join(makers)}")
    found, count = MARKED.subn(lambda match: f"{match[1]}\n{makers[match[2]](rows)}\n{match[3]}", text)
    if not count:
        raise InputError("has no <!-- figures: all --> ... <!-- /figures -->", remedy="write the marks into it")
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path, nargs="*", help="in place of the figures: JSON of gensim2 benchmark")
    parser.add_argument("--into", type=Path, nargs="+", default=[], help="documents to write the tables into")
    parser.add_argument("--switches", action="store_true", help="of the files: what each physics switch is worth")
    options = parser.parse_args()
    try:
        rows = [row for path in options.results for row in rows_of(path)]
        if options.switches and rows:
            take_in(rows)
        if options.switches or not rows:
            rows = list(figures().rows)
        for path in options.into:
            write_atomic(path, renewed(path.read_text(encoding="utf-8"), rows))
    except InputError as error:
        sys.exit(f"results_table: {error}")
    if not options.into:
        print(switches(measured_switches()) if options.switches else everything(rows))


if __name__ == "__main__":
    main()
