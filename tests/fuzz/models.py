"""Damage USD and MJCF files at random (by a seed) and check what their converters do.

``python tests/fuzz/models.py --inputs 500`` tries 500 files: USD as text, as binary and as a package, and MJCF. The
converter of USD runs in a subprocess of its own, which takes about a second.
"""

from __future__ import annotations

import shutil
import sys
import zipfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
from mutate import Verdict, damaged, judged
from runner import Ended, Round, Say, Tally, listing, main, tried

from gensim2.objects.library import mjcf, usd

BOXES = Path(__file__).parents[1] / "common" / "models"
"""A box with a lid, as a USD file that refers to a second one, and as an MJCF file."""


def bases(folder: Path) -> list[Path]:
    """Copy the good models to ``folder``, also as binary USD and as a package, and return their files."""
    from pxr import Usd

    shutil.copytree(BOXES, folder, dirs_exist_ok=True)
    text, binary, package = (folder / f"box.{suffix}" for suffix in ("usda", "usdc", "usdz"))
    Usd.Stage.Open(str(text)).Export(str(binary))
    with zipfile.ZipFile(package, "w") as archive:
        for name in ("box.usda", "lid.usda"):
            archive.write(folder / name, name)
    return [text, binary, package, folder / "box.xml"]


def attempt(base: Path, scratch: Path, generator: np.random.Generator) -> Verdict:
    """Convert a damaged copy of a model and return how the converter ended.

    Raises:
        AssertionError: the converter hangs, uses more than 5 s of CPU, refuses in more than one line, or writes outside
            its folder.
        Exception: any exception except :class:`InputError`.
    """
    folder, made = scratch / "model", scratch / "made"
    shutil.copytree(base.parent, folder)
    made.mkdir()
    file = folder / base.name
    chosen = folder / "lid.usda" if base.suffix == ".usda" and generator.random() < 0.3 else file
    kind = "binary" if base.suffix in (".usdc", ".usdz") else "lines"
    chosen.write_bytes(damaged(chosen.read_bytes(), kind, generator))
    before = listing(folder)
    verdict = judged(lambda: (mjcf.convert if base.suffix == ".xml" else usd.convert)(file, made))
    assert listing(folder) == before, "wrote into the source's folder"
    assert sorted(path.name for path in scratch.iterdir()) == ["made", "model"]
    return verdict


def run(good: Sequence[Path], numbers: range, seed: int, scratch: Path, say: Say) -> Tally:
    """Try damaged models; report and count failures."""

    def one(number: int) -> Ended:
        generator, place = np.random.default_rng([seed, number]), scratch / f"try{number}"
        place.mkdir(parents=True)
        base = good[number % len(good)]
        try:
            verdict = attempt(base, place, generator)
        finally:
            shutil.rmtree(place)
        return Ended(f"{base.suffix[1:]}-{verdict.outcome}", verdict.seconds)

    return tried(numbers, one, say)


def ready(folder: Path) -> dict[str, list[Round]]:
    """Write the good models."""
    return {"inputs": [partial(run, bases(folder / "good"))]}


if __name__ == "__main__":
    sys.exit(main(str(__doc__), {"inputs": 500}, ready))
