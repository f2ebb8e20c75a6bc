"""Convert models of other formats to URDF, which :mod:`gensim2.objects.library.importer` reads."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator
from pathlib import Path

from gensim2.objects.library import mjcf, usd
from gensim2.objects.types import AssetError


@contextlib.contextmanager
def as_urdf(source: Path) -> Iterator[tuple[Path, bool]]:
    """Convert an MJCF or USD file to a temporary URDF during the block; yield any other ``source`` itself.

    Yields:
        The URDF file, and whether all collision shapes are known to be convex.

    Raises:
        InputError: the file cannot be imported; errors of the block about the temporary file name ``source``.
        MissingExtraError: the format's reader is not installed.
    """
    if source.suffix not in (*mjcf.SUFFIXES, *usd.SUFFIXES) or source.is_dir():
        yield source, False
        return
    with tempfile.TemporaryDirectory() as scratch:
        try:
            if source.suffix in mjcf.SUFFIXES:
                yield mjcf.convert(source, Path(scratch)), True
            else:
                yield usd.convert(source, Path(scratch))
        except AssetError as error:
            if error.file is None or Path(scratch) not in Path(error.file).parents:
                raise
            raise AssetError(error.message, file=source, field=error.field, remedy=error.remedy) from error
