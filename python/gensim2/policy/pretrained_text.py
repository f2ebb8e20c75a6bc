"""Embed sentences with pretrained weights: CLIP's text encoder, or a sentence encoder."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from torch import nn

from gensim2.core.errors import InputError, required
from gensim2.core.files import cache_dir, replacing
from gensim2.core.foreign.tree import refuse_special, why
from gensim2.policy.config import CLIP, SENTENCE


def embeddings(sentences: Sequence[str], kind: str, model: str) -> torch.Tensor:
    """Return embeddings (S, E) of unit length, cached by kind, model and sentence.

    Args:
        sentences: S sentences.
        kind: ``"clip"``: projected output of CLIP; ``"sentence"``: mean over the tokens of a sentence encoder (SBERT).
        model: folder of weights, or a name on the Hugging Face hub.

    Raises:
        InputError: the weights cannot be loaded.
        MissingExtraError: ``transformers`` is not installed.
    """
    from safetensors.torch import load_file, save_file

    folder = cache_dir() / "policy" / kind / _digest(model)
    files = [folder / f"{hashlib.sha256(sentence.encode()).hexdigest()[:32]}.safetensors" for sentence in sentences]
    missing = [number for number, file in enumerate(files) if not file.exists()]
    if missing:
        made = _run([sentences[number] for number in missing], kind, model)
        for number, embedding in zip(missing, made, strict=True):
            with replacing(files[number]) as path:
                save_file({"embedding": embedding.contiguous()}, path)
    return torch.stack([load_file(file)["embedding"] for file in files])


def _digest(model: str) -> str:
    found = hashlib.sha256(model.encode())
    if Path(model).is_dir():
        found = hashlib.sha256(str(Path(model).resolve()).encode())
        for file in sorted(Path(model).iterdir()):
            about = file.stat()
            found.update(f"{file.name} {about.st_size} {about.st_mtime_ns}".encode())
    return found.hexdigest()[:16]


def _run(sentences: Sequence[str], kind: str, model: str) -> torch.Tensor:
    os.environ.setdefault("TOKENIZERS_PARALLELISM", "false")
    transformers = required("transformers", "clip")
    remedy = "give a folder or a hub name with --text-model, or use --text small"
    if kind == "sentence" and model == CLIP:
        wrong = f"the model is CLIP, which is not a sentence encoder such as {SENTENCE}"
        raise InputError(wrong, field="text_model", remedy=remedy)
    transformers.utils.logging.disable_progress_bar()
    path = Path(model)
    if path.exists() and not (path / "config.json").is_file():
        raise InputError("is not a folder of model weights: it has no config.json", file=path, remedy=remedy)
    # Refuse pipes and devices in the folder, because reading them could block forever.
    for file in path.rglob("*") if path.is_dir() else ():
        try:
            if not file.is_dir():
                refuse_special(file.stat())
        except OSError as error:  # A broken symbolic link raises this error, too.
            raise InputError(why(error), file=file, field="text_model", remedy=remedy) from error
    load = transformers.CLIPTextModelWithProjection if kind == "clip" else transformers.AutoModel
    text: Any
    try:
        # A folder of weights may contain code; transformers must not run it.
        tokenizer = transformers.AutoTokenizer.from_pretrained(model, trust_remote_code=False)
        text, told = load.from_pretrained(
            model, use_safetensors=True, trust_remote_code=False, output_loading_info=True
        )
        # The pooler is not used and may be missing. transformers would initialize other missing weights at random.
        missing = [name for name in told["missing_keys"] if "pooler" not in name]
        if missing:
            raise ValueError(
                f"the weights belong to a different model: {len(missing)} tensors are missing, such as {min(missing)}"
            )
        text.eval()
        with torch.no_grad():
            tokens = tokenizer(list(sentences), padding=True, truncation=True, return_tensors="pt")
            read, mask = tokens["input_ids"], tokens["attention_mask"]
            found = text(input_ids=read, attention_mask=mask)
            embedded = found.text_embeds if kind == "clip" else _mean(found.last_hidden_state, mask)
    except (OSError, ValueError, RuntimeError, KeyError, TypeError, AttributeError) as error:
        reason = str(error).strip().split("\n")[0][:200]
        wrong = f"the text encoder cannot be loaded from these weights: {reason}"
        raise InputError(wrong, file=model, field="text_model", remedy=remedy) from error
    return nn.functional.normalize(embedded.float(), dim=-1)


def _mean(tokens: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
    """Return the means (S, E) of the tokens (S, L, E) at which the mask (S, L) is nonzero."""
    there = mask[..., None].to(tokens.dtype)
    return (tokens * there).sum(1) / there.sum(1)
