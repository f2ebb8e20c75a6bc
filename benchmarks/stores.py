"""Cost of a recorded episode in different files: size, files, and CPU to write and to read it.

    gensim2 collect OpenBox OpenSafe --episodes 20 --assets builtin --out runs/episodes
    python benchmarks/stores.py runs/episodes
    gensim2 render runs/episodes
    python benchmarks/stores.py runs/episodes --exports

Reads the episodes of any folder that ``collect`` or ``demo`` left, and writes each anew in every layout; everything
is read back and compared. With ``--exports`` it writes the data set in every format of ``gensim2 data export`` instead,
without its observations and with them, and says what lies on the disk. Needs the extras ``bench`` (zarr) and ``data``.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import h5py
import numpy as np
import numpy.typing as npt
import zarr
from zarr.codecs import BloscCodec
from zarr.storage import LocalStore, ZipStore

from gensim2.data.formats.export import NATIVE, export
from gensim2.data.formats.manifest import Format

Arrays = Mapping[str, npt.NDArray[Any]]


@dataclass(frozen=True)
class Layout:
    """One way to keep an episode: what is written to a path, and how all arrays come back."""

    name: str
    suffix: str
    write: Callable[[Path, Arrays], None]
    read: Callable[[Path], Arrays]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="of recorded episodes")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--exports", action="store_true", help="sizes of what goes to other tools")
    options = parser.parse_args()
    if options.exports:
        exports(options.folder)
        return
    episodes = [_h5_read(path) for path in sorted(options.folder.rglob("episodes/*.h5"))]
    raw = sum(array.nbytes for episode in episodes for array in episode.values()) / len(episodes)
    print(f"{len(episodes)} episodes of {raw / 1e3:.1f} kB of numbers")
    print("| layout | kB an episode | files | write, ms | read, ms |\n|---|---|---|---|---|")
    for layout in LAYOUTS:
        size, files, write, read = _measured(layout, episodes, options.repeats)
        print(f"| {layout.name} | {size / 1e3:.1f} | {files:g} | {write * 1e3:.2f} | {read * 1e3:.2f} |")


def exports(folder: Path) -> None:
    """Print bytes and files of a data set, and of what is exported of it."""
    own = {"episodes": _lying(folder, "*/episodes/*.h5"), "observations": _lying(folder, "*/observations/*.h5")}
    count = own["episodes"][0]
    print(f"{count} episodes\n| what | kB an episode | files |\n|---|---|---|")
    for name, (files, size) in own.items():
        print(f"| {name} | {size / count / 1e3:.1f} | {files} |")
    for to in get_args(Format):
        for observations in (False, True) if own["observations"][0] and to != "maniskill" else (False,):
            with tempfile.TemporaryDirectory() as temporary:
                out = Path(temporary) / to
                begin = time.process_time()
                export(folder, out, to, observations=observations)
                seconds = time.process_time() - begin
                (files, size), (_, states) = _lying(out, "**/*"), _lying(out, f"{NATIVE}/**/*")
            beside = f", {states / count / 1e3:.1f} of them the episodes beside" if states else ""
            name = f"{to}{' with observations' if observations else ''}"
            print(f"| {name} | {size / count / 1e3:.1f}{beside} | {files} | {1e3 * seconds / count:.1f} ms of CPU each")


def _lying(folder: Path, pattern: str) -> tuple[int, int]:
    """Number and bytes of files."""
    sizes = [path.stat().st_size for path in folder.glob(pattern) if path.is_file()]
    return len(sizes), sum(sizes)


def _measured(layout: Layout, episodes: list[Arrays], repeats: int) -> tuple[float, float, float, float]:
    """Bytes, files, and seconds of CPU to write and to read, an episode; the best of some repeats."""
    writes, reads, size, files = [], [], 0, 0
    for _ in range(repeats):
        with tempfile.TemporaryDirectory() as folder:
            paths = [Path(folder) / f"{number:06d}{layout.suffix}" for number in range(len(episodes))]
            begin = time.process_time()
            for path, episode in zip(paths, episodes, strict=True):
                layout.write(path, episode)
            writes.append(time.process_time() - begin)
            begin = time.process_time()
            for path, episode in zip(paths, episodes, strict=True):
                found = layout.read(path)
                assert found.keys() == episode.keys()
            reads.append(time.process_time() - begin)
            assert all(np.array_equal(found[name], episode[name]) for name in episode)
            written = [path for path in Path(folder).rglob("*") if path.is_file()]
            size, files = sum(path.stat().st_size for path in written), len(written)
    count = len(episodes)
    return size / count, files / count, min(writes) / count, min(reads) / count


def _h5_write(libver: str, **filters: Any) -> Callable[[Path, Arrays], None]:
    def write(path: Path, arrays: Arrays) -> None:
        with h5py.File(path, "w", libver=libver) as file:
            for name, array in arrays.items():
                file.create_dataset(name, data=array, **({"chunks": array.shape, **filters} if filters else {}))

    return write


def _h5_read(path: Path) -> Arrays:
    found: dict[str, npt.NDArray[Any]] = {}
    with h5py.File(path) as file:
        group = file.get("traj", file)
        group.visititems(lambda name, item: found.update({name: item[()]}) if isinstance(item, h5py.Dataset) else None)
    return found


def _zarr_fill(store: Any, arrays: Arrays) -> None:
    group = zarr.create_group(store, zarr_format=3)
    for name, array in arrays.items():
        compressor = BloscCodec(cname="zstd", clevel=5, shuffle="shuffle")
        group.create_array(name, data=np.ascontiguousarray(array), chunks=array.shape, compressors=compressor)


def _zarr_arrays(store: Any) -> Arrays:
    members = zarr.open_group(store, mode="r").members(None)
    return {name: np.asarray(item[:]) for name, item in members if isinstance(item, zarr.Array)}


def _zip_write(path: Path, arrays: Arrays) -> None:
    with ZipStore(path, mode="w") as store:
        _zarr_fill(store, arrays)


def _zip_read(path: Path) -> Arrays:
    with ZipStore(path, mode="r") as store:
        return _zarr_arrays(store)


def _folder_write(path: Path, arrays: Arrays) -> None:
    shutil.rmtree(path, ignore_errors=True)
    _zarr_fill(LocalStore(path), arrays)


def _folder_read(path: Path) -> Arrays:
    return _zarr_arrays(LocalStore(path))


LAYOUTS = (
    Layout("HDF5, as it is", ".h5", _h5_write("earliest"), _h5_read),
    Layout("HDF5, gzip 4 + shuffle", ".h5", _h5_write("earliest", compression=4, shuffle=True), _h5_read),
    Layout("HDF5 1.10, gzip 4 + shuffle", ".h5", _h5_write("v110", compression=4, shuffle=True), _h5_read),
    Layout("HDF5 1.10, gzip 6 + shuffle", ".h5", _h5_write("v110", compression=6, shuffle=True), _h5_read),
    Layout("HDF5 1.10, lzf + shuffle", ".h5", _h5_write("v110", compression="lzf", shuffle=True), _h5_read),
    Layout("zarr v3 in a zip, zstd 5 + shuffle", ".zarr.zip", _zip_write, _zip_read),
    Layout("zarr v3 folder, zstd 5 + shuffle", ".zarr", _folder_write, _folder_read),
)

if __name__ == "__main__":
    main()
