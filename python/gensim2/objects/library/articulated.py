"""Libraries of objects: the generated one that ships with the project, and folders of real models."""

from __future__ import annotations

import difflib
import hashlib
import math
import os
import re
import reprlib
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Final, Literal, cast

from gensim2.errors import InputError
from gensim2.objects.generators.classes import class_modules, object_classes
from gensim2.objects.generators.generate import LICENSE as GENERATED_LICENSE
from gensim2.objects.generators.generate import generate
from gensim2.objects.known import DESCRIPTIONS, JOINT_TYPES
from gensim2.objects.library.cache import SHARED_MODULES, file_name, prepared, source_digest
from gensim2.objects.library.folder import ObjectFolder, existing_folder
from gensim2.objects.library.urdf import LONGEST_NAME, URDF, plain_name
from gensim2.objects.model import Model
from gensim2.objects.types import Instance
from gensim2.seeding import rng

Split = Literal["train", "test", "all"]
SPLITS: Final = ("train", "test", "all")
LARGEST_NUMBER = 10**6
TEST_SHARE = 0.1
SMALLEST_TO_SPLIT = 10
BUILTIN = "builtin"
GENERATOR_MODULES = ("gensim2.objects.generators.blueprint", "gensim2.objects.generators.generate")


def _near(word: str, words: Sequence[str]) -> str:
    matches = difflib.get_close_matches(word[:LONGEST_NAME], words, n=3, cutoff=0.4)
    return f"did you mean {', '.join(matches)}?" if matches else f"there are {', '.join(words[:8])}"


class Library(ABC):
    """A set of object classes with instances. Pickles: workers open the same one.

    Attributes:
        name: what to show; ``builtin`` or the folder's name.
        location: what ``open_library`` takes to open it again.
        license: terms of its data.
    """

    name: str
    location: str
    license: str

    @abstractmethod
    def classes(self) -> tuple[str, ...]:
        """Class names, sorted."""

    @abstractmethod
    def _ids(self, asset_class: str) -> tuple[str, ...]: ...

    @abstractmethod
    def _load(self, asset_class: str, instance_id: str) -> Instance: ...

    @abstractmethod
    def joint_type(self, asset_class: str) -> str:
        """``"revolute"`` or ``"prismatic"``: what the class is known for."""

    def describe(self, asset_class: str) -> str:
        """One sentence about a class."""
        return DESCRIPTIONS.get(self._known(asset_class), asset_class.replace("_", " "))

    def _known(self, asset_class: str) -> str:
        if asset_class not in self.classes():
            raise InputError(
                f"no class {reprlib.repr(asset_class)} in library {self.name}",
                field="class",
                remedy=_near(asset_class, self.classes()),
            )
        return asset_class

    def instances(self, asset_class: str) -> tuple[str, ...]:
        """Instance ids of a class, sorted (numbers by value).

        Raises:
            InputError: no such class.
        """
        return self._ids(self._known(asset_class))

    def load(self, asset_class: str, instance_id: str) -> Instance:
        """A prepared instance; the first time it is made and kept in the cache, later it is read from there.

        Raises:
            InputError: no such class or instance.
            AssetError: the instance cannot be used; says why.
        """
        self._check(self._known(asset_class), instance_id)
        cached: dict[tuple[str, str], Instance] = self.__dict__.setdefault("_loaded", {})
        key = (asset_class, instance_id)
        if key not in cached:
            cached[key] = self._load(asset_class, instance_id)
        return cached[key]

    def _check(self, asset_class: str, instance_id: str) -> None:
        ids = self.instances(asset_class)
        if instance_id not in ids:
            raise InputError(
                f"no instance {reprlib.repr(instance_id)} of {asset_class} in library {self.name}",
                field="instance",
                remedy=_near(instance_id, ids),
            )

    def split(self, asset_class: str, which: Split) -> tuple[str, ...]:
        """Ids for training (90 %) or testing (10 %), by a seeded rule; a class with under 10 instances is all train.

        Raises:
            InputError: ``which`` is ``"test"`` and the class is too small to have one; or an unknown split.
        """
        ids = self.instances(asset_class)
        if which == "all":
            return ids
        if which not in ("train", "test"):
            raise InputError(f"no split {reprlib.repr(which)}", field="split", remedy="train, test or all")
        if len(ids) < SMALLEST_TO_SPLIT:
            if which == "test":
                raise InputError(
                    f"{asset_class} has {len(ids)} instances, all for training; a test split takes {SMALLEST_TO_SPLIT}",
                    field="split",
                    remedy="use train or all",
                )
            return ids
        order = rng(0, f"split/{asset_class}").permutation(len(ids))
        held_out = {ids[i] for i in order[: math.ceil(TEST_SHARE * len(ids))]}
        return tuple(i for i in ids if (i in held_out) == (which == "test"))

    def choose(self, asset_class: str, which: str, seed: int = 0) -> tuple[str, ...]:
        """Ids that one word stands for: ``train``, ``test``, ``all``, ``random`` (one, by the seed) or an id.

        Raises:
            InputError: no such class, instance or test split.
        """
        if which in SPLITS:
            return self.split(asset_class, cast(Split, which))
        if which == "random":
            ids = self.instances(asset_class)
            return (ids[int(rng(seed, f"choose/{asset_class}").integers(len(ids)))],)
        self._check(self._known(asset_class), which)
        return (which,)

    def sample(self, asset_class: str, count: int, seed: int = 0) -> tuple[str, ...]:
        """``count`` ids drawn by the seed, no two the same; all of a class that has no more."""
        ids = self.instances(asset_class)
        order = rng(seed, f"sample/{asset_class}").permutation(len(ids))[:count]
        return tuple(ids[i] for i in sorted(order))

    def __getstate__(self) -> dict[str, object]:
        return {key: value for key, value in self.__dict__.items() if key != "_loaded"}


