"""Manage a run folder, which has the results of a run and everything needed to resume the run.

OUT/run.json                    command, identity, versions, hashes and licences of the objects, outcome
OUT/report.html                 page that shows the results
OUT/errors.log                  failed attempts, with their tracebacks
OUT/tasks/<Task>/               task.yaml, strategies/, checker.json, design.json, verification.json, trajectory.h5, ...
OUT/rejected/<Task>/            the same files for tasks that were designed but rejected
"""

from __future__ import annotations

import itertools
import platform
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from gensim2.core.errors import InputError
from gensim2.core.files import write_changed, write_json
from gensim2.core.progress import now
from gensim2.core.record_files import read_record
from gensim2.core.resumable import ResumableFolder, command_line
from gensim2.core.yaml_files import dump_yaml
from gensim2.data.records import RUN_SCHEMA_VERSION, CheckerRecord, Effort, RunRecord, Verification, VerificationRecord
from gensim2.objects import Library, ObjectModel
from gensim2.rollout.checker_result import CheckerResult
from gensim2.rollout.identity import versions
from gensim2.rollout.record import Episode
from gensim2.scenes.physics import DEFAULT_ENGINE, ENGINES, Engine
from gensim2.tasks.spec import TaskSpec
from gensim2.tasks.strategies import Strategies

RUN_JSON = "run.json"


def default_run_dir() -> Path:
    """Return ``runs/<date>-<time>`` in the current folder, with a number appended if the folder exists."""
    first = Path("runs") / time.strftime("%Y%m%d-%H%M%S")
    others = (first.with_name(f"{first.name}-{number}") for number in itertools.count(2))
    return next(path for path in itertools.chain([first], others) if not path.exists())


class RunFolder(ResumableFolder[RunRecord]):
    """Context manager of a new or resumed run folder, which is locked while it is open.

    Args:
        path: the folder.
        arguments: arguments of the run. When the run is resumed, the arguments in ``records.FIXED_ARGUMENTS`` must be
            the same.
        identity: digests of all other inputs that determine the results. A resumed run must have the same digests.
        resume: continue an existing run.

    Raises:
        InputError: the folder is another run's, in use, damaged or not writable, or it exists and ``resume`` is false.
    """

    def __init__(self, path: Path, arguments: dict[str, Any], identity: Mapping[str, str], resume: bool) -> None:
        super().__init__(path, RUN_JSON, self._new(arguments, identity), holds="a run", resume=resume)

    @property
    def errors_log(self) -> Path:
        """Path of the log of failed attempts."""
        return self.path / "errors.log"

    def save(self) -> None:
        self.record.assets = dict(sorted(self.record.assets.items()))
        self.record.licenses = dict(sorted(self.record.licenses.items()))
        super().save()

    def add_object(self, model: ObjectModel) -> None:
        """Record an object that the run uses.

        Raises:
            InputError: the object has changed since the run first used it.
        """
        key = f"{model.asset_class}/{model.id}"
        before = self.record.assets.setdefault(key, model.content_hash)
        if before != model.content_hash:
            raise InputError(
                "the object has changed since the run began: its hash was "
                f"{before[:12]}, and is now {model.content_hash[:12]}",
                file=self.path / RUN_JSON,
                field=f"assets.{key}",
                remedy="restore the object, or choose another --out",
            )
        self.record.licenses[key] = model.license

    def add_episodes(self, library: Library, episodes: Iterable[Episode], source: Path) -> None:
        """Record the objects of episodes.

        Args:
            source: file that contains the episodes, for error messages.

        Raises:
            InputError: an object has changed since an episode used it.
        """
        for episode in episodes:
            for record in episode.objects.values():
                model = library.load(record.asset_class, record.id)
                self.add_object(model)
                if record.content_hash != model.content_hash:
                    key = f"{record.asset_class}/{record.id}"
                    raise InputError(
                        f"the episode was recorded with a different version of the object {key}",
                        file=source,
                        field=f"seed {episode.seed}",
                        remedy="restore that version of the object, or delete the file and resume",
                    )

    def note_effort(self, task: str, cpu_s: float, wall_s: float) -> None:
        """Record the time of designing and verifying a task, unless an earlier call has recorded it already."""
        self.record.effort.setdefault(task, Effort(cpu_s=round(cpu_s, 3), wall_s=round(wall_s, 3)))
        self.save()

    def finish(self, result: dict[str, Any]) -> None:
        self.record.result = result
        self.record.finished = now()
        self.save()

    def task(self, name: str) -> TaskFolder:
        """Return the folder of a task, kept or rejected."""
        rejected = self.path / "rejected" / name
        return TaskFolder(rejected if rejected.exists() else self.path / "tasks" / name)

    def reject(self, name: str) -> None:
        """Move a task's folder from ``tasks`` to ``rejected``."""
        source, target = self.path / "tasks" / name, self.path / "rejected" / name
        if source.exists():
            target.parent.mkdir(parents=True, exist_ok=True)
            source.rename(target)

    @staticmethod
    def _new(arguments: dict[str, Any], identity: Mapping[str, str]) -> RunRecord:
        return RunRecord(
            schema_version=RUN_SCHEMA_VERSION,
            arguments=arguments,
            identity=dict(identity),
            command_line=command_line(),
            started=now(),
            finished=None,
            versions=versions(*_engines(arguments)),
            platform=platform.platform(),
            assets={},
            licenses={},
            result=None,
            resumed=0,
        )


class TaskFolder:
    """The files of one task."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def write_task(self, task: TaskSpec) -> None:
        """Write ``task.yaml``."""
        write_changed(self.path / "task.yaml", dump_yaml(task.model_dump(mode="json", exclude_none=True)))

    def write_strategies(self, strategies: Strategies) -> None:
        """Write ``strategies/<name>.yaml`` for each strategy."""
        for name, data in strategies.items():
            write_changed(self.path / f"strategies/{name}.yaml", dump_yaml(data))

    def write_checker(self, result: CheckerResult) -> None:
        """Write ``checker.json``."""
        write_json(self.path / "checker.json", {"schema_version": 1, **result.to_dict()})

    def checker(self) -> CheckerResult | None:
        """Return the check of the success criteria, or None if there is none yet.

        Raises:
            InputError: the file is damaged.
        """
        path = self.path / "checker.json"
        if not path.exists():
            return None
        return read_record(path, CheckerRecord, "delete the file and resume").result

    @property
    def verification_path(self) -> Path:
        return self.path / "verification.json"

    def write_verification(self, verification: Verification) -> None:
        write_json(self.verification_path, verification.to_dict())

    def verification(self) -> Verification | None:
        """Return the verification, or None if there is none yet.

        Raises:
            InputError: the file is damaged.
        """
        path = self.verification_path
        if not path.exists():
            return None
        return read_record(path, VerificationRecord, "delete the file and resume").verification


def _engines(arguments: Mapping[str, Any]) -> tuple[Engine, ...]:
    return ENGINES if arguments.get("engines") == "both" else (arguments.get("engine", DEFAULT_ENGINE),)
