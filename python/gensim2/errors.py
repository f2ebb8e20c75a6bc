"""Errors that a user can act on. The command line prints them on one line and exits with code 2."""

from __future__ import annotations

from pathlib import Path


class GenSim2Error(Exception):
    """Base class of every error that gensim2 raises on purpose."""


class InputError(GenSim2Error):
    """Something that the user gave cannot be used.

    Args:
        message: what is wrong, in one line.
        file: the file or folder that holds it, if any.
        field: the field, flag or element inside it, if any.
        remedy: what to do about it.
    """

    def __init__(
        self,
        message: str,
        *,
        file: Path | str | None = None,
        field: str | None = None,
        remedy: str | None = None,
    ) -> None:
        self.message, self.file, self.field, self.remedy = message, file, field, remedy
        where = ": ".join(str(part) for part in (file, field) if part is not None)
        text = f"{where}: {message}" if where else message
        super().__init__(f"{text} ({remedy})" if remedy else text)


class MissingExtraError(GenSim2Error):
    """An optional dependency is not installed."""

    def __init__(self, module: str, extra: str) -> None:
        super().__init__(f"{module} is not installed (pip install 'gensim2[{extra}]')")
        self.module, self.extra = module, extra

    def __reduce__(self) -> tuple[type[MissingExtraError], tuple[str, str]]:
        """Survive the way from a worker process."""
        return type(self), (self.module, self.extra)
