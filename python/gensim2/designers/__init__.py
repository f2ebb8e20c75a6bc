"""Designers: what an object affords in, task specs and candidate solver configs out."""

from gensim2.designers.base import Affordance, Candidate, CandidateResult, Designer, StageResult
from gensim2.designers.offline import OfflineDesigner

__all__ = ["Affordance", "Candidate", "CandidateResult", "Designer", "OfflineDesigner", "StageResult"]
