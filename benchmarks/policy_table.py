"""Table of policies and their controls from the JSON of `gensim2 evaluate --checkpoint DIR --controls ... --json FILE`.

python benchmarks/policy_table.py FILE... [--json OUT]
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

CONTROLS = ("blind", "shuffled", "no-op", "expert")


def rows_of(found: dict[str, Any]) -> list[dict[str, Any]]:
    """One row a task, without its episodes."""
    rows = []
    folder = Path(found["controller"]["arguments"]["checkpoint"])
    config = json.loads((folder / "config.json").read_text())
    for task in found["tasks"]:
        controls = {}
        for name in CONTROLS:
            for row in found.get("controls", {}).get(name, ()):
                if row["name"] == task["name"]:
                    controls[name] = {key: row[key] for key in ("held_mean", "held_interval", "episodes")}
        rows.append(
            {
                "name": task["name"],
                "policy": config["policy"]["head"],
                "instances": found["arguments"]["instances"],
                "seed": found["arguments"]["seed"],
                **{key: task[key] for key in ("held_mean", "held_interval", "strict_mean", "episodes", "causes")},
                "controls": controls,
                "demonstrations": config["data"]["episodes"],
                "steps": config["step"],
                "evaluation_cpu_s": found["cpu_s"],
            }
        )
    return rows


def main() -> None:
    """Print the table, and write it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="+", type=Path)
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    rows = [row for file in given.files for row in rows_of(json.loads(file.read_text()))]
    print("| task | objects | held (95 %) | blind | shuffled | no-op | expert | plans | steps |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- | --- |")
    for row in rows:
        low, high = row["held_interval"]
        beside = [row["controls"].get(name) for name in CONTROLS]
        told = ["" if each is None else f"{each['held_mean']:.2f}" for each in beside]
        held = f"{row['held_mean']:.2f} ({low:.2f} to {high:.2f}) of {row['episodes']}"
        print(
            "|",
            " | ".join([row["name"], row["instances"], held, *told, str(row["demonstrations"]), str(row["steps"])]),
            "|",
        )
    if given.json is not None:
        given.json.write_text(json.dumps({"schema_version": 1, "rows": rows}, indent=2) + "\n")


if __name__ == "__main__":
    main()
