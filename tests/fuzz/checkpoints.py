"""Damage checkpoints at random (by a seed) and check what making a controller of them does.

``python tests/fuzz/checkpoints.py --inputs 5000`` damages the package's policy and a small policy of action chunks:
values, names of code, weights with a matching digest, arrays, links and sizes. Each is read in a forked process that
may use 1 GiB more memory than at its start, 5 s of CPU and 60 s in total, and may not write to files. A checkpoint
must be accepted with exactly the content of its files, or refused in one line. A module ``canary`` beside it would
leave a file if it were imported.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import io
import json
import multiprocessing
import os
import shutil
import sys
import zipfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from mutate import check_line, damaged, damaged_value
from runner import Ended, Round, Say, Tally, in_process, main, tried
from safetensors import SafetensorError
from safetensors.numpy import load, save
from safetensors.torch import load as load_tensors

from gensim2.core.errors import InputError
from gensim2.perception import ObservationSpec
from gensim2.policy import controller, keypose  # noqa: F401 - loaded before forking
from gensim2.policy.checkpoint import ActionSpec, DataRecord, PolicyCheckpoint, checkpoint_folder
from gensim2.policy.config import PolicyConfig, TrainConfig
from gensim2.policy.control import Shuffled
from gensim2.policy.evaluating import policy_controller
from gensim2.policy.network import fresh_network
from gensim2.policy.sentences import sentence_row
from gensim2.policy.text import prepare as prepare_text
from gensim2.robots import panda  # noqa: F401

CONFIG, WAYS, CLOUDS = "config.json", "keypose.json", "clouds.npz"
CANARY = "from pathlib import Path\nPath(__file__).with_name('ran').touch()\nmake = panda = Controller = None\n"
NAMES = (
    "canary.py",
    "./canary.py:make",
    "{folder}/canary.py",
    "{folder}/canary.py:panda",
    "canary:make",
    "canary:Controller",
    "canary",
    "../canary.py",
    "{folder}",
    "pickle:{folder}/canary.py",
)
SIZES: dict[str, tuple[Any, ...]] = {
    "width": (4096, 4094, 16, 10**9),
    "layers": (48, 0, 3),
    "decoder_layers": (48, 1),
    "hidden": (8192, 8),
    "horizon": (256, 1),
    "execute": (256, 1),
    "history": (4, 2),
    "ways": (10_000, 1),
    "points": (49_152, 1, None),
    "blocks": (16, 1),
    "keyframes": (8, 0),
    "attention": (64, 3),
    "encoder": ("mlp", "pointnet", "pointnext", "state"),
    "head": ("chunk", "transformer", "diffusion", "flow", "keypose"),
    "text": ("none", "small", "clip", "sentence"),
    "noise_levels": (10_000, 2),
    "spread_points": (49_152, 0),
}


def good_checkpoints(folder: Path) -> list[Path]:
    """Return the package's policy and one of action chunks with random weights."""
    keyposes, chunks = folder / "keyposes", folder / "chunks"
    shutil.copytree(checkpoint_folder("builtin"), keyposes, ignore=shutil.ignore_patterns("__pycache__"))
    sentences = ("open the drawer", "close the box")
    config = PolicyConfig(width=16, layers=1, attention=2, hidden=16, horizon=4, execute=2, history=2, points=64)
    table = prepare_text(sentences, config)
    PolicyCheckpoint(
        fresh_network(config, 7, table.shape[1:], 0).eval(),
        "panda",
        ActionSpec(kind="joint-relative", arm=7, control_hz=20),
        ObservationSpec.of({"points": 64, "candidates": 256}),
        sentences,
        table,
        DataRecord(digest="0" * 64, tasks=("OpenDrawer",), episodes=1, frames=9, folders=("set",)),
        TrainConfig(),
        20,
        {"torch": "2"},
    ).save(chunks)
    draw = np.random.default_rng(0)
    Shuffled(draw.random((3, 64, 3), np.float32), draw.integers(0, 256, (3, 64, 3), np.uint8)).save(chunks)
    return [keyposes, chunks]


def verdict(folder: Path) -> str:
    """Return how making the controller of a checkpoint ended."""
    torch.set_num_threads(1)
    try:
        read(folder)
    except InputError as error:
        check_line(str(error))
        return "refused"
    return "accepted"


