"""Action noise: smooth, reproducible by the seed, and not part of the recorded labels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gensim2.core.errors import InputError
from gensim2.data import DataSet, collect
from gensim2.rollout.config import RolloutOptions
from gensim2.rollout.worker import PERIOD, Noisy

HZ = 20


class Still:
    """Returns always the same action."""

    def reset(self, observation: object, seed: int) -> None: ...

    def act(self, observation: object) -> list[float] | None:
        return [0.5] * 7 + [1.0]


def _sent(seed: int, steps: int) -> tuple[np.ndarray, Noisy]:
    noisy = Noisy(Still(), HZ, 7, 0.05, seed)
    noisy.reset(None, 0)
    return np.array([noisy.act(None) for _ in range(steps)]), noisy


def test_noise_comes_and_goes_smoothly_and_the_fingers_are_left_alone() -> None:
    steps = round(PERIOD * HZ)
    sent, noisy = _sent(1, 40 * steps)
    off = sent[:, :7] - 0.5
    assert np.abs(off[::steps]).max() < 1e-6
    pushed = np.abs(off).reshape(40, steps, 7).max(axis=(1, 2)) > 1e-6
    assert 10 <= pushed.sum() <= 30
    assert np.std(off[steps // 2 :: steps][pushed]) == pytest.approx(0.05, rel=0.2)
    assert (sent[:, 7] == 1.0).all()
    assert noisy.reference is not None
    assert noisy.reference.action is not None
    assert noisy.reference.action.tolist() == [0.5] * 7 + [1.0]
    assert (sent == _sent(1, 40 * steps)[0]).all()
    assert (sent != _sent(2, 40 * steps)[0]).any()


def test_a_collection_keeps_what_was_meant_beside_what_was_sent(tmp_path: Path) -> None:
    collect(["CloseBox"], episodes=2, out=tmp_path, noise=0.02, workers=0, assets="builtin", instances="train")
    dataset = DataSet.open(tmp_path)
    assert dataset.record.rollout.noise == 0.02
    store = dataset.task("CloseBox")
    rows = [row for row in store.rows() if row.held]
    assert rows
    recording = store.read(rows[0]).recording
    assert recording is not None
    off = recording.actions - recording.meant
    assert 0.005 < np.abs(off[:, :7]).max() < 0.15
    assert (off[:, 7] == 0).all()
    assert np.isfinite(recording.meant).all()


def test_without_noise_a_file_says_nothing_of_it_and_too_much_is_refused() -> None:
    assert "noise" not in RolloutOptions().to_record()
    assert RolloutOptions.from_record(RolloutOptions(noise=0.1).to_record()).noise == 0.1
    with pytest.raises(InputError, match=r"0\.\.0\.2"):
        RolloutOptions(noise=0.5)
