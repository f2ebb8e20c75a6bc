"""Folders of objects as users have them, drawn by a seed: what is proposed and designed on each.

    python benchmarks/user_folders.py [--folders 60] [--whole 12] [--skip 0] [--no-proposals] [--assets DIR]
        [--workers 2] [--made DIR] [--json FILE]

A folder is a random subset of classes, of real objects (``--assets``) or of generated ones that were exported: with few
objects or one, under other ids, rigid ones alone, class folders that are links, or classes of the user's own names. On
each the proposals of the offline designer are made and objects of all classes are looked at. On the first ``--whole``
of those that have a class with a joint, and on one without, ``run-pipeline``, ``demo``, ``collect`` and
``benchmark`` are run as commands.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import resource
import shutil
import sys
import tempfile
import time
import traceback
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from gensim2.cli import main as cli
from gensim2.core.errors import GenSim2Error
from gensim2.core.progress import NULL_PROGRESS
from gensim2.core.seeding import rng
from gensim2.design import Brief, OfflineDesigner
from gensim2.design.base import Known
from gensim2.design.briefing import Classes, robot_summary
from gensim2.objects import ObjectModel, open_library
from gensim2.objects.library.export import export
from gensim2.rollout.inputs import of_these_objects
from gensim2.tasks.library import load_strategies, load_task, packaged_names

KINDS = ("subset", "other ids", "one object", "only rigid", "links", "unknown names")
PROPOSALS = 200
"""At most, of one folder."""
INTERRUPTED = (129, 130, 143)
"""Exit codes of a command that a signal ended, which is meant for all of this."""


@dataclass
class Folder:
    """One drawn folder.

    Attributes:
        path: where it lies.
        kind: of ``KINDS``.
        articulated, rigid: number of classes.
    """

    path: Path
    kind: str
    articulated: int
    rigid: int


def make_folder(number: int, where: Path, pool: Path) -> Folder:
    """Make the folder of a number from a pool in the release's layout; objects are links or copies.

    Args:
        number: seeds all that is drawn.
        where: the new folder.
        pool: holds ``articulated_objs`` and ``rigidbody_objs/models``.
    """
    generator = rng(number, "user folder")
    kind = KINDS[number % len(KINDS)]
    articulated = sorted(path for path in (pool / "articulated_objs").iterdir() if path.is_dir())
    rigid = sorted(path for path in (pool / "rigidbody_objs" / "models").iterdir() if path.is_dir())
    counts = {"one object": (1, 0), "only rigid": (0, int(generator.integers(1, 6)))}
    wanted, wanted_rigid = counts.get(kind, (int(generator.integers(1, 8)), int(generator.integers(0, 4))))
    if where.is_dir():
        return Folder(where, kind, wanted, wanted_rigid)
    where.mkdir(parents=True)  # empty where the pool has no rigid objects
    for index in generator.choice(len(articulated), min(wanted, len(articulated)), replace=False):
        source = articulated[index]
        name = f"my_{source.name}" if kind == "unknown names" else source.name
        target = where / "articulated_objs" / name
        if kind == "links":
            target.parent.mkdir(parents=True, exist_ok=True)
            target.symlink_to(source)
            continue
        objects = sorted(path for path in source.iterdir() if (path / "mobility.urdf").is_file())
        most = 1 if kind == "one object" else int(generator.integers(1, 4))
        for place, chosen in enumerate(generator.choice(len(objects), min(most, len(objects)), replace=False)):
            id = f"mine-{place}" if kind == "other ids" else objects[chosen].name
            (target / id).parent.mkdir(parents=True, exist_ok=True)
            shutil.copytree(objects[chosen], target / id)
    for index in generator.choice(len(rigid), min(wanted_rigid, len(rigid)), replace=False):
        shutil.copytree(rigid[index], where / "rigidbody_objs" / "models" / rigid[index].name)
    return Folder(where, kind, wanted, wanted_rigid)


def make_pool(where: Path, assets: Path | None) -> list[Path]:
    """Return the folders that objects are drawn from: exported generated ones, and real ones where there are some."""
    made = where / "generated"
    if made.is_dir():
        return [made] if assets is None else [made, assets]
    library = open_library("builtin")
    for name in library.classes("articulated"):
        for each in library.instances(name)[:2]:
            export(library.load_articulated(name, each), made)
    models = made / "rigidbody_objs" / "models"
    if assets is None:  # rigid objects have no export: generated ones stand in for what a folder lacks
        models.mkdir(parents=True)
        return [made]
    models.parent.mkdir(parents=True)
    models.symlink_to(assets / "rigidbody_objs" / "models")
    return [made, assets]


class _Noted:
    """Takes note of the objects that a designer was told of, in the place of a run folder."""

    def __init__(self) -> None:
        self.objects: set[str] = set()

    def add_object(self, model: ObjectModel) -> None:
        self.objects.add(f"{model.asset_class}/{model.id}")


@cache
def _packaged() -> list[Known]:
    return [Known(load_task(name), load_strategies(name)) for name in packaged_names()]


def proposals(folder: Folder) -> dict[str, Any]:
    """Return how many tasks the offline designer proposes, and load an object of each class that it was told of."""
    library = open_library(folder.path)
    noted: Any = _Noted()
    classes = Classes(library, "all", 0, noted, NULL_PROGRESS)
    known = _packaged()
    # Nothing known in one half: so that what is familiar is proposed again and pieces are made.
    found: list[str] = []
    for have in (known, known[:: len(known) // 8], []):
        for task in OfflineDesigner().propose(Brief(robot_summary("panda"), classes, have), 0):
            found.append(task.name)
            if len(found) % PROPOSALS == 0:
                break
    tasks, skipped = of_these_objects(str(folder.path), packaged_names())
    return {"proposals": len(found), "objects": len(noted.objects), "tasks": len(tasks), "skipped": len(skipped)}


def command(words: list[str]) -> dict[str, Any]:
    """Run a command of gensim2 and return its exit code and what it said; all in this process, which imports once."""
    begin, cpu = time.monotonic(), cpu_seconds()
    out, err = io.StringIO(), io.StringIO()
    code = None
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code = cli.run(words)
        except Exception:  # noqa: BLE001 - what a user must never see is counted, not raised
            err.write(traceback.format_exc())
    if code in INTERRUPTED:
        sys.exit(code)
    said = err.getvalue().strip().splitlines()
    return {
        "code": code,
        "said": said[-1] if said else "",
        "clean": code is not None and "Traceback" not in err.getvalue(),
        "s": round(time.monotonic() - begin, 1),
        "cpu_s": round(cpu_seconds() - cpu, 1),
    }


def cpu_seconds() -> float:
    """CPU of this process and of the workers that have ended."""
    own, ended = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return own.ru_utime + own.ru_stime + ended.ru_utime + ended.ru_stime


def whole(folder: Folder, out: Path, workers: int) -> dict[str, Any]:
    """Design, keep, demonstrate, collect and measure on one folder."""
    common = ["--assets", str(folder.path), "--workers", str(workers)]
    told = out / "pipeline.json"
    found: dict[str, Any] = {}
    words = ["run-pipeline", "--single", "1", "--episodes", "1", "--from-empty", "--verify", "10", "--videos", "0"]
    words += ["--out", str(out / "run"), "--json", str(told), "--library", str(out / "library")]
    found["run-pipeline"] = command([*words, *common])
    result = json.loads(told.read_text()) if told.is_file() else {"tasks": [], "notes": []}
    kept = [task["name"] for task in result["tasks"] if task["kept"]]
    found |= {"designed": len(result["tasks"]), "kept": kept, "notes": result["notes"]}
    try:
        suite = list(of_these_objects(str(folder.path))[0])
    except GenSim2Error as error:
        found["suite"], suite = str(error), []
    tasks = [str(out / "run" / "tasks" / name) for name in kept[:1]] or suite[:1]
    for task in tasks:
        end = ["--videos", "0", "--out"]
        found["demo"] = command(["demo", task, "--episodes", "1", *end, str(out / "demo"), *common])
        end = ["--episodes", "2", "--out"]
        found["collect"] = command(["collect", task, *end, str(out / "collected"), *common])
        found["benchmark"] = command(["benchmark", task, "--runs", "1", *end, str(out / "bench"), *common])
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folders", type=int, default=60)
    parser.add_argument("--whole", type=int, default=12)
    parser.add_argument("--skip", type=int, default=0, help="leave out so many of those that are gone through whole")
    parser.add_argument("--no-proposals", dest="propose", action="store_false")
    parser.add_argument("--assets", type=Path, default=os.environ.get("GENSIM2_ASSETS"))
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument(
        "--made", type=Path, help="keep the folders and what the commands leave here, or go on with them"
    )
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as elsewhere:
        made = options.made or Path(elsewhere)
        pools = make_pool(made, options.assets)
        folders = [make_folder(n, made / str(n), pools[n % len(pools)]) for n in range(options.folders)]
        for number, folder in enumerate(folders):
            row: dict[str, Any] = {**asdict(folder), "path": number}
            try:
                row |= proposals(folder) if options.propose else {}
            except GenSim2Error as error:
                row["refused"] = str(error)
            except Exception:  # noqa: BLE001 - what a user must never see is counted, not raised
                row["traceback"] = traceback.format_exc()
            rows.append(row)
            print(number, {name: value for name, value in row.items() if name != "path"}, flush=True)
        jointed = [n for n, folder in enumerate(folders) if folder.articulated]
        rigid = [n for n, folder in enumerate(folders) if not folder.articulated]
        for number in [*jointed[options.skip : options.whole], *rigid[:1]] if options.whole else []:
            out = made / f"out-{number}"
            done = out / "done.json"
            if not done.is_file():
                shutil.rmtree(out, ignore_errors=True)
                out.mkdir()
                done.write_text(json.dumps(whole(folders[number], out, options.workers)))
            rows[number]["whole"] = json.loads(done.read_text())
            print(number, rows[number]["whole"], flush=True)
            if options.json:
                options.json.write_text(json.dumps(rows, indent=1, default=str))
    done = [row["whole"] for row in rows if "whole" in row and row["articulated"]]
    wrong = [row["path"] for row in rows if "traceback" in row]
    commands = [
        each[name] for each in done for name in ("run-pipeline", "demo", "collect", "benchmark") if name in each
    ]
    print(f"{len(rows)} folders, {len(wrong)} with a traceback: {wrong}")
    if options.propose:
        print(f"median of proposals: {np.median([row.get('proposals', 0) for row in rows]):g}")
    print(f"of {len(done)} with a joint {sum(bool(each['kept']) for each in done)} have a task designed and kept")
    print(f"{sum(each.get('clean', False) for each in commands)} of {len(commands)} commands without a traceback")
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1, default=str))
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
