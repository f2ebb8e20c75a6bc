"""Write the tables of estimated scenes, from the JSON of `gensim2 perceive measure` and `gensim2 benchmark`.

    python benchmarks/perception_table.py FILE.json ... --commit HASH     # stores results, writes tables
    python benchmarks/perception_table.py                                 # writes tables of stored results

A file is a result of ``gensim2 perceive measure builtin``, or of ``gensim2 benchmark`` with ``--scene perceived`` or on
the true scene. The results are stored in ``perception.json`` in this folder. The tables are in
docs/results/perception.md, docs/results/perceived_tasks.md and docs/results/perceived_designed.md.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from markdown_tables import Row, fill, markdown_table, take_in

from gensim2.cli.perceive import error_cells
from gensim2.objects import open_library
from gensim2.rollout.tally import interval
from gensim2.tasks.library import PAPER, load_task, origin_of

FIGURES = Path(__file__).with_name("perception.json")
_RESULTS = Path(__file__).parents[1] / "docs/results"
PAGES = (_RESULTS / "perception.md", _RESULTS / "perceived_tasks.md", _RESULTS / "perceived_designed.md")
DESIGNED = "offline"
"""Origin of the tasks of the offline designer."""
MARKED = re.compile(r"(<!-- perception: (\w+) -->\n).*?(<!-- /perception -->)", re.DOTALL)
ALL, GIVEN = "all, class estimated", "all, class given"
OBJECTS = ("generated", "real")
COLUMNS = (
    ("true scene, generated", ("true", "generated", "none")),
    ("estimated, generated", ("perceived", "generated", "none")),
    ("true scene, real", ("true", "real", "none")),
    ("estimated, real", ("perceived", "real", "none")),
    ("estimated, generated, depth noise", ("perceived", "generated", "deployed")),
)


def rows_of(found: Mapping[str, Any], commit: str) -> Iterator[Row]:
    """Yield one row for each class of a measurement, or for each task of a benchmark.

    Raises:
        ValueError: another estimator than the packaged one was measured.
    """
    if "estimated_classes" in found:
        if found["estimator"] != "builtin":
            raise ValueError(f"the measurement is of {found['estimator']}; measure the builtin estimator")
        about = {"what": "estimates", "scene": "none", "objects": _objects(found["assets"]), "noise": _noise(found)}
        named = {ALL: found["estimated"], GIVEN: found["given"], **found["classes"]}
        for name, figures in named.items():
            classes = found["estimated_classes"]
            alike = [name] if name in classes else list(classes)
            shape = sum(_alike(each, classes[each]) for each in alike)
            yield {**about, "name": name, **figures, "shape": shape, "commit": commit}
        return
    # Benchmarks leave out the default values of these options.
    asked = {"scene_source": "true", "depth_noise": None, **found["arguments"]}
    if asked["scene_source"] not in ("true", "perceived"):
        raise ValueError(f"the scene is {asked['scene_source']}; measure with --scene perceived or true")
    for task in found["tasks"]:
        yield {
            "what": "task",
            "name": task["name"],
            "scene": asked["scene_source"],
            "objects": _objects(asked["assets"]),
            "noise": asked["depth_noise"] or "none",
            "instances": asked["instances"],
            "engine": asked["engine"],
            "episodes": len(task["records"]),
            **{name: sum(row[name] for row in task["records"]) for name in ("held", "strict", "truncated")},
            "causes": task["causes"],
            "commit": commit,
        }


def _objects(assets: str | None) -> str:
    return "generated" if assets == "builtin" else "real"


def _noise(found: Mapping[str, Any]) -> str:
    return str(found["noise"] or "none")


def _alike(name: str, counts: Mapping[str, int]) -> int:
    """Return the number of clouds whose estimated class has objects of the same shape, such as box_move and
    box_rotate.
    """
    return sum(count for each, count in counts.items() if each.split("_")[0] == name.split("_")[0])


def estimates(rows: Sequence[Row]) -> str:
    """Return a table of the errors over all classes."""
    how = {ALL: "estimated", GIVEN: "given"}
    found = [
        {"objects, depth": _shown(row), "class": how[row["name"]], **_cells(row)}
        for row in _of(rows, "estimates")
        if row["name"] in how
    ]
    return markdown_table(list(found[0]), (each.values() for each in found))


def classes(rows: Sequence[Row]) -> str:
    """Return a table with the errors of each class on generated objects, with exact depth and the class given."""
    named = [row for row in _of(rows, "estimates") if row["name"] not in (ALL, GIVEN)]
    found = {row["name"]: _cells(row) for row in named if (row["objects"], row["noise"]) == AIMED}
    return markdown_table(
        ["class", *CLASS_HEADS], ([name, *(cells[head] for head in CLASS_HEADS)] for name, cells in found.items())
    )


CLASS_HEADS = ("right class", "axis, degrees", "axis, mm", "keypoints, mm", "part IoU")


def _cells(row: Row) -> dict[str, str]:
    """Return the cells of a row of estimates, by column title."""
    cells = error_cells(row)
    counted = {head: cells.pop(head) for head in ("clouds", "missed")}
    shape = f"{row['shape'] / row['clouds']:.2f}"
    return {**counted, "right class": cells.pop("class"), "right shape": shape, **cells}


def _shown(row: Row) -> str:
    """Return the kind of objects and the noise of the depth images."""
    depth = "exact" if row["noise"] == "none" else f"noise {row['noise']}"
    return f"{row['objects']}, {depth}"


def calibration(rows: Sequence[Row]) -> str:
    """Return a table of the fractions of the errors that are smaller than one predicted standard deviation."""
    found = []
    for row in _of(rows, "estimates"):
        if row["name"] == GIVEN:
            shares = (row["within_one_deviation"].get(name) for name in ("openness", "axis", "keypoints"))
            found.append([_shown(row), *("" if share is None else f"{share:.2f}" for share in shares)])
    return markdown_table(["objects, depth", "openness", "axis position", "keypoints"], found)


def tasks(rows: Sequence[Row], *, long: bool = False) -> str:
    """Return a table with the successful episodes of each task, and the success rates over all tasks.

    Args:
        rows: all stored rows.
        long: whether the table has the tasks with several steps, or those with one step.
    """
    names = sorted({row["name"] for row in _tasks(rows, long) if row["scene"] == "perceived"})
    known = {(row["name"], row["scene"], row["objects"], row["noise"]): row for row in _of(rows, "task")}
    columns = [(head, key) for head, key in COLUMNS if any((name, *key) in known for name in names)]
    counted = [
        [name, *(_count(known[name, *key]) if (name, *key) in known else "" for _, key in columns)] for name in names
    ]
    sums = ([known[name, *key] for name in names if (name, *key) in known] for _, key in columns)
    return markdown_table(["task", *(head for head, _ in columns)], [*counted, ["all", *map(_rate, sums)]])


def causes(rows: Sequence[Row], *, long: bool = False, origin: str = PAPER) -> str:
    """Return a table of the causes of failure on estimated scenes.

    Args:
        rows: all stored rows.
        long: whether the table has the tasks with several steps, or those with one step.
        origin: origin of the tasks.
    """
    found = []
    for row in _tasks(rows, long, origin):
        if row["scene"] == "perceived" and row["held"] < row["episodes"]:
            counted = ", ".join(f"{count} {cause}" for cause, count in row["causes"].items())
            found.append((row["name"], _shown(row), f"{row['held']} of {row['episodes']}", counted))
    return markdown_table(["task", "objects, depth", "held", "causes of failure"], found)


def designed(rows: Sequence[Row]) -> str:
    """Return a table of the success rates of the offline designer's tasks on estimated scenes."""
    library = open_library("builtin")
    groups: dict[str, list[Row]] = {}
    for long in (False, True):
        for row in _tasks(rows, long, DESIGNED):
            classes = [each.asset_class for each in load_task(row["name"]).objects.values()]
            jointed = sum(library.kind(name) == "articulated" for name in classes)
            steps = "several steps" if long else "one step"
            groups.setdefault(steps, []).append(row)
            if long:
                groups.setdefault(f"{steps}, articulated objects: {jointed}", []).append(row)
    found = []
    for name, group in groups.items():
        held, episodes = (sum(row[count] for row in group) for count in ("held", "episodes"))
        found.append((name, str(len(group)), f"{held} of {episodes}", _rate(group).rpartition(" of ")[0]))
    return markdown_table(["tasks with", "tasks", "held", "success rate"], found)


