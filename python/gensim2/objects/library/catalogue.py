"""Define object libraries. An articulated class has several instances, and a rigid class has a single instance."""

from __future__ import annotations

import math
import os
import re
import reprlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Final, Literal, cast

from gensim2.core.errors import InputError, near
from gensim2.core.seeding import rng
from gensim2.core.yaml_files import parse_yaml
from gensim2.objects.library.articulated import FolderShelf, GeneratedShelf
from gensim2.objects.library.folder import existing_folder
from gensim2.objects.library.rigid import YCB_INFO, FolderRigidShelf, GeneratedRigidShelf, YcbShelf, maniskill_ycb
from gensim2.objects.library.shelf import Shelf
from gensim2.objects.types import ONLY_ID, ArticulatedObject, AssetError, Hulls, Kind, RigidObject, Source


def release_split(asset_class: str, name: str, listed: Sequence[str]) -> tuple[str, ...] | None:
    """Return the ids of a named split of a class.

    Args:
        listed: ids of the class's instances in the library.

    Returns:
        The ids of the split, or None if there is no split of this name. If ``listed`` lacks an id of the split, the
        library is no complete GenSim2 release, and all of ``listed`` are returned.
    """
    split = _splits().get(asset_class, {}).get(name)
    if split is None:
        return None
    return tuple(i for i in listed if i in split) if set(split) <= set(listed) else tuple(listed)


@cache
def _splits() -> Mapping[str, Mapping[str, Sequence[str]]]:
    source = files("gensim2.objects.library") / "release_splits.yaml"
    found: Mapping[str, Mapping[str, Sequence[str]]] = parse_yaml(source.read_bytes(), str(source))
    return found


Split = Literal["train", "test", "all"]
SPLITS: Final = ("train", "test", "all")
TENTHS: Final = 10
_TENTH = re.compile(r"(train|test)-([1-9])")
SETS: Final = (
    *SPLITS,
    *(f"{each}-{tenth}" for each in ("train", "test") for tenth in range(1, TENTHS)),
    "new",
    "random",
)
"""Values of ``--instances`` that select a set of objects of any class; any other value is an id."""
KINDS: Final[tuple[Kind, ...]] = ("articulated", "rigid")
SMALLEST_TO_SPLIT = 10
BUILTIN = "builtin"
YCB = "ycb"


