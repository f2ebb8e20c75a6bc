"""Arrays in a file: the same when read, and damage is one error."""

from __future__ import annotations

import os
import zipfile
from pathlib import Path

import numpy as np
import pytest

from gensim2.errors import InputError
from gensim2.policy.array_file import read_arrays, write_arrays
from gensim2.policy.control import CLOUDS, Shuffled


def test_arrays_come_back_and_every_cut_is_one_error(tmp_path: Path) -> None:
    path = tmp_path / "new" / "arrays.npz"
    arrays = {"points": np.arange(12.0).reshape(4, 3), "words": np.array("say it")}
    write_arrays(path, arrays)
    found = read_arrays(path)
    assert found.keys() == arrays.keys()
    assert all(np.array_equal(found[name], arrays[name]) for name in arrays)
    whole = path.read_bytes()
    for cut in range(0, len(whole), 7):
        path.write_bytes(whole[:cut])
        with pytest.raises(InputError, match="is damaged"):
            read_arrays(path)


def test_nothing_is_unpickled(tmp_path: Path) -> None:
    np.savez(tmp_path / "objects.npz", things=np.array([{"a": 1}], dtype=object))
    with pytest.raises(InputError, match="is damaged"):
        read_arrays(tmp_path / "objects.npz")


def test_sizes_are_compared_before_memory_is_taken(tmp_path: Path) -> None:
    path = tmp_path / "arrays.npz"
    for shape, said in (("(1000000000000,)", "holds over"), ("(-1,)", "holds float32"), ("(3,)", "is damaged")):
        header = f"{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}}}".encode().ljust(118) + b"\n"
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("points.npy", b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header)
        with pytest.raises(InputError, match=said):
            read_arrays(path)


def test_a_pipe_is_never_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.npz")
    with pytest.raises(InputError, match="is a pipe"):
        read_arrays(tmp_path / "pipe.npz")


def test_what_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.npz: cannot be read: No such file"):
        read_arrays(tmp_path / "none.npz")


def test_what_would_wait_or_take_memory_is_refused_before_it_does(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / CLOUDS)
    with pytest.raises(InputError, match="is a pipe"):
        Shuffled.of(tmp_path)
    (tmp_path / CLOUDS).unlink()
    np.savez_compressed(tmp_path / CLOUDS, points=np.zeros(2**28, np.uint8), colours=np.zeros(1, np.uint8))
    with pytest.raises(InputError, match="holds over 64 MiB"):
        Shuffled.of(tmp_path)
    with zipfile.ZipFile(tmp_path / "lies.npz", "w") as archive, archive.open("points.npy", "w") as stream:
        header = {"descr": "<f4", "fortran_order": False, "shape": (10**12, 3)}
        np.lib.format.write_array_header_1_0(stream, header)
    with pytest.raises(InputError, match="holds over 256 MiB"):
        read_arrays(tmp_path / "lies.npz")


@pytest.mark.parametrize(
    ("points", "colours", "said"),
    [
        (np.zeros((4, 3), np.float32), np.zeros((4, 3), np.uint8), "has the shape"),
        (np.zeros((0, 4, 3), np.float32), np.zeros((0, 4, 3), np.uint8), "has no clouds"),
        (np.zeros((2, 4, 3), np.float32), np.zeros((1, 4, 3), np.uint8), "has the shape"),
        (np.full((2, 4, 3), np.nan, np.float32), np.zeros((2, 4, 3), np.uint8), "not finite"),
        (np.zeros((2, 4, 3), np.int64), np.zeros((2, 4, 3), np.uint8), "has no clouds"),
    ],
)
def test_clouds_that_cannot_be_shown_are_refused(
    tmp_path: Path, points: np.ndarray, colours: np.ndarray, said: str
) -> None:
    write_arrays(tmp_path / CLOUDS, {"points": points, "colours": colours})
    with pytest.raises(InputError, match=said):
        Shuffled.of(tmp_path)
