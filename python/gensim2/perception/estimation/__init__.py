"""Estimate articulated objects from one point cloud: class, parts, joint and keypoints.

A network (:mod:`~gensim2.perception.estimation.network`) is trained on generated objects that the ray caster renders
(:mod:`~gensim2.perception.estimation.examples`). :class:`SceneEstimator` runs the network, and refines the network's
estimates with the geometry of the cloud. The module :mod:`~gensim2.perception.estimation.scene` converts an estimate to
a scene of the planner.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from gensim2.core.lazy import lazy_names

if TYPE_CHECKING:
    from gensim2.perception.estimation.chain import PerceivingChain
    from gensim2.perception.estimation.estimator import JointEstimate, ObjectEstimate, SceneEstimator

__all__ = ["JointEstimate", "ObjectEstimate", "PerceivingChain", "SceneEstimator"]

__getattr__ = lazy_names(__name__)
