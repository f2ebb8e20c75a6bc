"""Whether the objects of a data set's episodes are still what they were."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from gensim2.data.attempt_log import LoggedEpisode
from gensim2.errors import InputError
from gensim2.objects import Library, open_library


def check_objects(row: LoggedEpisode, assets: str, file: Path) -> None:
    """Refuse objects whose content is not that of an episode's.

    Args:
        row: of the episode.
        assets: where its objects are now: a folder or ``"builtin"``.
        file: of the episode.

    Raises:
        InputError: an object is another one now, or is not there.
    """
    for thing in row.objects.values():
        if _content_hash(assets, thing.asset_class, thing.id) != thing.content_hash:
            raise InputError(
                f"was run with another {thing.asset_class}/{thing.id} than {assets} has now",
                file=file,
                remedy="restore the object, or say with --assets where it is",
            )


@lru_cache(maxsize=8192)
def _content_hash(assets: str, asset_class: str, instance: str) -> str:
    return _library(assets).load(asset_class, instance).content_hash


@lru_cache(maxsize=2)
def _library(assets: str) -> Library:
    return open_library(assets)
