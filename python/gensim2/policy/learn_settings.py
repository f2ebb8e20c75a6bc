"""What ``gensim2 learn`` trains: the settings of each kind of policy, what a file changes of them, and what is seen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from gensim2.errors import InputError
from gensim2.observations import DepthNoise, ObservationSpec
from gensim2.observations.cloud import candidates_for
from gensim2.policy.config import PolicyConfig, TrainConfig, configs
from gensim2.policy.keypose.training import POLICY, TRAINING
from gensim2.policy.starting import SPEC, with_noise

CHUNK_SPEC = ObservationSpec.of({"points": 256, "candidates": 2048, "robot": "none"})
"""Observations of a policy of action chunks: the scene without the robot."""
CHUNK_POLICY = PolicyConfig(keyframes=3, seen_points=192)
"""Network of a policy of action chunks; its head is what was asked for."""
CHUNK_TRAINING = TrainConfig(arm_noise=0.06, threads=1)
KNOWN_POINTS = 64
"""Of a cloud of keypoints and corners: more than the objects of any task of the library have."""
ELSEWHERE = {
    "head": "say it with --policy",
    "text": "say it with --text",
    "text_model": "say it with --text-model",
    "steps": "say how long with --minutes",
    "seed": "say it with --seed",
    "ways": "it is the number of strategies that are taught",
}
"""Settings that a run decides, and how."""


def learn_configs(policy: str, settings: Mapping[str, Any]) -> tuple[PolicyConfig, TrainConfig]:
    """Return network and training of a kind of policy.

    Args:
        policy: name of the head.
        settings: fields of either that are to be otherwise.

    Raises:
        InputError: a field is unknown, cannot be so, or is decided by the run; names it.
    """
    for name, remedy in ELSEWHERE.items():
        if name in settings:
            raise InputError("is not a setting of gensim2 learn", field=name, remedy=remedy)
    network, training = (POLICY, TRAINING) if policy == "keypose" else (CHUNK_POLICY, CHUNK_TRAINING)
    return configs({**network.to_dict(), **training.to_dict(), **settings, "head": policy})


def observation_of(policy: PolicyConfig, noise: DepthNoise | None) -> ObservationSpec:
    """Return what a policy sees: clouds of its number of points, or keypoints for the encoder of states.

    Raises:
        InputError: the noise is of cameras, and it looks through none.
    """
    spec = SPEC if policy.head == "keypose" else CHUNK_SPEC
    cloud = spec.cloud
    if policy.encoder == "state":
        cloud = replace(cloud, source="keypoints", points=KNOWN_POINTS)
    if policy.points is not None:
        cloud = replace(cloud, points=policy.points, candidates=candidates_for(policy.points))
    return with_noise(replace(spec, cloud=cloud), noise)
