"""Checkpoints load, or give an error of one line."""

from __future__ import annotations

import hashlib
import json
import os
import resource
from collections.abc import Callable
from pathlib import Path
from typing import Any

import made_up
import pytest
import torch

from gensim2.core.errors import InputError
from gensim2.policy.checkpoint import CheckpointError, PolicyCheckpoint
from gensim2.policy.train import train_policy


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A checkpoint of a tiny policy."""
    config = made_up.policy(head="flow")
    train_policy(made_up.MadeUpSource(config), config, made_up.training(steps=1), tmp_path / "policy")
    return tmp_path / "policy"


def _edit(folder: Path, change: Callable[[dict[str, Any]], Any]) -> None:
    file = folder / "config.json"
    content = json.loads(file.read_text())
    change(content)
    file.write_text(json.dumps(content))


def _weights(folder: Path) -> Path:
    return next(folder.glob("weights-*.safetensors"))


def _flip(folder: Path) -> None:
    content = bytearray(_weights(folder).read_bytes())
    content[-5] ^= 1
    _weights(folder).write_bytes(content)


def _foreign(folder: Path) -> None:
    """Put the weights of another network under the right name and digest."""
    from safetensors.torch import save

    content = save({"layer.weight": torch.zeros(3)})
    digest = hashlib.sha256(content).hexdigest()
    name = f"weights-{digest[:16]}.safetensors"
    (folder / name).write_bytes(content)
    _edit(folder, lambda c: c.update(weights={"file": name, "sha256": digest}))


def _sealed(folder: Path, change: Callable[[dict[str, torch.Tensor]], Any]) -> None:
    """Put other tensors under a name and digest that match, as an attacker would."""
    from safetensors.torch import load, save

    tensors = load(_weights(folder).read_bytes())
    change(tensors)
    content = save(tensors)
    digest = hashlib.sha256(content).hexdigest()
    name = f"weights-{digest[:16]}.safetensors"
    (folder / name).write_bytes(content)
    _edit(folder, lambda c: c.update(weights={"file": name, "sha256": digest}))


def _piped(folder: Path) -> None:
    path = _weights(folder)
    path.unlink()
    os.mkfifo(path)


DAMAGE: dict[str, tuple[Callable[[Path], Any], str]] = {
    "no folder": (lambda f: (f / "config.json").unlink(), "config.json"),
    "no JSON": (lambda f: (f / "config.json").write_text("{"), "is not valid JSON"),
    "another tool's": (lambda f: (f / "config.json").write_text('{"type": "act"}'), "schema_version"),
    "another kind": (lambda f: _edit(f, lambda c: c.update(kind="act")), "kind"),
    "another version": (
        lambda f: _edit(f, lambda c: c.update(schema_version=2)),
        "is 2, but this version of gensim2 reads files with schema version 1",
    ),
    "another field": (lambda f: _edit(f, lambda c: c.update(more=1)), "more"),
    "another head": (lambda f: _edit(f, lambda c: c["policy"].update(head="chunk")), "do not fit"),
    "another setting": (lambda f: _edit(f, lambda c: c["policy"].update(width="wide")), "width"),
    "another width": (lambda f: _edit(f, lambda c: c["policy"].update(width=32)), "do not fit"),
    "another observation": (lambda f: _edit(f, lambda c: c["observation"].update(modalities=["smell"])), "modalities"),
    "a path": (lambda f: _edit(f, lambda c: c["weights"].update(file="../x.safetensors")), "weights.file"),
    "no weights": (lambda f: _weights(f).unlink(), "no such file"),
    "a flipped bit": (_flip, "is damaged"),
    "half": (lambda f: _weights(f).write_bytes(_weights(f).read_bytes()[:999]), "is damaged"),
    "foreign weights": (_foreign, "do not fit the configuration"),
    "fewer sentences": (
        lambda f: _edit(f, lambda c: c["sentences"].pop()),
        "expected type and shape are I64 [1, 24, 12]",
    ),
    "a table of no axes": (
        lambda f: _sealed(f, lambda t: t.update(sentences=torch.tensor(0))),
        "sentences has the type and shape I64 []",
    ),
    "pieces of no word": (lambda f: _sealed(f, lambda t: t["sentences"].fill_(2048)), "must lie in 0..2047"),
    "no number": (lambda f: _sealed(f, lambda t: t["network.cloud_mean"].fill_(torch.nan)), "not finite"),
    "another type": (
        lambda f: _sealed(f, lambda t: t.update(sentences=t["sentences"].double())),
        "sentences has the type and shape F64",
    ),
    "a pipe": (_piped, "is a pipe, not a file"),
    "other points": (lambda f: _edit(f, lambda c: c["observation"]["cloud"].update(points=9)), "policy.points"),
    "a task of a path": (lambda f: _edit(f, lambda c: c["data"].update(tasks=["../../etc"])), "data.tasks.0"),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_what_is_damaged_or_foreign_is_refused_in_one_line(name: str, folder: Path) -> None:
    damage, said = DAMAGE[name]
    damage(folder)
    with pytest.raises(InputError) as caught:
        PolicyCheckpoint.load(folder)
    assert said.lower() in str(caught.value).lower()
    assert str(folder) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "sizes",
    [{"width": 4096, "layers": 48}, {"encoder": "pointnext", "blocks": 16}, {"decoder_layers": 48}, {"horizon": 256}],
)
def test_a_network_larger_than_its_file_takes_no_memory(sizes: dict[str, int], folder: Path) -> None:
    _edit(folder, lambda c: c["policy"].update(sizes))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(CheckpointError, match="do not fit the configuration"):
        PolicyCheckpoint.load(folder)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000  # KiB


def test_a_checkpoint_is_for_one_robot_and_its_sentences(folder: Path) -> None:
    found = PolicyCheckpoint.load(folder)
    found.require_robot("panda", folder)
    with pytest.raises(CheckpointError, match="is for the robot 'panda', not for 'fetch'"):
        found.require_robot("fetch", folder)
    assert torch.equal(found.row_of("close the box", folder)[0], found.table[1])
    with pytest.raises(CheckpointError, match="was not trained on the sentence 'dance'"):
        found.row_of("dance", folder)


def test_a_new_one_replaces_the_old_one(folder: Path) -> None:
    found = PolicyCheckpoint.load(folder)
    before = _weights(folder).name
    with torch.no_grad():
        next(found.network.parameters()).add_(1.0)
    found.save(folder)
    assert _weights(folder).name != before
    assert len(list(folder.glob("weights-*"))) == 1
    PolicyCheckpoint.load(folder)


@pytest.mark.parametrize("corner", ["OpenDrawer", ["a", 0, 0], [[0.1], 0, 0], [0, 0], {}, 5, [10**400, 0, 0], None])
def test_a_box_of_no_three_numbers_is_refused(corner: object, folder: Path) -> None:
    _edit(folder, lambda c: c["observation"]["cloud"].update(low=corner))
    with pytest.raises(CheckpointError, match="low: must be three numbers"):
        PolicyCheckpoint.load(folder)
