"""Groups and arrays of an HDF5 file, checked before the library reads a number.

HDF5 can point anywhere: soft and external links, data in other files, groups inside themselves, arrays of 1e12 rows
that take no byte. Only what lies in the file itself is followed, and only as far as the caller asks.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt

MAX_ARRAY = 2**30  # bytes of one array in memory
MAX_MEMBERS = 10_000  # of one group; trajectories of ManiSkill are asked for by name

#: deflate, shuffle, fletcher32 and lzf: what h5py writes. Others would be looked for in plug-ins.
_FILTERS = {1, 2, 3, 32000}

Array = npt.NDArray[Any]


class ForeignHdf5Error(ValueError):
    """Something in an HDF5 file is not what it may be; says what, and where."""


def group_in(parent: h5py.Group, name: str) -> h5py.Group:
    """Return the group ``name`` of a group.

    Raises:
        ForeignHdf5Error: there is none, or it is reached by a link.
    """
    item = _member(parent, name)
    if not isinstance(item, h5py.Group):
        raise ForeignHdf5Error(f"{_path(parent, name)} is no group")
    return item


def array_in(
    parent: h5py.Group,
    name: str,
    dtype: npt.DTypeLike | None = None,
    shape: tuple[int | None, ...] | None = None,
    max_bytes: int = MAX_ARRAY,
) -> Array:
    """Return the array ``name`` of a group; arguments and errors as of :func:`dataset_in`."""
    values: Array = dataset_in(parent, name, dtype, shape, max_bytes)[()]
    return values


def dataset_in(
    parent: h5py.Group,
    name: str,
    dtype: npt.DTypeLike | None = None,
    shape: tuple[int | None, ...] | None = None,
    max_bytes: int = MAX_ARRAY,
) -> h5py.Dataset:
    """Return the array ``name`` of a group, of which parts may be read.

    Args:
        dtype: that it must have; None: any numbers or truth values.
        shape: that it must have, None for any length of an axis.
        max_bytes: bytes that it may take in memory.

    Raises:
        ForeignHdf5Error: there is none, its data lie elsewhere, or it is of another type, shape or size.
    """
    item, path = _member(parent, name), _path(parent, name)
    if not isinstance(item, h5py.Dataset):
        raise ForeignHdf5Error(f"{path} is no array")
    found, size = item.dtype, item.shape
    if size is None or (found.kind not in "biuf" if dtype is None else found != np.dtype(dtype)):
        raise ForeignHdf5Error(f"{path} holds {_shown(found)}, not {'numbers' if dtype is None else np.dtype(dtype)}")
    if shape is not None and not fits(size, shape):
        raise ForeignHdf5Error(f"{path} has the shape {size}, not {shown_shape(shape)}")
    chunk = item.chunks or ()
    if any(_bytes(each, found) > max_bytes for each in (size, chunk)):
        raise ForeignHdf5Error(f"{path} has the shape {size}: more than {max_bytes // 2**20} MiB")
    if item.external is not None or item.is_virtual:
        raise ForeignHdf5Error(f"{path} keeps its numbers in another file")
    plist = item.id.get_create_plist()
    if any(plist.get_filter(number)[0] not in _FILTERS for number in range(plist.get_nfilters())):
        raise ForeignHdf5Error(f"{path} is compressed in an unknown way")
    return item


def members(group: h5py.Group) -> Iterator[str]:
    """Yield the names in a group, sorted as HDF5 does.

    Raises:
        ForeignHdf5Error: there are too many.
    """
    if len(group) > MAX_MEMBERS:
        raise ForeignHdf5Error(f"{group.name} has {len(group)} members, more than {MAX_MEMBERS}")
    yield from group


def is_group(parent: h5py.Group, name: str) -> bool:
    """Whether a member of a group, which is there, is a group itself."""
    return isinstance(_member(parent, name), h5py.Group)


def fits(shape: tuple[int, ...], wanted: tuple[int | None, ...]) -> bool:
    """Whether a shape is the wanted one, None for any length of an axis."""
    return len(shape) == len(wanted) and all(want in (None, size) for size, want in zip(shape, wanted, strict=True))


def shown_shape(shape: tuple[int | None, ...]) -> str:
    """A wanted shape for people."""
    return f"({', '.join('any' if size is None else str(size) for size in shape)})"


def _member(parent: h5py.Group, name: str) -> Any:
    try:
        link = parent.get(name, getlink=True)
        if link is not None and not isinstance(link, h5py.HardLink):
            raise ForeignHdf5Error(f"{_path(parent, name)} is a link")
        return parent[name]
    except (KeyError, OSError, RuntimeError) as error:
        raise ForeignHdf5Error(f"{_path(parent, name)} is not there, or is damaged") from error


def _path(parent: h5py.Group, name: str) -> str:
    return f"{(parent.name or '').strip('/')}/{name}".strip("/")


def _bytes(shape: tuple[int, ...], dtype: np.dtype[Any]) -> int:
    count = dtype.itemsize
    for size in shape:
        count *= int(size)
    return count


def _shown(dtype: np.dtype[Any]) -> str:
    return "text or objects" if dtype.kind in "OSUV" else str(dtype)