class GeneratedLibrary(Library):
    """Objects that the project makes itself. Ids are numbers: any up to 10^6 loads, ``instances`` lists a few."""

    name = location = BUILTIN
    license = GENERATED_LICENSE

    def classes(self) -> tuple[str, ...]:
        return tuple(object_classes())

    def joint_type(self, asset_class: str) -> str:
        return object_classes()[self._known(asset_class)].joint_type

    def _ids(self, asset_class: str) -> tuple[str, ...]:
        return tuple(str(i) for i in range(object_classes()[asset_class].count))

    def _check(self, asset_class: str, instance_id: str) -> None:
        if not re.fullmatch(r"0|[1-9][0-9]{0,6}", instance_id) or int(instance_id) > LARGEST_NUMBER:
            raise InputError(
                f"no instance {reprlib.repr(instance_id)} of {asset_class} in library {self.name}",
                field="instance",
                remedy=f"a number from 0 to {LARGEST_NUMBER}",
            )

    def sample(self, asset_class: str, count: int, seed: int = 0) -> tuple[str, ...]:
        """``count`` numbers up to 10^6 that are no built-in instance's, drawn by the seed, no two the same."""
        first = len(self.instances(asset_class))
        if not 0 <= count <= LARGEST_NUMBER + 1 - first:
            raise InputError(f"cannot draw {count} of {LARGEST_NUMBER + 1 - first}", field="random")
        drawn = rng(seed, f"sample/{asset_class}").choice(LARGEST_NUMBER + 1 - first, count, replace=False)
        return tuple(str(first + int(number)) for number in sorted(drawn))

    def _load(self, asset_class: str, instance_id: str) -> Instance:
        modules = (*SHARED_MODULES, *GENERATOR_MODULES, *class_modules())
        return prepared(
            f"generated-{asset_class}-{instance_id}-{source_digest(*modules)}",
            lambda folder: _prepare(generate(asset_class, int(instance_id)), folder),
        )


