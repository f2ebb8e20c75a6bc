"""Read the predictions of the keypose head: strategies with their probabilities and programs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import torch

from gensim2.core.seeding import rng
from gensim2.perception import Observation
from gensim2.perception.observation import CLOUD as SEEN_CLOUD
from gensim2.policy.checkpoint import PolicyCheckpoint
from gensim2.policy.frames import SEEN, inputs_of, turn_matrix
from gensim2.policy.heads.keypose import KeyposeHead
from gensim2.policy.keypose.program import KEYPOSES, KeyposeProgram
from gensim2.policy.network import CLOUD, PROPRIO, TEXT

_SHAPES = ((KEYPOSES, 3), (KEYPOSES, 3, 3), (KEYPOSES + 1,), (KEYPOSES,), ())


def order_of_points(count: int) -> npt.NDArray[np.int64]:
    """Return the order (N,) in which a network gets the points of a cloud. The order is random but always the same.

    The first stage of the network uses only the first points of this order. Because the order is random, these points
    are spread over the whole cloud.
    """
    return rng(0, "keypose/points").permutation(count)


@dataclass(frozen=True)
class Answer:
    """One predicted strategy.

    Attributes:
        way: index of the strategy's class.
        chance: predicted probability, 0 to 1.
        program: program in the base frame; meaningless if the class is "done".
    """

    way: int
    chance: float
    program: KeyposeProgram


def answers(checkpoint: PolicyCheckpoint, observation: Observation, row: torch.Tensor) -> list[Answer]:
    """Return the most probable strategies for an observation and an instruction, the most probable strategy first.

    Args:
        checkpoint: policy with a keypose head.
        observation: observation as described by the checkpoint's spec.
        row: (1, ...) encoded instruction.
    """
    network, config = checkpoint.network, checkpoint.config
    assert isinstance(network.head, KeyposeHead)
    # Copy the arrays, because PyTorch requires writable arrays, and arrays that a policy server received are read-only.
    seen = {name: torch.from_numpy(np.array(observation[name], dtype=np.float32))[None, None] for name in SEEN}
    seen[SEEN_CLOUD] = seen[SEEN_CLOUD][:, :, order_of_points(seen[SEEN_CLOUD].shape[2])]
    inputs = inputs_of(seen, config, checkpoint.action.arm)
    with torch.inference_mode():
        found = network({CLOUD: inputs.cloud, PROPRIO: inputs.proprio, TEXT: row}, torch.zeros(1, 0))[0]
    angle = seen["state"][0, 0, 0] if config.frame == "turned" else torch.zeros(())
    turn = turn_matrix(angle).numpy()
    return [_answer(numbers, turn) for numbers in found.numpy()]


def _answer(numbers: np.ndarray, turn: np.ndarray) -> Answer:
    chance, way, *rest = numbers[0], numbers[1], numbers[2:]
    sizes = [int(np.prod(shape)) for shape in _SHAPES]
    parts = np.split(np.asarray(rest[0]), np.cumsum(sizes)[:-1])
    positions, rotations, gripper, seconds, force = (p.reshape(s) for p, s in zip(parts, _SHAPES, strict=True))
    program = KeyposeProgram(
        positions=(positions @ turn.T).astype(np.float32),
        rotations=np.einsum("ij,kjl->kil", turn, rotations).astype(np.float32),
        gripper=np.clip(gripper, -1.0, 1.0).astype(np.float32),
        seconds=np.maximum(seconds, 0.0).astype(np.float32),
        force=max(0.0, float(force)),
    )
    return Answer(round(float(way)), float(chance), program)
