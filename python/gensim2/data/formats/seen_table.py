"""Write the metadata of exported observations: spec, cameras, and the meaning of segmentation ids."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from gensim2.core.errors import InputError
from gensim2.core.files import write_json
from gensim2.data.observation_file import ObservedEpisode

NAME = "observations.json"
SCHEMA_VERSION = 1

_SPEC = ("modalities", "cameras", "cloud")


class SeenTable:
    """Collects the contents of ``observations.json`` from the episodes of an export.

    ``observations.json`` has four fields:

    - ``spec`` is the observation spec.
    - ``cameras`` describes each camera by its matrix ``intrinsic`` (3, 3), in pixels, and by its pose ``T_base_camera``
      (4, 4). For a camera on the robot, the pose is ``T_link_camera`` in the frame of a link, and ``link`` is the name
      of this link.
    - ``tables`` is a list of segmentation tables. A segmentation table gives the object and the link of every
      segmentation id.
    - ``episodes`` has an entry for each episode, with the fields ``task``, ``index`` and ``table``. The field ``table``
      is an index in the list ``tables``; it is None if an old version of gensim2 rendered the episode.
    """

    def __init__(self) -> None:
        self._spec: dict[str, Any] | None = None
        self._cameras: dict[str, Any] = {}
        self._tables: list[dict[str, list[str]]] = []
        self._episodes: list[dict[str, Any]] = []

    def add(self, task: str, index: int, observation: ObservedEpisode) -> None:
        """Add an episode.

        Raises:
            InputError: the settings with which the episode was rendered differ from the settings of earlier episodes.
        """
        description, arrays = observation.description, observation.arrays
        spec = {name: description.get(name) for name in _SPEC}
        if self._spec not in (None, spec):
            raise InputError(
                "the task was rendered with settings that differ from the settings of the earlier tasks",
                field=f"tasks.{task}",
                remedy="export each task separately with --task, or render all tasks with the same settings",
            )
        self._spec = spec
        for name in arrays:
            camera, _, what = name.removeprefix("cameras/").rpartition("/")
            is_own = name.startswith("cameras/") and what in ("intrinsic", "T_base_camera", "T_link_camera")
            # A matrix without a time axis is the same in all frames and is stored in ``observations.json``. Readers can
            # compute the pose of a moving camera from the joint positions.
            if is_own and arrays[name].ndim == 2:
                self._cameras.setdefault(camera, {})[what] = arrays[name].tolist()
        for camera, link in description.get("camera_links", {}).items():
            self._cameras.setdefault(camera, {})["link"] = link
        ids = description.get("segmentation_ids")
        if ids and ids not in self._tables:
            self._tables.append(ids)
        self._episodes.append({"task": task, "index": index, "table": self._tables.index(ids) if ids else None})

    def write(self, folder: Path) -> None:
        """Write ``observations.json``. If no episode has observations, write no file."""
        if self._spec is None:
            return
        found = {"spec": self._spec, "cameras": self._cameras, "tables": self._tables, "episodes": self._episodes}
        write_json(folder / NAME, {"schema_version": SCHEMA_VERSION, **found})
