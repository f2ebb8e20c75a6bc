"""Text encoders: results for texts, and errors for missing weights."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

import made_up
import pytest
import torch

from gensim2.core.errors import InputError, MissingExtraError
from gensim2.policy import pretrained_text
from gensim2.policy.config import CLIP
from gensim2.policy.text import SmallText, pieces, prepare


def test_the_small_encoder_reads_words_not_bytes() -> None:
    assert torch.equal(pieces("Open the drawer."), pieces("open  the drawer"))
    assert not torch.equal(pieces("open the drawer"), pieces("close the drawer"))
    shared = set(pieces("opened")[0].tolist()) & set(pieces("open")[0].tolist()) - {0}
    assert len(shared) >= 3  # <op, ope, pen
    assert (pieces("")).sum() == 0
    assert pieces("word " * 99).shape == (24, 12)


def test_the_small_encoder_ignores_what_is_not_there() -> None:
    torch.manual_seed(0)
    encoder = SmallText(16)
    rows = torch.stack([pieces("open the drawer"), pieces("")])
    found = encoder(rows)
    assert torch.isfinite(found).all()
    with torch.no_grad():
        encoder.places[5:] += 1.0  # of words in neither text
    assert torch.allclose(encoder(rows), found)


@pytest.mark.parametrize(("kind", "size"), [("clip", 8), ("sentence", 16)])
def test_pretrained_encoders_embed_once_a_sentence(
    kind: str, size: int, clip: str, sentence_model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = clip if kind == "clip" else sentence_model
    config = made_up.policy(text=kind, text_model=model)
    first = prepare(["push the lever", "pull it"], config)
    assert first.shape == (2, size)
    assert torch.allclose(first.norm(dim=-1), torch.ones(2), atol=1e-6)
    assert not torch.allclose(first[0], first[1], atol=1e-3)
    (alone,) = pretrained_text._run(["pull it"], kind, model)  # padding must not matter
    assert torch.allclose(alone, first[1], atol=1e-5)
    monkeypatch.setattr(pretrained_text, "_run", lambda *_: pytest.fail("was cached"))
    assert torch.equal(prepare(["pull it", "push the lever"], config), first.flip(0))


def test_weights_and_tokenizers_that_are_pipes_are_refused_and_never_waited_for(
    sentence_model: str, tmp_path: Path
) -> None:
    for name in (path.name for path in Path(sentence_model).iterdir() if path.name != "config.json"):
        folder = tmp_path / name
        shutil.copytree(sentence_model, folder)
        (folder / name).unlink()
        os.mkfifo(folder / name)
        with pytest.raises(InputError, match=rf"{name}: text_model: is a pipe, not a file \(give a folder"):
            prepare(["a"], made_up.policy(text="sentence", text_model=str(folder)))


def test_missing_and_foreign_weights_are_one_line(
    sentence_model: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "empty").mkdir()
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_OFFLINE", True)  # else it tries the hub for almost a minute
    for kind in ("clip", "sentence"):
        for model in (str(tmp_path / "empty"), "nobody/has-these-weights"):
            with pytest.raises(InputError, match="--text small") as caught:
                prepare(["a"], made_up.policy(text=kind, text_model=model))
            assert model in str(caught.value)
    for kind, model, reason in (
        ("clip", sentence_model, "tensors are missing"),
        ("sentence", CLIP, "is CLIP"),
    ):
        with pytest.raises(InputError, match="--text small") as caught:
            prepare(["a"], made_up.policy(text=kind, text_model=model))
        assert reason in str(caught.value)
    monkeypatch.setitem(sys.modules, "transformers", None)
    with pytest.raises(MissingExtraError, match=r"gensim2\[clip\]"):
        prepare(["b"], made_up.policy(text="clip", text_model="nobody/has-these-weights"))
