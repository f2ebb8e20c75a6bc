"""Define errors that a user can act on. The command line prints them on one line and exits with code 2."""

from __future__ import annotations

import contextlib
import difflib
import importlib
import re
import signal
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

#: Maximum length of an error message, characters.
LONGEST_LINE = 1500

#: Messages shorten a word that has more characters than this. A path without spaces counts as one word.
LONGEST_WORD = 300

#: Number of valid words that a message lists if none of them resembles the user's word.
SHOWN_WORDS = 10

_LONG_WORD = re.compile(rf"""[^\s:,;()'"]{{{LONGEST_WORD + 1},}}""")


def one_line(text: str) -> str:
    """Return ``text`` as one printable line with long words shortened."""
    words = " ".join(text.split())
    line = _LONG_WORD.sub(_shortened, printable(words))
    if len(line) <= LONGEST_LINE:
        return line
    return f"{line[: LONGEST_LINE - 300]} ... {line[-200:]} ({len(line)} characters)"


def printable(text: str) -> str:
    """Return ``text`` with control characters, except line breaks and tabs, replaced by escape sequences."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in "\n\t" else repr(c)[1:-1] for c in text)


def brief(number: int) -> str:
    """Return an integer as decimal digits. For a very long integer, return its number of bits as text instead."""
    return str(number) if abs(number) < 10**30 else f"a number of {number.bit_length()} bits"


def near(word: object, words: Iterable[str]) -> str:
    """Return a hint such as ``"did you mean drawer?"``.

    The hint names the most similar words, or the first words if no word is similar.
    """
    known = list(words)
    matches = difflib.get_close_matches(str(word)[:LONGEST_WORD], known, n=3, cutoff=0.5)
    if matches:
        return f"did you mean {' or '.join(matches)}?"
    if len(known) <= SHOWN_WORDS:
        return f"one of {', '.join(known)}" if known else "there is none"
    return f"one of {', '.join(known[:SHOWN_WORDS])} and {len(known) - SHOWN_WORDS} more"


def _shortened(word: re.Match[str]) -> str:
    return f"{word[0][:40]}...{word[0][-20:]} ({len(word[0])} characters)"


class GenSim2Error(Exception):
    """Base class of the errors that gensim2 raises on purpose."""


class InputError(GenSim2Error):
    """Invalid input from the user.

    The message is always a single line (:func:`one_line`).

    Args:
        message: what is wrong.
        file: file or folder with the error, if any.
        field: name of the wrong field, command-line option or element, if any.
        remedy: instruction that corrects the error.
    """

    def __init__(
        self, message: str, *, file: Path | str | None = None, field: str | None = None, remedy: str | None = None
    ) -> None:
        self.message, self.file, self.field, self.remedy = message, file, field, remedy
        where = ": ".join(str(part) for part in (file, field) if part is not None)
        text = f"{where}: {message}" if where else message
        super().__init__(one_line(f"{text} ({remedy})" if remedy else text))


class Stopped(BaseException):
    """A signal asked the program to stop; ``except Exception`` does not catch this exception."""

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.number = number


@contextlib.contextmanager
def user_code(refused: Callable[[BaseException], InputError], *passed: type[BaseException]) -> Iterator[None]:
    """Turn any exception that the block raises into an InputError. Use this context manager around code of the user.

    Args:
        refused: function that turns the exception into the InputError to raise.
        passed: exceptions that are not converted, in addition to KeyboardInterrupt, stop signals and MemoryError.
            SystemExit is converted, because the user's code may call ``sys.exit``.

    Raises:
        InputError: the block raised an exception; ``refused`` creates this error.
    """
    through: tuple[type[BaseException], ...] = (KeyboardInterrupt, Stopped, MemoryError, *passed)
    try:
        yield
    except through:
        raise
    except BaseException as error:
        raise refused(error) from error


def described(error: BaseException) -> str:
    """Return the type and the message of an exception as text."""
    return f"{type(error).__name__}: {error}"


class WriteError(InputError):
    """A file could not be written, for example because the disk is full; further writes would fail as well."""


class ClosedEnvError(GenSim2Error):
    """An environment was used after ``close``."""


class MissingExtraError(GenSim2Error):
    """An optional dependency is not installed.

    Args:
        module: name of the missing module or command.
        extra: name of the pip extra that installs the module; empty if the module needs no extra.
        distribution: name of the distribution that has the extra.
    """

    def __init__(self, module: str, extra: str, distribution: str = "gensim2") -> None:
        wanted = f"'{distribution}[{extra}]'" if extra else distribution
        super().__init__(f"{module} is not installed (pip install {wanted})")
        self.module, self.extra, self.distribution = module, extra, distribution

    def __reduce__(self) -> tuple[type[MissingExtraError], tuple[str, str, str]]:
        """Support pickling, so that a worker process can send the error."""
        return type(self), (self.module, self.extra, self.distribution)


def required(module: str, extra: str, distribution: str = "gensim2", package: str = "") -> Any:
    """Import and return a module of an optional dependency.

    Args:
        module, extra, distribution: full name of the module, and the extra of the distribution that installs it.
        package: name of the package for the message; default: the module's first part.

    Raises:
        MissingExtraError: the module is not installed.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise MissingExtraError(package or module.partition(".")[0], extra, distribution) from error


class NotRunError(GenSim2Error):
    """Jobs that failed in all attempts; all other jobs are finished, and their results are kept.

    Args:
        what: name of the jobs, for example ``"OpenDrawer: demonstrations"``.
        reasons: for each failed job, by job index, the reason why its last attempt failed.
        log: file with the log of all attempts.
    """

    SHOWN = 20

    def __init__(self, what: str, reasons: dict[int, str], log: Path | None = None) -> None:
        indices = sorted(reasons)
        named = ", ".join(str(index) for index in indices[: self.SHOWN])
        if len(indices) > self.SHOWN:
            named += f" and {len(indices) - self.SHOWN} more"
        details = f"; all attempts are logged in {log}" if log is not None else ""
        super().__init__(f"{what}: could not be run: {named} ({reasons[indices[0]]}{details}; run again with --resume)")
        self.what, self.reasons, self.log = what, reasons, log

    def __reduce__(self) -> tuple[type[NotRunError], tuple[str, dict[int, str], Path | None]]:
        return type(self), (self.what, self.reasons, self.log)


class ModelError(GenSim2Error):
    """A language model's endpoint is unreachable, refuses requests, or still limits the rate after all retries.

    Finished work is kept, and a run can be resumed.
    """
