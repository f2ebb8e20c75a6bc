"""Store the episodes of one task in one folder, with one file for each episode (docs/reference/data_format.md)."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from gensim2.core.errors import InputError, brief
from gensim2.core.files import replacing
from gensim2.core.foreign.tree import ForeignTree
from gensim2.data.episode_file import DamagedEpisodeError, episode_digest, read_episode, read_row, write_episode
from gensim2.data.recorded import check_recording
from gensim2.rollout.episode_log import episodes_in, log_line
from gensim2.rollout.record import Episode
from gensim2.rollout.recording import EpisodeResult, Recording
from gensim2.tasks.library import load_task_file
from gensim2.tasks.spec import TaskSpec

ROWS, OBSERVATIONS = "episodes.jsonl", "observations"

LAST_INDEX = 999_999_999

_EPISODE_FILE = re.compile(r"^(\d{6,9})\.h5$")
_ROWS_REMEDY = "delete the file and collect with --resume: it is then made again from the episodes"


class TaskStore:
    """The episodes of one task in one folder.

    Args:
        folder: folder with ``task.yaml``, ``strategies/``, ``episodes/``, ``failures/`` and finally ``episodes.jsonl``.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @property
    def name(self) -> str:
        return self.folder.name

    def spec(self) -> TaskSpec:
        """Read the task.

        Raises:
            InputError: ``task.yaml`` cannot be used.
        """
        return load_task_file(self.folder)

    def path(self, index: int, held: bool = True) -> Path:
        return self.folder / ("episodes" if held else "failures") / f"{index:06d}.h5"

    @property
    def rows_path(self) -> Path:
        return self.folder / ROWS

    def observation_path(self, index: int) -> Path:
        """Return the path of an episode's observations.

        Raises:
            InputError: a symbolic link leads out of the folder.
        """
        return self._inside(self.folder / OBSERVATIONS / f"{index:06d}.h5")

    def add(self, index: int, episode: Episode, recording: Recording | None) -> str:
        """Write one finished episode atomically and return the digest of its file.

        Several processes may write the same episode at once, because all write the same bytes.

        Args:
            recording: recorded states of the episode; None: store the record only.

        Raises:
            WriteError: the folder cannot be written to, or the disk is full.
        """
        return write_episode(self.path(index, episode.held), episode, recording)

    def rows(self) -> Iterator[Episode]:
        """Yield all records of ``episodes.jsonl`` by index. Only one record is in memory at a time.

        Raises:
            InputError: the file is missing because the collection is incomplete, or the file cannot be read. The error
                is also raised if the objects of an episode differ from the objects of the task.
        """
        path = self.rows_path
        last, objects = -1, self.spec().objects.keys()
        rows = episodes_in(self._inside(path), _ROWS_REMEDY, unreadable="finish the collection with --resume")
        for number, row in enumerate(rows, 1):
            if row is None:
                raise InputError("is incomplete", file=path, field=f"line {number}", remedy=_ROWS_REMEDY)
            if not last < row.index <= LAST_INDEX:
                wrong = f"is {brief(row.index)}, must increase from line to line up to {LAST_INDEX}"
                raise InputError(wrong, file=path, field=f"line {number}: index", remedy=_ROWS_REMEDY)
            if row.objects.keys() != objects:
                wrong = f"episode {row.index} has other objects than the task"
                raise InputError(wrong, file=path, field=f"line {number}: objects", remedy=_ROWS_REMEDY)
            last = row.index
            yield row

    def logged(self) -> list[Episode]:
        """Return the finished, undamaged episodes in the order of their index. The collection may still be running.

        Raises:
            InputError: ``episodes.jsonl`` cannot be read, or another version of gensim2 wrote an episode.
        """
        if self.rows_path.exists():
            return list(self.rows())
        rows = [each.at(index, each.episode_digest) for index, _, each in self.found() if each]
        return sorted(rows, key=lambda row: row.index)

    def read(self, row: Episode) -> EpisodeResult:
        """Read an episode's file and check the file against ``row``, the episode's line in ``episodes.jsonl``.

        Raises:
            InputError: the file is missing, damaged or belongs to another episode; its recording does not fit the
                episode (:func:`~gensim2.data.recorded.check_recording`); or a successful episode has no recording.
        """
        path = self._inside(self.path(row.index, row.held))
        stored = read_episode(path)
        if stored.episode.at(row.index, stored.episode.episode_digest) != row:
            wrong = "does not match the row of this episode in the table of episodes"
            raise DamagedEpisodeError(wrong, file=path, remedy="delete the file and resume")
        if stored.recording is not None:
            check_recording(stored.recording, row, path)
        elif row.held:
            raise DamagedEpisodeError("has no states", file=path, remedy="delete the file and resume")
        return stored

    def recording(self, row: Episode) -> Recording:
        """Read the states and actions of an episode.

        Raises:
            InputError: as for :meth:`read`, or the states of this failed episode were not stored.
        """
        found = self.read(row).recording
        if found is None:
            path, remedy = self.path(row.index, row.held), "collect the data set with --keep-failures"
            raise InputError("has no states", file=path, remedy=remedy)
        return found

    def _inside(self, path: Path) -> Path:
        """Return ``path`` after checking that no symbolic link leads out of the task's folder."""
        return ForeignTree(self.folder).inside(str(path.relative_to(self.folder)))

    def found(self) -> Iterator[tuple[int, Path, Episode | None]]:
        """Yield index, path and record of every episode file; the record is None if the file is damaged.

        Raises:
            InputError: another version of gensim2 wrote a file, or a symbolic link leads out of the folder.
        """
        for held in (True, False):
            folder = self.path(0, held).parent
            for path in sorted(folder.iterdir()) if folder.is_dir() else ():
                if match := _EPISODE_FILE.match(path.name):
                    try:
                        found: Episode | None = read_row(self._inside(path))
                    except DamagedEpisodeError:
                        found = None
                    lies_right = found is not None and found.held == held
                    yield int(match[1]), path, found if lies_right else None

    def is_complete(self, row: Episode) -> bool:
        """Return whether the file of an episode exists and is undamaged."""
        try:
            return episode_digest(self.path(row.index, row.held)) == row.episode_digest
        except DamagedEpisodeError:
            return False
        except InputError:
            if self.path(row.index, row.held).exists():
                raise
            return False

    def write_rows(self, count: int) -> Iterator[Episode]:
        """Write ``episodes.jsonl`` from the files of the first ``count`` episodes, and yield each record.

        ``episodes.jsonl`` is complete when the iterator ends.

        Raises:
            InputError: an episode is missing or damaged.
        """
        with replacing(self.rows_path) as path, path.open("wb") as stream:
            for index in range(count):
                held = self.path(index, True)
                found = read_row(held if held.exists() else self.path(index, False))
                logged = found.at(index, found.episode_digest)
                stream.write(log_line(logged))
                yield logged
