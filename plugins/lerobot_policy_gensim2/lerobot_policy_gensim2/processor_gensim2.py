"""Processors that change no number: a policy of gensim2 has its normalization in its checkpoint, and gives commands."""

from __future__ import annotations

from typing import Any

from lerobot.processor import (
    DeviceProcessorStep,
    PolicyAction,
    PolicyProcessorPipeline,
    RenameObservationsProcessorStep,
)
from lerobot.processor.converters import policy_action_to_transition, transition_to_policy_action
from lerobot.utils.constants import POLICY_POSTPROCESSOR_DEFAULT_NAME, POLICY_PREPROCESSOR_DEFAULT_NAME

from lerobot_policy_gensim2.configuration_gensim2 import GenSim2Config


def make_gensim2_pre_post_processors(
    config: GenSim2Config, dataset_stats: dict[str, Any] | None = None
) -> tuple[
    PolicyProcessorPipeline[dict[str, Any], dict[str, Any]], PolicyProcessorPipeline[PolicyAction, PolicyAction]
]:
    """Return a pipeline for observations and one for actions; both have the steps that LeRobot's scripts set."""
    return (
        PolicyProcessorPipeline[dict[str, Any], dict[str, Any]](
            steps=[RenameObservationsProcessorStep(rename_map={}), DeviceProcessorStep(device=config.device or "cpu")],
            name=POLICY_PREPROCESSOR_DEFAULT_NAME,
        ),
        PolicyProcessorPipeline[PolicyAction, PolicyAction](
            steps=[DeviceProcessorStep(device="cpu")],
            name=POLICY_POSTPROCESSOR_DEFAULT_NAME,
            to_transition=policy_action_to_transition,
            to_output=transition_to_policy_action,
        ),
    )
