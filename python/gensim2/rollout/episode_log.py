"""A log of episodes: what is done is a set of indices, in whatever order they were finished.

One JSON object a line, appended as soon as an episode is finished. A line counts from its line feed on, so one that was
cut off by the end of the process is dropped and its episode made again; any other line that cannot be read is an error.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from pydantic import TypeAdapter

from gensim2.core.errors import InputError
from gensim2.core.files import write_atomic
from gensim2.core.foreign.tree import MAX_RECORD, read_input
from gensim2.core.record_files import parse_record
from gensim2.rollout.record import Episode

ATTEMPTS = "attempts.jsonl"
"""Name of the log of a collection."""

_REMEDY = "delete the file and resume; its episodes are made again"
_ADAPTER = TypeAdapter(Episode)


class EpisodeLog:
    """The log in one file.

    Args:
        path: of the file; it need not be there.
        seeds: of the environment, by index: what is logged must be one of these.

    Attributes:
        done: what is finished, by index.

    Raises:
        InputError: a line cannot be read, or is not of this run.
    """

    def __init__(self, path: Path, seeds: Sequence[int]) -> None:
        self.path = path
        self.done: dict[int, Episode] = {}
        entries, torn = _read(path)
        for number, entry in enumerate(entries, 1):
            if entry.index >= len(seeds) or entry.seed != seeds[entry.index]:
                raise InputError("is not of this run", file=path, field=f"line {number}: seed", remedy=_REMEDY)
            self.done[entry.index] = entry
        if torn:
            self._rewrite(self.done.values())

    def add(self, index: int, episode: Episode) -> None:
        """Append one finished episode.

        Raises:
            InputError: the file cannot be written to.
        """
        entry = replace(episode, index=index)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with self.path.open("ab") as stream:
                stream.write(log_line(entry))
        except OSError as error:
            raise InputError(
                f"cannot write: {error.strerror}", file=self.path, remedy="make room, or choose another --out"
            ) from error
        self.done[index] = entry

    def forget(self, index: int) -> None:
        """Take an episode for not done; once it is made again its new line counts."""
        del self.done[index]

    def finish(self, count: int) -> list[Episode]:
        """Leave the first ``count`` episodes in the file, by index, and return them."""
        self.done = {index: self.done[index] for index in range(count)}
        self._rewrite(self.done.values())
        return list(self.done.values())

    def _rewrite(self, entries: Iterable[Episode]) -> None:
        write_atomic(self.path, b"".join(map(log_line, entries)))


def log_line(entry: Episode) -> bytes:
    """The line of an episode in a log."""
    place = {"index": entry.index, "episode_digest": entry.episode_digest}
    return json.dumps({**place, **entry.to_dict()}, allow_nan=False).encode() + b"\n"


def parse_line(line: bytes, path: Path, number: int, remedy: str = _REMEDY) -> Episode:
    """Return what a line of a log holds, without its line feed.

    Args:
        path: of the log.
        number: of the line, from 1.

    Raises:
        InputError: it cannot be read.
    """
    episode = parse_record(line, _ADAPTER, path, remedy, f"line {number}")
    if episode.index < 0:
        raise InputError("is missing", file=path, field=f"line {number}: index", remedy=remedy)
    return episode


def read_log(path: Path) -> list[Episode]:
    """Return what a log holds, by index; a line that was cut off is left out.

    Raises:
        InputError: a line cannot be read.
    """
    found = {entry.index: entry for entry in _read(path)[0]}
    return [found[index] for index in sorted(found)]


def _read(path: Path) -> tuple[list[Episode], bool]:
    """The entries in the order of the lines, and whether a last line was cut off."""
    content = read_input(path, MAX_RECORD, _REMEDY) if path.exists() else b""
    *lines, torn = content.split(b"\n")
    entries = [parse_line(line, path, number) for number, line in enumerate(lines, 1)]
    return entries, bool(torn)
