"""Check that learning can start from an existing policy."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from gensim2.core.errors import InputError
from gensim2.core.foreign.limits import MAX_RECORD
from gensim2.core.foreign.tree import read_input
from gensim2.core.progress import Progress
from gensim2.objects import open_library
from gensim2.perception import DepthNoise, ObservationSpec
from gensim2.policy.checkpoint import CONFIG_JSON, PolicyCheckpoint
from gensim2.policy.config import PolicyConfig
from gensim2.policy.text import prepare
from gensim2.rollout.inputs import TaskInput, what_it_lacks
from gensim2.tasks.library import load_task, task_names

SPEC = ObservationSpec.of({"points": 1024, "candidates": 4096, "robot": "none"})
"""Observations of a keypose policy: the scene without the robot."""


def read_start(start: Path, policy: str, given: Sequence[TaskInput], noise: DepthNoise | None) -> PolicyCheckpoint:
    """Read the policy that learning starts from, and check that tasks can be added to it.

    Args:
        start: folder of the policy.
        policy: name of the requested head.
        given: tasks to add.
        noise: requested camera noise.

    Raises:
        InputError: the folder has no readable keypose policy of several tasks, the policy already knows a task, or it
            has another robot or observation.
    """
    found = PolicyCheckpoint.load(start)
    if policy != "keypose" or found.action.kind != "keypose":
        message = "goes on from a keypose policy of several tasks"
        raise InputError(message, file=start, field="from", remedy="chunks: gensim2 train --from")
    if found.config.text == "none":
        message = "is a policy of one task, which takes no task sentence"
        remedy = "teach several tasks to one policy first: gensim2 learn --multi-task"
        raise InputError(message, file=start, field="from", remedy=remedy)
    for one in given:
        if one.spec.name in found.data.tasks:
            raise InputError("the policy already knows this task", file=start, field=f"tasks.{one.spec.name}")
    found.require_robot(given[0].scene.robot, start)
    found.observation.require(with_noise(found.observation, noise), "this run", of=str(start))
    return found


def with_noise(spec: ObservationSpec, noise: DepthNoise | None) -> ObservationSpec:
    return replace(spec, cloud=replace(spec.cloud, noise=noise))


def digest_of_start(start: Path) -> tuple[str, str]:
    """Return the folder of a policy and the SHA-256 of its configuration, for records of runs that start from it."""
    return str(start.resolve()), hashlib.sha256(read_input(start / CONFIG_JSON, MAX_RECORD)).hexdigest()


def known_tasks(begun: PolicyCheckpoint, assets: Path | str | None, progress: Progress) -> list[str]:
    """Return the tasks of a policy that are in the task library and whose objects are available.

    Args:
        assets: see :class:`~gensim2.scenes.config.SceneArguments`.
        progress: progress listener; gets a message for each task that is left out.
    """
    there, library, found = task_names(), open_library(assets), []
    for name in begun.data.tasks:
        why = what_it_lacks(library, load_task(name)) if name in there else "the library does not have it"
        if why is None:
            found.append(name)
        else:
            progress.message(f"{name}: not measured again, {why}")
    return found


def check_sentences(sentences: Sequence[str]) -> None:
    """Check that all tasks have different instructions. A policy distinguishes the tasks by their instructions.

    Raises:
        InputError: two tasks have the same instruction.
    """
    for sentence in sentences:
        if sentences.count(sentence) > 1:
            message = f"two tasks of one policy have the sentence {sentence!r}"
            raise InputError(message, field="description", remedy="give each task another sentence")


def check_text(text: str | None, model: str | None, sentences: Sequence[str], begun: PolicyCheckpoint | None) -> None:
    """Check that a policy can have the requested text encoder.

    Args:
        text: requested text encoder. None requests the encoder of ``begun``, or ``"small"`` if ``begun`` is None.
        model: requested weights; None for the default.
        sentences: instructions of the tasks that one policy learns; empty if the policy ignores instructions.
        begun: policy that learning starts from, or None.

    Raises:
        InputError: the policy ignores instructions, ``begun`` has a different encoder, or the weights cannot be loaded.
        MissingExtraError: ``transformers`` is not installed.
    """
    if begun is not None:
        had = begun.config.text
        if text not in (None, had):
            wrong = f"the policy given with --from has the text encoder {had!r}, which cannot be changed to {text!r}"
            raise InputError(wrong, field="text")
        if model not in (None, begun.config.text_model):
            raise InputError("is determined by the policy given with --from", field="text_model", remedy="leave it out")
        begun.require_text_model(model, "--from")
        prepare([*begun.sentences, *sentences], begun.config)
        return
    if not sentences and (text is not None or model is not None):
        wrong = "applies to multi-task policies only"
        raise InputError(wrong, field="text", remedy="name several TASKS and give --multi-task")
    if model is not None and text in (None, "small", "none"):
        wrong = "applies to pretrained encoders only"
        raise InputError(wrong, field="text_model", remedy="give --text clip or sentence")
    if text == "none":
        raise InputError("cannot be none, because only the instruction distinguishes the tasks", field="text")
    if sentences:
        prepare(
            sentences, PolicyConfig.of({"text": text or "small", **({} if model is None else {"text_model": model})})
        )
