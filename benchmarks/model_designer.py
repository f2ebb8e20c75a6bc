"""Tables of docs/results/model_designer.md: tasks that a language model designed, from its recorded runs.

    python benchmarks/model_designer.py RUN... --records benchmarks/model_designer.tar.xz   # packs the runs
    python benchmarks/model_designer.py --into docs/results/model_designer.md               # writes the tables

The archive keeps of each run what a replay and the tables need: `run.json`, the folder `model` with every prompt and
answer, the prompts of the user's own, and the tasks with their designs and verifications.
"""

from __future__ import annotations

import argparse
import json
import tarfile
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from markdown_tables import line

from gensim2.core.files import write_json
from gensim2.data.records import Verification
from gensim2.data.runfolder import TaskFolder
from gensim2.design.designs import DesignRecord, read_design
from gensim2.design.model_report import ModelReport
from gensim2.objects import open_library
from gensim2.rollout.tally import interval
from gensim2.tasks.criteria import ArticulatedBetween, ArticulatedClosed, ArticulatedOpen, RigidMoved
from gensim2.tasks.library import load_task_file
from gensim2.tasks.likeness import first_alike
from gensim2.tasks.spec import HAND, TABLE, TaskSpec

RECORDS = Path(__file__).with_name("model_designer.tar.xz")
KEPT = 0.8
"""Success rate in each engine from which a task counts as kept; the pipeline itself keeps long tasks from 0.6."""
OF_JOINT = (ArticulatedOpen, ArticulatedClosed, ArticulatedBetween)
START, END = "<!-- from runs: {} -->", "<!-- /from runs -->"
LEFT_OUT = {".mp4", ".png", ".html", ".jsonl"}
FIELDS = ("arguments", "effort", "versions", "started", "finished")


@dataclass(frozen=True)
class Row:
    """A proposal that was tried in physics, with its result and cost.

    Attributes:
        run: name of the run.
        task: the proposal.
        design: candidates of the search; None if the model gave no valid configs.
        verification: episodes with new objects in both engines; None if the search found no strategy.
        sums: answers and tokens of the conversations about the task.
        cpu_s: CPU seconds of search and verification.
        rejected: reason why the pipeline rejected the proposal without verification; empty if it did not.
    """

    run: str
    task: TaskSpec
    design: DesignRecord | None
    verification: Verification | None
    sums: dict[str, Any]
    cpu_s: float
    rejected: str

    @property
    def counts(self) -> tuple[str, str]:
        """Successful episodes of all in SAPIEN and in MuJoCo."""
        found = self.verification
        if found is None:
            return "", ""
        second = "" if found.second is None else f"{found.second.tally.held}/{len(found.second.episodes)}"
        return f"{found.tally.held}/{len(found.episodes)}", second

    @property
    def kept(self) -> bool:
        """Whether both engines reach the success rate ``KEPT``."""
        found = self.verification
        return found is not None and found.rate >= KEPT and found.second is not None and found.second.rate >= KEPT

    @property
    def round(self) -> int | None:
        """Round of the chosen strategies: 0 for the first answers, 1 or 2 after failures were shown; None without."""
        if self.design is None or self.design.steps is None:
            return None
        return int(self.design.candidates[0].provenance.get("round", 0))

    def kinds(self, rigid: frozenset[str]) -> list[str]:
        """Return what is special about the task."""
        task = self.task
        joints = {criterion.object for step in task.steps for criterion in step.done if isinstance(criterion, OF_JOINT)}
        holds = [step for step in task.steps if step.tool != HAND]
        tools = any(isinstance(c, OF_JOINT) for step in holds for c in step.done)
        moved = any(isinstance(c, RigidMoved) for c in task.success)
        out = any(thing.place.on != TABLE for thing in task.objects.values())
        half = any(isinstance(c, ArticulatedBetween) for c in task.success)
        named = {"two joints": len(joints) > 1, "tool": tools, "taking out": out, "direction": moved, "halfway": half}
        named["several rigid objects"] = sum(t.asset_class in rigid for t in task.objects.values()) > 1
        return [word for word, holds_ in named.items() if holds_]

    @property
    def failure(self) -> str:
        """Reason why the task was not kept; empty for a kept one."""
        if self.kept:
            return ""
        if self.verification is not None:
            episodes = [*self.verification.episodes]
            episodes += self.verification.second.episodes if self.verification.second is not None else ()
            causes = [f"{e.diagnosis.get('step', '')}: {e.cause}" for e in episodes if e.cause is not None]
            return f"verification; mostly {max(causes, key=causes.count)}"
        return self.rejected


def rows_of(run: Path) -> list[Row]:
    """Return the proposals of a run folder that were tried, in the order in which they were made."""
    record = json.loads((run / "run.json").read_text())
    told = ModelReport(run)
    reasons = {each["name"]: each["reason"] for each in record["rejected"]}
    found = []
    for name, effort in record["effort"].items():
        folder = next(run / each / name for each in ("tasks", "rejected") if (run / each / name).exists())
        about = told.of_task(name) or {"sums": {"answers": 0, "tokens_in": 0, "tokens_out": 0}}
        verification = TaskFolder(folder).verification()
        task = load_task_file(folder)
        found.append(
            Row(
                run.name, task, read_design(folder), verification, about["sums"], effort["cpu_s"], reasons.get(name, "")
            )
        )
    return found


