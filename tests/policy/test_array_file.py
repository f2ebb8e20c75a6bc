"""Arrays in a file are read back unchanged, and damage gives one error."""

from __future__ import annotations

import json
import os
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest

from gensim2.core.errors import InputError
from gensim2.policy.array_file import read_arrays, write_arrays
from gensim2.policy.control import CLOUDS, Shuffled
from gensim2.policy.frames import SEEN
from gensim2.policy.heads.actions import ACTION
from gensim2.policy.keypose import data
from gensim2.policy.relabels import Relabels


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
    for shape, said in (
        ("(1000000000000,)", "the arrays take more than"),
        ("(-1,)", "unsupported type or shape"),
        ("(3,)", "is damaged"),
    ):
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
    with pytest.raises(InputError, match="the arrays take more than 64 MiB"):
        Shuffled.of(tmp_path)
    with zipfile.ZipFile(tmp_path / "lies.npz", "w") as archive, archive.open("points.npy", "w") as stream:
        header = {"descr": "<f4", "fortran_order": False, "shape": (10**12, 3)}
        np.lib.format.write_array_header_1_0(stream, header)
    with pytest.raises(InputError, match="the arrays take more than 256 MiB"):
        read_arrays(tmp_path / "lies.npz")


@pytest.mark.parametrize(
    ("points", "colours", "said"),
    [
        (np.zeros((4, 3), np.float32), np.zeros((4, 3), np.uint8), "has the shape"),
        (np.zeros((0, 4, 3), np.float32), np.zeros((0, 4, 3), np.uint8), "there are no point clouds"),
        (np.zeros((2, 4, 3), np.float32), np.zeros((1, 4, 3), np.uint8), "has the shape"),
        (np.full((2, 4, 3), np.nan, np.float32), np.zeros((2, 4, 3), np.uint8), "NaN or infinity"),
        (np.zeros((2, 4, 3), np.int64), np.zeros((2, 4, 3), np.uint8), "points' has the type int64, not float32"),
    ],
)
def test_clouds_that_cannot_be_shown_are_refused(
    tmp_path: Path, points: np.ndarray, colours: np.ndarray, said: str
) -> None:
    write_arrays(tmp_path / CLOUDS, {"points": points, "colours": colours})
    with pytest.raises(InputError, match=said):
        Shuffled.of(tmp_path)


HEADER = "{'descr': '<f4', 'fortran_order': False, 'shape': (0,)}"


def header_of(text: str) -> bytes:
    """Return the start of a .npy file of version 1.0 with this header."""
    header = text.encode().ljust(118) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header


def test_no_compression_and_no_header_takes_more_memory_than_the_limit_allows(tmp_path: Path) -> None:
    path = tmp_path / "arrays.npz"
    blank = HEADER.encode().ljust(2**26) + b"\n"
    long_header = b"\x93NUMPY\x02\x00" + len(blank).to_bytes(4, "little") + blank
    for method, content in (
        (zipfile.ZIP_BZIP2, header_of(HEADER) + bytes(2**26)),
        (zipfile.ZIP_LZMA, header_of(HEADER) + bytes(2**26)),
        (zipfile.ZIP_DEFLATED, long_header),
    ):
        with zipfile.ZipFile(path, "w", method) as archive:
            archive.writestr("points.npy", content)
        tracemalloc.start()
        try:
            with pytest.raises(InputError, match="is damaged"):
                read_arrays(path)
            assert tracemalloc.get_traced_memory()[1] < 2**22
        finally:
            tracemalloc.stop()


def test_members_and_sizes_are_compared_before_one_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "arrays.npz"
    write_arrays(path, {f"a{number}": np.zeros(1) for number in range(101)})
    with pytest.raises(InputError, match="has over 100 members"):
        read_arrays(path)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("points.npy", header_of(HEADER) + bytes(2**24))
    with pytest.raises(InputError, match=r"the arrays take more than 0\.5 MiB"):
        read_arrays(path, 2**19)
    path.write_bytes(bytes(2**23))
    monkeypatch.setattr(zipfile, "ZipFile", None)
    with pytest.raises(InputError, match=r"is larger than 0\.5 MiB"):
        read_arrays(path, 2**19)


@pytest.mark.parametrize(
    "header",
    [
        "{'descr': (",
        "(" * 9000,
        "-" * 9000 + "1",
        "{[]: 1}",
        "{'descr': (), 'fortran_order': False, 'shape': ()}",
        "{'descr': '>f4', 'fortran_order': False, 'shape': (0,)}",
    ],
)
def test_any_damaged_header_is_one_error(tmp_path: Path, header: str) -> None:
    with zipfile.ZipFile(tmp_path / "arrays.npz", "w") as archive:
        archive.writestr("points.npy", header_of(header))
    with pytest.raises(InputError, match="is damaged"):
        read_arrays(tmp_path / "arrays.npz")


@pytest.mark.parametrize("content", [b"\xff\xff\xff\xff", b"\x00\x00\x11\x00", b"\x00\xd8\x00\x00"])
def test_text_of_no_code_points_is_refused(tmp_path: Path, content: bytes) -> None:
    with zipfile.ZipFile(tmp_path / "arrays.npz", "w") as archive:
        archive.writestr("about.npy", header_of("{'descr': '<U1', 'fortran_order': False, 'shape': ()}") + content)
    with pytest.raises(InputError, match="is damaged"):
        read_arrays(tmp_path / "arrays.npz")


def test_relabels_and_shards_of_other_types_or_shapes_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "relabels.npz"
    sizes = {"point_cloud": (5, 6), "state": (9,), "velocity": (9,), "tool_pose": (7,), "gripper": (2,)}
    good = {name: np.zeros((3, 2, *sizes[name]), np.float32) for name in SEEN}
    good[ACTION] = np.zeros((3, 4, 9), np.float32)
    Relabels("do it", good).save(path)
    assert len(Relabels.load(path)) == 3
    Relabels("do it", {}).save(path)
    assert len(Relabels.load(path)) == 0
    for name, values in good.items():
        for bad in (values.astype(np.int32), values.astype(np.float64), values[..., None], values[:2]):
            Relabels("do it", {**good, name: bad}).save(path)
            if not (name == "point_cloud" and len(bad) == 2):  # the first array defines the number of rows
                with pytest.raises(InputError, match=f"is damaged, because the array '{name}'"):
                    Relabels.load(path)
        Relabels("do it", {each: good[each] for each in good if each != name}).save(path)
        with pytest.raises(InputError, match=f"is damaged, because the array '{name}' is missing"):
            Relabels.load(path)
    for language in (np.zeros(()), np.array(["one", "two"])):
        write_arrays(path, {"language": language, **good})
        with pytest.raises(InputError, match="is damaged, because the array 'language'"):
            Relabels.load(path)
    about = np.array(json.dumps({"scenes": 0, "failed": {}, "cpu_s": 0.0}))
    shard = {name: np.zeros(tuple(size or 4 for size in shape), dtype) for name, (dtype, shape) in data._SHAPES.items()}
    write_arrays(path, {"about": about, **shard})
    data._read(path)
    for name, values in shard.items():
        write_arrays(path, {"about": about, **shard, name: values.astype(np.complex64).real.astype(np.float64)})
        with pytest.raises(InputError, match=f"is damaged, because the array '{name}' has the type float64"):
            data._read(path)
