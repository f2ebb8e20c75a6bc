"""Episodes: plan, run, judge and record, one loop whoever decides what the robot does."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gensim2.lazy import lazy_names

if TYPE_CHECKING:
    from gensim2.episodes.chain import ChainController
    from gensim2.episodes.controller import Controller, Event, Observation
    from gensim2.episodes.record import Cause, Episode, StrictMiss
    from gensim2.episodes.recording import Recording
    from gensim2.episodes.run import EpisodeResult
    from gensim2.episodes.still import StillController
    from gensim2.episodes.trajectory import TrajectoryStore
    from gensim2.episodes.world import World

__all__ = [
    "Cause",
    "ChainController",
    "Controller",
    "Episode",
    "EpisodeResult",
    "Event",
    "Observation",
    "Recording",
    "StillController",
    "StrictMiss",
    "TrajectoryStore",
    "World",
]

__getattr__ = lazy_names(
    __name__,
    {
        "Cause": "gensim2.episodes.record",
        "ChainController": "gensim2.episodes.chain",
        "Controller": "gensim2.episodes.controller",
        "Episode": "gensim2.episodes.record",
        "EpisodeResult": "gensim2.episodes.run",
        "Event": "gensim2.episodes.controller",
        "Observation": "gensim2.episodes.controller",
        "Recording": "gensim2.episodes.recording",
        "StillController": "gensim2.episodes.still",
        "StrictMiss": "gensim2.episodes.record",
        "TrajectoryStore": "gensim2.episodes.trajectory",
        "World": "gensim2.episodes.world",
    },
)