def read(folder: Path) -> None:
    """Make the controller of a checkpoint with its control clouds.

    Raises:
        AssertionError: it was accepted, but differs from its files.
    """
    policy_controller(str(folder), sees="other").make()
    found = PolicyCheckpoint.load(str(folder))
    sentence_row(found, found.sentences[0], folder, embed=False)
    told = json.loads((folder / CONFIG).read_bytes())
    if isinstance(told["observation"].get("cameras"), list):
        told["observation"]["cameras"] = list(found.observation.cameras)  # their order does not matter
    parts = {
        "policy": found.config.to_dict(),
        "training": found.training.to_dict(),
        "observation": found.observation.to_dict(),
        "action": found.action.model_dump(mode="json"),
        "data": found.data.model_dump(mode="json"),
        "sentences": list(found.sentences),
        "robot": found.robot,
        "step": found.step,
        "versions": found.versions,
    }
    for name, part in parts.items():
        assert _holds(part, told[name]), f"{name} is {part!r:.300}, not {told[name]!r:.300}"
    stored = load_tensors((folder / told["weights"]["file"]).read_bytes())
    held = {f"network.{name}": value for name, value in found.network.state_dict().items()} | {"sentences": found.table}
    assert held.keys() == stored.keys()
    assert all(held[name].dtype == value.dtype and held[name].equal(value) for name, value in stored.items())


def imports_the_canary(_: Path) -> None:
    """Import the module, to test that this is noticed."""
    with contextlib.suppress(SystemExit):
        importlib.import_module("canary")


def _holds(found: Any, told: Any) -> bool:
    """Return whether a value equals the one in a file; missing fields have their defaults."""
    if isinstance(told, dict) and isinstance(found, dict):
        return all(name in found and _holds(found[name], each) for name, each in told.items())
    if isinstance(told, list) and isinstance(found, list | tuple):
        return len(found) == len(told) and all(map(_holds, found, told))
    return bool(found == told)


def damage(folder: Path, generator: np.random.Generator) -> str:
    """Apply one to three damages to a checkpoint, and return their names."""
    ways: tuple[Callable[[Path, np.random.Generator], str], ...]
    ways = (_values, _values, _name, _name, _size, _weights, _weights, _header, _arrays, _file, _replaced)
    return "; ".join(
        ways[int(generator.integers(len(ways)))](folder, generator) for _ in range(int(generator.integers(1, 4)))
    )


def _pick(values: Sequence[Any], generator: np.random.Generator) -> Any:
    return values[int(generator.integers(len(values)))]


def _json(folder: Path, change: Callable[[Any], Any], name: str = CONFIG) -> str:
    path = folder / name
    if _is_special(path):
        return "nothing"
    try:
        value = change(json.loads(path.read_bytes()) if path.is_file() else {})
        path.write_text(json.dumps(value))
    except (ValueError, TypeError, LookupError, AttributeError, OSError, RecursionError) as error:
        return f"nothing ({type(error).__name__}: damaged before)"
    return name


def _is_special(path: Path) -> bool:
    """Return whether earlier damage put a link, pipe, folder or terabyte there, which must not be touched."""
    return os.path.lexists(path) and (path.is_symlink() or not path.is_file() or path.stat().st_size > 2**24)


def _values(folder: Path, generator: np.random.Generator) -> str:
    name = CONFIG if generator.random() < 0.7 or not (folder / WAYS).is_file() else WAYS
    return f"values of {_json(folder, partial(damaged_value, generator=generator), name)}"


def _name(folder: Path, generator: np.random.Generator) -> str:
    """Put a name of code in the place of a text."""
    word = _pick(NAMES, generator).format(folder=folder)

    def change(config: Any) -> Any:
        places = [(config, "robot")] * 4 + [(config["policy"], "text_model"), (config["policy"], "text")]
        places += [(config["policy"], name) for name in ("encoder", "head", "frame")]
        places += [(config["data"], "tasks"), (config["data"], "folders"), (config, "versions"), (config, "sentences")]
        places += [(config["weights"], "file"), (config, "kind"), (config["observation"], "modalities")]
        parent, key = _pick(places, generator)
        parent[key] = [word] if isinstance(parent[key], list) else {"canary": word} if key == "versions" else word
        if key == "text_model":
            config["policy"]["text"] = _pick(("clip", "sentence"), generator)
        return config

    return f"{word} in {_json(folder, change)}"


