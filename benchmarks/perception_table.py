"""Write the tables of estimated scenes, from the JSON of `gensim2 perceive measure` and `gensim2 benchmark`.

    python benchmarks/perception_table.py FILE.json ... --commit HASH     # stores results, writes tables
    python benchmarks/perception_table.py                                 # writes tables of stored results

A file is a result of ``gensim2 perceive measure builtin``, or of ``gensim2 benchmark`` with ``--scene perceived`` or on
the true scene. The results are stored in ``perception.json`` in this folder. The tables are in
docs/results/perception.md.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from markdown_tables import Row, fill, line, take_in

from gensim2.rollout.tally import interval

FIGURES = Path(__file__).with_name("perception.json")
PAGE = Path(__file__).parents[1] / "docs/results/perception.md"
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
            counts = Counter({each: _alike(each, classes[each]) for each in alike})
            yield {**about, "name": name, **figures, "shape": sum(counts.values()), "commit": commit}
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
    head = ["objects, depth", "class", *HEADS]
    lines = [line(head), line(["---"] * len(head))]
    for row in _of(rows, "estimates"):
        if row["name"] in (ALL, GIVEN):
            depth = "exact" if row["noise"] == "none" else f"noise {row['noise']}"
            how = "estimated" if row["name"] == ALL else "given"
            lines.append(line([f"{row['objects']}, {depth}", how, *_cells(row)]))
    return "\n".join(lines) + "\n"


def classes(rows: Sequence[Row]) -> str:
    """Return a table with the errors of each class on generated objects, with exact depth and the class given."""
    head = ["class", *CLASS_HEADS]
    lines = [line(head), line(["---"] * len(head))]
    named = [row for row in _of(rows, "estimates") if row["name"] not in (ALL, GIVEN)]
    found = [row for row in named if (row["objects"], row["noise"]) == AIMED]
    for row in found:
        cells = dict(zip(HEADS, _cells(row), strict=True))
        lines.append(line([row["name"], *(cells[head] for head in CLASS_HEADS)]))
    return "\n".join(lines) + "\n"


HEADS = (
    "clouds",
    "missed",
    "right class",
    "right shape",
    "axis, degrees",
    "axis, mm",
    "keypoints, mm",
    "openness",
    "part IoU",
)


CLASS_HEADS = ("right class", "axis, degrees", "axis, mm", "keypoints, mm", "part IoU")


def _cells(row: Row) -> list[str]:
    def pair(name: str, scale: float, digits: int) -> str:
        return " / ".join(f"{scale * value:.{digits}f}" for value in row.get(name, ()))

    return [
        str(row["clouds"]),
        str(row["missed"]),
        f"{row['class']:.2f}",
        f"{row['shape'] / row['clouds']:.2f}",
        pair("axis_degrees", 1.0, 1),
        pair("axis_m", 1000.0, 0),
        pair("keypoint_m", 1000.0, 0),
        pair("openness", 1.0, 2),
        f"{row['part_iou']:.2f}",
    ]


def calibration(rows: Sequence[Row]) -> str:
    """Return a table of the fractions of the errors that are smaller than one predicted standard deviation."""
    head = ["objects, depth", "openness", "axis position", "keypoints"]
    lines = [line(head), line(["---"] * len(head))]
    for row in _of(rows, "estimates"):
        if row["name"] == GIVEN:
            depth = "exact" if row["noise"] == "none" else f"noise {row['noise']}"
            shares = (row["within_one_deviation"].get(name) for name in ("openness", "axis", "keypoints"))
            cells = ("" if share is None else f"{share:.2f}" for share in shares)
            lines.append(line([f"{row['objects']}, {depth}", *cells]))
    return "\n".join(lines) + "\n"


def tasks(rows: Sequence[Row]) -> str:
    """Return a table with the successful episodes of each task, and the success rates over all tasks."""
    names = sorted({row["name"] for row in _of(rows, "task") if row["scene"] == "perceived"})
    known = {(row["name"], row["scene"], row["objects"], row["noise"]): row for row in _of(rows, "task")}
    columns = [(head, key) for head, key in COLUMNS if any((name, *key) in known for name in names)]
    head = ["task", *(each for each, _ in columns)]
    lines = [line(head), line(["---"] * len(head))]
    for name in names:
        cells = (_count(known[name, *key]) if (name, *key) in known else "" for _, key in columns)
        lines.append(line([name, *cells]))
    sums = ([known[name, *key] for name in names if (name, *key) in known] for _, key in columns)
    lines.append(line(["all", *map(_rate, sums)]))
    return "\n".join(lines) + "\n"


def causes(rows: Sequence[Row]) -> str:
    """Return a table of the causes of failure on estimated scenes."""
    head = ["task", "objects, depth", "held", "causes of failure"]
    lines = [line(head), line(["---"] * len(head))]
    for row in _of(rows, "task"):
        if row["scene"] == "perceived" and row["held"] < row["episodes"]:
            depth = "exact" if row["noise"] == "none" else f"noise {row['noise']}"
            counted = ", ".join(f"{count} {cause}" for cause, count in row["causes"].items())
            cells = (row["name"], f"{row['objects']}, {depth}", f"{row['held']} of {row['episodes']}", counted)
            lines.append(line(cells))
    return "\n".join(lines) + "\n"


def aims(rows: Sequence[Row]) -> str:
    """Return a table of the aims on generated objects with exact depth, beside the measured values."""
    known = {row["name"]: row for row in _of(rows, "estimates") if (row["objects"], row["noise"]) == AIMED}
    held = [row for row in _of(rows, "task") if (row["scene"], row["objects"], row["noise"]) == ("perceived", *AIMED)]
    lines = [line(["", "aim", "class estimated", "class given"]), line(["---"] * 4)]
    for name, aim, scale, digits in AIMS:
        cells = []
        for row in (known[ALL], known[GIVEN]):
            values = row[name] if isinstance(row[name], list) else [row[name]]
            cells.append(" / ".join(f"{scale * value:.{digits}f}" for value in values))
        lines.append(line([HEAD_OF[name], aim, *cells]))
    lines.append(line(["success rate, `held`", "0.98", "", _rate(held)]))
    return "\n".join(lines) + "\n"


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


def _count(row: Row) -> str:
    return f"{row['held']}/{row['episodes']}"


def _rate(rows: Sequence[Row]) -> str:
    held, episodes = (sum(row[name] for row in rows) for name in ("held", "episodes"))
    low, high = interval(held, episodes)
    return f"{held / episodes:.2f} ({low:.2f} to {high:.2f}) of {episodes}"


def main() -> None:
    """Store the results of measurements, and write the tables."""
    rows = take_in(__doc__, FIGURES, rows_of, ("what", "name", "scene", "objects", "noise"))
    makers = {
        "estimates": estimates,
        "classes": classes,
        "aims": aims,
        "calibration": calibration,
        "tasks": tasks,
        "causes": causes,
    }
    fill((PAGE,), MARKED, makers, rows)


if __name__ == "__main__":
    main()
