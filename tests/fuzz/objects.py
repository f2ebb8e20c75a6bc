"""Damage object folders at random (by a seed) and check what the readers do.

``python tests/fuzz/objects.py --inputs 3000`` tries 3000 and prints how they ended; ``--assets DIR`` starts from real
objects too, ``--decompose`` runs the real convex decomposition (minutes, without time limit).
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from mutate import Verdict, damaged, judged

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
SLOWEST = 5.0  # s of CPU, convex decomposition apart
HANGS = 600.0  # s in total, long because the machine may be busy
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


def attempt(base: Path, scratch: Path, generator: np.random.Generator, limit: float = SLOWEST) -> dict[str, Verdict]:
    """Run reader and importer on a damaged copy and return how they ended.

    Raises:
        AssertionError: one hangs, uses more than ``limit`` seconds of CPU, or refuses in more than one line.
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
            began = time.process_time()
            verdicts[name] = judged(reader, max(HANGS, 10 * limit))
            spent = time.process_time() - began
            assert spent < limit, f"{name} took {spent:.1f} s of CPU"
    return verdicts


def rough_hulls(body: Pieces, moving: Pieces, motion: Motion) -> PairHulls:
    """Return the hull of each piece, instead of a convex decomposition."""
    hulls = [[hull.points for hull in map(make_hull, [v for v, _ in pieces]) if hull] for pieces in (body, moving)]
    return PairHulls(hulls[0], hulls[1], 0, 0)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return 1 if an input is neither accepted nor refused in one line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="number of the first input")
    parser.add_argument("--assets", default=os.environ.get("GENSIM2_ASSETS"))
    parser.add_argument("--decompose", action="store_true")
    options = parser.parse_args(arguments)
    ended: Counter[str] = Counter()
    slowest, faults = 0.0, 0
    with tempfile.TemporaryDirectory() as name:
        os.environ["GENSIM2_CACHE"] = f"{name}/cache"
        if not options.decompose:
            released.decompose_pair = rough_hulls
        good = bases(Path(name) / "good", options.assets)
        for number in range(options.first, options.first + options.inputs):
            generator = np.random.default_rng([options.seed, number])
            scratch = Path(name) / "scratch"
            scratch.mkdir()
            try:
                found = attempt(_pick(good, generator), scratch, generator, 600.0 if options.decompose else SLOWEST)
            except Exception as error:  # noqa: BLE001 - other exceptions are the bugs to be found
                faults += 1
                print(f"{number}: {type(error).__name__}: {error}", file=sys.stderr, flush=True)
            else:
                ended.update(f"{what} {'accepted' if v.accepted else 'refused'}" for what, v in found.items())
                slowest = max(slowest, *(v.seconds for v in found.values()))
            shutil.rmtree(scratch)
            shutil.rmtree(Path(name) / "cache" / "hulls", ignore_errors=True)
    print(f"{options.inputs} inputs, {faults} faults, slowest {slowest:.2f} s: {dict(sorted(ended.items()))}")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
