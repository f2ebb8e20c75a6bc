"""Training: all combinations run, are saved, and resume bit for bit; invalid ones are refused in one line."""

from __future__ import annotations

import contextlib
import hashlib
import itertools
import json
import math
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import made_up
import pytest
import torch

from gensim2.core.errors import InputError
from gensim2.core.progress import Progress
from gensim2.core.resumable import FolderLock
from gensim2.policy.checkpoint import PolicyCheckpoint
from gensim2.policy.config import ENCODERS, TEXTS
from gensim2.policy.dagger import train_rounds
from gensim2.policy.heads.actions import ACTION
from gensim2.policy.train import learning_rate, train_policy

CHUNK_HEADS = ("chunk", "transformer", "diffusion", "flow")
#: Every encoder with every head, and every text encoder with every encoder and with every head.
COMBINATIONS = [
    (encoder, head, TEXTS[(first + second) % len(TEXTS)])
    for (first, encoder), (second, head) in itertools.product(enumerate(ENCODERS), enumerate(CHUNK_HEADS))
]


class Interrupting(Progress):
    """Sends Ctrl-C after the first step of a training."""

    def __init__(self) -> None:
        self.steps = -1

    def advance(self, steps: int = 1) -> None:
        self.steps += 1
        if self.steps == 1:
            signal.raise_signal(signal.SIGINT)


def files(folder: Path) -> dict[str, bytes]:
    """Return the contents of a checkpoint."""
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir()) if path.is_file()}


@pytest.mark.parametrize(("encoder", "head", "text"), COMBINATIONS)
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
    with pytest.raises(InputError, match=r"settings\.seed: was begun with 0, not 9"):
        train_policy(source, config, made_up.training(seed=9), tmp_path, resume=True)
    renamed = made_up.MadeUpSource(config, sentences=("turn on the faucet",))
    with pytest.raises(InputError, match=r"settings\.sentences: was begun with"):
        train_policy(renamed, config, made_up.training(), tmp_path, resume=True)
    start = train_policy(source, config, made_up.training(seed=3), tmp_path / "start").checkpoint
    with pytest.raises(InputError, match=r"settings\.start: was begun with None"):
        train_policy(source, config, made_up.training(), tmp_path, start=start, resume=True)
    # An earlier version wrote only settings.
    file = tmp_path / "training" / "state.json"
    record = json.loads(file.read_bytes())
    for name in ("action", "sentences", "folders"):
        del record["settings"][name]
    file.write_text(json.dumps(record))
    with pytest.raises(InputError, match=r"settings\.seed: was begun with 0, not 9"):
        train_policy(source, config, made_up.training(seed=9), tmp_path, resume=True)
    state = next((tmp_path / "training").glob("state-*.safetensors"))
    state.write_bytes(state.read_bytes()[:-1])
    with pytest.raises(InputError, match="is damaged"):
        train_policy(source, config, made_up.training(), tmp_path, resume=True)


def test_a_folder_has_one_training_at_a_time(tmp_path: Path) -> None:
    config = made_up.policy()
    lock = FolderLock(tmp_path)
    with pytest.raises(InputError, match="another run is using this folder"):
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


def test_a_signal_between_two_questions_leaves_no_step_unsaved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    answers = iter([False, True])

    @contextlib.contextmanager
    def signals() -> Iterator[Any]:
        yield lambda: next(answers)

    monkeypatch.setitem(train_policy.__globals__, "deferred_signals", signals)
    config = made_up.policy()
    told = made_up.training(steps=5, save_every=100)
    result = train_policy(made_up.MadeUpSource(config), config, told, tmp_path)
    assert result.steps == json.loads((tmp_path / "training/state.json").read_text())["step"] == 2


def test_the_loss_is_that_of_a_training_without_interruption(tmp_path: Path) -> None:
    config, told = made_up.policy(), made_up.training(steps=4, log_every=3, save_every=100)
    source = made_up.MadeUpSource(config)
    whole = train_policy(source, config, told, tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt):
        train_policy(source, config, told, tmp_path / "parts", progress=Interrupting())
    parts = train_policy(source, config, told, tmp_path / "parts", resume=True)
    assert parts.loss == whole.loss
    mean, again = (
        json.loads((tmp_path / name / "training/curves.jsonl").read_text().splitlines()[0])["loss"]
        for name in ("whole", "parts")
    )
    assert mean == again
    (tmp_path / "whole/training/curves.jsonl").unlink()
    assert train_policy(source, config, told, tmp_path / "whole", resume=True).loss == whole.loss


def test_a_state_without_losses_goes_on_by_its_curves(tmp_path: Path) -> None:
    config = made_up.policy()
    source, state = made_up.MadeUpSource(config), tmp_path / "training/state.json"
    done = train_policy(source, config, made_up.training(), tmp_path)
    older = {name: value for name, value in json.loads(state.read_text()).items() if not name.startswith("loss")}
    state.write_text(json.dumps(older))
    assert train_policy(source, config, made_up.training(), tmp_path, resume=True).loss == done.loss
    (tmp_path / "training/curves.jsonl").unlink()
    with pytest.raises(InputError, match=r"curves\.jsonl: has no loss"):
        train_policy(source, config, made_up.training(), tmp_path, resume=True)


@pytest.mark.parametrize("tensors", [{"network.more": torch.zeros(3)}, {"other.weight": torch.zeros(3)}, None])
def test_a_state_of_another_version_is_one_line(tensors: dict[str, torch.Tensor] | None, tmp_path: Path) -> None:
    from safetensors.torch import save

    config = made_up.policy()
    source = made_up.MadeUpSource(config)
    train_policy(source, config, made_up.training(), tmp_path)
    content = b"no tensors" if tensors is None else save(tensors)
    record, digest = tmp_path / "training/state.json", hashlib.sha256(content).hexdigest()
    file = f"state-{digest[:16]}.safetensors"
    (tmp_path / "training" / file).write_bytes(content)
    record.write_text(json.dumps({**json.loads(record.read_text()), "file": file, "sha256": digest}))
    with pytest.raises(InputError, match="is of another version of gensim2"):
        train_policy(source, config, made_up.training(), tmp_path, resume=True)


@pytest.mark.parametrize("resume", [False, True])
def test_rounds_of_relabels_need_a_free_folder_before_the_first(resume: bool, tmp_path: Path) -> None:
    config = made_up.policy()
    source: Any = made_up.MadeUpSource(config)
    train_policy(source, config, made_up.training(), tmp_path)
    with pytest.raises(InputError, match="holds a policy already"):
        train_rounds(source, (), config, made_up.training(), tmp_path, rounds=1, resume=resume)
    assert not (tmp_path / "rounds").exists()


@pytest.mark.parametrize(("encoder", "made_of"), [("state", "depth"), ("mlp", "keypoints")])
def test_clouds_that_are_not_the_encoder_s_are_refused(encoder: str, made_of: str, tmp_path: Path) -> None:
    source = made_up.MadeUpSource(made_up.policy(encoder="mlp" if made_of == "depth" else "state"))
    with pytest.raises(InputError, match=f"encoder: is {encoder}, and the clouds are made of {made_of}"):
        train_policy(source, made_up.policy(encoder=encoder), made_up.training(), tmp_path / "policy")
