"""Designers: what objects afford in, task specs and candidate strategies out."""

from gensim2.designers.affordance import Affordance
from gensim2.designers.base import (
    Brief,
    Candidate,
    CandidateResult,
    Declined,
    Designer,
    Known,
    Settings,
    StageResult,
)
from gensim2.designers.diagnosis import Diagnosis
from gensim2.designers.offline import OfflineDesigner

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
    "Settings",
    "StageResult",
]
