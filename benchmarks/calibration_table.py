"""Write the table of docs/results/calibration.md from the JSON of `benchmarks/original_configs.py --json FILE`.

    python benchmarks/calibration_table.py FILE...       # stores the results of these runs, and writes the table
    python benchmarks/calibration_table.py               # writes the table from the stored results

The results are stored in ``calibration.json`` in this folder: one run for each source of scenes, with rows but without
episodes.
"""

from __future__ import annotations

import argparse
import json
import re
from pathlib import Path
from typing import Any

from gensim2.core.files import write_atomic, write_json
from gensim2.rollout.tally import interval

FIGURES = Path(__file__).with_suffix("").with_name("calibration.json")
PAGE = Path(__file__).parents[1] / "docs/results/calibration.md"
BEGIN, END = "<!-- calibration: begin -->\n", "<!-- calibration: end -->\n"
ROW = ("name", "paper", "release", "p_value", "causes", "instances")


def figures_of(found: dict[str, Any]) -> dict[str, Any]:
    """Return the results of a run for storage: rows and sums, without episodes and without local file paths."""
    provenance = dict(found["provenance"])
    provenance["command"] = re.sub(r" --(out|resume|workers|json)( [^-]\S*)?", "", provenance["command"])
    provenance["command"] = re.sub(r"\S*/(\S+)", r"\1", provenance["command"])
    rows = [{name: task.get(name) for name in ROW} for task in found["tasks"]]
    return {"provenance": provenance, "rows": rows, "in_all": found["in_all"], "left_out": len(found["left_out"])}


def share(counted: dict[str, Any] | None) -> str:
    """Format a success count with its 95 % interval, such as ``"8/10 (0.49 to 0.94)"``; empty without trials."""
    if counted is None:
        return ""
    low, high = interval(counted["count"], counted["of"])
    return f"{counted['count']}/{counted['of']} ({low:.2f} to {high:.2f})"


def table(figures: dict[str, Any]) -> str:
    """Return the tables of all runs as Markdown."""
    parts = []
    for scenes, found in sorted(figures.items(), reverse=True):
        told = found["provenance"]
        # Show only the arguments, because the command had other names in earlier versions.
        given = re.sub(r"^.*\s(?=\S+\.jsonl)", "", told["command"])
        what = "recorded in the release" if scenes == "recorded" else "sampled at random"
        parts.append(
            f"**Scenes {scenes}.** The scenes of this table were {what}. The table was measured at commit "
            f"{told['commit'][:7]} on {told['date']} with the arguments `{given}`.\n"
        )
        parts.append("| task | here (95 %) | its release (95 %) | p | causes of our failures |\n|---|---|---|---|---|")
        for row in found["rows"]:
            causes = ", ".join(f"{cause} {count}" for cause, count in row["causes"].items())
            p = "" if row["p_value"] is None else f"{row['p_value']:.2f}"
            parts.append(f"| {row['name']} | {share(row['paper'])} | {share(row['release'])} | {p} | {causes} |")
        sums = found["in_all"]
        here, there = share(sums["paper"]), share(sums["release"])
        parts.append(f"| **tasks of one step** | {here} | {there} | {sums['p_value']:.2f} | |\n")
    return "\n".join(parts)


def main() -> None:
    """Store the results of runs, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", type=Path)
    figures = json.loads(FIGURES.read_text()) if FIGURES.exists() else {}
    for file in parser.parse_args().files:
        found = json.loads(file.read_text())
        figures[found["arguments"]["scenes"]] = figures_of(found)
    write_json(FIGURES, figures)
    page = PAGE.read_text()
    begin, end = page.index(BEGIN) + len(BEGIN), page.index(END)
    write_atomic(PAGE, page[:begin] + table(figures) + page[end:])


if __name__ == "__main__":
    main()