class Library:
    """A set of object classes with their instances. Pickling stores only the location; unpickling opens the library.

    The name of a rigid object is its class, and its only instance is ``"0"``.

    Attributes:
        name: ``builtin`` or the folder's name.
        location: argument of ``open_library`` that opens this library.
    """

    def __init__(self, name: str, location: str, shelves: Sequence[Shelf], stand_in: Shelf | None = None) -> None:
        """Build a library from ``shelves``.

        Each class is in only one of them, and ``stand_in`` has the missing classes.
        """
        self.name, self.location = name, location
        self._own = {asset_class: shelf for shelf in shelves for asset_class in shelf.classes()}
        lent = {} if stand_in is None else dict.fromkeys(stand_in.classes(), stand_in)
        self._shelves: dict[str, Shelf] = {**lent, **self._own}
        self._loaded: dict[tuple[str, str, Hulls], ArticulatedObject | RigidObject] = {}

    def __getstate__(self) -> dict[str, object]:
        return {**self.__dict__, "_loaded": {}}

    @property
    def license(self) -> str:
        """Licence terms of the library's own data."""
        return "; ".join(dict.fromkeys(shelf.license for shelf in self._own.values()))

    def _shelf(self, asset_class: str) -> Shelf:
        if asset_class not in self._shelves:
            wrong = f"the library {self.name} has no class {reprlib.repr(asset_class)}"
            raise InputError(wrong, field="class", remedy=near(asset_class, tuple({**self._own, **self._shelves})))
        return self._shelves[asset_class]

    def classes(self, kind: Kind | None = None) -> tuple[str, ...]:
        """Return the sorted names of classes of one kind, or of both kinds."""
        return tuple(sorted(name for name, shelf in self._shelves.items() if kind in (None, shelf.kind)))

    def own_classes(self, kind: Kind | None = None) -> tuple[str, ...]:
        """Return the sorted names of the library's own classes, without generated substitutes for missing classes."""
        return tuple(name for name in self.classes(kind) if name in self._own)

    def kind(self, asset_class: str) -> Kind:
        """Return ``"articulated"`` or ``"rigid"``. Raises InputError for an unknown class."""
        return self._shelf(asset_class).kind

    def source(self, asset_class: str) -> Source:
        """Return ``"generated"`` or ``"real"``. Raises InputError for an unknown class."""
        return self._shelf(asset_class).source

    def license_of(self, asset_class: str) -> str:
        """Return the licence terms of a class. Raises InputError for an unknown class."""
        return self._shelf(asset_class).license

    def joint_type(self, asset_class: str) -> str | None:
        """Return ``"revolute"`` or ``"prismatic"``, the usual joint type of a class; None for a rigid class.

        Raises:
            InputError: the class is unknown.
        """
        return self._shelf(asset_class).joint_type(asset_class)

    def describe(self, asset_class: str) -> str:
        """Return a phrase that describes a class. Raises InputError for an unknown class."""
        return self._shelf(asset_class).describe(asset_class)

    def instances(self, asset_class: str) -> tuple[str, ...]:
        """Return the instance ids of a class in sorted order. Ids that are numbers are sorted by their value.

        Raises:
            InputError: the class is unknown.
        """
        return self._shelf(asset_class).instances(asset_class)

    def load(self, asset_class: str, instance_id: str, hulls: Hulls = "default") -> ArticulatedObject | RigidObject:
        """Return an object ready for simulation; the first call prepares it and stores it in the cache.

        Args:
            asset_class: name of the class.
            instance_id: id of the instance.
            hulls: method that converts real meshes to convex collision parts.

        Raises:
            InputError: class or instance is unknown.
            AssetError: the object cannot be used; the message gives the reason.
        """
        self._check(asset_class, instance_id)
        key = (asset_class, instance_id, hulls)
        if key not in self._loaded:
            self._loaded[key] = self._shelf(asset_class).load(*key)
        return self._loaded[key]

    def load_articulated(self, asset_class: str, instance_id: str) -> ArticulatedObject:
        """Return an articulated object, like :meth:`load`; raises InputError if the class is rigid."""
        self.check_kind(asset_class, "articulated")
        return cast(ArticulatedObject, self.load(asset_class, instance_id))

    def load_rigid(self, asset_class: str) -> RigidObject:
        """Return a rigid object, like :meth:`load`; raises InputError if the class is articulated."""
        self.check_kind(asset_class, "rigid")
        return cast(RigidObject, self.load(asset_class, ONLY_ID))

    def check_kind(self, asset_class: str, kind: Kind) -> None:
        """Check that a class has the given kind (articulated or rigid), without loading an object.

        Raises:
            InputError: the class is unknown or of the other kind.
        """
        if self.kind(asset_class) != kind:
            wrong = "is rigid: it has no joint" if kind == "articulated" else "has a joint: it is not rigid"
            raise InputError(f"{asset_class} {wrong}", field="class", remedy=near(asset_class, self.classes(kind)))

    def _check(self, asset_class: str, instance_id: str) -> None:
        shelf = self._shelf(asset_class)
        if not shelf.holds(asset_class, instance_id):
            wrong = f"no instance {reprlib.repr(instance_id)} of {asset_class} in library {self.name}"
            raise InputError(wrong, field="instance", remedy=shelf.remedy(asset_class, instance_id))

    def split(self, asset_class: str, which: Split, tenth: int = 0) -> tuple[str, ...]:
        """Return the training ids (90 %) or test ids (10 %) of a class.

        A fixed seed determines the split. If the class has fewer than 10 instances, all are for training.

        Args:
            asset_class: name of the class.
            which: ``"train"``, ``"test"`` or ``"all"``.
            tenth: number from 0 to 9 of the tenth of the shuffled instances that is the test split. Sizes are rounded
                up, so the last tenths may share instances with the first ones.

        Raises:
            InputError: the class is too small for a test split, or the split or tenth does not exist.
        """
        ids = self.instances(asset_class)
        if which == "all":
            return ids
        if not 0 <= tenth < TENTHS:
            wrong = f"the number of the tenth used for testing must lie in 0..{TENTHS - 1}, but is {tenth}"
            raise InputError(wrong, field="tenth")
        if which not in ("train", "test"):
            raise InputError(f"no split {reprlib.repr(which)}", field="split", remedy="train, test or all")
        if len(ids) < SMALLEST_TO_SPLIT:
            if which == "test":
                raise InputError(
                    f"{asset_class} has only {len(ids)} instances, which are all used for training; a test split needs "
                    f"at least {SMALLEST_TO_SPLIT} instances",
                    field="split",
                    remedy="use train or all",
                )
            return ids
        order = rng(0, f"split/{asset_class}").permutation(len(ids))
        count = math.ceil(len(ids) / TENTHS)
        held_out = {ids[order[place % len(ids)]] for place in range(tenth * count, (tenth + 1) * count)}
        return tuple(i for i in ids if (i in held_out) == (which == "test"))

    def choose(self, asset_class: str, which: str, seed: int = 0) -> tuple[str, ...]:
        """Return the ids that an ``--instances`` value selects.

        Args:
            asset_class: name of the class. A rigid class has a single object, so every valid value selects this object.
            which: value of ``--instances``. ``train``, ``test`` and ``all`` select a split. ``train-1`` to ``train-9``
                and ``test-1`` to ``test-9`` select alternative splits, each of which uses a different tenth of the
                instances for testing. ``new`` selects generated instances that the library does not list. ``random``
                selects one instance at random; ``seed`` determines which. Any other value is the name of a split of the
                GenSim2 release, or an id.
            seed: seed of ``random``.

        Raises:
            InputError: class, instance or test split does not exist, or the class has no new instances.
        """
        if which in SETS and self.kind(asset_class) == "rigid":
            return self.instances(asset_class)
        if which == "new":
            return self._shelf(asset_class).new(asset_class)
        if which in SPLITS:
            return self.split(asset_class, cast(Split, which))
        if tenth := _TENTH.fullmatch(which):
            return self.split(asset_class, cast(Split, tenth[1]), int(tenth[2]))
        if which == "random":
            ids = self.instances(asset_class)
            return (ids[int(rng(seed, f"choose/{asset_class}").integers(len(ids)))],)
        split = release_split(asset_class, which, self.instances(asset_class))
        if split is not None:
            return split
        self._check(asset_class, which)
        return (which,)

    def sample(self, asset_class: str, count: int, seed: int = 0) -> tuple[str, ...]:
        """Sample ``count`` different ids; return all ids if the class has fewer than ``count``.

        For generated articulated classes the ids are numbers up to 10^6 that ``instances`` does not list.

        Raises:
            InputError: the class is unknown.
        """
        return self._shelf(asset_class).sample(asset_class, count, seed)


