"""Determine the settings of ``gensim2 learn``: defaults for each kind of policy, a settings file, and observations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from gensim2.core.errors import InputError
from gensim2.perception import DepthNoise, ObservationSpec
from gensim2.perception.cloud import candidates_for
from gensim2.policy.config import OF_KEYPOSES, PolicyConfig, TrainConfig, configs
from gensim2.policy.keypose.training import POLICY, TRAINING
from gensim2.policy.starting import SPEC, with_noise

CHUNK_SPEC = ObservationSpec.of({"points": 256, "candidates": 2048, "robot": "none"})
"""Observation spec of action-chunk policies: point clouds without the robot's points."""
CHUNK_POLICY = PolicyConfig(keyframes=3, seen_points=192)
"""Default network settings of action-chunk policies; the user chooses the head."""
CHUNK_TRAINING = TrainConfig(arm_noise=0.06, threads=1)
KNOWN_POINTS = 64
"""Number of points in a cloud of keypoints and bounding-box corners; no task of the library needs more."""
OF_CHUNKS = (
    "history",
    "stride",
    "horizon",
    "execute",
    "colour",
    "velocity",
    "frame",
    "yaw",
    "keyframes",
    "noise_levels",
    "denoise_steps",
    "decoder_layers",
    "colour_jitter",
    "arm_noise",
)
"""Settings that only action-chunk policies have. Keypose policies see one cloud without colours in the ``turned``
frame.
"""
ELSEWHERE = {
    "head": "say it with --policy",
    "text": "say it with --text",
    "text_model": "say it with --text-model",
    "steps": "say how long with --minutes",
    "seed": "say it with --seed",
    "ways": "it is the number of strategies that are taught",
}
"""Settings that ``gensim2 learn`` sets itself, with the option to use instead."""


def learn_configs(
    policy: str, settings: Mapping[str, Any], *, file: str | None = None
) -> tuple[PolicyConfig, TrainConfig]:
    """Return network and training settings for a kind of policy.

    Args:
        policy: name of the head.
        settings: fields of network or training settings that differ from the defaults.
        file: file of the settings, for error messages.

    Raises:
        InputError: a field is unknown or invalid, belongs to another kind of policy, or is set by ``learn`` itself.
    """
    for name, remedy in ELSEWHERE.items():
        if name in settings:
            raise InputError("this field is not a setting of gensim2 learn", file=file, field=name, remedy=remedy)
    strangers, kind = (OF_CHUNKS, "action chunks") if policy == "keypose" else (OF_KEYPOSES, "keyposes")
    for name in strangers:
        if name in settings:
            wrong = f"applies only to {kind}"
            raise InputError(wrong, file=file, field=name, remedy="leave it out, or change --policy")
    network, training = (POLICY, TRAINING) if policy == "keypose" else (CHUNK_POLICY, CHUNK_TRAINING)
    made = configs({**network.to_dict(), **training.to_dict(), **settings, "head": policy}, file=file)
    if made[0].encoder == "state" and made[0].points is not None and made[0].points < KNOWN_POINTS:
        message = f"must be at least {KNOWN_POINTS} for the encoder state"
        raise InputError(message, file=file, field="points", remedy="leave it out")
    return made


def observation_of(policy: PolicyConfig, noise: DepthNoise | None) -> ObservationSpec:
    """Return the observation spec that a policy needs.

    The head and the source of the cloud determine the spec. The settings can change only the number of points.

    Raises:
        InputError: camera noise is requested, but the policy's encoder does not use depth images.
    """
    spec = SPEC if policy.head == "keypose" else CHUNK_SPEC
    cloud = spec.cloud
    if policy.source == "keypoints":
        cloud = replace(cloud, source=policy.source, points=KNOWN_POINTS)
    if policy.points is not None:
        cloud = replace(cloud, points=policy.points, candidates=candidates_for(policy.points))
    return with_noise(replace(spec, cloud=cloud), noise)
