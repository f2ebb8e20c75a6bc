"""Arrays in a file: the same when read, and damage is one error."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gensim2.errors import InputError
from gensim2.policy.array_file import read_arrays, write_arrays


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


def test_what_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.npz: is not there"):
        read_arrays(tmp_path / "none.npz")