@dataclass(frozen=True)
class ClassListing:
    """A row of ``gensim2 assets list``; ``joint_type`` is None for a rigid object."""

    asset_class: str
    kind: Kind
    joint_type: str | None
    source: Source
    license: str
    description: str
    ids: tuple[str, ...]


def listing(library: Library) -> tuple[ClassListing, ...]:
    """Return one row for each class of a library, articulated classes first.

    For a class unknown to gensim2, one object is loaded to find the joint type.

    Example:
        ```python
        for row in listing(gensim2.open_library("builtin")):
            print(row)
        ```
    """
    return tuple(
        ClassListing(
            name,
            library.kind(name),
            library.joint_type(name),
            library.source(name),
            library.license_of(name),
            library.describe(name),
            library.instances(name),
        )
        for kind in KINDS
        for name in library.classes(kind)
    )


def open_library(where: Path | str | None = None) -> Library:
    """Open a library of objects.

    Example:
        ```python
        library = gensim2.open_library("builtin")
        drawer = library.load_articulated("drawer", "3")
        drawer.urdf, drawer.joint.lower, drawer.joint.upper  # a path; rad or m
        ```

    Args:
        where: ``"builtin"``, ``"ycb"`` (downloaded by ManiSkill), or a folder. A folder is the GenSim2 release, its
            ``articulated_objs`` or ``rigidbody_objs/models``, or has ManiSkill's layout. Generated objects replace
            rigid objects that it lacks. None: the folder in ``GENSIM2_ASSETS``, else the generated library.

    Returns:
        The library; objects are read on first use.

    Raises:
        InputError: the folder is missing, unreadable or without objects, or two objects share a name.
    """
    field = None
    if where is None:
        where = os.environ.get("GENSIM2_ASSETS") or BUILTIN
        field = "GENSIM2_ASSETS"
    if str(where) == BUILTIN:
        return Library(BUILTIN, BUILTIN, [GeneratedShelf(), GeneratedRigidShelf()])
    remedy = f'give an existing one, "{BUILTIN}", or "{YCB}" after `python -m mani_skill.utils.download_asset ycb`'
    folder = existing_folder(maniskill_ycb() if str(where) == YCB else where, field, remedy)
    try:
        shelves = _shelves(folder)
    except OSError as error:
        raise InputError(f"cannot read: {error.strerror}", file=where, field=field) from error
    if not any(shelf.classes() for shelf in shelves):
        raise InputError(
            "contains no objects",
            file=folder,
            remedy="give a folder with <class>/<id>/mobility.urdf or <name>/collision.obj, or its parent",
        )
    known: set[str] = set()
    for shelf in shelves:
        for name in known.intersection(shelf.classes()):
            wrong = "the name belongs to both an articulated class and a rigid object"
            raise AssetError(wrong, file=folder, field=name)
        known.update(shelf.classes())
    return Library(folder.resolve().name, str(folder.resolve()), shelves, GeneratedRigidShelf())


