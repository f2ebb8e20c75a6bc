"""Demonstrations on disk, in ManiSkill's trajectory format: ``trajectory.h5`` beside ``trajectory.json``.

Each episode is first written to a file of its own under ``episodes/``, whole or not at all, as soon as it is
finished; the two files are merged from those that the caller names, in that order. So nothing that is finished is
lost, and the bytes do not depend on how many workers there were or which was faster.

ManiSkill's own command replays the result, since the environment's id names the module that registers it:

    python -m mani_skill.trajectory.replay_trajectory --traj-path trajectory.h5
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from gensim2.episodes.record import Episode
from gensim2.episodes.recording import Recording
from gensim2.episodes.world import Tree
from gensim2.errors import InputError
from gensim2.files import replacing, write_atomic, write_json
from gensim2.tasks.spec import TaskSpec

SCHEMA_VERSION = 2
H5_NAME, JSON_NAME = "trajectory.h5", "trajectory.json"

_EPISODE_FILE = re.compile(r"^(\d{6,})\.h5$")


@dataclass(frozen=True)
class Provenance:
    """What the demonstrations are of and where they come from; it is written into ``trajectory.json``.

    Attributes:
        task: what was done.
        strategies: by name: how it was done, as plain data.
        assets: ``"builtin"``, or the folder that the objects come from.
        licenses: terms by ``class/id``, which the data carries on.
        seed: of the run.
        environment: further arguments of the environment (the robot, the physics), where they are not its defaults.
        details: anything else worth keeping (versions, command), as plain data.
    """

    task: TaskSpec
    strategies: Mapping[str, Mapping[str, Any]]
    assets: str
    licenses: Mapping[str, str]
    seed: int
    environment: Mapping[str, Any] = field(default_factory=dict)
    details: Mapping[str, Any] = field(default_factory=dict)


class TrajectoryStore:
    """The demonstrations of one task in one folder.

    Args:
        folder: holds ``episodes/``, ``trajectory.h5`` and ``trajectory.json``.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._episodes = folder / "episodes"

    @property
    def h5_path(self) -> Path:
        """The merged file."""
        return self._folder / H5_NAME

    def indices(self) -> tuple[int, ...]:
        """Indices of the episode files that are there, whoever wrote them, sorted."""
        if not self._episodes.is_dir():
            return ()
        matches = (_EPISODE_FILE.match(path.name) for path in self._episodes.iterdir())
        return tuple(sorted(int(match[1]) for match in matches if match))

    def add(self, index: int, recording: Recording, episode: Episode) -> str:
        """Write one finished episode, atomically, and return the digest by which :meth:`digest` knows it again.

        Args:
            index: its place in the order of the merged file; need not be contiguous.
            recording: what was recorded of it.
            episode: what is known of it; its entry in the JSON file holds it.

        Raises:
            InputError: the folder cannot be written to.
        """
        entry = {
            "episode_seed": recording.seed,
            "control_mode": recording.control_mode,
            "elapsed_steps": recording.steps,
            "reset_kwargs": {"seed": recording.seed, "options": recording.reset_options},
            "success": bool(recording.success[-1]),
            "instances": recording.instances,
            "episode": episode.to_dict(),
        }
        buffer = io.BytesIO()
        with h5py.File(buffer, "w") as file:
            file.attrs["episode"] = json.dumps(entry, allow_nan=False)
            _write_recording(file.create_group("traj"), recording)
        content = buffer.getvalue()
        write_atomic(self._path(index), content)
        return hashlib.sha256(content).hexdigest()

    def digest(self, index: int) -> str | None:
        """Digest of an episode file's bytes; None where there is no such file, or none that can be read."""
        try:
            with self._path(index).open("rb") as file:
                return hashlib.file_digest(file, "sha256").hexdigest()
        except OSError:
            return None

    def entry(self, index: int, digest: str | None) -> dict[str, Any]:
        """What the JSON file says of a finished episode, whose file has this digest.

        Raises:
            InputError: there is no such episode, or it is damaged.
        """
        with self._episode(index, digest) as (_, entry):
            return entry

    def merge(self, provenance: Provenance, episodes: Mapping[int, str | None]) -> Path:
        """Write ``trajectory.h5`` and ``trajectory.json`` from finished episodes and return the first.

        Args:
            provenance: goes into the JSON file.
            episodes: index to the digest of its file, in order.

        Raises:
            InputError: there is no episode, or one is damaged.
        """
        if not episodes:
            raise InputError("there is no finished episode to merge", file=self._folder)
        entries = []
        # The data first: a JSON file never promises what is not there.
        with replacing(self.h5_path) as path, h5py.File(path, "w") as merged:
            for number, (index, digest) in enumerate(episodes.items()):
                with self._episode(index, digest) as (recorded, entry):
                    recorded.file.copy(recorded, merged, name=f"traj_{number}")
                    entries.append({"episode_id": number, **entry})
        write_json(self._folder / JSON_NAME, _document(provenance, entries))
        return self.h5_path

    def _path(self, index: int) -> Path:
        return self._episodes / f"{index:06d}.h5"

    @contextlib.contextmanager
    def _episode(self, index: int, digest: str | None) -> Iterator[tuple[h5py.Group, dict[str, Any]]]:
        """The recording and the entry of an episode file.

        Only bytes that were recorded reach HDF5: damaged ones can end the process.
        """
        path = self._path(index)
        try:
            content = path.read_bytes()
            if digest is None or hashlib.sha256(content).hexdigest() != digest:
                raise ValueError(f"{path} has another digest")
            with h5py.File(io.BytesIO(content), "r") as file:
                yield file["traj"], _entry(file)
        except (OSError, KeyError, ValueError, TypeError, RuntimeError) as error:
            raise InputError("is not a finished episode", file=path, remedy="delete it and resume") from error


