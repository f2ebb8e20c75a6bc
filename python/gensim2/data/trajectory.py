"""Demonstrations on disk, in ManiSkill's trajectory format: ``trajectory.h5`` beside ``trajectory.json``.

Each episode is first written to a file of its own under ``episodes/``, whole or not at all, as soon as it is
finished; the two files are merged from those that the caller names, in that order. So nothing that is finished is
lost, and the bytes do not depend on how many workers there were or which was faster.

ManiSkill's own command replays the result, since the environment's id names the module that registers it:

    python -m mani_skill.trajectory.replay_trajectory --traj-path trajectory.h5
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
        task: what was done.
        strategies: by name: how it was done, as plain data.
        assets: ``"builtin"``, or the folder that the objects come from.
        licenses: terms by ``class/id``, which the data carries on.
        seed: of the run.
        environment: further arguments of the environment (the robot, the physics), where they are not its defaults.
        details: anything else worth keeping (versions, command), as plain data.
        controller: who decided the actions, ``module:Class`` or ``FILE.py:Class``.
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
    """Write ``trajectory.h5`` and ``trajectory.json`` from files of episodes, one of which is in memory at a time.

    Args:
        folder: to write to.
        provenance: goes into the JSON file.
        episodes: files and their digests, in order.

    Raises:
        InputError: there is no episode, or one is damaged or was recorded without its states.
    """
    if not episodes:
        raise InputError("there is no finished episode to merge", file=folder)
    used: dict[str, set[str]] = {name: set() for name in provenance.task.objects}
    # The data gets its name first: a JSON file never promises what is not there. Its head says which objects there are,
    # which the last episode decides: entries wait in a file of their own, and each episode is read once.
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
    """An item of a list in an indented JSON document."""
    return "    " + json.dumps(entry, indent=2, allow_nan=False).replace("\n", "\n    ")


@contextlib.contextmanager
def _recorded(file: Path, digest: str | None) -> Iterator[tuple[h5py.Group, dict[str, Any]]]:
    """The recording and the entry of an episode's file."""
    with open_episode(file) as (episode, header, group):
        if episode.episode_digest != digest or header is None:
            raise DamagedEpisodeError("is not a finished episode", file=file, remedy="delete it and resume")
        yield group, _entry(episode, header)


def _entry(episode: Episode, recorded: RecordingHeader) -> dict[str, Any]:
    """Return an episode's entry in ManiSkill's JSON."""
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


def _source(controller: str) -> str:
    return "gensim2 keypoint planner" if controller == CHAIN else f"controller {controller}"


def _document(provenance: TrajectoryMetadata, instances: dict[str, list[str]]) -> dict[str, Any]:
    """The JSON file without its episodes."""
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