def _shelves(folder: Path) -> list[Shelf]:
    if (folder / YCB_INFO).is_file():
        return [YcbShelf(folder)]
    articulated, rigid = folder / "articulated_objs", folder / "rigidbody_objs" / "models"
    shelves: list[Shelf] = []
    if articulated.is_dir() or not rigid.is_dir():
        shelves.append(FolderShelf(articulated if articulated.is_dir() else folder))
    if rigid.is_dir() or not articulated.is_dir():
        shelves.append(FolderRigidShelf((rigid if rigid.is_dir() else folder).resolve()))
    return shelves


def load_all(
    library: Library, items: Sequence[tuple[str, str]], workers: int = 0
) -> Iterator[tuple[tuple[str, str], str | None]]:
    """Prepare objects (class, id) in worker processes.

    Yield the error of each object, or None if the object can be used.
    """
    from gensim2.core.processes import WorkerPool, enumerated, in_order

    with WorkerPool(workers) as pool:
        for outcome in in_order(pool.map_unordered(_prepare, enumerated((library, *item) for item in items))):
            if isinstance(outcome.error, InputError):
                yield items[outcome.index], str(outcome.error)
            elif outcome.failures:
                yield items[outcome.index], outcome.failures[-1].reason
            else:
                outcome.unwrap()
                yield items[outcome.index], None


def _prepare(library: Library, asset_class: str, instance_id: str) -> None:
    library.load(asset_class, instance_id)
