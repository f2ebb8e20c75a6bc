"""Tables of policies in docs/results/*_policies.md and README.md, from `gensim2 learn --json FILE`.

    python benchmarks/policy_table.py FILE... --commit HASH   # takes the figures of these runs in, and writes tables
    python benchmarks/policy_table.py                         # writes the tables from the figures that there are

The figures stand in ``policies.json`` beside this file, a row for each task and way of learning: a run takes the place
of an earlier one of the same task, policy, objects, randomization, number of tasks and seed of training. Where there
are several seeds, the first one's row stands in the tables, and all of them in one of their own.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import mean
from typing import Any

from markdown_tables import fill, markdown_table, take_in

from gensim2.core.yaml_files import read_yaml
from gensim2.policy.config import HEADS
from gensim2.rollout.tally import interval

FIGURES = Path(__file__).with_name("policies.json")
ROOT = Path(__file__).parents[1]
PAGES = (ROOT / "docs/results/keypose_policies.md", ROOT / "docs/results/chunk_policies.md", ROOT / "README.md")
MARKED = re.compile(r"(<!-- policies: (\w+) -->\n).*?(<!-- /policies -->)", re.DOTALL)
CONTROLS = ("blind", "shuffled", "no_op", "expert")
NAMES = {"blind": "blind", "shuffled": "shuffled", "no_op": "no-op", "expert": "expert"}
BASELINES = {
    ", ".join(f"{name} {value}" for name, value in read_yaml(path).items()): f"`{path.name}`"
    for path in sorted(Path(__file__).with_name("baselines").glob("*.yaml"))
}
"""Files of settings, by what they set."""
FIVE = ("CloseBox", "OpenDrawer", "TurnOnFaucet", "OpenLaptop", "PlaceGolfBallIntoDrawer")
"""Tasks on which every head is compared."""
WHAT = ("name", "policy", "settings", "objects", "randomization", "together")
KEY = (*WHAT, "seed")

Row = dict[str, Any]


def rows_of(found: Mapping[str, Any], commit: str) -> list[Row]:
    """Return the rows of one run, without folders of the machine that it ran on."""
    scene = found["scene"]
    real = scene["assets"] != "builtin"
    rows = []
    for task in found["tasks"]:
        controls = {name: task[f"{name}_mean"] for name in CONTROLS if task[f"{name}_mean"] is not None}
        rows.append(
            {
                "name": task["name"],
                "policy": task["policy"],
                "settings": ", ".join(f"{name} {value}" for name, value in found.get("settings", {}).items()),
                "objects": f"{'real' if real else 'generated'}, {found['test_instances']}",
                "taught_on": scene["instances"] if found["objects"] is None else found["objects"],
                "randomization": scene["randomization"],
                "together": len(found["tasks"]) if found["multi_task"] else 1,
                "seed": found["seed"],
                "episodes": task["episodes"],
                "held": round(task["held_mean"] * task["episodes"]),
                "strict": round(task["strict_mean"] * task["episodes"]),
                "control_episodes": task["control_episodes"],
                **{name: round(share * task["control_episodes"]) for name, share in controls.items()},
                "demonstrations": task["demonstrations"],
                "steps": task["steps"],
                "data_cpu_s": round(task["data_cpu_s"]),
                "training_cpu_s": round(task["training_cpu_s"]),
                "evaluation_cpu_s": round(task["evaluation_cpu_s"]),
                "causes": task["causes"],
                "commit": commit,
            }
        )
    return rows


def every(rows: Sequence[Row]) -> str:
    """Return tables of keypose policies: of one single-step task each, in the paper's scenes and wide ones; others."""
    keyposes = [row for row in _first_seeds(rows) if row["policy"] == "keypose" and not row["settings"]]
    plain = [row for row in keyposes if _is_plain(row, "paper")]
    wide = [row for row in keyposes if _is_plain(row, "wide")]
    others = [row for row in keyposes if row not in plain and row not in wide]
    parts = [_table(plain, others=False)] if plain else []
    if wide:
        parts.append(
            "**`wide` scenes.** The next policies were trained and evaluated with the randomization `wide`.\n\n"
            + _table(wide, others=False)
        )
    if others:
        parts.append(
            "**Other policies.** The next policies are for other objects, long-horizon tasks or several tasks.\n\n"
            + _table(others, others=True)
        )
    return "\n".join(parts)