def aims(rows: Sequence[Row]) -> str:
    """Return a table of the aims on generated objects with exact depth, beside the measured values."""
    known = {row["name"]: row for row in _of(rows, "estimates") if (row["objects"], row["noise"]) == AIMED}
    held = [
        row for row in _tasks(rows, long=False) if (row["scene"], row["objects"], row["noise"]) == ("perceived", *AIMED)
    ]
    found = []
    for name, aim, scale, digits in AIMS:
        cells = []
        for row in (known[ALL], known[GIVEN]):
            values = row[name] if isinstance(row[name], list) else [row[name]]
            cells.append(" / ".join(f"{scale * value:.{digits}f}" for value in values))
        found.append([HEAD_OF[name], aim, *cells])
    found.append(["success rate, `held`", "0.98", "", _rate(held)])
    return markdown_table(["", "aim", "class estimated", "class given"], found)


AIMED = ("generated", "none")
AIMS = (
    ("class", "0.99", 1.0, 2),
    ("axis_degrees", "2 / 8", 1.0, 1),
    ("axis_m", "8 / none", 1000.0, 0),
    ("keypoint_m", "8 / none", 1000.0, 0),
    ("part_iou", "0.92", 1.0, 2),
)
HEAD_OF = {
    "class": "right class",
    "axis_degrees": "axis direction, degrees",
    "axis_m": "axis position, mm",
    "keypoint_m": "keypoints, mm",
    "part_iou": "part IoU",
}


