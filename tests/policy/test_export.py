"""Exports compute the same function within 1e-5, for every encoder, head and text encoder."""

from __future__ import annotations

import json
from pathlib import Path

import made_up
import pytest

from gensim2.core.errors import InputError
from gensim2.policy import export
from gensim2.policy.export import export_policy
from gensim2.policy.train import train_policy

pytest.importorskip("onnxscript")


@pytest.mark.parametrize(
    ("encoder", "head", "text", "keyframes"),
    [
        ("mlp", "transformer", "none", 0),
        ("pointnet", "diffusion", "small", 0),
        ("pointnext", "chunk", "clip", 1),
        ("mlp", "flow", "small", 3),
        ("state", "chunk", "small", 0),
    ],
)
def test_exports_are_the_same_function(
    encoder: str, head: str, text: str, keyframes: int, tmp_path: Path, clip: str
) -> None:
    told = {"encoder": encoder, "head": head, "text": text, "text_model": clip, "keyframes": keyframes}
    config = made_up.policy(**told, history=1)
    train_policy(made_up.MadeUpSource(config), config, made_up.training(), tmp_path / "policy")
    for to in export.FORMATS:
        told = export_policy(tmp_path / "policy", tmp_path / f"policy.{to}", to)
        assert told["difference"] <= 1e-5
        about = json.loads((tmp_path / f"policy.{to}.json").read_text())
        assert about["inputs"]["cloud"] == [1, 1, made_up.POINTS, 9]
        assert list(about["sentences"]) == list(made_up.SENTENCES)


def test_formats_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="to: must be one of torch, onnx, but is 'ONNX'"):
        export_policy(tmp_path, tmp_path / "policy", "ONNX")  # type: ignore[arg-type]


def test_an_export_that_is_another_function_is_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = made_up.policy(text="none", history=1)
    train_policy(made_up.MadeUpSource(config), config, made_up.training(steps=1), tmp_path / "policy")
    whole = export.exported
    monkeypatch.setattr(export, "exported", lambda *given: lambda inputs: whole(*given)(inputs) + 1e-3)
    with pytest.raises(InputError, match="its output differs from the output of the checkpoint"):
        export_policy(tmp_path / "policy", tmp_path / "policy.pt2", "torch")
    assert not (tmp_path / "policy.pt2").exists()
