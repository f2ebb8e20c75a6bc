"""Damage exports at random (by a seed) and check what the importers do.

``python tests/fuzz/exports.py --inputs 10000 --commands 100`` damages exports of the three formats (bits, structure,
links, sizes) and imports each in its own process, the last ones through the command line. Each must be accepted and
equal the undamaged export (or give a readable data set, if its manifest was rewritten or removed), or be refused in one
line; within 5 s of CPU and 1 GiB of memory.
"""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow
import pyarrow.parquet
from mutate import check_line, damaged
from runner import Cost, Ended, Round, Say, Tally, main, measured, tried

from gensim2.core.errors import InputError
from gensim2.core.foreign.process import FRUGAL, Bounds, isolated
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.core.sealed_file import HEADER_SIZE, Seal
from gensim2.data import collect
from gensim2.data.dataset import DataSet
from gensim2.data.formats.columns import camera_array
from gensim2.data.formats.export import NATIVE, export
from gensim2.data.formats.importing import PRELOAD, read_export
from gensim2.data.formats.manifest import FORMATS, MANIFEST, Format, write_manifest
from gensim2.data.formats.native import read_back
from gensim2.data.observation_file import write_observation

SLOWEST = 5.0  # s of CPU
HANGS = 900.0  # s in total, long because the machine may be busy
MEMORY = 2**30

PIXELS, POINTS = 8, 16


LARGE = 2**24
"""Size (bytes) that only damaged files of these exports have."""

#: Treatment of the manifest after damage: kept, rewritten, or removed as in older exports.
MANIFESTS = ("kept", "made anew", "removed")


#: Target of links, which no import may read or write.
OUTSIDE = Path(tempfile.gettempdir()) / "gensim2-fuzz-outside"
OF_SOMEBODY_ELSE = "of somebody else\n" * 100

#: Modules imported once for all processes, and this module, which contains their function.
MODULES = ("__main__", *PRELOAD, "pyarrow.parquet")