def different(rows: Sequence[Row]) -> list[Row]:
    """Return the rows without repetitions: of proposals with the same meaning, the first."""
    found: list[Row] = []
    for row in rows:
        if first_alike(row.task, [other.task for other in found]) is None:
            found.append(row)
    return found


def proposals(rows: Sequence[Row], rigid: frozenset[str]) -> str:
    """Return the table of all proposals."""
    head = ["run", "sentence", "steps", "special", "round", "SAPIEN", "MuJoCo", "kept", "prompts", "tokens", "CPU s"]
    new = different(rows)
    table: list[list[Any]] = [head, ["---"] * len(head)]
    for row in rows:
        special = row.kinds(rigid) if row in new else [*row.kinds(rigid), "repetition"]
        tokens = row.sums["tokens_in"] + row.sums["tokens_out"]
        found = [row.run, row.task.description, len(row.task.steps), ", ".join(special)]
        found += ["" if row.round is None else row.round, *row.counts, "yes" if row.kept else "no"]
        table.append([*found, row.sums["answers"], tokens, round(row.cpu_s)])
    return "\n".join(f"|{'|'.join(map(str, cells))}|" for cells in table)


def sums(rows: Sequence[Row], rigid: frozenset[str]) -> str:
    """Return the table of kept proposals by kind, and the cost of a kept task."""
    groups = {
        "all": rows,
        "without repetitions": different(rows),
        "one step": [row for row in rows if row.task.is_single_step],
        "several steps": [row for row in rows if not row.task.is_single_step],
        **{
            kind: [row for row in rows if kind in row.kinds(rigid)]
            for kind in ("two joints", "tool", "taking out", "direction", "several rigid objects")
        },
    }
    head = ["proposals", "tried", "kept", "95 %", "kept with the first answers"]
    lines = [line(head), line(["---"] * len(head))]
    for name, group in groups.items():
        kept = sum(row.kept for row in group)
        low, high = interval(kept, len(group))
        first = sum(row.kept and row.round == 0 for row in group)
        lines.append(line(map(str, [name, len(group), kept, f"{low:.2f}–{high:.2f}", first])))
    kept = max(1, sum(row.kept for row in rows))
    answers, tokens_in, tokens_out = (
        sum(row.sums[key] for row in rows) for key in ("answers", "tokens_in", "tokens_out")
    )
    cost = (
        f"A kept task cost {answers / kept:.1f} prompts, {tokens_in / kept:,.0f} tokens of prompts, "
        f"{tokens_out / kept:,.0f} tokens of answers and {sum(row.cpu_s for row in rows) / kept:.0f} s of CPU time, "
        "including the tasks that were not kept."
    )
    return "\n".join([*lines, "", cost])


def failures(rows: Sequence[Row]) -> str:
    """Return the list of proposals that were not kept, with the reasons."""
    lost = [row for row in rows if not row.kept]
    lines = [line(["run", "task", "reason"]), line(["---"] * 3)]
    lines += [line([row.run, row.task.name, row.failure.replace("|", "/")]) for row in lost]
    return "\n".join(lines)


def pack(runs: Sequence[Path], target: Path) -> None:
    """Write the records of runs into an archive, without paths of this machine."""

    def kept(info: tarfile.TarInfo) -> tarfile.TarInfo | None:
        info.uid = info.gid = info.mtime = 0
        info.uname = info.gname = ""
        return None if Path(info.name).suffix in LEFT_OUT else info

    with tarfile.open(target, "w:xz") as archive:
        for run in runs:
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "run.json"
                record = json.loads((run / "run.json").read_text())
                rejected = (record["result"] or {}).get("rejected", [])
                write_json(path, {**{name: record[name] for name in FIELDS}, "rejected": rejected})
                archive.add(path, f"{run.name}/run.json", filter=kept)
            for part in ("model", "tasks", "rejected"):
                if (run / part).exists():
                    archive.add(run / part, f"{run.name}/{part}", filter=kept)


def main() -> None:
    """Pack runs, or write the tables of the packed runs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="*", type=Path)
    parser.add_argument("--records", type=Path, default=RECORDS)
    parser.add_argument("--into", type=Path)
    given = parser.parse_args()
    if given.runs:
        pack(given.runs, given.records)
    with tempfile.TemporaryDirectory() as folder:
        with tarfile.open(given.records) as archive:
            archive.extractall(folder, filter="data")
        rows = [row for run in sorted(Path(folder).iterdir()) for row in rows_of(run)]
    rigid = frozenset(open_library("builtin").classes("rigid"))
    tables = {"sums": sums(rows, rigid), "proposals": proposals(rows, rigid), "failures": failures(rows)}
    if given.into is None:
        print("\n\n".join(tables.values()))
        return
    text = given.into.read_text()
    for name, table in tables.items():
        before, _, rest = text.partition(f"{START.format(name)}\n")
        _, end, after = rest.partition(END)
        assert end, f"{given.into} has no place for {name}"
        text = f"{before}{START.format(name)}\n\n{table}\n\n{END}{after}"
    given.into.write_text(text)


if __name__ == "__main__":
    main()
