"""Write demonstrations in ManiSkill's trajectory format: ``trajectory.h5`` and ``trajectory.json``.

Each finished episode is written atomically under ``episodes/``, so an interruption loses no episode.
:func:`write_trajectory` merges the files in the order of ``episodes``, so the bytes do not depend on the workers.

ManiSkill's own command can replay the result:

    python -m mani_skill.trajectory.replay_trajectory --traj-path trajectory.h5

The id in ``trajectory.json`` begins with a module. The command imports this module to register the environment.
"""

from __future__ import annotations

import contextlib
import json
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py

from gensim2.core.errors import InputError
from gensim2.core.files import replacing
from gensim2.data.episode_file import LIBVER, DamagedEpisodeError, RecordingHeader, open_episode
from gensim2.rollout.controller_spec import CHAIN
from gensim2.rollout.record import Episode
from gensim2.tasks.spec import TaskSpec

SCHEMA_VERSION = 2
H5_NAME, JSON_NAME = "trajectory.h5", "trajectory.json"


@dataclass(frozen=True)
class TrajectoryMetadata:
    """Task, strategies and sources of demonstrations, written into ``trajectory.json``.

    Attributes:
        strategies: strategies by name, as plain data.
        assets: folder of the objects, or ``"builtin"``.
        licenses: licences by ``class/id``, which also apply to the data.
        seed: seed of the run.
        environment: arguments of the environment (robot, physics) that differ from the defaults.
        details: further facts to store, such as the versions and the command, as plain data.
        controller: class that chose the actions, written as ``module:Class`` or ``FILE.py:Class``.
    """

    task: TaskSpec
    strategies: Mapping[str, Mapping[str, Any]]
    assets: str
    licenses: Mapping[str, str]
    seed: int
    environment: Mapping[str, Any] = field(default_factory=dict)
    details: Mapping[str, Any] = field(default_factory=dict)
    controller: str = CHAIN


def write_trajectory(folder: Path, provenance: TrajectoryMetadata, episodes: Sequence[tuple[Path, str | None]]) -> None:
    """Write ``trajectory.h5`` and ``trajectory.json`` from episode files, with one episode in memory at a time.

    Args:
        folder: output folder.
        provenance: task, strategies and sources, for the JSON file.
        episodes: (file, digest) of each episode, in the order of the trajectories.

    Raises:
        InputError: there are no episodes, or one is damaged or has no states.
    """
    if not episodes:
        raise InputError("there is no finished episode to merge", file=folder)
    used: dict[str, set[str]] = {name: set() for name in provenance.task.objects}
    # ``trajectory.h5`` is written first, so that the JSON file never refers to missing data. In the JSON file, the list
    # of used objects precedes the episodes but is complete only at the end. Therefore entries go to a temporary file,
    # and each episode is read once.
    with (
        replacing(folder / JSON_NAME) as json_path,
        replacing(folder / H5_NAME) as h5_path,
        tempfile.TemporaryFile("w+", dir=folder, encoding="utf-8") as entries,
    ):
        with h5py.File(h5_path, "w", libver=LIBVER) as merged:
            for number, (file, digest) in enumerate(episodes):
                with _recorded(file, digest) as (recorded, entry):
                    recorded.file.copy(recorded, merged, name=f"traj_{number}")
                    entries.write((",\n" if number else "\n") + _indented({"episode_id": number, **entry}))
                    for name, ids in used.items():
                        ids.add(entry["instances"][name])
        document = _document(provenance, {name: sorted(ids) for name, ids in used.items()})
        entries.seek(0)
        with json_path.open("w", encoding="utf-8") as stream:
            stream.write(json.dumps(document, indent=2, allow_nan=False).removesuffix("\n}") + ',\n  "episodes": [')
            shutil.copyfileobj(entries, stream)
            stream.write("\n  ]\n}\n")


def _indented(entry: dict[str, Any]) -> str:
    return "    " + json.dumps(entry, indent=2, allow_nan=False).replace("\n", "\n    ")


@contextlib.contextmanager
def _recorded(file: Path, digest: str | None) -> Iterator[tuple[h5py.Group, dict[str, Any]]]:
    """Yield the recording in an episode's file and the episode's entry for the JSON file."""
    with open_episode(file) as (episode, header, group):
        if episode.episode_digest != digest or header is None:
            raise DamagedEpisodeError("is not a finished episode", file=file, remedy="delete the file and resume")
        yield group, _entry(episode, header)


def _entry(episode: Episode, recorded: RecordingHeader) -> dict[str, Any]:
    """Return an episode's entry in ManiSkill's JSON file."""
    return {
        "episode_seed": recorded.seed,
        "control_mode": recorded.control_mode,
        "elapsed_steps": recorded.steps,
        "reset_kwargs": {"seed": recorded.seed, "options": recorded.reset_options},
        "success": recorded.success,
        "instances": recorded.instances,
        "episode": episode.to_dict(),
    }


def _env_id(task: TaskSpec) -> str:
    from gensim2.sim.registration import env_id  # imported here: argument checks do not need gymnasium

    return env_id(task)


def env_kwargs(
    task: TaskSpec, assets: str, instances: Mapping[str, Sequence[str]], environment: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the arguments for ``gym.make(env_id(task), ...)`` that make the environment of the demonstrations.

    Args:
        assets: ``"builtin"``, or a folder.
        instances: instance ids by object name.
        environment: further arguments of the environment.
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
    # An id that ends with ``task.env_id`` is a library task. For other tasks the arguments have the definition.
    if not _env_id(task).endswith(task.env_id):
        kwargs["task"] = task.model_dump(mode="json")
    return kwargs


def _source(controller: str) -> str:
    return "gensim2 keypoint planner" if controller == CHAIN else f"controller {controller}"


def _document(provenance: TrajectoryMetadata, instances: dict[str, list[str]]) -> dict[str, Any]:
    task = provenance.task
    names = [f"{task.objects[name].asset_class}/{id}" for name, ids in instances.items() for id in ids]
    return {
        "env_info": {
            "env_id": _env_id(task),
            "env_kwargs": env_kwargs(task, provenance.assets, instances, provenance.environment),
            "max_episode_steps": task.max_episode_steps,
        },
        "commit_info": None,
        "source_type": "motionplanning" if provenance.controller == CHAIN else "controller",
        "source_desc": f"{_source(provenance.controller)}: {task.description}",
        "gensim2": {
            "schema_version": SCHEMA_VERSION,
            "controller": provenance.controller,
            "task": task.model_dump(mode="json"),
            "strategies": {name: dict(strategy) for name, strategy in provenance.strategies.items()},
            "seed": provenance.seed,
            "licenses": {name: provenance.licenses[name] for name in names if name in provenance.licenses},
            **provenance.details,
        },
    }