def _size(folder: Path, generator: np.random.Generator) -> str:
    names = [_pick(list(SIZES), generator) for _ in range(int(generator.integers(1, 4)))]

    def change(config: Any) -> Any:
        config["policy"].update({name: _pick(SIZES[name], generator) for name in names})
        if generator.random() < 0.2:
            config["action"]["arm"] = _pick((1, 6, 8, 64), generator)
        return config

    return f"{', '.join(names)} of {_json(folder, change)}"


def _weights_file(folder: Path) -> Path | None:
    return next((path for path in folder.glob("weights-*.safetensors") if not _is_special(path)), None)


def _sealed(folder: Path, content: bytes) -> str:
    """Replace the weights and update the digest, as an attacker would."""
    digest = hashlib.sha256(content).hexdigest()
    name = f"weights-{digest[:16]}.safetensors"
    if not _is_special(folder / name):
        (folder / name).write_bytes(content)
    return _json(folder, lambda config: {**config, "weights": {"file": name, "sha256": digest}})


def _weights(folder: Path, generator: np.random.Generator) -> str:
    """Remove, rename or change tensors (shape, type, not finite), or damage bits."""
    path = _weights_file(folder)
    if path is None or path.stat().st_size > 2**24:
        return "nothing"
    if generator.random() < 0.3:
        content = damaged(path.read_bytes(), "binary", generator)
        return f"bits of weights, sealed {_sealed(folder, content)}"
    try:
        tensors = load(path.read_bytes())
    except (SafetensorError, ValueError, KeyError):
        return "nothing"
    name = "sentences" if generator.random() < 0.4 and "sentences" in tensors else _pick(sorted(tensors), generator)
    value = tensors.pop(name)
    kinds: dict[str, Callable[[], Any]] = {
        "gone": dict,
        "renamed": lambda: {f"{name}_": value},
        "shape []": lambda: {name: np.array(0, value.dtype)},
        "shape [0]": lambda: {name: value.reshape(-1)[:0]},
        "flat": lambda: {name: value.reshape(-1)},
        "one more axis": lambda: {name: value[None]},
        "longer": lambda: {name: np.concatenate([value, value]) if value.ndim else value},
        "float64": lambda: {name: value.astype(np.float64)},
        "whole numbers": lambda: {name: value.astype(np.int32)},
        "not finite": lambda: {name: np.full_like(value, np.nan) if value.dtype.kind == "f" else value},
        "out of range": lambda: {name: np.full_like(value, 2**20)},
        "negative": lambda: {name: np.full_like(value, -1)},
        "another one": lambda: {name: value, "canary": value},
    }
    kind = _pick(list(kinds), generator)
    return f"{name} {kind}, sealed {_sealed(folder, save(tensors | kinds[kind]()))}"


def _header(folder: Path, generator: np.random.Generator) -> str:
    """Write a header with other values, names or lengths before the same numbers."""
    path = _weights_file(folder)
    if path is None or path.stat().st_size > 2**24:
        return "nothing"
    content = path.read_bytes()
    length = int.from_bytes(content[:8], "little")
    header = damaged(content[8 : 8 + length], "json", generator)
    told = _pick((len(header), len(header), len(header), 0, 2**63 - 1, 10**8, 2**40), generator)
    return f"header, sealed {_sealed(folder, told.to_bytes(8, 'little') + header + content[8 + length :])}"


