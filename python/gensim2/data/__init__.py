"""Collect, read and export data sets; resuming an interrupted collection does not change its result."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gensim2.core.lazy import lazy_names

if TYPE_CHECKING:
    from gensim2.data.collection import collect
    from gensim2.data.dataset import DataSet
    from gensim2.data.observation_file import ObservedEpisode, read_observation
    from gensim2.data.record import DatasetRecord
    from gensim2.data.rendering import render
    from gensim2.data.store import TaskStore

__all__ = ["DataSet", "DatasetRecord", "ObservedEpisode", "TaskStore", "collect", "read_observation", "render"]

__getattr__ = lazy_names(__name__)
