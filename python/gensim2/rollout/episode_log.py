"""Log finished episodes. Episodes may finish in any order; each episode is identified by its index.

Each finished episode is appended as one JSON line. A last line without a line feed is incomplete: the line is dropped,
and its episode is run again. Any other unreadable line is an error.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from pydantic import TypeAdapter

from gensim2.core.errors import InputError
from gensim2.core.files import append, not_written, write_atomic
from gensim2.core.foreign.tree import open_regular, why
from gensim2.core.record_files import parse_record
from gensim2.rollout.record import Episode

ATTEMPTS = "attempts.jsonl"
"""File name of the log of a collection."""

MAX_LINE = 64 * 2**20
"""Maximum size of the record of an episode, bytes; typical records have a few kB."""

_REMEDY = "delete the file and resume; its episodes are made again"
_ADAPTER = TypeAdapter(Episode)


class EpisodeLog:
    """Log of episodes in one file.

    Args:
        path: path of the file, which may be missing.
        seeds: seed of each episode by index, to check that the log belongs to this run.

    Attributes:
        done: finished episodes by index.

    Raises:
        InputError: a line cannot be read, or belongs to another run.
    """

    def __init__(self, path: Path, seeds: Sequence[int]) -> None:
        self.path = path
        self.done: dict[int, Episode] = {}
        torn = False
        for number, entry in enumerate(episodes_in(path) if path.exists() else (), 1):
            if entry is None:
                torn = True
                break
            if entry.index >= len(seeds) or entry.seed != seeds[entry.index]:
                wrong = "the episode belongs to another run"
                raise InputError(wrong, file=path, field=f"line {number}: seed", remedy=_REMEDY)
            self.done[entry.index] = entry
        if torn:
            self._rewrite(self.done.values())

    def add(self, index: int, episode: Episode) -> None:
        """Append a finished episode.

        Raises:
            WriteError: the file cannot be written to.
        """
        entry = replace(episode, index=index)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise not_written(error, self.path) from error
        append(self.path, log_line(entry))
        self.done[index] = entry

    def forget(self, index: int) -> None:
        """Remove an episode from ``done``, so that the episode is run again.

        The old line stays until the file is rewritten, but only the line of the repeated episode counts.
        """
        del self.done[index]

    def finish(self, count: int) -> list[Episode]:
        """Rewrite the file with the first ``count`` episodes, ordered by index, and return these episodes."""
        self.done = {index: self.done[index] for index in range(count)}
        self._rewrite(self.done.values())
        return list(self.done.values())

    def _rewrite(self, entries: Iterable[Episode]) -> None:
        write_atomic(self.path, b"".join(map(log_line, entries)))


def log_line(entry: Episode) -> bytes:
    place = {"index": entry.index, "episode_digest": entry.episode_digest}
    return json.dumps({**place, **entry.to_dict()}, allow_nan=False).encode() + b"\n"


def episodes_in(path: Path, remedy: str = _REMEDY, *, unreadable: str = _REMEDY) -> Iterator[Episode | None]:
    """Yield the episodes of a log one by one, or None for an incomplete last line.

    Only one episode is in memory at a time.

    Args:
        remedy: advice to the user in the error message about an invalid line.
        unreadable: advice to the user in the error message about a file that cannot be opened or read.

    Raises:
        InputError: the file or a line cannot be read.
    """
    try:
        with open_regular(path) as stream:
            for number in itertools.count(1):
                line = stream.readline(MAX_LINE + 1)
                if len(line) > MAX_LINE:
                    wrong = f"has over {MAX_LINE // 2**20} MiB"
                    raise InputError(wrong, file=path, field=f"line {number}", remedy=remedy)
                if not line.endswith(b"\n"):
                    if line:
                        yield None
                    return
                episode = parse_record(line[:-1], _ADAPTER, path, remedy, f"line {number}")
                if episode.index < 0:
                    raise InputError("is missing", file=path, field=f"line {number}: index", remedy=remedy)
                yield episode
    except OSError as error:
        raise InputError(why(error), file=path, remedy=unreadable) from error


def read_log(path: Path) -> list[Episode]:
    """Return the episodes of a log by index; an incomplete last line is ignored.

    Raises:
        InputError: a line cannot be read.
    """
    found = {entry.index: entry for entry in episodes_in(path) if entry is not None} if path.exists() else {}
    return [found[index] for index in sorted(found)]