def _of(rows: Sequence[Row], what: str) -> list[Row]:
    return [row for row in rows if row["what"] == what]


def _tasks(rows: Sequence[Row], long: bool, origin: str = PAPER) -> list[Row]:
    """Return the rows of an origin's tasks with several steps (``long``), or with one step."""
    known = [(row, load_task(row["name"])) for row in _of(rows, "task")]
    return [row for row, task in known if origin_of(task) == origin and (len(task.steps) > 1) == long]


def _count(row: Row) -> str:
    return f"{row['held']}/{row['episodes']}"


def _rate(rows: Sequence[Row]) -> str:
    held, episodes = (sum(row[name] for row in rows) for name in ("held", "episodes"))
    low, high = interval(held, episodes)
    return f"{held / episodes:.2f} ({low:.2f} to {high:.2f}) of {episodes}"


def main() -> None:
    """Store the results of measurements, and write the tables."""
    rows = take_in(__doc__, FIGURES, rows_of, ("what", "name", "scene", "objects", "noise"))
    makers: dict[str, Callable[[Sequence[Row]], str]] = {
        "estimates": estimates,
        "classes": classes,
        "aims": aims,
        "calibration": calibration,
        "tasks": tasks,
        "causes": causes,
        "long": partial(tasks, long=True),
        "long_causes": partial(causes, long=True),
        "designed": designed,
        "designed_causes": partial(causes, origin=DESIGNED),
        "designed_long_causes": partial(causes, long=True, origin=DESIGNED),
    }
    fill(PAGES, MARKED, makers, rows)


if __name__ == "__main__":
    main()
