"""The run folder: what a run leaves behind, and what lets a second run go on where the first one stopped.

OUT/run.json                    command, seed, versions, hashes and licences of the objects, outcome
OUT/report.html
OUT/tasks/<Task>/               task.yaml, solver.yaml, design.json, verification.json, trajectory.h5, ...
OUT/rejected/<Task>/            the same for what was designed and not kept
"""

from __future__ import annotations

import importlib.metadata
import json
import platform
import shutil
import sys
import time
from pathlib import Path
from typing import Any

import yaml

from gensim2.errors import InputError
from gensim2.files import write_atomic, write_json
from gensim2.pipeline.records import SCHEMA_VERSION, Verification
from gensim2.tasks.spec import TaskSpec

#: Distributions whose versions decide what an episode looks like.
VERSIONED = ("gensim2", "mani_skill", "sapien", "numpy", "torch")

#: Arguments that a resumed run must share with the run it resumes.
IDENTITY = ("command", "seed", "assets", "designer", "target_task", "episodes", "instance")


def default_run_dir() -> Path:
    """Return ``runs/<date>-<time>`` under the present folder."""
    return Path("runs") / time.strftime("%Y%m%d-%H%M%S")


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that decide the outcome."""
    found = {"python": platform.python_version()}
    for name in VERSIONED:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = "absent"
    return found


class RunFolder:
    """A run folder, new or resumed.

    Args:
        path: the folder.
        arguments: what the run was asked to do; those in ``IDENTITY`` must agree when resuming.
        resume: go on with a folder that a run began.

    Raises:
        InputError: the folder exists and ``resume`` is off, or it belongs to a different run, or cannot be written.
    """

    def __init__(self, path: Path, arguments: dict[str, Any], resume: bool) -> None:
        self.path = path
        record = path / "run.json"
        if path.exists() and not path.is_dir():
            raise InputError("is not a folder", file=path, remedy="choose another --out")
        if record.exists():
            if not resume:
                raise InputError("holds a run already", file=path, remedy="add --resume, or choose another --out")
            self.record = read_json(record)
            for name in IDENTITY:
                before, now = self.record["arguments"].get(name), arguments.get(name)
                if before != now:
                    raise InputError(
                        f"the run was started with {before!r}, not {now!r}",
                        file=record,
                        field=f"arguments.{name}",
                        remedy="resume with the same arguments, or choose another --out",
                    )
            self.record["arguments"] = arguments
            self.record["resumed"] = self.record.get("resumed", 0) + 1
        else:
            if path.exists() and any(path.iterdir()):
                raise InputError("is not empty and holds no run", file=path, remedy="choose another --out")
            self.record = {
                "schema_version": SCHEMA_VERSION,
                "arguments": arguments,
                "command_line": sys.argv[1:],
                "started": time.strftime("%Y-%m-%dT%H:%M:%S%z"),
                "finished": None,
                "versions": versions(),
                "platform": platform.platform(),
                "assets": {},
                "licenses": {},
                "result": None,
                "resumed": 0,
            }
        self.save()

    def save(self) -> None:
        """Write ``run.json``."""
        write_json(self.path / "run.json", self.record)

    def add_instance(self, key: str, content_hash: str, license: str) -> None:
        """Note an object that the run used; ``key`` is ``class/id``."""
        self.record["assets"][key] = content_hash
        self.record["licenses"][key] = license

    def finish(self, result: dict[str, Any]) -> None:
        """Note the outcome and the time."""
        self.record["result"] = result
        self.record["finished"] = time.strftime("%Y-%m-%dT%H:%M:%S%z")
        self.save()

    def task(self, name: str) -> TaskFolder:
        """Return the folder of a task, kept or not, as it stands."""
        rejected = self.path / "rejected" / name
        return TaskFolder(rejected if rejected.exists() else self.path / "tasks" / name)

    def reject(self, name: str) -> None:
        """Move a task's folder from ``tasks`` to ``rejected``."""
        source, target = self.path / "tasks" / name, self.path / "rejected" / name
        if source.exists():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.move(source, target)


class TaskFolder:
    """The files of one task."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def write_task(self, task: TaskSpec) -> None:
        """Write ``task.yaml``."""
        write_atomic(self.path / "task.yaml", dump_yaml(task.model_dump(mode="json", exclude_none=True)))

    def write_config(self, config: dict[str, Any]) -> None:
        """Write ``solver.yaml``."""
        write_atomic(self.path / "solver.yaml", dump_yaml(config))

    def read(self, name: str) -> dict[str, Any] | None:
        """Return a JSON file of the folder, or None where it has not been written yet."""
        path = self.path / name
        return read_json(path) if path.exists() else None

    def verification(self) -> Verification | None:
        """Return the verification, or None where it has not been done yet."""
        value = self.read("verification.json")
        return Verification.from_dict(value) if value is not None else None


def dump_yaml(value: dict[str, Any]) -> str:
    """Return YAML in the order given, lists of numbers on one line."""
    return yaml.dump(value, sort_keys=False, default_flow_style=None, width=100, allow_unicode=True)


def read_json(path: Path) -> dict[str, Any]:
    """Read a JSON object.

    Raises:
        InputError: it cannot be read or is not an object.
    """
    try:
        value = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise InputError(f"cannot be read: {error}", file=path, remedy="restore or delete the file") from error
    if not isinstance(value, dict):
        raise InputError("is not a JSON object", file=path, remedy="restore or delete the file")
    return value