def _entry(file: h5py.File) -> dict[str, Any]:
    entry = json.loads(file.attrs["episode"])
    if not isinstance(entry, dict) or not isinstance(entry.get("instances"), dict):
        raise ValueError("the episode does not say what it is of")
    return entry


def _env_id(task: TaskSpec) -> str:
    from gensim2.sim.registration import env_id  # here: it brings gymnasium, which refusing arguments needs not

    return env_id(task)


def env_kwargs(
    task: TaskSpec, assets: str, instances: Mapping[str, Sequence[str]], environment: Mapping[str, Any]
) -> dict[str, Any]:
    """Arguments with which ``gym.make(env_id(task), ...)`` makes the environment of the demonstrations.

    Args:
        task: what was done.
        assets: ``"builtin"``, or a folder.
        instances: ids by object.
        environment: further arguments.
    """
    kwargs: dict[str, Any] = {
        "obs_mode": "state",
        "control_mode": "pd_joint_pos",
        "sim_backend": "physx_cpu",
        "reward_mode": "sparse",
        "assets": assets if assets == "builtin" else str(Path(assets).resolve()),
        "instances": {name: list(ids) for name, ids in instances.items()},
        **environment,
    }
    if not _env_id(task).endswith(task.env_id):  # not in the library: the spec travels with the data
        kwargs["task"] = task.model_dump(mode="json")
    return kwargs


def _document(provenance: Provenance, entries: list[dict[str, Any]]) -> dict[str, Any]:
    task = provenance.task
    instances = {name: sorted({entry["instances"][name] for entry in entries}) for name in task.objects}
    names = [f"{task.objects[name].asset_class}/{id}" for name, ids in instances.items() for id in ids]
    return {
        "env_info": {
            "env_id": _env_id(task),
            "env_kwargs": env_kwargs(task, provenance.assets, instances, provenance.environment),
            "max_episode_steps": task.max_episode_steps,
        },
        "commit_info": None,
        "source_type": "motionplanning",
        "source_desc": f"gensim2 keypoint planner: {task.description}",
        "gensim2": {
            "schema_version": SCHEMA_VERSION,
            "task": task.model_dump(mode="json"),
            "strategies": {name: dict(strategy) for name, strategy in provenance.strategies.items()},
            "seed": provenance.seed,
            "licenses": {name: provenance.licenses[name] for name in names if name in provenance.licenses},
            **provenance.details,
        },
        "episodes": entries,
    }


def _write_recording(group: h5py.Group, recording: Recording) -> None:
    """Names, shapes and types as ManiSkill's ``RecordEpisode`` writes them."""
    group.create_dataset("obs", data=recording.obs)
    group.create_dataset("actions", data=recording.actions)
    group.create_dataset("terminated", data=recording.terminated)
    group.create_dataset("truncated", data=recording.truncated)
    group.create_dataset("success", data=recording.success)
    _write_tree(group.create_group("env_states"), recording.env_states)
    group.create_dataset("rewards", data=recording.rewards)


def _write_tree(group: h5py.Group, tree: Tree) -> None:
    for name, value in tree.items():
        if isinstance(value, dict):
            _write_tree(group.create_group(name), value)
        else:
            group.create_dataset(name, data=np.asarray(value))