def _arrays(folder: Path, generator: np.random.Generator) -> str:
    """Write clouds of other shapes and types, of a terabyte, or pickled."""
    path = folder / CLOUDS
    if _is_special(path):
        return "nothing"
    points, colours = np.zeros((3, 64, 3), np.float32), np.zeros((3, 64, 3), np.uint8)
    kinds: dict[str, Callable[[], dict[str, Any]]] = {
        "no points": lambda: {"colours": colours},
        "shape []": lambda: {"points": np.float32(0), "colours": np.uint8(0)},
        "no clouds": lambda: {"points": points[:0], "colours": colours[:0]},
        "other colours": lambda: {"points": points, "colours": colours[:, :5]},
        "text": lambda: {"points": np.array(["x"]), "colours": colours},
        "objects": lambda: {"points": np.array([{}], dtype=object), "colours": colours},
        "not finite": lambda: {"points": points + np.inf, "colours": colours},
        "a bomb": lambda: {"points": np.zeros((1, 2**24, 3), np.float32), "colours": np.zeros((1, 2**24, 3), np.uint8)},
    }
    kind = _pick([*kinds, "a lie", "a lie"], generator)
    if kind == "a lie":
        header = _pick(("(1000000000, 64, 3)", "(-1, 64, 3)", "(3,", "(10**9,)", "()"), generator)
        said = f"{{'descr': '<f4', 'fortran_order': False, 'shape': {header}, }}".encode().ljust(118) + b"\n"
        with zipfile.ZipFile(path, "w") as archive:
            for name in ("points", "colours"):
                archive.writestr(f"{name}.npy", b"\x93NUMPY\x01\x00" + len(said).to_bytes(2, "little") + said)
    else:
        buffer = io.BytesIO()
        np.savez_compressed(buffer, **kinds[kind]())
        path.write_bytes(buffer.getvalue())
    return f"{CLOUDS}: {kind}"


def _file(folder: Path, generator: np.random.Generator) -> str:
    """Damage bits or text of any file."""
    path = _pick(_files(folder), generator)
    if path.stat().st_size < 2**24:
        path.write_bytes(damaged(path.read_bytes(), "json" if path.suffix == ".json" else "binary", generator))
    return f"bits of {path.name}"


def _files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.iterdir() if path.is_file() and not path.is_symlink())


def _replaced(folder: Path, generator: np.random.Generator) -> str:
    """Replace a file by a link, a special file, a folder, another file or a terabyte."""
    path = _pick([each for each in _files(folder) if each.name != "canary.py"] or [folder / CONFIG], generator)
    other = _pick(_files(folder), generator)
    content = other.read_bytes() if other.stat().st_size < 2**24 else b""

    def grown(size: int) -> None:
        path.touch()
        os.truncate(path, size)

    ways: dict[str, Callable[[], object]] = {
        "gone": lambda: None,
        "a pipe": lambda: os.mkfifo(path),
        "a folder": path.mkdir,
        "a link to /dev/zero": lambda: path.symlink_to("/dev/zero"),
        "a link to itself": lambda: path.symlink_to(path.name),
        "a terabyte": lambda: grown(2**40),
        "2 GiB": lambda: grown(2**31),
        "another file": lambda: path.write_bytes(content),
        "nothing in it": path.touch,
    }
    told = _pick(list(ways), generator)
    path.unlink(missing_ok=True)
    ways[told]()
    return f"{path.name}: {told}"


def attempt(good: Path, scratch: Path, generator: np.random.Generator) -> tuple[str, Ended]:
    """Damage a checkpoint and read it; return the damages and how it ended.

    Raises:
        AssertionError: it was neither accepted as it is nor refused in one line, took too much time or memory, ran
            code, printed, or wrote a file.
    """
    folder = scratch / "policy"
    shutil.copytree(good, folder)
    (folder / "canary.py").write_text(CANARY)
    told = damage(folder, generator)
    try:
        outcome, *cost = in_process(partial(verdict, folder), folder)
    except AssertionError as error:
        raise AssertionError(f"{told}: {error}") from error
    return told, Ended(f"{good.name}: {outcome}", *cost)


def run(goods: Sequence[Path], numbers: range, seed: int, scratch: Path, say: Say) -> Tally:
    """Try damaged checkpoints; report and count failures."""

    def one(number: int) -> Ended:
        place = scratch / f"try{number}"
        place.mkdir(parents=True)
        try:
            return attempt(goods[number % len(goods)], place, np.random.default_rng([seed, number]))[1]
        finally:
            shutil.rmtree(place, ignore_errors=True)

    return tried(numbers, one, say)


def prepare(folder: Path) -> dict[str, list[Round]]:
    """Write the good checkpoints in a process of their own, because PyTorch's threads do not survive a fork."""
    with multiprocessing.get_context("fork").Pool(1) as pool:
        return {"inputs": [partial(run, pool.apply(good_checkpoints, (folder,)))]}


if __name__ == "__main__":
    sys.exit(main(str(__doc__), {"inputs": 5000}, prepare))