def chunks(rows: Sequence[Row]) -> str:
    """Return a table of policies of action chunks."""
    mine = [row for row in _first_seeds(rows) if row["policy"] != "keypose" and not row["settings"]]
    return _table(mine, others=True) if mine else ""


def heads(rows: Sequence[Row]) -> str:
    """Return a table of every head on five tasks, generated objects that no training saw."""
    found = {(row["policy"], row["name"]): row for row in _first_seeds(rows) if _is_of_one_task(row)}
    head = ["held of 100", *FIVE, "all"]
    lines: list[list[str]] = []
    for policy in HEADS:
        mine = [found.get((policy, name)) for name in FIVE]
        cells = ["" if row is None else f"{row['held']} of {row['episodes']}" for row in mine]
        known = [row for row in mine if row is not None]
        whole = len(known) == len(FIVE)
        held, episodes = sum(row["held"] for row in known), sum(row["episodes"] for row in known)
        lines.append([f"`{policy}`", *cells, f"{held / episodes:.3f}" if whole else ""])
    return markdown_table(head, lines)


def _is_of_one_task(row: Row) -> bool:
    usual = row["together"] == 1 and row["randomization"] == "paper" and not row["settings"]
    return usual and str(row["objects"]) == "generated, new"


def baselines(rows: Sequence[Row]) -> str:
    """Return a table of policies with other settings than usual."""
    mine = [row for row in _first_seeds(rows) if row["settings"]]
    return _table(mine, others=True) if mine else ""


def seeds(rows: Sequence[Row]) -> str:
    """Return a table of what was trained by several seeds; controls are added up."""
    groups = {what: mine for what, mine in _by_what(rows).items() if len(mine) > 1}
    if not groups:
        return ""
    several = [row for mine in groups.values() for row in mine]
    names = sorted({row["seed"] for row in several})
    controls = [name for name in CONTROLS if any(name in row for row in several)]
    head = ["task", "policy", *(f"seed {seed}" for seed in names), "together (95 %)", "strict"]
    head += [*(NAMES[name] for name in controls), "CPU s each"]
    lines: list[list[str]] = []
    for what, mine in groups.items():
        held, episodes = sum(row["held"] for row in mine), sum(row["episodes"] for row in mine)
        low, high = interval(held, episodes)
        of_seed = {row["seed"]: f"{row['held']} of {row['episodes']}" for row in mine}
        cells = [what[0], _told(mine[0]), *(of_seed.get(seed, "") for seed in names)]
        cells.append(f"{held / episodes:.3f} ({low:.3f} to {high:.3f})")
        cells.append(f"{sum(row['strict'] for row in mine) / episodes:.2f}")
        for name in controls:
            asked = [row for row in mine if name in row]
            counts = sum(row[name] for row in asked), sum(row["control_episodes"] for row in asked)
            cells.append(f"{counts[0]} of {counts[1]}" if asked else "")
        cells.append(f"{mean(row['data_cpu_s'] + row['training_cpu_s'] for row in mine):.0f}")
        lines.append(cells)
    return markdown_table(head, lines)


