"""Run episodes: plan, act, evaluate and record. All controllers use the same loop."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gensim2.core.lazy import lazy_names

if TYPE_CHECKING:
    from gensim2.rollout.chain import ChainController
    from gensim2.rollout.controller import Controller, Event, PrivilegedObservation
    from gensim2.rollout.controller_spec import ControllerError, ControllerSpec
    from gensim2.rollout.driving import drive
    from gensim2.rollout.no_op import NoOpController
    from gensim2.rollout.record import Cause, Episode, StrictMiss
    from gensim2.rollout.recording import EpisodeResult, Recording
    from gensim2.rollout.solving import solve
    from gensim2.rollout.world import Body, World

__all__ = [
    "Body",
    "Cause",
    "ChainController",
    "Controller",
    "ControllerError",
    "ControllerSpec",
    "Episode",
    "EpisodeResult",
    "Event",
    "NoOpController",
    "PrivilegedObservation",
    "Recording",
    "StrictMiss",
    "World",
    "drive",
    "solve",
]

__getattr__ = lazy_names(__name__)
