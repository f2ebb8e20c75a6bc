"""Read and write ``learn.json``, the record of a ``gensim2 learn`` run: arguments, gradient steps and CPU times."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field

from gensim2.core.errors import InputError
from gensim2.core.files import new_folder, write_json
from gensim2.core.foreign.tree import ForeignTree
from gensim2.core.record_files import read_record
from gensim2.core.resumable import ResumableFolder, RunSettings, differing
from gensim2.data.store import OBSERVATIONS
from gensim2.perception import DepthNoise, ObservationSpec
from gensim2.policy.keypose.adding import BESIDE, DATA
from gensim2.policy.learn_settings import learn_configs, observation_of
from gensim2.policy.train import holds_training
from gensim2.scenes.config import SceneRecord
from gensim2.scenes.physics import Engines

LEARN_JSON = "learn.json"
LOCK = ".learn.lock"
DATA_FIELDS = ("tasks", "multi_task", "seed", "objects", "generated", "scene", "noise", "verify", "engines")
"""Fields that determine the demonstrations of a policy, apart from the observation spec."""
REFUSED = "give a folder that gensim2 learn has made"


class LearnRecord(RunSettings):
    """Content of ``learn.json``: the arguments, which must be the same in a resumed run, and the progress.

    Attributes:
        minutes: limit of the CPU time for data and training, min.
        objects: number of generated training objects of each class. None: the objects of ``scene``.
        generated: number of generated objects of each class in addition to the objects of ``scene``.
        verify: whether scenes whose plans fail in simulation are left out.
        engines: ``"both"`` if only demonstrations that succeed in both physics engines are used.
        noise: depth noise of the cameras; None for exact depth.
        text, text_model: text encoder of a policy for several tasks, and its weights, as the user gave them.
        settings: network and training settings that the user gave.
        start: folder of the starting policy and the SHA-256 of its ``config.json``. None: training from scratch.
        demonstrations_of: folder of another run whose demonstrations were copied.
        steps: number of gradient steps by folder of the policy, fixed when the training of the policy starts.
        data_cpu_s: CPU time (s) of the demonstrations by folder of the policy, including copied demonstrations.
        episodes: number of demonstrations of each task, by folder of action-chunk policies.
    """

    FREE = frozenset({"steps", "data_cpu_s", "episodes", "demonstrations_of", "start"})

    schema_version: Literal[1] = 1
    tasks: tuple[str, ...]
    policy: str
    minutes: float
    multi_task: bool
    seed: int
    scenes: int
    objects: int | None = None
    generated: int | None = None
    verify: bool = False
    engines: Engines = "one"
    scene: SceneRecord
    noise: dict[str, float | bool] | None = None
    text: str | None = None
    text_model: str | None = None
    settings: dict[str, Any] = Field(default_factory=dict)
    start: tuple[str, str] | None = None
    demonstrations_of: str | None = None
    steps: dict[str, Annotated[int, Field(ge=1)]] = Field(default_factory=dict)
    data_cpu_s: dict[str, Annotated[float, Field(ge=0)]] = Field(default_factory=dict)
    episodes: dict[str, Annotated[int, Field(ge=0)]] = Field(default_factory=dict)

    def differences(self, now: Self) -> Iterator[tuple[str, str]]:
        """Yield the fields that differ between two records.

        The starting policies are compared by their content (SHA-256), so the folder of a starting policy may be moved.
        """
        yield from super().differences(now)
        was, given = ((each.start or (None, None))[1] for each in (self, now))
        yield from differing("start", was, given)
        if now.demonstrations_of is not None:
            yield from differing("demonstrations", self.demonstrations_of, now.demonstrations_of)

    def resumed_by(self, now: Self) -> Self:
        """Return this record with the path of the starting policy from ``now``, the record of the resuming command."""
        return self.model_copy(update={"start": now.start})

    @property
    def is_of_plans(self) -> bool:
        """Return whether the policies are keypose policies, which train on plans and not on episodes."""
        return self.policy == "keypose"

    @property
    def observation(self) -> ObservationSpec:
        """Return the observation spec of the policies.

        Raises:
            InputError: a setting is unknown or invalid.
        """
        noise = None if self.noise is None else DepthNoise(**self.noise)  # type: ignore[arg-type]
        return observation_of(learn_configs(self.policy, self.settings)[0], noise)


class LearnFolder(ResumableFolder[LearnRecord]):
    """Folder of a ``gensim2 learn`` run.

    Training locks this folder, too, with the usual lock file. Therefore the run uses another lock file.

    Raises:
        InputError: the folder has a run with other arguments or a policy of another command, or it has a run and
            ``resume`` is false.
    """

    def __init__(self, out: Path, record: LearnRecord, resume: bool) -> None:
        super().__init__(out, LEARN_JSON, record, holds="a run", resume=resume, lock=LOCK, alone=False)

    def _opened(self, settings: LearnRecord) -> LearnRecord:
        out = self.path
        folders = (out, *(out / name for name in settings.tasks))
        if not (out / LEARN_JSON).exists() and any(map(holds_training, folders)):
            wrong = "the folder contains a policy that was trained by a different command"
            raise InputError(wrong, file=out, remedy="choose another --out")
        return super()._opened(settings)


def check_demonstrations(other: Path, record: LearnRecord) -> None:
    """Raise an error if another run's demonstrations differ from the demonstrations that this run would make.

    Raises:
        InputError: the folder has no run, or a run with other arguments; the message names the field.
    """
    there = read_record(other / LEARN_JSON, LearnRecord, REFUSED)
    if there.is_of_plans is not record.is_of_plans:
        kinds = {True: "plans", False: "episodes"}
        message = f"its demonstrations are {kinds[there.is_of_plans]}, but the policy needs {kinds[record.is_of_plans]}"
        raise InputError(message, file=other, field="policy")
    for name in DATA_FIELDS:
        was, now = getattr(there, name), getattr(record, name)
        if was != now:
            wrong = f"the value is {was!r} in the other run, but {now!r} in this run"
            raise InputError(wrong, file=other / LEARN_JSON, field=name)
    if record.is_of_plans:  # plan files contain point clouds, which must match the observation spec
        record.observation.require(there.observation, str(other / LEARN_JSON), of="this run")


def take_demonstrations(record: LearnRecord, key: str, folder: Path, out: Path) -> None:
    """Copy a policy's demonstrations from ``record.demonstrations_of``, unless the policy already has some.

    If the observation spec differs, the rendered observations are not copied.

    Args:
        record: record of the run; the CPU time of the copied demonstrations is added to the record.
        key: path of the policy's folder relative to ``out``. In the folder of the other run the path is the same.
        folder: absolute path of the policy's folder.
        out: folder of the run.

    Raises:
        InputError: the other run has no demonstrations.
    """
    if record.demonstrations_of is None or (folder / DATA).exists():
        return
    other = Path(record.demonstrations_of)
    there = read_record(other / LEARN_JSON, LearnRecord, REFUSED)
    found = other / key / DATA
    if not found.is_dir():
        raise InputError("contains no demonstrations", file=found, remedy="leave --demonstrations out")
    record.data_cpu_s[key] = there.data_cpu_s.get(key, 0.0)
    if key in there.episodes:
        record.episodes[key] = there.episodes[key]
    # Save the record first, so that a resumed run copies again and still knows the CPU time.
    write_json(out / LEARN_JSON, record.model_dump(mode="json"))
    seen_alike = there.observation == record.observation
    leave_out = None if seen_alike else OBSERVATIONS
    with new_folder(folder / DATA) as made:
        both = [f"{name}{end}" for name in record.tasks for end in ("", BESIDE)]
        for name in both if record.is_of_plans else ["."]:
            part = ForeignTree(other).inside(f"{key}/{DATA}/{name}")
            if part.is_dir():
                (made / name).mkdir(exist_ok=True)
                ForeignTree(part).copy_all(made / name, leave_out)
