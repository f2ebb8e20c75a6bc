"""Propose tasks and strategies, test the strategies in simulation, and keep successful tasks.

Names are imported on first use, so that checking an argument does not load the simulator.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from gensim2.core.lazy import lazy_names

if TYPE_CHECKING:
    from gensim2.design.affordance import Affordance
    from gensim2.design.base import (
        Brief,
        Candidate,
        CandidateResult,
        Declined,
        Designer,
        Known,
        RobotSummary,
        StageResult,
    )
    from gensim2.design.diagnosis import Diagnosis
    from gensim2.design.gallery import tasks_gallery
    from gensim2.design.offline import OfflineDesigner
    from gensim2.design.own import design_task
    from gensim2.design.run import run_pipeline
    from gensim2.design.single import demo

__all__ = [
    "Affordance",
    "Brief",
    "Candidate",
    "CandidateResult",
    "Declined",
    "Designer",
    "Diagnosis",
    "Known",
    "OfflineDesigner",
    "RobotSummary",
    "StageResult",
    "demo",
    "design_task",
    "run_pipeline",
    "tasks_gallery",
]

__getattr__ = lazy_names(__name__)