def short(rows: Sequence[Row]) -> str:
    """Return a paragraph about single-task keypose policies."""
    plain = [row for row in _first_seeds(rows) if _is_plain(row, "paper")]
    if not plain:
        return ""
    held, episodes = sum(row["held"] for row in plain), sum(row["episodes"] for row in plain)
    low, high = interval(held, episodes)
    worst = min(plain, key=lambda row: row["held"] / row["episodes"])
    blind, of = (
        sum(row.get("blind", 0) for row in plain),
        sum(row["control_episodes"] for row in plain if "blind" in row),
    )
    seconds = [row["data_cpu_s"] + row["training_cpu_s"] for row in plain]
    rates = [row["held"] / row["episodes"] for row in plain]
    return (
        f"We trained one policy for each of {len(plain)} single-step tasks. Collecting the data and training took "
        f"{min(seconds)} to {max(seconds)} s of CPU time per policy. On unseen objects the policies succeed in {held} "
        f"of {episodes} episodes ({mean(rates):.2f}; 95 % interval {low:.3f} to {high:.3f}). The task with the lowest "
        f"success rate is {worst['name']} with {min(rates):.2f}. As a control we blanked out the point cloud: then the "
        f"policies succeed in {blind} of {of} episodes.\n"
    )


def _by_what(rows: Sequence[Row]) -> dict[tuple[Any, ...], list[Row]]:
    """Rows that differ by their seed alone, in its order."""
    groups: dict[tuple[Any, ...], list[Row]] = {}
    for row in sorted(rows, key=lambda row: [row[name] for name in KEY]):
        groups.setdefault(tuple(row[name] for name in WHAT), []).append(row)
    return groups


def _first_seeds(rows: Sequence[Row]) -> list[Row]:
    return [mine[0] for mine in _by_what(rows).values()]


def _told(row: Row) -> str:
    together = [f"one of {row['together']} tasks"] if row["together"] > 1 else []
    wide = [row["randomization"]] if row["randomization"] != "paper" else []
    settings = str(row["settings"])
    other = [BASELINES.get(settings, settings)] if settings else []
    return ", ".join([row["policy"], *other, *together, row["objects"], *wide])


def _is_plain(row: Row, randomization: str) -> bool:
    usual = row["policy"] == "keypose" and not row["settings"]
    common = usual and row["together"] == 1 and row["randomization"] == randomization
    return common and row["objects"].startswith("generated") and _is_single_step(row["name"])


def _is_single_step(name: str) -> bool:
    from gensim2.tasks.library import load_task

    return load_task(name).is_single_step


def _table(rows: Sequence[Row], *, others: bool) -> str:
    controls = [name for name in CONTROLS if any(name in row for row in rows)]
    head = ["task", *(["policy"] if others else []), "held (95 %)", "strict", *(NAMES[name] for name in controls)]
    head += ["demonstrations", "training steps", "CPU s: data, training", "causes of failures"]
    lines: list[list[str]] = []
    for row in sorted(rows, key=lambda row: [row[each] for each in ("together", "policy", "name", "objects")]):
        cells = [row["name"]]
        if others:
            cells.append(_told(row))
        low, high = interval(row["held"], row["episodes"])
        cells.append(f"{row['held'] / row['episodes']:.2f} ({low:.2f} to {high:.2f}) of {row['episodes']}")
        cells.append(f"{row['strict'] / row['episodes']:.2f}")
        cells += ["" if name not in row else f"{row[name]} of {row['control_episodes']}" for name in controls]
        cells += [str(row["demonstrations"]), str(row["steps"]), f"{row['data_cpu_s']}, {row['training_cpu_s']}"]
        cells.append(", ".join(f"{count} {cause}" for cause, count in row["causes"].items()))
        lines.append(cells)
    if not others:
        held = [row["held"] / row["episodes"] for row in rows]
        cpu = mean(row["data_cpu_s"] + row["training_cpu_s"] for row in rows)
        blank = [""] * (3 + len(controls))
        lines.append([f"mean of {len(rows)}", f"{mean(held):.3f}", *blank, f"{cpu:.0f} in all", ""])
    return markdown_table(head, lines)


def main() -> None:
    """Take runs in, and write the tables."""
    rows = take_in(__doc__, FIGURES, rows_of, KEY, order=str)
    makers = {"all": every, "short": short, "chunks": chunks, "heads": heads, "baselines": baselines, "seeds": seeds}
    fill(PAGES, MARKED, makers, rows)


if __name__ == "__main__":
    main()
