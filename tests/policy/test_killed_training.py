"""A killed and resumed training gives the same result; a folder has one owner; hostile states are refused."""

from __future__ import annotations

import hashlib
import json
import os
import resource
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import made_up
import pytest
import torch

from gensim2.core.errors import InputError, WriteError
from gensim2.core.progress import Progress
from gensim2.core.resumable import FolderLock
from gensim2.policy.experiments.config import config_of
from gensim2.policy.experiments.running import run_experiment
from gensim2.policy.learn_record import LOCK
from gensim2.policy.learning import learn
from gensim2.policy.train import train_policy

HERE = Path(__file__).parent
STEPS = 60


def contents(folder: Path) -> dict[str, bytes]:
    """Return weights, settings and curves without the CPU time of the state."""
    found = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file() and path.name != ".lock"}
    points = [json.loads(line) for line in (folder / "training/curves.jsonl").read_text().splitlines()]
    return found | {"curves": json.dumps([{**point, "cpu_s": 0} for point in points]).encode()}


class Broken(Progress):
    """Breaks what the training writes to after 20 steps."""

    def __init__(self, act: Callable[[], object]) -> None:
        self._act, self._steps = act, 0

    def advance(self, steps: int = 1) -> None:
        self._steps += steps
        if self._steps == 20:
            self._act()


def test_a_full_disk_ends_a_training_and_a_resumed_one_ends_as_an_undisturbed_one(tmp_path: Path) -> None:
    config, training = made_up.policy(), made_up.training(steps=STEPS, save_every=3, log_every=2)
    whole, parts, before = tmp_path / "whole", tmp_path / "parts", resource.getrlimit(resource.RLIMIT_FSIZE)
    train_policy(made_up.MadeUpSource(config), config, training, whole)
    full = Broken(lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (0, before[1])))
    try:
        with pytest.raises(
            WriteError, match=r"cannot write: File too large \(free disk space, and resume with --resume\)"
        ):
            train_policy(made_up.MadeUpSource(config), config, training, parts, progress=full)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert json.loads((parts / "training/state.json").read_text())["step"] == 18
    assert not list(parts.rglob(".*.tmp*"))
    train_policy(made_up.MadeUpSource(config), config, training, parts, resume=True)
    assert contents(parts) == contents(whole)


def test_a_training_whose_folder_is_removed_ends_in_one_line(tmp_path: Path) -> None:
    config, training, out = (
        made_up.policy(),
        made_up.training(steps=STEPS, save_every=30, log_every=2),
        tmp_path / "out",
    )
    removed = Broken(lambda: shutil.rmtree(out))
    with pytest.raises(WriteError, match=r"curves.jsonl: cannot write: No such file .* \(choose another folder"):
        train_policy(made_up.MadeUpSource(config), config, training, out, progress=removed)
    assert not out.exists()


def _edit(path: Path, **fields: Any) -> None:
    path.write_text(json.dumps({**json.loads(path.read_text()), **fields}))


def _pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def _moments(folder: Path) -> None:
    from safetensors.torch import load, save

    (path,) = folder.glob("state-*.safetensors")
    tensors = load(path.read_bytes())
    name = next(each for each in tensors if each.startswith("optimizer.exp_avg."))
    content = save({**tensors, name: torch.zeros(3)})
    digest = hashlib.sha256(content).hexdigest()
    (folder / f"state-{digest[:16]}.safetensors").write_bytes(content)
    _edit(folder / "state.json", file=f"state-{digest[:16]}.safetensors", sha256=digest)


HOSTILE: dict[str, tuple[Callable[[Path], Any], str]] = {
    "a path": (lambda f: _edit(f / "state.json", file="../../x.safetensors"), "file"),
    "a step before the first": (lambda f: _edit(f / "state.json", step=-5), "step"),
    "a step after the last": (lambda f: _edit(f / "state.json", step=10**30), "step"),
    "a pipe": (lambda f: _pipe(f / "state.json"), "is a pipe"),
    "a pipe of tensors": (lambda f: _pipe(next(f.glob("state-*"))), "is a pipe"),
    "curves that are a pipe": (lambda f: _pipe(f / "curves.jsonl"), "is a pipe"),
    "curves without steps": (lambda f: (f / "curves.jsonl").write_text('{"loss": 1.0}\n'), "line 1: step"),
    "curves of lists": (lambda f: (f / "curves.jsonl").write_text('[{}]\n{"a": {}}\n'), ""),
    "moments of another shape": (_moments, "optimizer.exp_avg"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_state_is_refused_in_one_line(name: str, tmp_path: Path) -> None:
    config, training = made_up.policy(), made_up.training(steps=4)
    source = made_up.MadeUpSource(config)
    train_policy(source, config, training, tmp_path)
    damage, said = HOSTILE[name]
    damage(tmp_path / "training")
    if not said:  # incomplete lines belong to repeated steps
        train_policy(source, config, training, tmp_path, resume=True)
        return
    with pytest.raises(InputError) as told:
        train_policy(source, config, training, tmp_path, resume=True)
    assert said in str(told.value)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("name", ["config.json", "training", "gone"])
def test_a_folder_with_a_link_out_of_it_is_not_written_to(name: str, tmp_path: Path) -> None:
    config, training = made_up.policy(), made_up.training(steps=4)
    source, out, outside = made_up.MadeUpSource(config), tmp_path / "out", tmp_path / "outside"
    train_policy(source, config, training, out)
    if (out / name).exists():
        (out / name).rename(outside)
    (out / name).symlink_to(outside)
    before = [(path, path.read_bytes()) for path in sorted(tmp_path.glob("outside*/**/*")) if path.is_file()]
    experiment = config_of("generalization", small=True)
    resumes: list[Callable[[], object]] = [lambda: train_policy(source, config, training, out, resume=True)]
    if name == "gone":
        resumes.append(lambda: learn(["CloseBox"], out=out, assets="builtin", resume=True))
        resumes.append(lambda: run_experiment(experiment, out=out, assets="builtin", resume=True))
    for resume in resumes:
        with pytest.raises(InputError, match=f"{name}: is a link out of the folder"):
            resume()
    assert [(path, path.read_bytes()) for path in sorted(tmp_path.glob("outside*/**/*")) if path.is_file()] == before
    assert outside.exists() is (name != "gone")


def test_a_second_learning_and_a_second_experiment_in_a_folder_are_refused(tmp_path: Path) -> None:
    for name, again in (
        (LOCK, lambda: learn(["CloseBox"], out=tmp_path, assets="builtin", resume=True)),
        (
            FolderLock.NAME,
            lambda: run_experiment(config_of("generalization", small=True), out=tmp_path, assets="builtin"),
        ),
    ):
        with FolderLock(tmp_path, name), pytest.raises(InputError, match="another run is using this folder"):
            again()
    assert not (tmp_path / "learn.json").exists()
    assert not (tmp_path / "experiment.json").exists()
