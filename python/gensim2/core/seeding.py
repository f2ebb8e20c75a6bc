"""Derive independent random generators from a seed, a task's name and an episode's index."""

from __future__ import annotations

import hashlib
import operator
from typing import TYPE_CHECKING

from gensim2.core.errors import InputError, brief

if TYPE_CHECKING:
    import numpy as np

#: Largest seed that a run or the reset of a simulator accepts.
LARGEST_SEED = 2**32 - 1


def check_seed(seed: object) -> int:
    """Return ``seed`` as an int.

    Raises:
        InputError: ``seed`` is not an integer from 0 to ``LARGEST_SEED``.
    """
    try:
        number = operator.index(seed)  # type: ignore[arg-type]
    except TypeError as error:
        raise InputError(f"must be a whole number, but is {seed!r}", field="seed") from error
    if isinstance(seed, bool) or not 0 <= number <= LARGEST_SEED:
        raise InputError(f"must lie in 0..2**32 - 1, but is {brief(number)}", field="seed")
    return number


def rng(seed: int, task: str, episode: int = 0) -> np.random.Generator:
    """Return the random generator of one episode.

    Equal arguments give equal random numbers in every process, for any number of workers.

    Args:
        task: name of the task. Another string, such as ``"OpenDrawer/verify"``, gives independent numbers.
        episode: index of the episode.
    """
    import numpy as np  # imported here to keep the command line fast

    digest = hashlib.blake2b(task.encode(), digest_size=8).digest()
    return np.random.default_rng([seed, int.from_bytes(digest, "little"), episode])


def scene_seeds(seed: int, task: str, purpose: str, count: int, start: int = 0) -> list[int]:
    """Return the seeds of ``count`` scenes from index ``start``; different purposes have independent seeds.

    Args:
        purpose: purpose of the scenes, for example ``"verify"``.
    """
    return [int(rng(seed, f"{task}/{purpose}", index).integers(2**31)) for index in range(start, start + count)]
