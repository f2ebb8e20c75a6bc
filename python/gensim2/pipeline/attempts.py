"""A log of episodes: what is done is a set of indices, in whatever order they were finished.

One JSON object a line, appended as soon as an episode is finished. A line counts from its line feed on, so one that was
cut off by the end of the process is dropped and its episode made again; any other line that cannot be read is an error.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path

from pydantic import TypeAdapter

from gensim2.errors import InputError
from gensim2.files import write_atomic
from gensim2.pipeline.reading import parse_record
from gensim2.pipeline.records import LoggedAttempt

_ADAPTER = TypeAdapter(LoggedAttempt)
_REMEDY = "delete the file and resume; its episodes are made again"


class AttemptLog:
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
        self.done: dict[int, LoggedAttempt] = {}
        try:
            content = path.read_bytes() if path.exists() else b""
        except OSError as error:
            raise InputError(f"cannot be read: {error.strerror}", file=path, remedy=_REMEDY) from error
        *lines, torn = content.split(b"\n")
        for number, line in enumerate(lines, 1):
            at = f"line {number}"
            entry = parse_record(line, _ADAPTER, path, _REMEDY, at)
            if entry.index >= len(seeds) or entry.seed != seeds[entry.index]:
                raise InputError("is not of this run", file=path, field=f"{at}: seed", remedy=_REMEDY)
            self.done[entry.index] = entry
        if torn:
            self._rewrite(self.done.values())

    def add(self, entry: LoggedAttempt) -> None:
        """Append one finished episode.

        Raises:
            InputError: the file cannot be written to.
        """
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with self.path.open("ab") as stream:
                stream.write(_line(entry))
        except OSError as error:
            raise InputError(
                f"cannot write: {error.strerror}", file=self.path, remedy="make room, or choose another --out"
            ) from error
        self.done[entry.index] = entry

    def forget(self, index: int) -> None:
        """Take an episode for not done; once it is made again its new line counts."""
        del self.done[index]

    def finish(self, count: int) -> list[LoggedAttempt]:
        """Leave the first ``count`` episodes in the file, by index, and return them."""
        self.done = {index: self.done[index] for index in range(count)}
        self._rewrite(self.done.values())
        return list(self.done.values())

    def _rewrite(self, entries: Iterable[LoggedAttempt]) -> None:
        write_atomic(self.path, b"".join(map(_line, entries)))


def _line(entry: LoggedAttempt) -> bytes:
    return json.dumps({"index": entry.index, **entry.to_dict()}, allow_nan=False).encode() + b"\n"
