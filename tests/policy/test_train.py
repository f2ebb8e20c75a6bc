"""Training: every combination takes steps, is saved, and goes on bit for bit; what cannot be is refused in one line."""

from __future__ import annotations

import itertools
import json
import math
import signal
from pathlib import Path
from typing import Any

import made_up
import pytest
import torch

from gensim2.data.lock import FolderLock
from gensim2.errors import InputError
from gensim2.policy.checkpoint import PolicyCheckpoint
from gensim2.policy.config import ENCODERS, TEXTS
from gensim2.policy.heads.actions import ACTION
from gensim2.policy.train import learning_rate, train_policy
from gensim2.progress import NullProgress

CHUNK_HEADS = ("chunk", "transformer", "diffusion", "flow")


class Interrupting(NullProgress):
    """Sends Ctrl-C after the first step of a training."""

    def __init__(self) -> None:
        self.steps = -1

    def advance(self, steps: int = 1) -> None:
        self.steps += 1
        if self.steps == 1:
            signal.raise_signal(signal.SIGINT)


def files(folder: Path) -> dict[str, bytes]:
    """Contents of a checkpoint."""
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir()) if path.is_file()}


@pytest.mark.parametrize(("encoder", "head", "text"), list(itertools.product(ENCODERS, CHUNK_HEADS, TEXTS)))
def test_every_combination_trains_and_goes_on_bit_for_bit(
    encoder: str, head: str, text: str, tmp_path: Path, clip: str
) -> None:
    keyframes = 2 if text == "small" else 0
    config = made_up.policy(encoder=encoder, head=head, text=text, text_model=clip, keyframes=keyframes)
    source = made_up.MadeUpSource(config)
    result = train_policy(source, config, made_up.training(), tmp_path / "whole")
    assert result.steps == 2
    assert math.isfinite(result.loss)
    with pytest.raises(KeyboardInterrupt):
        train_policy(source, config, made_up.training(), tmp_path / "parts", progress=Interrupting())
    assert not (tmp_path / "parts" / "config.json").exists()
    train_policy(source, config, made_up.training(), tmp_path / "parts", resume=True)
    assert files(tmp_path / "whole") == files(tmp_path / "parts")
    loaded = PolicyCheckpoint.load(tmp_path / "whole")
    for name, value in result.checkpoint.network.state_dict().items():
        assert torch.equal(value, loaded.network.state_dict()[name]), name


def test_the_seed_decides(tmp_path: Path) -> None:
    config = made_up.policy()
    source = made_up.MadeUpSource(config)
    for name, seed in (("a", 0), ("b", 0), ("c", 1)):
        train_policy(source, config, made_up.training(seed=seed), tmp_path / name)
    weights = {name: next((tmp_path / name).glob("weights-*")).read_bytes() for name in "abc"}
    assert weights["a"] == weights["b"] != weights["c"]


def test_a_small_set_is_learned_by_heart(tmp_path: Path) -> None:
    config = made_up.policy(width=64, hidden=128, layers=1, history=1)
    source = made_up.MadeUpSource(config, frames=10)
    told = made_up.training(
        steps=250, batch=10, learning_rate=3e-3, warmup=20, dropout=0, jitter=0, save_every=400, ema=0.9
    )
    result = train_policy(source, config, told, tmp_path / "policy")
    points = [json.loads(line) for line in (tmp_path / "policy/training/curves.jsonl").read_text().splitlines()]
    assert [point["step"] for point in points] == list(range(1, 251))
    assert points[0]["loss"] > 0.5
    assert result.loss < 0.05


def test_the_rate_ends_with_the_last_step() -> None:
    told = made_up.training(steps=100, warmup=10, learning_rate=1.0)
    rates = [learning_rate(step, told) for step in range(100)]
    assert rates[0] == pytest.approx(0.1)
    assert max(rates) == rates[10] == 1.0
    assert 0 < rates[-1] < 1e-3
    assert learning_rate(100, told) == pytest.approx(0.0, abs=1e-12)


def test_fine_tuning_starts_from_the_weights(tmp_path: Path) -> None:
    config = made_up.policy()
    source = made_up.MadeUpSource(config)
    first = train_policy(source, config, made_up.training(), tmp_path / "first")
    other = made_up.MadeUpSource(config, sentences=("turn on the faucet",))
    still = made_up.training(steps=1, learning_rate=0.0)
    second = train_policy(other, first.checkpoint.config, still, tmp_path / "second", start=first.checkpoint)
    assert second.checkpoint.sentences == ("turn on the faucet",)
    for name, value in first.checkpoint.network.state_dict().items():
        assert torch.allclose(value, second.checkpoint.network.state_dict()[name], atol=1e-7), name
    with pytest.raises(InputError, match="--from: width"):
        train_policy(source, made_up.policy(width=32), still, tmp_path / "third", start=first.checkpoint)


@pytest.mark.parametrize(
    ("settings", "told", "said"),
    [
        ({"points": 25}, {}, "points: the data have 24 points, the policy 25"),
        ({}, {"learning_rate": 1.0, "clip": 1e6, "steps": 1}, "holds a policy already"),
    ],
)
def test_what_does_not_go_together_is_refused(
    settings: dict[str, Any], told: dict[str, Any], said: str, tmp_path: Path
) -> None:
    config = made_up.policy(**settings)
    source = made_up.MadeUpSource(config)
    (tmp_path / "config.json").write_text("{}")
    with pytest.raises(InputError, match=said):
        train_policy(source, config, made_up.training(**told), tmp_path)


def test_another_training_is_not_gone_on_with(tmp_path: Path) -> None:
    config = made_up.policy()
    source = made_up.MadeUpSource(config)
    train_policy(source, config, made_up.training(), tmp_path)
    with pytest.raises(InputError, match="other settings or data"):
        train_policy(source, config, made_up.training(seed=9), tmp_path, resume=True)
    state = next((tmp_path / "training").glob("state-*.safetensors"))
    state.write_bytes(state.read_bytes()[:-1])
    with pytest.raises(InputError, match="is damaged"):
        train_policy(source, config, made_up.training(), tmp_path, resume=True)


def test_a_folder_has_one_training_at_a_time(tmp_path: Path) -> None:
    config = made_up.policy()
    lock = FolderLock(tmp_path)
    with pytest.raises(InputError, match="another run is at work in it"):
        train_policy(made_up.MadeUpSource(config), config, made_up.training(), tmp_path)
    lock.release()


def test_a_loss_that_is_no_number_ends_the_training(tmp_path: Path) -> None:
    config = made_up.policy()
    source = made_up.MadeUpSource(config)
    drawn = source.draw

    def poisoned(*given: Any) -> dict[str, torch.Tensor]:
        batch = dict(drawn(*given))
        return {**batch, ACTION: batch[ACTION] * math.inf} if given[1] == 4 else batch

    source.draw = poisoned  # type: ignore[method-assign]
    with pytest.raises(InputError, match="the loss is"):
        train_policy(source, config, made_up.training(), tmp_path)