def contents(folder: Path) -> dict[str, bytes]:
    """Return the content of every file of a data set."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def good_exports(folder: Path) -> dict[Format, Path]:
    """Make exports of six episodes of two tasks in a fake world, with clouds, images and depth."""
    sys.path[:0] = [str(Path(__file__).parents[1] / name) for name in ("kill", "pipeline")]
    import fake_world

    fake_world.install()
    fake_world.EPISODE_SECONDS = 0.0
    source = folder / "set"
    collect(("OpenDrawer", "CloseBox"), episodes=4, seed=3, workers=0, assets="builtin", out=source)
    dataset = DataSet.open(source)
    draw = np.random.default_rng(0)
    for name in dataset.tasks:
        store = dataset.task(name)
        for row in store.rows():
            if row.held:
                frames = row.control_steps + 1
                arrays = {
                    "pointcloud/xyz": draw.integers(-1000, 1000, (frames, POINTS, 3)).astype(np.int16),
                    "pointcloud/rgb": draw.integers(0, 256, (frames, POINTS, 3)).astype(np.uint8),
                    camera_array("left", "rgb"): draw.integers(0, 256, (frames, PIXELS, PIXELS, 3)).astype(np.uint8),
                    camera_array("left", "depth"): draw.integers(0, 9000, (frames, PIXELS, PIXELS)).astype(np.uint16),
                }
                write_observation(store.observation_path(row.index), {"episode_digest": row.episode_digest}, arrays)
    found: dict[Format, Path] = {}
    for kind in FORMATS:
        found[kind] = folder / kind
        export(source, found[kind], kind)
    return found


def damage(folder: Path, kind: Format, generator: np.random.Generator) -> str:
    """Apply one to three damages to an export, and return their names."""
    manifest = MANIFESTS[int(generator.integers(3))]
    assert folder == Path(os.path.realpath(folder)), "a folder of its own"
    told = [f"manifest {manifest}"]
    for _ in range(int(generator.integers(1, 4))):
        files = sorted(path for path in folder.rglob("*") if path.is_file() and not path.is_symlink())
        files = [path for path in files if Path(os.path.realpath(path)).is_relative_to(folder)]  # the export only
        files = [path for path in files if path.stat().st_size < LARGE]  # already enlarged files stay
        if not files:
            break
        ways: tuple[Callable[[Path, list[Path], np.random.Generator], str], ...]
        ways = (_bits, _bits, _structure, _structure, _structure, partial(_replaced, folder), _size)
        path = _pick([p for p in files if generator.random() < 0.5 or p.suffix != ".mp4"] or files, generator)
        way = ways[int(generator.integers(len(ways)))]
        told.append(f"{path.relative_to(folder)}: {way(path, files, generator)}")
    if manifest != "kept":
        path = folder / MANIFEST
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        path.unlink(missing_ok=True)
    if manifest == "made anew":
        try:
            write_manifest(folder, kind, int(generator.integers(1, 8)) if generator.random() < 0.1 else _count(folder))
        except (InputError, OSError):  # impossible for links and pipes
            told.append("none could be made")
    return "; ".join(told)


def nothing(_: Any) -> None:
    """Do nothing."""


def _count(folder: Path) -> int:
    """Return the number of episodes of an undamaged export."""
    return int((folder.parent / "count").read_text())


def _pick(values: Sequence[Any], generator: np.random.Generator) -> Any:
    return values[int(generator.integers(len(values)))]


def _bits(path: Path, _: list[Path], generator: np.random.Generator) -> str:
    """Flip, cut, repeat or move bytes; for an episode file also with a matching seal."""
    data = path.read_bytes()
    if path.suffix == ".h5" and data.startswith(b"gensim2-episode") and generator.random() < 0.7:
        _reseal(path, damaged(data[HEADER_SIZE:], "binary", generator))
        return "bits behind a seal that fits"
    path.write_bytes(damaged(data, "binary", generator))
    return "bits"


def _reseal(path: Path, body: bytes) -> None:
    """Write an episode file and its row with a matching seal, as an attacker would."""
    digest = Seal("gensim2-episode", 1, "", "", InputError).write(path, body)
    rows = path.parents[1] / "episodes.jsonl"
    if rows.is_file() and not rows.is_symlink() and rows.stat().st_size < LARGE:  # do not follow links
        try:
            lines = [json.loads(line) for line in rows.read_bytes().splitlines()]
        except ValueError:  # damaged before
            return
        for row in lines:
            if row.get("index") == int(path.stem):
                row["episode_digest"] = digest
        rows.write_text("".join(json.dumps(row) + "\n" for row in lines))


def _structure(path: Path, files: list[Path], generator: np.random.Generator) -> str:
    """Change values of a document, arrays of an HDF5 file or columns of a table; bits if nothing else is possible."""
    try:
        if path.suffix in (".json", ".zarray", ".zattrs", ".zgroup") or path.name.startswith(".z"):
            path.write_bytes(damaged(path.read_bytes(), "json", generator))
            return "values"
        if path.suffix in (".yaml", ".jsonl"):
            path.write_bytes(damaged(path.read_bytes(), "yaml" if path.suffix == ".yaml" else "lines", generator))
            return "values"
        if path.suffix == ".h5":
            return _hdf5(path, generator)
        if path.suffix == ".parquet":
            return _table(path, generator)
    except (OSError, ValueError, KeyError, RuntimeError, TypeError, MemoryError, pyarrow.ArrowException):
        return _bits(path, files, generator)  # too damaged to change its values
    return _bits(path, files, generator)


def _hdf5(path: Path, generator: np.random.Generator) -> str:
    sealed = path.read_bytes().startswith(b"gensim2-episode")
    names: list[str] = []
    with h5py.File(path, "r+") as file:
        file.visit(names.append)
        name = _pick(names, generator)
        parent, item = file[name].parent, file[name]
        word = name.rpartition("/")[2]
        values = item[()] if isinstance(item, h5py.Dataset) else np.zeros(3, np.float32)
        steps = values.shape[0] if values.shape else 1
        ways: dict[str, Callable[[], Any]] = {
            "gone": lambda: None,
            "a group in its place": lambda: parent.create_group(word),
            "a circle": lambda: parent.__setitem__(word, file["/"]),
            "a soft link to itself": lambda: parent.__setitem__(word, h5py.SoftLink(f"/{name}")),
            "a link to another file": lambda: parent.__setitem__(word, h5py.ExternalLink(str(OUTSIDE), "/")),
            "data outside": lambda: parent.create_dataset(
                word, (8,), "u1", external=[(str(OUTSIDE), 0, h5py.h5f.UNLIMITED)]
            ),
            "1e12 rows": lambda: parent.create_dataset(word, (10**12, *values.shape[1:]), values.dtype, chunks=True),
            "a chunk of 1e9 rows": lambda: parent.create_dataset(word, (10**9, 4), "f4", chunks=(10**8, 4)),
            "virtual": lambda: parent.create_virtual_dataset(word, _virtual(values)),
            "text": lambda: parent.create_dataset(word, data=np.array([b"move"] * steps, dtype=object)),
            "NaN": lambda: parent.create_dataset(word, data=np.full(values.shape, np.nan, np.float32)),
            "shorter": lambda: parent.create_dataset(word, data=values[: steps // 2]),
            "other numbers": lambda: parent.create_dataset(word, data=values.astype(np.float64)),
            "flat": lambda: parent.create_dataset(word, data=values.reshape(-1)),
            "empty": lambda: parent.create_dataset(word, data=h5py.Empty("f4")),
            "a number": lambda: parent.create_dataset(word, data=1.0),
            "longer": lambda: parent.create_dataset(word, data=np.concatenate([values, values])),
        }
        told = _pick(list(ways), generator)
        del parent[word]
        ways[told]()
    if sealed:
        _reseal(path, path.read_bytes()[HEADER_SIZE:])
    return told


def _virtual(values: Any) -> h5py.VirtualLayout:
    layout = h5py.VirtualLayout(values.shape, "f4")
    layout[...] = h5py.VirtualSource(str(OUTSIDE), "x", values.shape)
    return layout


def _table(path: Path, generator: np.random.Generator) -> str:
    table = pyarrow.parquet.read_table(path)
    name = _pick(table.column_names, generator)
    place = table.column_names.index(name)
    values = table[name].to_pylist()
    ways: dict[str, Callable[[], Any]] = {
        "a column gone": lambda: table.drop_columns([name]),
        "fewer rows": lambda: table.slice(0, len(table) // 2),
        "rows twice": lambda: pyarrow.concat_tables([table, table]),
        "text": lambda: table.set_column(place, name, pyarrow.array(["x"] * len(table))),
        "nothing": lambda: table.set_column(place, name, pyarrow.array([None] * len(table))),
        "zeros": lambda: table.set_column(place, name, pyarrow.array(np.zeros(len(table)))),
        "a hostile number": lambda: table.set_column(
            place, name, pyarrow.array([_pick((-1, 2**62, 99), generator)] * len(table))
        ),
        "backwards": lambda: table.set_column(place, name, pyarrow.array(values[::-1], table[name].type)),
        "1e8 rows": lambda: pyarrow.table({name: pyarrow.array(np.zeros(10**8, np.int8))}),
        "lists of other lengths": lambda: table.set_column(
            place, name, pyarrow.array([[1.0] * (n % 4) for n in range(len(table))])
        ),
        "no rows": lambda: table.slice(0, 0),
    }
    told = _pick(list(ways), generator)
    pyarrow.parquet.write_table(ways[told](), path)
    return told


def _replaced(root: Path, path: Path, files: list[Path], generator: np.random.Generator) -> str:
    """Replace a file or its folder by a link, a special file, another file or a folder."""
    other = _pick(files, generator)

    def bound() -> None:
        before = Path.cwd()  # socket paths have a length limit
        os.chdir(path.parent)
        try:
            with socket.socket(socket.AF_UNIX) as server:
                server.bind(path.name[:90])
        finally:
            os.chdir(before)

    whole = path.parent
    ways: dict[str, Callable[[], object]] = {
        "a link up for its folder": lambda: (shutil.rmtree(whole), whole.symlink_to("..")),
        "gone": lambda: None,
        "a pipe": lambda: os.mkfifo(path),
        "a socket": bound,
        "a folder": path.mkdir,
        "a link to /dev/zero": lambda: path.symlink_to("/dev/zero"),
        "a link to a file outside": lambda: path.symlink_to(OUTSIDE),
        "a link to itself": lambda: path.symlink_to(path.name),
        "a link to another file of it": lambda: path.symlink_to(other.resolve()),
        "another file of it": lambda: path.write_bytes(content),
        "a link to / beside it": lambda: (path.write_bytes(mine), (whole / "rest").symlink_to("/")),
        "a name of the file system's longest": lambda: (path.write_bytes(mine), (whole / ("x" * 255)).touch()),
        "a name with a line break": lambda: (whole / "a\nb\x1b[31m").write_bytes(mine),
    }
    if whole == root:
        ways.pop("a link up for its folder")  # not for the export folder itself
    content, mine = other.read_bytes(), path.read_bytes()
    told = _pick(list(ways), generator)
    path.unlink()
    ways[told]()
    return told


def _size(path: Path, _: list[Path], generator: np.random.Generator) -> str:
    """Make a sparse terabyte, deeply nested folders, thousands of files, or an empty file."""
    way = int(generator.integers(5))
    if way == 0:
        with path.open("r+b") as stream:
            stream.truncate(2**40)
        return "a terabyte"
    if way == 1:
        with path.open("r+b") as stream:
            stream.truncate(200 * 2**20)
        return "200 MiB"
    if way == 2:
        (path.parent / "/".join(["d"] * 60)).mkdir(parents=True, exist_ok=True)
        return "60 folders inside each other"
    if way == 3:
        for number in range(500):
            (path.parent / f"{number}.zarray").write_bytes(b"{}")
        return "500 files beside it"
    path.write_bytes(b"")
    return "nothing in it"


@dataclass
class Verdict:
    """Result of an import.

    Attributes:
        outcome: ``"accepted"`` or ``"refused"``.
        message: the error message.
        cpu_s: CPU time of the reading process.
        memory: its highest memory, bytes.
    """

    outcome: str
    message: str = ""
    cpu_s: float = 0.0
    memory: int = 0


def reading(path: Path, out: Path, kind: Format, progress: Progress) -> int:
    """Call :func:`~gensim2.data.formats.importing.read_export` and report its time and memory."""
    with measured(progress):
        return read_export(path, out, kind, NULL_PROGRESS)


def attempt(good: Path, kind: Format, scratch: Path, generator: np.random.Generator) -> tuple[str, Verdict]:
    """Damage a copy of an export and import it.

    Raises:
        AssertionError: the import is neither correct nor refused in one line, or took too much time or memory.
        Exception: any other exception that it raised.
    """
    folder, out, cost = scratch / "export", scratch / "out", Cost()
    shutil.copytree(good, folder)
    (scratch / "count").write_text((good.parent / f"{kind}.count").read_text())
    told = damage(folder, kind, generator)
    out.mkdir()
    began = time.monotonic()
    try:
        size = sum(path.lstat().st_size for path in good.rglob("*"))
        count = isolated(reading, (folder, out, kind), folder, Bounds.of(size), cost, MODULES)
        verdict = Verdict("accepted")
    except InputError as error:
        verdict = Verdict("refused", str(error))
    assert time.monotonic() - began < HANGS, f"{told}: took {time.monotonic() - began:.0f} s by the clock"
    verdict.cpu_s, verdict.memory = cost.seconds, cost.memory
    if verdict.outcome == "refused":
        check_line(verdict.message)
    assert verdict.cpu_s < SLOWEST, f"{told}: took {verdict.cpu_s:.1f} s"
    assert verdict.memory < MEMORY, f"{told}: took {verdict.memory / 2**20:.0f} MiB"
    assert "the library that reads it crashed" not in verdict.message or "manifest kept" not in told, told
    if verdict.outcome == "accepted":
        check_accepted(out, good, kind, count, "manifest kept" in told, told)
    return told, verdict


def check_accepted(out: Path, good: Path, kind: Format, count: int, same: bool, told: str) -> None:
    """Check that an accepted export can be read, and equals the original if the manifest was kept."""
    episodes = list(read_back(DataSet.open(out), NULL_PROGRESS))
    assert len(episodes) == count > 0, f"{told}: {count} counted, {len(episodes)} there"
    if same:
        assert contents(out) == contents(good.parent / f"{kind}.back"), f"{told}: accepted, and another"


def attempt_command(good: Path, kind: Format, scratch: Path, generator: np.random.Generator) -> tuple[str, Verdict]:
    """Do the same as :func:`attempt` through the command line."""
    folder, out = scratch / "export", scratch / "out"
    shutil.copytree(good, folder)
    (scratch / "count").write_text((good.parent / f"{kind}.count").read_text())
    told = damage(folder, kind, generator)
    command = [sys.executable, "-m", "gensim2", "data", "import", str(folder), "--from", kind, "--out", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=120, check=False)
    said = [line for line in done.stderr.splitlines() if line.startswith("gensim2:")]
    assert "Traceback" not in done.stderr, f"{told}: {done.stderr}"
    assert done.returncode in (0, 2), f"{told}: {done.returncode}: {done.stderr}"
    assert len(said) == (done.returncode == 2), f"{told}: {done.stderr}"
    left = sorted(path.name for path in scratch.iterdir() if path.name not in ("export", "out", "count"))
    assert not left, f"{told}: {left}"
    if done.returncode == 0:
        check_accepted(out, good, kind, int(done.stdout.split()[0]), "manifest kept" in told, told)
        return told, Verdict("accepted")
    assert not out.exists(), told
    check_line(said[0])
    return told, Verdict("refused", said[0])


def prepare(folder: Path) -> dict[Format, Path]:
    """Make good exports and import them for comparison."""
    OUTSIDE.write_text(OF_SOMEBODY_ELSE)
    good = good_exports(folder)
    for kind, path in good.items():
        back = folder / f"{kind}.back"
        back.mkdir()
        (folder / f"{kind}.count").write_text(str(read_export(path, back, kind, NULL_PROGRESS)))
        isolated(nothing, (), path, Bounds.of(0), NULL_PROGRESS, MODULES)  # starts the fork server
        assert (path / MANIFEST).is_file()
        assert kind == "maniskill" or (path / NATIVE).is_dir()
    return good


def run(commands: bool, good: dict[Format, Path], numbers: range, seed: int, scratch: Path, say: Say) -> Tally:
    """Try damaged exports, formats in turn; report and count failures."""
    attempted = attempt_command if commands else attempt

    def one(number: int) -> Ended:
        kind, place = FORMATS[number % len(FORMATS)], scratch / f"try{number}"
        place.mkdir(parents=True)
        try:
            told, verdict = attempted(good[kind], kind, place, np.random.default_rng([seed, number]))
        finally:
            shutil.rmtree(place, ignore_errors=True)
        assert OUTSIDE.read_text() == OF_SOMEBODY_ELSE, f"{told}: wrote outside its folder"
        fate = next((each for each in ("died", "MiB of memory") if each in verdict.message), "")
        outcome = f"{kind}: {verdict.outcome} ({fate or told.split(';')[0]})"
        return Ended(outcome, verdict.cpu_s, verdict.memory)

    return tried(numbers, one, say)


def rounds(folder: Path) -> dict[str, list[Round]]:
    """Write the good exports."""
    os.environ |= FRUGAL
    good = prepare(folder)
    return {"inputs": [partial(run, False, good)], "commands": [partial(run, True, good)]}


if __name__ == "__main__":
    sys.exit(main(str(__doc__), {"inputs": 10_000, "commands": 100}, rounds))
