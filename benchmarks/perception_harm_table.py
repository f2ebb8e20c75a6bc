"""Write the tables of contact forces and refusals on estimated scenes, from the JSON of ``perception_harm.py``.

    python benchmarks/perception_harm_table.py FILE.json ... --commit HASH     # stores results, writes tables
    python benchmarks/perception_harm_table.py                                 # writes tables of stored results

The results are stored in ``perception_harm.json`` in this folder. The tables are in docs/results/perception_harm.md.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from markdown_tables import Row, fill, markdown_table, take_in

from gensim2.robots.force import FORCE_LIMIT
from gensim2.rollout.tally import interval

FIGURES = Path(__file__).with_name("perception_harm.json")
PAGES = (Path(__file__).parents[1] / "docs/results/perception_harm.md",)
MARKED = re.compile(r"(<!-- harm: (\w+) -->\n).*?(<!-- /harm -->)", re.DOTALL)
NAMES = {
    "distractors": "object, 1 to 4 rigid objects",
    "close": "object, 1 to 3 rigid objects close to it",
    "other": "another articulated object",
    "clutter": "0 to 4 rigid objects",
}
MOVED = 0.03
"""Displacement (m) from which a rigid object counts as moved."""


def rows_of(found: Mapping[str, Any], commit: str) -> Iterator[Row]:
    """Yield one row for each kind of scenes."""
    for key in sorted({(row["kind"], row["noise"]) for row in found["rows"]}):
        rows = [row for row in found["rows"] if (row["kind"], row["noise"]) == key]
        above = [row for row in rows if row["force"] > FORCE_LIMIT]
        yield {
            "kind": key[0],
            "noise": key[1],
            "scenes": len(rows),
            "empty": sum(row["cause"] == "empty cloud" for row in rows),
            "refused": sum(row["refused"] for row in rows),
            "held": sum(bool(row["held"]) for row in rows),
            "forces": sorted(row["force"] for row in rows if row["force"] > 0.0),
            "moved": sum(row["moved"] > MOVED for row in rows),
            "above": [
                {name: row[name] for name in ("task", "seed", "force", "force_on", "seconds_above")} for row in above
            ],
            "accepted": [
                {"task": row["task"], "seed": row["seed"], "stranger": row["stranger"], "force": row["force"]}
                for row in rows
                if key[0] in ("other", "clutter") and not row["refused"]
            ],
            "commit": commit,
        }


def refusals(rows: Sequence[Row]) -> str:
    """Return a table of the refused scenes of each kind."""
    cells = []
    for noise in sorted({row["noise"] for row in rows}, reverse=True):
        for kinds in (("distractors", "close"), ("other",), ("clutter",), ("other", "clutter")):
            chosen = [row for row in rows if row["noise"] == noise and row["kind"] in kinds]
            if not chosen:
                continue
            scenes, refused, empty, held = (
                sum(row[name] for row in chosen) for name in ("scenes", "refused", "empty", "held")
            )
            is_present = kinds[0] == "distractors"
            what = (
                "object and others" if is_present else "all without the object" if len(kinds) > 1 else NAMES[kinds[0]]
            )
            cells.append(
                [
                    what,
                    _depth(noise),
                    _share(refused, scenes),
                    "" if is_present or "clutter" not in kinds else f"{empty}",
                    _share(held, scenes) if is_present else "",
                ]
            )
    return markdown_table(["scene", "depth", "refused", "of these, empty tables (error)", "held"], cells)


def forces(rows: Sequence[Row]) -> str:
    """Return a table of the largest contact force in each scene."""
    cells = []
    for row in sorted(rows, key=lambda each: (each["noise"] != "none", list(NAMES).index(each["kind"]))):
        touched = row["forces"]
        median = f"{touched[len(touched) // 2]:.0f}" if touched else ""
        over = [each["seconds_above"] for each in row["above"]]
        cells.append(
            [
                NAMES[row["kind"]],
                _depth(row["noise"]),
                f"{len(touched)} of {row['scenes']}",
                median,
                f"{max(touched, default=0.0):.0f}",
                f"{len(over)}",
                f"{max(over):.2f} s" if over else "",
                f"{row['moved']}",
            ]
        )
    head = ["scene", "depth", "with contact", "median force, N", "largest force, N", f"above {FORCE_LIMIT:.0f} N"]
    return markdown_table([*head, "longest time above", "rigid object moved"], cells)


def _share(count: int, of: int) -> str:
    low, high = interval(count, of)
    return f"{count} of {of}, {count / of:.2f} ({low:.2f} to {high:.2f})"


def _depth(noise: str) -> str:
    return "exact" if noise == "none" else f"noise {noise}"


def main() -> None:
    """Store the results of measurements, and write the tables."""
    rows = take_in(__doc__, FIGURES, rows_of, ("kind", "noise"))
    makers: dict[str, Callable[[Sequence[Row]], str]] = {"refusals": refusals, "forces": forces}
    fill(PAGES, MARKED, makers, rows)


if __name__ == "__main__":
    main()
