"""Damage object folders at random (by a seed) and check what the readers do.

``python tests/fuzz/objects.py --inputs 3000`` tries 3000 generated objects, and real ones if ``GENSIM2_ASSETS`` names
their folder. Each is read and imported in a forked process with 1 GiB of memory and 5 s of CPU, without the convex
decomposition.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
import warnings
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from mutate import Verdict, damaged, judged
from runner import CANARY, Ended, Round, Say, Tally, in_process, main, tried

from gensim2.objects import open_library
from gensim2.objects.library import released
from gensim2.objects.library.export import export
from gensim2.objects.library.importer import import_object
from gensim2.objects.library.prepare import prepare
from gensim2.objects.library.released import read_model
from gensim2.objects.meshwork.clearance import Motion, PairHulls, Pieces
from gensim2.objects.meshwork.decompose import make_hull

GENERATED = (("drawer", "1"), ("box_rotate", "2"), ("bottle_cap", "0"), ("bucket_swing", "1"))
REAL = (("switch", 1), ("kitchen_pot", 1), ("stapler_press", 1), ("laptop_rotate", 0))
NUMBERS = b"nan inf -inf 0 -1 1e30 -1e30 1e-30 1e308 1e999 0.5 3 99999999999999999999 -99 1/2 x 0x10 1_0".split()


def bases(folder: Path, assets: str | None = None) -> list[Path]:
    """Write folders of good generated objects to ``folder``, and return them with a few real ones of ``assets``."""
    library = open_library("builtin")
    found = [export(library.load(*item), folder) for item in GENERATED]
    if assets:
        top = Path(assets) / "articulated_objs"
        top = top if top.is_dir() else Path(assets)
        found += [sorted((top / name).iterdir())[number] for name, number in REAL]
    return found


def damage(folder: Path, generator: np.random.Generator) -> None:
    """Apply one to three damages to files of an object."""
    for _ in range(int(generator.integers(1, 4))):
        files = sorted(path for path in folder.rglob("*") if path.is_file() and not path.is_symlink())
        if not files:
            return
        special = [path for path in files if path.name in ("info.json", "mobility.urdf")] or files
        path = _pick(special if generator.random() < 0.6 else files, generator)
        if generator.random() < 0.1:
            _replace(path, files, generator)
        elif path.suffix != ".json" and generator.random() < 0.6:
            path.write_bytes(_other_number(path.read_bytes(), generator))
        else:
            path.write_bytes(damaged(path.read_bytes(), "json" if path.suffix == ".json" else "lines", generator))


def _pick(values: Sequence[Path], generator: np.random.Generator) -> Path:
    return values[int(generator.integers(len(values)))]


def _replace(path: Path, files: list[Path], generator: np.random.Generator) -> None:
    """Replace a file by something else."""
    other = _pick(files, generator)
    ways: tuple[Callable[[], object], ...] = (
        path.unlink,
        lambda: (path.unlink(), os.mkfifo(path)),
        lambda: (path.unlink(), path.mkdir()),
        lambda: (path.unlink(), path.symlink_to("/dev/zero")),
        lambda: (path.unlink(), path.symlink_to("../../../../etc/passwd")),
        lambda: (path.unlink(), path.symlink_to(path.name)),
        lambda: path.write_bytes(other.read_bytes()),
    )
    ways[int(generator.integers(len(ways)))]()


def _other_number(data: bytes, generator: np.random.Generator) -> bytes:
    places = list(re.finditer(rb"-?\d+\.?\d*(e[+-]?\d+)?", data))
    if not places:
        return data
    place = places[int(generator.integers(len(places)))]
    return data[: place.start()] + NUMBERS[int(generator.integers(len(NUMBERS)))] + data[place.end() :]


def attempt(base: Path, scratch: Path, generator: np.random.Generator) -> dict[str, Verdict]:
    """Run reader and importer on a damaged copy and return how they ended.

    Raises:
        AssertionError: one hangs, uses more than 5 s of CPU, or refuses in more than one line.
        Exception: any exception except :class:`InputError`, including warnings of NumPy.
    """
    folder = scratch / base.parent.name / base.name
    shutil.copytree(base, folder)
    damage(folder, generator)

    def read() -> None:
        (scratch / "prepared").mkdir()
        prepare(read_model(folder, base.parent.name, "", None), scratch / "prepared")

    def take_over() -> None:
        import_object(folder, scratch / "library", base.parent.name, "1")

    verdicts = {}
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        for name, reader in (("read", read), ("import", take_over)):
            verdicts[name] = judged(reader)
    return verdicts


def rough_hulls(body: Pieces, moving: Pieces, motion: Motion) -> PairHulls:
    """Return the hull of each piece, instead of a convex decomposition."""
    hulls = [[hull.points for hull in map(make_hull, [v for v, _ in pieces]) if hull] for pieces in (body, moving)]
    return PairHulls(hulls[0], hulls[1], 0, 0)


def run(good: Sequence[Path], numbers: range, seed: int, scratch: Path, say: Say) -> Tally:
    """Try damaged objects; report and count failures."""
    beside = scratch / "objects"
    beside.mkdir(parents=True)
    (beside / "canary.py").write_text(CANARY)

    def one(number: int) -> Ended:
        generator, place = np.random.default_rng([seed, number]), scratch / f"try{number}"
        place.mkdir()
        os.environ["GENSIM2_CACHE"] = str(place / "cache")
        base = _pick(good, generator)

        def both() -> str:
            return ",".join(f"{name}-{found.outcome}" for name, found in attempt(base, place, generator).items())

        try:
            outcome, *cost = in_process(both, beside, 2**30)
        finally:
            shutil.rmtree(place)
        return Ended(outcome, *cost)

    return tried(numbers, one, say)


def ready(folder: Path) -> dict[str, list[Round]]:
    """Write the good objects, and replace the convex decomposition, which takes longer than the limit."""
    os.environ["GENSIM2_CACHE"] = str(folder / "cache")
    released.decompose_pair = rough_hulls
    good = bases(folder / "good", os.environ.get("GENSIM2_ASSETS"))
    import_object(good[0], folder / "library", good[0].parent.name, "1")  # imports what the forked processes need
    return {"inputs": [partial(run, good)]}


if __name__ == "__main__":
    sys.exit(main(str(__doc__), {"inputs": 5000}, ready))
