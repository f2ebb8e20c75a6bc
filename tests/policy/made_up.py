"""A made-up source of training batches, and settings of the smallest networks."""

from __future__ import annotations

import os
import signal
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch

from gensim2.perception import ObservationSpec
from gensim2.perception.observation import CLOUD, GRIPPER, STATE, TOOL_POSE, VELOCITY, tool_pose
from gensim2.policy.checkpoint import ActionSpec, DataRecord
from gensim2.policy.config import PolicyConfig, TrainConfig
from gensim2.policy.control import Shuffled
from gensim2.policy.heads.actions import ACTION
from gensim2.policy.keyframes import KEY_POSITIONS, KEY_ROTATIONS
from gensim2.policy.source import SENTENCE
from gensim2.robots import robot

POINTS = 24
SMALL: dict[str, Any] = {
    "width": 16,
    "layers": 1,
    "attention": 2,
    "hidden": 16,
    "decoder_layers": 1,
    "horizon": 4,
    "execute": 2,
    "history": 2,
    "stride": 1,
    "noise_levels": 4,
    "denoise_steps": 2,
}
SENTENCES = ("open the drawer", "close the box")


def policy(**settings: Any) -> PolicyConfig:
    """Return the config of a policy with a few thousand weights."""
    return PolicyConfig.of({**SMALL, **settings})


def training(**settings: Any) -> TrainConfig:
    """Return the settings of a training of two steps."""
    return TrainConfig.of({"steps": 2, "batch": 4, "warmup": 1, "save_every": 1, "log_every": 1, **settings})


class MadeUpSource:
    """Draws frames of a Panda in random poses, whose actions follow from the pose and the first point.

    Args:
        config: history and horizon.
        frames: number of different frames; 0: unlimited.
    """

    def __init__(self, config: PolicyConfig, frames: int = 0, sentences: tuple[str, ...] = SENTENCES) -> None:
        self.robot = "panda"
        self.action = ActionSpec(kind="joint-relative", arm=7, control_hz=20)
        source = "keypoints" if config.encoder == "state" else "depth"
        self.observation = ObservationSpec.of({"points": POINTS, "candidates": 4 * POINTS, "source": source})
        self.sentences = sentences
        self.record = DataRecord(digest="made up", tasks=("OpenDrawer",), episodes=1, frames=9, folders=("made-up",))
        self._config, self._frames = config, frames
        self._kept = self._make(np.random.default_rng(5), frames) if frames else None

    def draw(self, rng: np.random.Generator, size: int) -> Mapping[str, torch.Tensor]:
        """Return a batch, from the kept frames if there are any."""
        if self._kept is None:
            return self._make(rng, size)
        rows = rng.integers(self._frames, size=size)
        return {name: values[rows] for name, values in self._kept.items()}

    def some_clouds(self, max_clouds: int) -> Shuffled:
        rng = np.random.default_rng(6)
        points = rng.uniform(0, 1, (min(max_clouds, 3), POINTS, 3)).astype(np.float32)
        return Shuffled(points, np.zeros(points.shape, np.uint8))

    def _make(self, rng: np.random.Generator, size: int) -> dict[str, torch.Tensor]:
        frames = self._config.history
        cloud = rng.uniform(0, 1, (size, frames, POINTS, 6))
        state = rng.uniform(-0.5, 0.5, (size, frames, 9)) + np.array(robot("panda").reset_qpos)
        poses = [tool_pose(robot("panda"), q) for q in state.reshape(-1, 9).astype(np.float32)]
        sentence = rng.integers(len(self.sentences), size=size)
        actions = (
            rng.normal(0, 0.1, (size, self._config.horizon, 9))
            if not self._frames
            else np.zeros((size, self._config.horizon, 9))
        )
        if self._frames:
            steps = np.arange(1, self._config.horizon + 1)[None, :, None]
            actions[..., :7] = 0.1 * steps * np.sin(state[:, -1, None, :7] + 5 * sentence[:, None, None])
            actions[..., 7:] = np.sign(state[:, -1, None, 1:2])
        found = {
            CLOUD: cloud,
            STATE: state,
            VELOCITY: rng.normal(0, 0.1, (size, frames, 9)),
            TOOL_POSE: np.array(poses).reshape(size, frames, 7),
            GRIPPER: rng.uniform(-1, 1, (size, frames, 2)),
            ACTION: actions,
        }
        if count := self._config.keyframes:
            found[KEY_POSITIONS] = rng.normal(0, 0.1, (size, count, 3))
            found[KEY_POSITIONS][0] = np.nan  # unknown
            found[KEY_ROTATIONS] = np.tile(np.eye(3), (size, count, 1, 1))
        tensors = {name: torch.from_numpy(values.astype(np.float32)) for name, values in found.items()}
        return {**tensors, SENTENCE: torch.from_numpy(sentence)}


class FailsElsewhere(MadeUpSource):
    """Fails to draw a batch in other processes than its own."""

    def draw(self, rng: np.random.Generator, size: int) -> Mapping[str, torch.Tensor]:
        """Return a batch, in its own process only."""
        if os.getpid() != self.home:
            raise RuntimeError("CUDA out of memory")
        return super().draw(rng, size)

    home = 0


class KilledElsewhere(MadeUpSource):
    """Kills the process of its fourth batch if that is not its own, as the kernel does when memory runs out."""

    home, drawn = 0, 0

    def draw(self, rng: np.random.Generator, size: int) -> Mapping[str, torch.Tensor]:
        """Return a batch, or kill the process."""
        self.drawn += os.getpid() != self.home
        if self.drawn == 4:
            os.kill(os.getpid(), signal.SIGKILL)
        return super().draw(rng, size)


def random_clip(folder: Path) -> Path:
    """Write CLIP's text encoder with random weights, with two layers of 16."""
    import json

    import transformers

    folder.mkdir(parents=True)
    letters = "abcdefghijklmnopqrstuvwxyz"
    words = [*letters, *(f"{letter}</w>" for letter in letters), "<|startoftext|>", "<|endoftext|>"]
    (folder / "vocab.json").write_text(json.dumps({word: number for number, word in enumerate(words)}))
    (folder / "merges.txt").write_text("#version: 0.2\n")
    (folder / "tokenizer_config.json").write_text(
        json.dumps({"tokenizer_class": "CLIPTokenizer", "model_max_length": 77})
    )
    config = transformers.CLIPTextConfig(
        vocab_size=len(words),
        hidden_size=16,
        intermediate_size=16,
        num_hidden_layers=2,
        num_attention_heads=2,
        projection_dim=8,
        bos_token_id=len(words) - 2,
        eos_token_id=len(words) - 1,
    )
    torch.manual_seed(0)
    transformers.CLIPTextModelWithProjection(config).save_pretrained(folder, safe_serialization=True)
    return folder


def random_sentence_model(folder: Path) -> Path:
    """Write a sentence encoder with random weights, with two layers of 16."""
    import transformers

    folder.mkdir(parents=True)
    words = ["[PAD]", "[UNK]", "[CLS]", "[SEP]", "[MASK]", "push", "the", "lever", "pull", "it"]
    (folder / "vocab.txt").write_text("\n".join(words))
    transformers.BertTokenizer(str(folder / "vocab.txt")).save_pretrained(folder)
    config = transformers.BertConfig(
        vocab_size=len(words), hidden_size=16, intermediate_size=16, num_hidden_layers=2, num_attention_heads=2
    )
    torch.manual_seed(0)
    transformers.BertModel(config).save_pretrained(folder, safe_serialization=True)
    return folder
