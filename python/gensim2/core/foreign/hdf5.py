"""Check groups and arrays of an untrusted HDF5 file before HDF5 reads data.

Such a file may link to other files, contain itself, or claim to have 1e12 rows. This module reads only data inside the
file itself, up to the caller's limits.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt

from gensim2.core.foreign.limits import MAX_HDF5_ARRAY, MAX_HDF5_MEMBERS

#: Filters that h5py can write: deflate, shuffle, fletcher32 and lzf. HDF5 would load a plug-in for other filters.
_FILTERS = {1, 2, 3, 32000}

Array = npt.NDArray[Any]


class ForeignHdf5Error(ValueError):
    """An HDF5 file has unexpected content; the message gives the path inside the file."""


def group_in(parent: h5py.Group, name: str) -> h5py.Group:
    """Return the subgroup ``name`` of the group ``parent``.

    Raises:
        ForeignHdf5Error: ``name`` is missing, is a link, or is not a group.
    """
    item = _member(parent, name)
    if not isinstance(item, h5py.Group):
        raise ForeignHdf5Error(f"{_path(parent, name)} is not a group")
    return item


def array_in(
    parent: h5py.Group,
    name: str,
    dtype: npt.DTypeLike | None = None,
    shape: tuple[int | None, ...] | None = None,
    max_bytes: int = MAX_HDF5_ARRAY,
) -> Array:
    """Read the array ``name`` in a group. The arguments and errors are those of :func:`dataset_in`."""
    values: Array = dataset_in(parent, name, dtype, shape, max_bytes)[()]
    return values


def dataset_in(
    parent: h5py.Group,
    name: str,
    dtype: npt.DTypeLike | None = None,
    shape: tuple[int | None, ...] | None = None,
    max_bytes: int = MAX_HDF5_ARRAY,
) -> h5py.Dataset:
    """Return the dataset ``name`` of the group ``parent``. Its values are not read.

    Args:
        dtype: required data type; None: any numbers or booleans.
        shape: required shape. An axis whose length is None may have any length.
        max_bytes: maximum size of the array in memory.

    Raises:
        ForeignHdf5Error: the dataset is missing, is stored in another file, or has a wrong type, shape or size.
    """
    item, path = _member(parent, name), _path(parent, name)
    if not isinstance(item, h5py.Dataset):
        raise ForeignHdf5Error(f"{path} is not an array")
    found, size = item.dtype, item.shape
    if size is None or (found.kind not in "biuf" if dtype is None else found != np.dtype(dtype)):
        wrong = f"{path} contains {_shown(found)}, but must contain {'numbers' if dtype is None else np.dtype(dtype)}"
        raise ForeignHdf5Error(wrong)
    if shape is not None and not fits(size, shape):
        raise ForeignHdf5Error(f"{path} has the shape {size}, not {shown_shape(shape)}")
    chunk = item.chunks or ()
    if any(_bytes(each, found) > max_bytes for each in (size, chunk)):
        raise ForeignHdf5Error(
            f"{path} has the shape {size}, and the array or one of its chunks takes more than {max_bytes // 2**20} MiB"
        )
    if item.external is not None or item.is_virtual:
        raise ForeignHdf5Error(f"{path} stores its data in another file")
    plist = item.id.get_create_plist()
    if any(plist.get_filter(number)[0] not in _FILTERS for number in range(plist.get_nfilters())):
        raise ForeignHdf5Error(f"{path} is compressed in an unknown way")
    return item


def members(group: h5py.Group) -> Iterator[str]:
    """Yield the names of the members of a group, in HDF5's order.

    Raises:
        ForeignHdf5Error: the group has too many members.
    """
    if len(group) > MAX_HDF5_MEMBERS:
        raise ForeignHdf5Error(f"{group.name} has {len(group)} members, more than {MAX_HDF5_MEMBERS}")
    yield from group


def is_group(parent: h5py.Group, name: str) -> bool:
    """Return whether the member ``name`` of ``parent``, which must exist, is a group."""
    return isinstance(_member(parent, name), h5py.Group)


def fits(shape: tuple[int, ...], wanted: tuple[int | None, ...]) -> bool:
    """Return whether a shape equals the shape ``wanted``, in which None allows any length."""
    return len(shape) == len(wanted) and all(want in (None, size) for size, want in zip(shape, wanted, strict=True))


def shown_shape(shape: tuple[int | None, ...]) -> str:
    """Format an expected shape for an error message; None in the shape is shown as "any"."""
    return f"({', '.join('any' if size is None else str(size) for size in shape)})"


def _member(parent: h5py.Group, name: str) -> Any:
    try:
        link = parent.get(name, getlink=True)
        if link is not None and not isinstance(link, h5py.HardLink):
            raise ForeignHdf5Error(f"{_path(parent, name)} is a link")
        return parent[name]
    except (KeyError, OSError, RuntimeError) as error:
        raise ForeignHdf5Error(f"{_path(parent, name)} is missing or damaged") from error


def _path(parent: h5py.Group, name: str) -> str:
    return f"{(parent.name or '').strip('/')}/{name}".strip("/")


def _bytes(shape: tuple[int, ...], dtype: np.dtype[Any]) -> int:
    count = dtype.itemsize
    for size in shape:
        count *= int(size)
    return count


def _shown(dtype: np.dtype[Any]) -> str:
    return "text or objects" if dtype.kind in "OSUV" else str(dtype)
