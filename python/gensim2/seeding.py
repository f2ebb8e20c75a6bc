"""Random numbers: every draw comes from a generator made from (seed, task, episode)."""

from __future__ import annotations

import hashlib

import numpy as np


def rng(seed: int, task: str, episode: int = 0) -> np.random.Generator:
    """Return the generator of one episode.

    The same three values give the same stream in every process and on every day; the number of workers has no say.

    Args:
        seed: the run's seed.
        task: name of the task, or of whatever purpose draws (for example ``"OpenDrawer/verify"``).
        episode: index of the episode.
    """
    digest = hashlib.blake2b(task.encode(), digest_size=8).digest()
    return np.random.default_rng([seed, int.from_bytes(digest, "little"), episode])
