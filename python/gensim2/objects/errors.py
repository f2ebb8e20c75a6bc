"""Errors of the object library."""

from __future__ import annotations

from gensim2.core.errors import InputError


class AssetError(InputError):
    """An object that cannot be used."""


class MissingFileError(AssetError):
    """A file that an object names is not there."""