class FolderLibrary(Library):
    """Real objects in the layout of the GenSim2 release: ``<class>/<id>/mobility.urdf`` and ``info.json``."""

    def __init__(self, folder: Path) -> None:
        inner = folder / "articulated_objs"
        self._folder = inner if inner.is_dir() else folder
        self.name, self.location = folder.resolve().name, str(folder.resolve())
        found: dict[str, tuple[str, ...]] = {}
        for class_folder in sorted(p for p in self._folder.iterdir() if p.is_dir()):
            ids = [p.name for p in class_folder.iterdir() if os.path.lexists(p / URDF)]
            if ids:
                for path in (class_folder, *(class_folder / instance_id for instance_id in ids)):
                    plain_name(path.name, path, "name of the folder")
                found[class_folder.name] = tuple(sorted(ids, key=lambda i: (len(i), i)))
        if not found:
            raise InputError(
                "no objects in it",
                file=folder,
                remedy="give a folder with <class>/<id>/mobility.urdf, or its parent",
            )
        self._found = found

    @cached_property
    def license(self) -> str:  # type: ignore[override]
        from gensim2.objects.library.released import LICENSE, declared_license

        terms = {
            declared_license(ObjectFolder(self._folder / name / ids[0])) or LICENSE for name, ids in self._found.items()
        }
        return "; ".join(sorted(terms))

    def classes(self) -> tuple[str, ...]:
        return tuple(sorted(self._found))

    def joint_type(self, asset_class: str) -> str:
        return JOINT_TYPES.get(self._known(asset_class), "revolute")

    def _ids(self, asset_class: str) -> tuple[str, ...]:
        return self._found[asset_class]

    def _load(self, asset_class: str, instance_id: str) -> Instance:
        from gensim2.objects.library.released import READER_MODULES, read_model

        folder = self._folder / asset_class / instance_id
        print_of_data = ObjectFolder(folder).fingerprint()
        modules = (*SHARED_MODULES, *READER_MODULES)
        key = hashlib.sha256(f"{asset_class}/{instance_id}/{print_of_data}".encode()).hexdigest()[:16]
        return prepared(
            f"real-{file_name(asset_class)}-{file_name(instance_id)}-{key}-{source_digest(*modules)}",
            lambda target: _prepare(
                read_model(folder, asset_class, print_of_data, JOINT_TYPES.get(asset_class)), target
            ),
        )


def _prepare(model: Model, folder: Path) -> Instance:
    # Here: naming objects, or reading prepared ones, needs no mesh library.
    from gensim2.objects.library.prepare import prepare

    return prepare(model, folder)


@dataclass(frozen=True)
class ClassListing:
    """One row of ``gensim2 assets list``."""

    asset_class: str
    joint_type: str
    count: int
    license: str
    description: str
    ids: tuple[str, ...] = field(default=())


def listing(library: Library) -> tuple[ClassListing, ...]:
    """What a library holds, one row a class; nothing is loaded."""
    return tuple(
        ClassListing(c, library.joint_type(c), len(ids), library.license, library.describe(c), ids)
        for c in library.classes()
        for ids in (library.instances(c),)
    )


def open_library(where: Path | str | None = None) -> Library:
    """Open a library.

    Args:
        where: None: ``$GENSIM2_ASSETS`` where set, else the generated one; ``"builtin"``: the generated one;
            otherwise a folder in the layout of the GenSim2 release, or its ``articulated_objs``.

    Raises:
        InputError: the folder is missing, cannot be read, or holds no objects.
    """
    field = None
    if where is None:
        where = os.environ.get("GENSIM2_ASSETS") or BUILTIN
        field = "GENSIM2_ASSETS"
    if str(where) == BUILTIN:
        return GeneratedLibrary()
    folder = existing_folder(where, field, 'give an existing one, or "builtin"')
    try:
        return FolderLibrary(folder)
    except OSError as error:
        raise InputError(f"cannot read: {error.strerror}", file=where, field=field) from error
